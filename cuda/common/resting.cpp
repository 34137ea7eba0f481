#include "cuda/common/resting.h"

#include <algorithm>
#include <limits>
#include <span>
#include <utility>
#include <vector>

#include "backends/registry.h"

namespace voxspring::cuda {
namespace {

template <class T>
void copy(const Buffer<T>& from, const Buffer<T>& to, const Stream& stream) {
    check(cudaMemcpyAsync(to.data(), from.data(), to.bytes(), cudaMemcpyDeviceToDevice, stream.get()));
}

/// Blocks with a particle that is not at rest, or as many as `enough`.
std::size_t count_moved(const Problem& problem, const State& state, BlockShape shape, std::size_t enough) {
    const BlockGrid grid(problem.lattice, shape);
    std::vector<std::uint8_t> moved(grid.places());
    std::size_t count = 0;
    for (std::size_t i = 0; i < problem.particle_count() && count < enough; ++i) {
        if (state.displacement[i] == glm::dvec3(0) && state.increment[i] == glm::dvec3(0)) continue;
        std::uint8_t& block = moved[grid.place_of(problem.lattice, problem.lattice.voxel[i])];
        count += block == 0 ? 1 : 0;
        block = 1;
    }
    return count;
}

/// Whether kernels can name as many places.
bool can_be_named(std::size_t places) { return places <= std::size_t(std::numeric_limits<int>::max()); }

}  // namespace

Resting::Resting(const Options& options)
    : way_([&] {
          const std::string& rest = options.tuning.at("rest");
          if (rest == "auto") return options.tuning.at("terms") == "all" ? Way::step : Way::decide;
          if (rest == "skip") return Way::skip;
          return rest == "flush" ? Way::flush : Way::step;
      }()) {}

void Resting::check(const Options& options) {
    if (options.tuning.at("rest") == "flush" && !by_increments(options.formulation))
        throw BadSpecification("cuda_implicit_*: rest=flush is for increment and compensated");
}

std::string Resting::refused(const Lattice& lattice, BlockShape shape) const {
    const std::size_t places = BlockGrid(lattice, shape).places();
    if (way_ == Way::step || way_ == Way::decide || can_be_named(places)) return {};
    return std::to_string(places) + " places of blocks that may rest exceed the index limit of " +
           std::to_string(std::numeric_limits<int>::max());
}

bool Resting::could_look(const Problem& problem, BlockShape shape) const {
    if (way_ != Way::decide) return way_ != Way::step;
    const std::size_t places = BlockGrid(problem.lattice, shape).places();
    return problem.gravity == glm::dvec3(0) && problem.load.empty() && places >= min_blocks &&
           can_be_named(places);
}

std::uint64_t Resting::bytes_needed(const Problem& problem, BlockShape shape) const {
    if (!could_look(problem, shape)) return 0;
    return BlockGrid(problem.lattice, shape).places() * (4 * sizeof(std::uint32_t) + 3 * sizeof(BlockOrigin));
}

std::uint64_t Resting::bytes_held() const {
    return all_.bytes() + lists_[0].bytes() + lists_[1].bytes() + all_marks_.bytes() + no_marks_.bytes() +
           marks_[0].bytes() + marks_[1].bytes();
}

void Resting::upload(const Problem& problem, const State& state, BlockShape shape, const Stream& stream) {
    may_look_ = looking_ = asked_ = false;
    if (!could_look(problem, shape)) return;
    const BlockGrid grid(problem.lattice, shape);
    const std::vector<BlockOrigin> all = list_blocks(problem.lattice, shape);
    const std::size_t count = all.size();
    if (way_ == Way::decide &&
        (count < min_blocks || !pays(count_moved(problem, state, shape, count), count)))
        return;
    may_look_ = looking_ = true;
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
    wake(0, stream);
    left_ = period;
    pause_ = shortest_pause;
}

void Resting::wake(int reading, const Stream& stream) {
    if (!may_look_) return;
    const auto now = std::size_t(reading), next = std::size_t(1 - reading);
    copy(all_, lists_[now], stream);
    copy(all_marks_, marks_[now], stream);
    copy(no_marks_, marks_[next], stream);
    cuda::check(cudaMemcpyAsync(counts_.data(), awake_counts_.data() + reading, sizeof(Counts),
                                cudaMemcpyDeviceToDevice, stream.get()));
}

ActiveBlocks Resting::active(int reading) const {
    if (!may_look_) return {};
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
            count + finished,
            count + taken};
}

void Resting::stepped(int count, int reading, const Stream& stream) {
    if (!decides()) return;
    left_ -= count;
    if (left_ > 0) return;
    left_ = period;
    if (!looking_) {
        looking_ = true;
        wake(reading, stream);
        return;
    }
    if (std::exchange(asked_, false)) {
        copied_.wait();
        if (!pays(seen_.values().front()[taken], blocks())) {
            looking_ = false;
            left_ = pause_;
            pause_ = std::min(2 * pause_, longest_pause);
            return;
        }
        pause_ = shortest_pause;
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
