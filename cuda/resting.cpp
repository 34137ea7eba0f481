#include "cuda/resting.h"

#include <algorithm>
#include <limits>
#include <span>
#include <utility>
#include <vector>

#include "backends/registry.h"

namespace voxspring::cuda {
namespace {

std::size_t count_stepped(std::span<const std::uint64_t> reports) {
    return std::size_t(std::count_if(reports.begin(), reports.end(),
                                     [](std::uint64_t said) { return (said & any_stepped) != 0; }));
}

/// Blocks with a particle that is not at rest, or as many as `enough`.
std::size_t count_moved(const Problem& problem, const State& state, BlockShape shape, std::size_t enough) {
    const ReportGrid grid(problem.lattice, shape);
    std::vector<std::uint8_t> moved(grid.size());
    std::size_t count = 0;
    for (std::size_t i = 0; i < problem.particle_count() && count < enough; ++i) {
        if (state.displacement[i] == glm::dvec3(0) && state.increment[i] == glm::dvec3(0)) continue;
        std::uint8_t& block = moved[grid.of_voxel(problem.lattice, problem.lattice.voxel[i])];
        count += block == 0 ? 1 : 0;
        block = 1;
    }
    return count;
}

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
    const std::size_t size = ReportGrid(lattice, shape).size();
    constexpr auto most = std::size_t(std::numeric_limits<int>::max());
    if (way_ == Way::step || way_ == Way::decide || size <= most) return {};
    return std::to_string(size) + " blocks that may rest exceed the index limit of " + std::to_string(most);
}

std::uint64_t Resting::bytes_needed(const Lattice& lattice, BlockShape shape) const {
    const std::size_t size = ReportGrid(lattice, shape).size();
    return way_ == Way::step ? 0 : size * (3 * sizeof(std::uint64_t) + 2 * sizeof(BlockOrigin));
}

std::uint64_t Resting::bytes_held() const {
    return all_.bytes() + listed_.bytes() + counts_.bytes() + awake_.bytes() + reports_[0].bytes() +
           reports_[1].bytes();
}

void Resting::upload(const Problem& problem, const State& state, BlockShape shape, const Stream& stream) {
    may_look_ = looking_ = asked_ = false;
    const bool at_ease = problem.gravity == glm::dvec3(0) && problem.load.empty();
    const ReportGrid grid(problem.lattice, shape);
    if (way_ == Way::step) return;
    if (way_ == Way::decide && (!at_ease || grid.size() < least_blocks ||
                                grid.size() > std::size_t(std::numeric_limits<int>::max())))
        return;
    const std::vector<BlockOrigin> all = list_blocks(problem.lattice, shape);
    const std::size_t count = all.size();
    if (way_ == Way::decide &&
        (count < least_blocks || !pays(count_moved(problem, state, shape, count), count)))
        return;
    std::vector<std::uint64_t> awake(grid.size());
    for (const BlockOrigin& block : all) awake[std::size_t(block.report)] = any_changed | any_stepped;
    all_.upload(all, stream);
    listed_.resize(count);
    counts_.resize(2);
    may_look_ = looking_ = true;
    row_ = int(grid.row());
    slice_ = int(grid.slice());
    awake_.upload(awake, stream);
    for (Buffer<std::uint64_t>& reports : reports_) reports.resize(awake.size());
    wake(stream);
    left_ = period;
    pause_ = shortest_pause;
}

void Resting::wake(const Stream& stream) {
    if (!may_look_) return;
    counts_.fill_with_zeros(stream);
    for (const Buffer<std::uint64_t>& reports : reports_)
        cuda::check(cudaMemcpyAsync(reports.data(), awake_.data(), awake_.bytes(), cudaMemcpyDeviceToDevice,
                                    stream.get()));
}

BlockReports Resting::reports(int reading) const {
    if (!may_look_) return {};
    return {row_, slice_, reports_[std::size_t(reading)].data(), reports_[std::size_t(1 - reading)].data()};
}

LivelyBlocks Resting::lively(int reading) const {
    if (!may_look_) return {};
    return {listed_.data(), counts_.data() + reading, counts_.data() + 1 - reading};
}

void Resting::stepped(int count, int current, const Stream& stream) {
    if (!decides()) return;
    left_ -= count;
    if (left_ > 0) return;
    left_ = period;
    if (!looking_) {
        looking_ = true;
        wake(stream);
        return;
    }
    if (std::exchange(asked_, false)) {
        copied_.wait();
        if (!pays(count_stepped(seen_.values()), blocks())) {
            looking_ = false;
            left_ = pause_;
            pause_ = std::min(2 * pause_, longest_pause);
            return;
        }
        pause_ = shortest_pause;
    }
    seen_.copy(reports_[std::size_t(current)], stream);
    copied_.record(stream);
    asked_ = true;
}

std::size_t Resting::blocks_stepped(int current, const Stream& stream) const {
    const Buffer<std::uint64_t>& reports = reports_[std::size_t(current)];
    std::vector<std::uint64_t> said(reports.size());
    reports.download(said, stream);
    return count_stepped(said);
}

}  // namespace voxspring::cuda
