#include "cuda/common/resting.h"

#include <algorithm>
#include <limits>
#include <span>
#include <utility>
#include <vector>

namespace voxspring::cuda {
namespace {

template <class T>
void copy(const Buffer<T>& from, const Buffer<T>& to, const Stream& stream) {
    check(cudaMemcpyAsync(to.data(), from.data(), to.bytes(), cudaMemcpyDeviceToDevice, stream.get()));
}

/// How many blocks have a particle that is not at rest; counts no further than `enough`.
std::size_t count_moved(const Problem& problem, const State& state, BlockShape shape, std::size_t enough) {
    const BlockGrid grid(problem.lattice, shape);
    std::vector<std::uint8_t> moved(grid.places());
    std::size_t count = 0;
    for (std::size_t i = 0; i < problem.particle_count() && count < enough; ++i) {
        if (state.displacement_of(i) == glm::dvec3(0) && state.increment_of(i) == glm::dvec3(0)) continue;
        std::uint8_t& block = moved[grid.place_of(problem.lattice, problem.lattice.voxel[i])];
        count += block == 0 ? 1 : 0;
        block = 1;
    }
    return count;
}

/// Whether the numbers of `places` blocks fit into BlockOrigin::place, an int.
bool can_be_named(std::size_t places) { return places <= std::size_t(std::numeric_limits<int>::max()); }

}  // namespace

Resting::Resting(const Options& options)
    : rest_(rest_of(options)),
      // On an H200, checks make a step of all blocks 15 to 60% longer, while a block at rest costs nothing.
      // So checks pay if at most 2/3 of the blocks move.
      policy_({.period = 64,
               .min_pause = 256,
               .max_pause = 4096,
               .paying_numerator = 2,
               .paying_denominator = 3}) {}

std::string Resting::refused(const Lattice& lattice, BlockShape shape) const {
    const std::size_t places = BlockGrid(lattice, shape).places();
    if (rest_ == Rest::step || rest_ == Rest::choose || can_be_named(places)) return {};
    return "rest=skip and rest=flush take a grid of at most " +
           std::to_string(std::numeric_limits<int>::max()) + " blocks, but the grid of this lattice has " +
           std::to_string(places);
}

bool Resting::could_check(const Problem& problem, BlockShape shape) const {
    if (rest_ != Rest::choose) return rest_ != Rest::step;
    const std::size_t places = BlockGrid(problem.lattice, shape).places();
    return stays_at_rest(problem) && places >= min_blocks && can_be_named(places);
}

std::uint64_t Resting::bytes_needed(const Problem& problem, BlockShape shape) const {
    if (!could_check(problem, shape)) return 0;
    return BlockGrid(problem.lattice, shape).places() * (5 * sizeof(std::uint32_t) + 4 * sizeof(BlockOrigin));
}

std::uint64_t Resting::bytes_held() const {
    return all_.bytes() + lists_[0].bytes() + lists_[1].bytes() + all_marks_.bytes() + no_marks_.bytes() +
           marks_[0].bytes() + marks_[1].bytes() + first_list_.bytes() + first_marks_.bytes();
}

void Resting::upload(const Problem& problem, const State& state, BlockShape shape, const Stream& stream) {
    policy_.start(false, false);
    asked_ = starts_checking_ = has_start_check_ = false;
    if (!could_check(problem, shape)) return;
    const BlockGrid grid(problem.lattice, shape);
    const std::vector<BlockOrigin> all = list_blocks(problem.lattice, shape);
    const std::size_t count = all.size();
    if (rest_ == Rest::choose &&
        (count < min_blocks || !policy_.pays(count_moved(problem, state, shape, count), count)))
        return;
    starts_checking_ = true;
    row_ = int(grid.row());
    slice_ = int(grid.slice());
    std::vector<std::uint32_t> marks(grid.places(), 1);
    all_.upload(all, stream);
    all_marks_.upload(marks, stream);
    for (const BlockOrigin& block : all) marks[std::size_t(block.place)] = 0;
    no_marks_.upload(marks, stream);
    for (const std::size_t reading : {0, 1}) {
        lists_[reading].resize(count);
        marks_[reading].resize(grid.places());
    }
    const std::array<Counts, 2> awake{Counts{unsigned(count), 0, 0, 0}, Counts{0, unsigned(count), 0, 0}};
    awake_counts_.upload(awake, stream);
    counts_.resize(1);
    rewind(stream);
}

ActiveBlocks Resting::start_check() const {
    ActiveBlocks blocks = active(0);
    blocks.only_checks = true;
    return blocks;
}

void Resting::start_checked(const Stream& stream) {
    first_list_.resize(lists_[1].size());
    first_marks_.resize(marks_[1].size());
    copy(lists_[1], first_list_, stream);
    copy(marks_[1], first_marks_, stream);
    const Counts none{};
    first_counts_.upload(std::span(&none, 1), stream);
    check(cudaMemcpyAsync(first_counts_.data()->data() + listed_for_0, counts_.data()->data() + listed_for_1,
                          sizeof(unsigned), cudaMemcpyDeviceToDevice, stream.get()));
    has_start_check_ = true;
    rewind(stream);
}

void Resting::rewind(const Stream& stream) {
    policy_.start(starts_checking_, starts_checking_ && rest_ == Rest::choose);
    asked_ = false;
    if (!has_start_check_) {
        wake(0, stream);
        return;
    }
    copy(first_list_, lists_[0], stream);
    copy(first_marks_, marks_[0], stream);
    copy(no_marks_, marks_[1], stream);
    copy(first_counts_, counts_, stream);
}

bool Resting::stop() {
    if (rest_ == Rest::skip || rest_ == Rest::flush) return false;
    policy_.start(false, false);
    return true;
}

void Resting::wake(int reading, const Stream& stream) {
    if (!may_check()) return;
    const auto now = std::size_t(reading), next = std::size_t(1 - reading);
    copy(all_, lists_[now], stream);
    copy(all_marks_, marks_[now], stream);
    copy(no_marks_, marks_[next], stream);
    cuda::check(cudaMemcpyAsync(counts_.data(), awake_counts_.data() + reading, sizeof(Counts),
                                cudaMemcpyDeviceToDevice, stream.get()));
}

ActiveBlocks Resting::active(int reading) const {
    if (!may_check()) return {};
    const auto now = std::size_t(reading), next = std::size_t(1 - reading);
    unsigned* const count = counts_.data()->data();
    return {row_,
            slice_,
            lists_[now].data(),
            lists_[next].data(),
            count + now,
            count + next,
            marks_[now].data(),
            marks_[next].data(),
            count + readers,
            count + taken,
            false};
}

void Resting::stepped(int count, int reading, const Stream& stream) {
    policy_.stepped(count);
    if (!policy_.is_due()) return;
    if (!checks()) {
        policy_.begin_checks();
        wake(reading, stream);
        return;
    }
    if (std::exchange(asked_, false)) {
        copied_.wait();
        policy_.decide(seen_.values().front()[taken], blocks());
        if (!checks()) return;
    } else {
        policy_.go_on();
    }
    seen_.copy(counts_, stream);
    copied_.record(stream);
    asked_ = true;
}

std::size_t Resting::blocks_stepped(const Stream& stream) const {
    Counts now{};
    counts_.download(std::span(&now, 1), stream);
    return now[taken];
}

}  // namespace voxspring::cuda
