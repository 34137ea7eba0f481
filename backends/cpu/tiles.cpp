#include "backends/cpu/tiles.h"

#include <algorithm>
#include <atomic>
#include <limits>

#include "backends/cpu/kernel.h"

namespace voxspring::cpu_parallel {
namespace {

constexpr std::int64_t never = std::numeric_limits<std::int64_t>::min();

/// A range of tiles by index.
struct Range {
    std::ptrdiff_t begin, end;
};

/// Sets to[t] = from[t - stride] | from[t] | from[t + stride] for each t whose three sources are in `range`,
/// and shrinks `range` to these t.
void dilate(const std::vector<std::uint8_t>& from, std::vector<std::uint8_t>& to, Range& range,
            std::ptrdiff_t stride) {
    range = {range.begin + stride, range.end - stride};
    const std::uint8_t* const a = from.data();
    std::uint8_t* const b = to.data();
    for (std::ptrdiff_t t = range.begin; t < range.end; ++t)
        b[t] = std::uint8_t(a[t - stride] | a[t] | a[t + stride]);
}

}  // namespace

Tiles::Shape::Shape(glm::ivec3 blocks)
    : row(blocks.x + 1), plane(row * ((blocks.y + side - 1) / side + 1)), margin(plane + row + 1) {
    count = plane * ((blocks.z + side - 1) / side) + 4 * margin;
}

Tiles::Tiles(glm::ivec3 blocks, int window) : window_(window), shape_(blocks) {
    used_.assign(std::size_t(shape_.count), 0);
    latest_.fill(std::vector<std::int64_t>(used_.size(), never));
}

std::size_t Tiles::used() const { return std::size_t(std::count(used_.begin(), used_.end(), 1)); }

std::size_t Tiles::bytes(glm::ivec3 blocks, std::size_t shares) {
    return std::size_t(Shape(blocks).count) * (1 + 2 * sizeof(std::int64_t) + shares * 5);
}

Tiles::Share Tiles::share(std::size_t begin, std::size_t end) const {
    const std::vector<std::uint8_t> none(used_.size(), 0);
    return {.begin = begin, .end = end, .action = none, .active = none, .marks = {none, none, none}};
}

void Tiles::mark_all_active(std::int64_t step) {
    for (std::size_t t = 0; t < used_.size(); ++t) {
        if (used_[t] != 0) latest_[0][t] = latest_[1][t] = step;
    }
}

void Tiles::decide(Share& share, std::int64_t step) const {
    auto& [a, b, c] = share.marks;
    const auto& latest = latest_[std::size_t((step - 1) % 2)];
    Range range{std::ptrdiff_t(share.begin) - 2 * shape_.margin,
                std::ptrdiff_t(share.end) + 2 * shape_.margin};
    for (std::ptrdiff_t t = range.begin; t < range.end; ++t)
        a[std::size_t(t)] = latest[std::size_t(t)] >= step - window_;
    dilate(a, b, range, 1);
    dilate(b, a, range, shape_.row);
    dilate(a, c, range, shape_.plane);
    const auto& steps = c;
    dilate(c, a, range, 1);
    dilate(a, b, range, shape_.row);
    dilate(b, a, range, shape_.plane);
    const auto& beside = a;
    for (std::size_t t = share.begin; t < share.end; ++t) {
        const bool falls_asleep = window_ > 1 && (share.action[t] & tile_steps) != 0;
        share.action[t] = steps[t] != 0 ? std::uint8_t(tile_steps)
                                        : std::uint8_t((beside[t] != 0 ? tile_leaves_densities : 0) |
                                                       (falls_asleep ? tile_falls_asleep : 0));
    }
}

void Tiles::settle(Share& share, std::int64_t step) {
    const auto& before = latest_[std::size_t((step - 1) % 2)];
    auto& after = latest_[std::size_t(step % 2)];
    for (std::size_t t = share.begin; t < share.end; ++t) {
        if ((share.action[t] & tile_steps) == 0) continue;  // a tile at rest has the same step in both lists
        const std::int64_t latest = share.active[t] != 0 ? step : before[t];
        const std::atomic_ref<std::int64_t> shared(after[t]);
        std::int64_t known = shared.load(std::memory_order_relaxed);
        while (known < latest && !shared.compare_exchange_weak(known, latest, std::memory_order_relaxed)) {
        }
        share.active[t] = 0;
    }
}

std::size_t Tiles::stepped(const std::vector<const Share*>& shares) const {
    std::size_t count = 0;
    for (std::size_t t = 0; t < used_.size(); ++t) {
        const bool steps = std::any_of(shares.begin(), shares.end(), [t](const Share* share) {
            return t >= share->begin && t < share->end && (share->action[t] & tile_steps) != 0;
        });
        count += used_[t] != 0 && steps ? 1 : 0;
    }
    return count;
}

}  // namespace voxspring::cpu_parallel
