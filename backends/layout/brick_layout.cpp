#include "backends/layout/brick_layout.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <glm/common.hpp>
#include <glm/vector_relational.hpp>
#include <limits>
#include <utility>

#include "backends/layout/boxes.h"
#include "backends/layout/rounding.h"

namespace voxspring::layout {
namespace {

constexpr int warp = 32;

constexpr std::array<BrickTileSize, 5> tile_sizes = {{{3, 1, 1}, {2, 1, 2}, {2, 2, 2}, {3, 2, 2}, {3, 2, 3}}};

/// If the tiles of `shape` have size tile_sizes[n], visits the springs of a tile, sets `mask` and returns
/// true. Otherwise returns false.
template <std::size_t n, class Visit>
bool visit_size(const BrickShape& shape, Visit& visit, BrickMask& mask) {
    constexpr BrickTileSize size = tile_sizes[n];
    if (!(BrickTileSize{shape.tx, shape.ty, shape.tz} == size)) return false;
    if (shape.both) {
        mask.early = visit_brick_springs<size.x, size.y, size.z, true, false>(visit, 0);
        mask.springs = visit_brick_springs<size.x, size.y, size.z, true, true>(visit, mask.early);
    } else {
        mask.early = visit_brick_springs<size.x, size.y, size.z, false, false>(visit, 0);
        mask.springs = visit_brick_springs<size.x, size.y, size.z, false, true>(visit, mask.early);
    }
    mask.particles = size.x * size.y * size.z;
    return true;
}

template <class Visit, std::size_t... sizes>
BrickMask visit_tile(const BrickShape& shape, Visit& visit, std::index_sequence<sizes...>) {
    BrickMask mask{};
    (visit_size<sizes>(shape, visit, mask) || ...);
    return mask;
}
template <class Visit>
BrickMask visit_tile(const BrickShape& shape, Visit& visit) {
    return visit_tile(shape, visit, std::make_index_sequence<tile_sizes.size()>());
}

struct NoVisit {
    void both(int, int, int, int, int, int, int) {}
    void half(int, int, int, int, int, int, int) {}
};

/// The least and the greatest coordinates of voxels that have a particle.
std::pair<glm::ivec3, glm::ivec3> bounds_of(const Lattice& lattice) {
    glm::ivec3 low = lattice.dims, high(-1);
    for (const std::uint32_t voxel : lattice.voxel) {
        const glm::ivec3 at = lattice.coordinates(voxel);
        low = glm::min(low, at);
        high = glm::max(high, at);
    }
    return {low, high};
}

glm::ivec3 size_of(const BrickShape& shape) { return {shape.nx(), shape.ny(), shape.nz()}; }

/// Counts the particles in any box of voxels. For this it stores the counts of all boxes that begin at the
/// least coordinates of the body.
class ParticleCounts {
public:
    ParticleCounts(const Lattice& lattice, const glm::ivec3& low, const glm::ivec3& high)
        : size_(high - low + 2), sum_(volume(size_)) {
        for (const std::uint32_t voxel : lattice.voxel) at(lattice.coordinates(voxel) - low + 1) = 1;
        for (int axis = 0; axis < 3; ++axis) {
            visit_box(glm::ivec3(1), size_, [&](glm::ivec3 to) {
                std::uint32_t& sum = at(to);
                to[axis] -= 1;
                sum += at(to);
            });
        }
    }
    /// How many particles are in the box from `begin` to `end` (exclusive). Coordinates count from the least
    /// ones of the body.
    std::uint32_t in(const glm::ivec3& begin, const glm::ivec3& end) const {
        const glm::ivec3 to = glm::min(end, size_ - 1);
        std::uint32_t count = 0;
        for (int corner = 0; corner < 8; ++corner) {
            const glm::ivec3 of((corner & 1) != 0 ? begin.x : to.x, (corner & 2) != 0 ? begin.y : to.y,
                                (corner & 4) != 0 ? begin.z : to.z);
            const bool odd = ((corner ^ corner >> 1 ^ corner >> 2) & 1) != 0;
            count += odd ? 0U - at(of) : at(of);
        }
        return count;
    }

private:
    std::uint32_t& at(const glm::ivec3& c) { return sum_[index_in(size_, c)]; }
    std::uint32_t at(const glm::ivec3& c) const { return sum_[index_in(size_, c)]; }

    glm::ivec3 size_;
    std::vector<std::uint32_t> sum_;
};

/// Where the tiles of the first two warps of a brick lie. The other warps have nearly the same bank
/// conflicts.
std::vector<TilePlace> first_places(const BrickShape& shape) {
    constexpr int warps = 2;
    const BrickBlock inner{0, 0, 0, 1, brick_low_y | brick_high_y | brick_low_z | brick_high_z};
    std::vector<TilePlace> places;
    for (int lane = 0; lane < std::min(shape.threads(), warps * warp); ++lane)
        places.emplace_back(shape, inner, lane);
    return places;
}

/// The average number of bank conflicts per load from shared memory. Lanes conflict if they want different
/// words of one bank.
double bank_conflicts(const BrickShape& shape, const std::vector<TilePlace>& places) {
    int conflicts = 0, loads = 0;
    for (std::size_t first = 0; first < places.size(); first += warp) {
        for (int k = -1; k <= shape.tz; ++k) {
            for (int j = -1; j <= shape.ty; ++j) {
                std::array<int, warp> wanted{};
                for (std::size_t lane = first; lane < std::min(first + warp, places.size()); ++lane) {
                    const TilePlace& p = places[lane];
                    const int slot = shape.slot(p.x / shape.tx, 0, p.y + p.dy * j, p.z + p.dz * k);
                    ++wanted[std::size_t(slot) % warp];
                }
                conflicts += *std::max_element(wanted.begin(), wanted.end()) - 1;
                ++loads;
            }
        }
    }
    return double(conflicts) / loads;
}

/// Gives `shape` the pads (row_pad and plane_pad) with which it has the fewest bank_conflicts() among those
/// with which it fits into `bytes` of shared memory. Returns bank_conflicts().
double pad(BrickShape& shape, std::size_t bytes) {
    const std::vector<TilePlace> places = first_places(shape);
    BrickShape best = shape;
    double fewest = std::numeric_limits<double>::infinity();
    for (int row = 0; row < warp; ++row) {
        for (int plane = 0; plane < warp; ++plane) {
            BrickShape tried = shape;
            tried.row_pad = row;
            tried.plane_pad = plane;
            if (fewest == 0 || std::size_t(tried.shared_bytes()) > bytes) break;
            const double conflicts = bank_conflicts(tried, places);
            if (conflicts >= fewest) continue;
            fewest = conflicts;
            best = tried;
        }
    }
    shape = best;
    return fewest;
}

/// The registers per thread with a tile at which the compiler NVRTC 13.0 spills none, or only few for the
/// largest tile.
int registers_of(const BrickShape& shape, bool with_increments) {
    const int particles = shape.tile();
    const int points = particles <= 3    ? 88
                       : particles <= 4  ? 104
                       : particles <= 8  ? 128
                       : particles <= 12 ? 136
                                         : 144;
    return points + (with_increments ? rounded_up(4 * particles, 8) : 0);
}
constexpr int registers_of_multiprocessor = 65536;
constexpr int warps_that_move_registers = 4;
/// The registers of a poller: of one that keeps all points that it receives in registers, and of one that
/// takes them in turns, and fetches those of the next turn meanwhile, or that sends points after each step.
constexpr int registers_of_keeper = 56, registers_of_fetcher = 80;
constexpr int max_threads = 1024;

/// The most registers per thread for a block of `threads` threads that is alone on its multiprocessor. Each
/// quarter of a multiprocessor takes every fourth warp.
int registers_at_launch(int threads) {
    return registers_of_multiprocessor / rounded_up(threads, 4 * warp) / 8 * 8;
}

/// Chooses how many threads of a block are pollers, which exchange points with neighbouring blocks, and how
/// many registers each thread has. `polls`: the number of points that the block waits for. `needed`:
/// registers of a thread with a tile. `moves_registers`: pollers may give registers to threads with tiles.
/// Returns false if threads or registers do not suffice.
bool assign_threads_and_registers(BrickPlan& plan, std::size_t polls, int needed, bool moves_registers) {
    const int lanes = plan.shape.lanes();
    constexpr int alike = warps_that_move_registers * warp;
    for (const int pollers : {256, 128}) {
        // 256 pollers are faster than 128 only if each of the 128 would wait for more than five points. Up to
        // five, a poller fetches its points within the time of one round trip to L2.
        if (pollers == 256 && polls <= std::size_t(5) * 128) continue;
        if (lanes + pollers > max_threads) continue;
        plan.pollers = pollers;
        plan.lane_registers = plan.poller_registers = 0;
        // Pollers that send and give up registers shorten a step of tiles of 8 particles by a tenth. With
        // other tiles, or if pollers take their points in turns, points would come too late.
        const bool keeps = units_of(int(polls), pollers) < kept_polls;
        plan.pollers_send = plan.shape.tile() == 8 && keeps;
        const int poller_registers = keeps && !plan.pollers_send ? registers_of_keeper : registers_of_fetcher;
        const int at_launch = registers_at_launch(lanes + pollers);
        // The launch sets the total of a block's registers. A thread that asks for more than are left waits
        // for ever.
        const int left = (at_launch * (lanes + pollers) - poller_registers * pollers) / lanes / 8 * 8;
        const int of_lane = std::min(left, 240);
        const bool can_move = moves_registers && lanes % alike == 0 && pollers % alike == 0 &&
                              of_lane >= std::max(needed, at_launch);
        if (at_launch >= needed && !(plan.pollers_send && can_move)) return true;
        if (!can_move) continue;
        plan.lane_registers = of_lane;
        plan.poller_registers = poller_registers;
        return true;
    }
    return false;
}

/// Calls the function of the same name above. If that returns false and the formulation has increments, calls
/// it again for a plan that keeps them in memory instead of registers.
bool assign_threads_and_registers(BrickPlan& plan, std::size_t polls, Formulation formulation,
                                  bool moves_registers) {
    if (assign_threads_and_registers(plan, polls, registers_of(plan.shape, by_increments(formulation)),
                                     moves_registers))
        return true;
    plan.increments_in_memory = by_increments(formulation);
    return plan.increments_in_memory &&
           assign_threads_and_registers(plan, polls, registers_of(plan.shape, false), moves_registers);
}

/// An upper bound of the number of points in the frame of a brick. These points belong to the bricks around
/// it.
std::size_t frame_of(const BrickShape& shape) {
    const std::size_t with = std::size_t(shape.nx() + (shape.both ? 2 : 1)) * std::size_t(shape.ny() + 2) *
                             std::size_t(shape.nz() + 2);
    return with - std::size_t(shape.nx()) * std::size_t(shape.ny()) * std::size_t(shape.nz());
}

/// The predicted seconds of a step, from instructions counted in the machine code of compute capability 9.0,
/// and from the share of its issue slots that a quarter of a multiprocessor uses. This share depends on how
/// many warps the quarter has, because warps also wait. `conflicts`: bank conflicts per load, on average.
double seconds_of(const BrickPlan& plan, double conflicts, const MarchDevice& device) {
    const BrickShape& shape = plan.shape;
    NoVisit none;
    const BrickMask mask = visit_tile(shape, none);
    const double instructions = 15.5 * mask.springs + 25.0 * mask.particles + 50;
    const int warps = units_of(shape.lanes() / warp, 4);
    const double issued = warps == 1 ? 0.62 : warps == 2 ? 0.83 : 0.89;
    // Receiving and sending 32 points takes 40 cycles of issue, spread over the multiprocessor's quarters.
    // This was counted with threads with tiles that send. Where pollers send, a step is shorter by a tenth.
    const double exchange = double(frame_of(shape)) / warp * 40 / 4;
    const double work = (warps * instructions / issued * (1 + 0.2 * conflicts) + exchange) / device.hertz;
    // While points of neighbouring bricks travel, threads add the springs that do not need them (early
    // springs). A poller whose polls do not fit into its registers takes them in turns. Latencies were
    // measured on an H200 at 1.98 GHz. They are converted to cycles, so that on other cards they scale with
    // the clock.
    constexpr double measured_at = 1.98e9;
    const double slower = measured_at / device.hertz;
    const double barriers = 0.15e-6 * slower, trip = 0.75e-6 * slower;
    const int rounds = units_of(int(frame_of(shape)), plan.pollers);
    const double travel = trip * (rounds < kept_polls ? 1 : units_of(rounds, polls_in_turn));
    // If increments are in memory, they are loaded in groups of `in_flight`, and each group takes a round
    // trip to L2.
    constexpr int in_flight = 3;
    const double load = 0.4e-6 * slower;
    const double increments = plan.increments_in_memory ? load * units_of(shape.tile(), in_flight) : 0;
    return work + barriers + increments + std::max(0.0, travel - work * mask.early / mask.springs);
}

}  // namespace

std::span<const BrickTileSize> brick_tile_sizes() { return tile_sizes; }

std::string registers_refusal(const BrickPlan& plan, int compiled) {
    if (plan.lane_registers == 0) return {};
    const int lanes = plan.shape.lanes();
    const int at_launch = rounded_up(compiled, 8);  // registers are given out in multiples of 8
    const bool enough = plan.poller_registers <= at_launch && at_launch <= plan.lane_registers &&
                        plan.lane_registers * lanes + plan.poller_registers * plan.pollers <=
                            at_launch * (lanes + plan.pollers);
    if (enough) return {};
    return "the compiler gave each of " + std::to_string(lanes + plan.pollers) + " threads " +
           std::to_string(compiled) + " registers, which setmaxnreg cannot redistribute to " +
           std::to_string(lanes) + " threads with " + std::to_string(plan.lane_registers) + " each and " +
           std::to_string(plan.pollers) + " with " + std::to_string(plan.poller_registers) +
           " each: try another tile, such as tile=2x2x2";
}

std::optional<BrickPlan> plan_bricks(const Problem& problem, Formulation formulation,
                                     const MarchDevice& device, bool moves_registers,
                                     std::optional<BrickTileSize> size) {
    const auto [low, high] = bounds_of(problem.lattice);
    const glm::ivec3 body = high - low + 1;
    const auto most = std::size_t(device.multiprocessors);
    // Bricks without a particle get no block, so there may be more bricks than blocks.
    const std::size_t max_bricks = 4 * most;
    const std::size_t max_brick = device.block_shared_bytes / (2 * sizeof(Vector<float>));  // particles
    if (problem.particle_count() > most * max_brick || volume(body) > max_bricks * max_brick)
        return std::nullopt;
    const ParticleCounts counts(problem.lattice, low, high);
    std::optional<BrickPlan> best;
    for (const BrickTileSize& tile : tile_sizes) {
        if (size && !(*size == tile)) continue;
        const glm::ivec3 of(tile.x, tile.y, tile.z);
        for (int gz = 1; gz <= body.z && std::size_t(gz) <= max_bricks; ++gz) {
            for (int gy = 1; gy <= body.y && std::size_t(gy) * std::size_t(gz) <= max_bricks; ++gy) {
                for (int gx = 1;
                     gx <= body.x && std::size_t(gx) * std::size_t(gy) * std::size_t(gz) <= max_bricks;
                     ++gx) {
                    const glm::ivec3 wanted(gx, gy, gz);
                    const glm::ivec3 threads = ((body + wanted - 1) / wanted + of - 1) / of;
                    const glm::ivec3 brick = threads * of, bricks = (body + brick - 1) / brick;
                    // A brick is rounded up to whole tiles. If this leaves fewer bricks than `wanted`, skip:
                    // the loops try the smaller number too.
                    if (bricks != wanted) continue;
                    BrickPlan plan{.shape = {tile.x, tile.y, tile.z, threads.x, threads.y, threads.z,
                                             bricks.x > 2, 0, 0}};
                    // Along y and z a tile waits for points of other bricks only at its far end. So a brick
                    // of one tile cannot have neighbours on both sides.
                    if ((threads.y == 1 && bricks.y > 2) || (threads.z == 1 && bricks.z > 2)) continue;
                    if (volume(threads) > max_threads ||
                        std::size_t(plan.shape.shared_bytes()) > device.block_shared_bytes)
                        continue;
                    // First predict the time without bank conflicts, because finding the pads takes longer.
                    if (!assign_threads_and_registers(plan, frame_of(plan.shape), formulation,
                                                      moves_registers))
                        continue;
                    if (best && seconds_of(plan, 0, device) >= best->seconds) continue;
                    std::size_t blocks = 0;
                    visit_box(glm::ivec3(0), bricks, [&](const glm::ivec3& at) {
                        if (counts.in(at * brick, (at + 1) * brick) > 0) ++blocks;
                    });
                    if (blocks > most) continue;
                    const double conflicts = pad(plan.shape, device.block_shared_bytes);
                    plan.seconds = seconds_of(plan, conflicts, device);
                    if (!best || plan.seconds < best->seconds) best = plan;
                }
            }
        }
    }
    return best;
}

class BrickLayout::ListSprings {
public:
    ListSprings(const BrickShape& shape, std::vector<TileSpring>& springs)
        : shape_(shape), springs_(springs) {}
    void both(int bit, int i, int j, int k, int i2, int j2, int k2) { half(bit, i, j, k, i2, j2, k2); }
    void half(int bit, int i, int j, int k, int i2, int j2, int k2) {
        springs_.push_back({i, j, k, i2 - i, j2 - j, k2 - k, bit, shape_.crossed(i2, j2, k2)});
    }

private:
    const BrickShape& shape_;
    std::vector<TileSpring>& springs_;
};

BrickLayout::BrickLayout(const Problem& problem, const BrickPlan& plan)
    : plan_(plan),
      strides_(march_strides(problem.lattice, sizeof(float))),
      dims_(problem.lattice.dims),
      voxel_(problem.lattice.voxel),
      mask_(volume(dims_)) {
    for (std::size_t i = 0; i < problem.particle_count(); ++i)
        mask_[problem.lattice.voxel[i]] = problem.lattice.mask[i];
    const auto [low, high] = bounds_of(problem.lattice);
    low_ = low;
    const glm::ivec3 size = size_of(plan.shape);
    bricks_ = (high - low + size) / size;
    ListSprings list(plan.shape, springs_);
    bits_ = visit_tile(plan.shape, list);
    find_plain_words(problem.group_bits);

    find_blocks();
    masks_.assign(std::size_t(bits_.words_in_all()) * lane_count(), 0);
#pragma omp parallel for schedule(dynamic)
    for (std::ptrdiff_t n = 0; n < std::ptrdiff_t(blocks_.size()); ++n) {
        const auto block = std::size_t(n);
        for (int lane = 0; lane < plan_.shape.threads(); ++lane) write_masks(block, lane);
    }
    find_points();
}

std::uint32_t BrickLayout::mask_at(const glm::ivec3& voxel) const {
    if (glm::any(glm::lessThan(voxel, glm::ivec3(0))) || glm::any(glm::greaterThanEqual(voxel, dims_)))
        return 0;
    return mask_[index_in(dims_, voxel)];
}

void BrickLayout::find_blocks() {
    const glm::ivec3 size = size_of(plan_.shape);
    block_at_.assign(volume(bricks_), resident_none);
    visit_box(glm::ivec3(0), bricks_, [&](const glm::ivec3& brick) {
        const glm::ivec3 begin = low_ + brick * size;
        bool any = false;
        visit_box(begin, begin + size, [&](const glm::ivec3& voxel) { any = any || mask_at(voxel) != 0; });
        if (!any) return;
        block_at_[index_in(bricks_, brick)] = std::uint32_t(blocks_.size());
        // If there are two bricks along x, the second is mirrored. Then each has the other where its X ends.
        const bool mirrored = !plan_.shape.both && brick.x == 1;
        std::uint32_t sides = 0;
        const auto side = [&](bool here, std::uint32_t bit) { sides |= here ? bit : 0; };
        side(brick.x > 0, mirrored ? brick_high_x : brick_low_x);
        side(brick.x + 1 < bricks_.x, brick_high_x);
        side(brick.y > 0, brick_low_y);
        side(brick.y + 1 < bricks_.y, brick_high_y);
        side(brick.z > 0, brick_low_z);
        side(brick.z + 1 < bricks_.z, brick_high_z);
        blocks_.push_back(
            {mirrored ? begin.x + size.x - 1 : begin.x, begin.y, begin.z, mirrored ? -1 : 1, sides});
    });
}

void BrickLayout::write_masks(std::size_t block, int lane) {
    const TilePlace place(plan_.shape, blocks_[block], lane);
    const auto voxel = [&](int i, int j, int k) {
        return glm::ivec3(place.x + place.dx * i, place.y + place.dy * j, place.z + place.dz * k);
    };
    TileWords words{};
    const auto set = [&](int bit) { words[std::size_t(bit) / 32] |= 1U << bit % 32; };
    std::array<std::uint32_t, 32> masks{};
    for (int n = 0; n < plan_.shape.tile(); ++n) {
        const int i = n % plan_.shape.tx, j = n / plan_.shape.tx % plan_.shape.ty,
                  k = n / (plan_.shape.tx * plan_.shape.ty);
        const std::uint32_t mask = mask_at(voxel(i, j, k));
        masks[std::size_t(n)] = mask;
        if (mask == 0) continue;
        set(bits_.exists(n));
        if ((mask & PINNED_BIT) == 0) set(bits_.moves(n));
    }
    for (const TileSpring& s : springs_) {
        const std::uint32_t mask = masks[std::size_t(plan_.shape.number(s.i, s.j, s.k))];
        const int bit = bit_of(place.dx * s.dx, place.dy * s.dy, place.dz * s.dz);
        if ((mask >> bit & 1U) != 0) set(s.bit);
    }
    words[std::size_t(bits_.words())] = sides_of(words).bits;
    const std::size_t at = block * std::size_t(plan_.shape.lanes()) + std::size_t(lane);
    for (int n = 0; n < bits_.words_in_all(); ++n)
        masks_[std::size_t(n) * lane_count() + at] = words[std::size_t(n)];
}

/// Computes plain_words_, across_ and moves_, by which sides_of() tells whether a thread is plain.
/// `group_bits`: the springs in use.
void BrickLayout::find_plain_words(std::uint32_t group_bits) {
    const auto set = [](TileWords& words, int bit) { words[std::size_t(bit) / 32] |= 1U << bit % 32; };
    for (const TileSpring& s : springs_) {
        if ((group_bits & bits_of_class(spring_class(s.dx, s.dy, s.dz))) == 0) continue;
        for (std::uint32_t open = 0; open < plain_words_.size(); ++open) {
            if ((s.crossed & ~open) == 0) set(plain_words_[open], s.bit);
        }
        for (std::size_t side = 0; side < across_.size(); ++side) {
            if (s.crossed == 1U << side) set(across_[side], s.bit);
        }
    }
    for (TileWords& words : plain_words_) {
        for (int n = 0; n < bits_.particles; ++n) set(words, bits_.exists(n));
    }
    for (int n = 0; n < bits_.particles; ++n) set(moves_, bits_.moves(n));
}

TileSides BrickLayout::sides_of(const TileWords& words) const {
    const auto count = std::size_t(bits_.words());
    std::uint32_t open = 0;
    for (std::size_t side = 0; side < across_.size(); ++side) {
        for (std::size_t n = 0; n < count; ++n) {
            if ((words[n] & across_[side][n]) != 0) open |= 1U << side;
        }
    }
    for (std::size_t n = 0; n < count; ++n) {
        if ((words[n] & ~moves_[n]) != plain_words_[open][n]) return {0};
    }
    std::uint32_t bits = TileSides::plain;
    for (std::uint32_t crossed = 1; crossed < plain_words_.size(); ++crossed) {
        if ((crossed & ~open) == 0) bits |= 1U << crossed;
    }
    return {bits};
}

bool BrickLayout::all_plain() const {
    const std::uint32_t* const sides = masks_.data() + std::size_t(bits_.words()) * lane_count();
    for (std::size_t block = 0; block < blocks_.size(); ++block) {
        const std::uint32_t* const of = sides + block * std::size_t(plan_.shape.lanes());
        for (int lane = 0; lane < plan_.shape.threads(); ++lane) {
            if (!TileSides{of[lane]}.is_plain()) return false;
        }
    }
    return true;
}

/// The particles inside the block's brick that share a face or an edge with a particle outside, or those
/// outside that share one with a particle inside. It does not matter whether a spring joins them: each block
/// has to wait for all blocks that wait for it, so that no block gets two steps ahead.
std::vector<BrickPoint> BrickLayout::border_of(const BrickBlock& block, bool inside) const {
    const BrickShape& shape = plan_.shape;
    // The voxel at `at`, which counts from the block's origin and, along x, in the block's direction.
    const auto voxel = [&](const glm::ivec3& at) {
        return glm::ivec3(block.x + block.direction * at.x, block.y + at.y, block.z + at.z);
    };
    const auto is_inside = [size = size_of(shape)](const glm::ivec3& at) {
        return glm::all(glm::greaterThanEqual(at, glm::ivec3(0))) && glm::all(glm::lessThan(at, size));
    };
    // Most particles of a brick are not at its border. Their neighbours need not be looked up.
    const auto is_deep = [size = size_of(shape)](const glm::ivec3& at) {
        return glm::all(glm::greaterThan(at, glm::ivec3(0))) && glm::all(glm::lessThan(at, size - 1));
    };
    std::vector<BrickPoint> border;
    visit_box({shape.both ? -1 : 0, -1, -1}, size_of(shape) + 1, [&](const glm::ivec3& at) {
        if (is_inside(at) != inside || is_deep(at) || mask_at(voxel(at)) == 0) return;
        const bool at_border =
            std::any_of(directions().begin(), directions().end(), [&](const Direction& direction) {
                const glm::ivec3 o = direction.offset;
                return is_face_or_edge(o.x, o.y, o.z) && is_inside(at + o) != inside &&
                       mask_at(voxel(at + o)) != 0;
            });
        if (at_border)
            border.push_back(
                {std::uint32_t(strides_.element(voxel(at))), std::uint32_t(shape.slot_of(at.x, at.y, at.z))});
    });
    return border;
}

/// Shares the points of each block among its pollers.
BrickLayout::Points BrickLayout::in_rounds(const std::vector<std::vector<BrickPoint>>& of_blocks) const {
    std::size_t most = 1;
    for (const auto& of_block : of_blocks) most = std::max(most, of_block.size());
    const auto pollers = std::size_t(plan_.pollers);
    Points points{int(units_of(most, pollers)), {}};
    const std::size_t of_one = std::size_t(points.rounds) * pollers;
    points.points.assign(of_blocks.size() * of_one, {resident_none, 0});
    for (std::size_t b = 0; b < of_blocks.size(); ++b)
        std::copy(of_blocks[b].begin(), of_blocks[b].end(),
                  points.points.begin() + std::ptrdiff_t(b * of_one));
    return points;
}

void BrickLayout::find_points() {
    std::vector<std::vector<BrickPoint>> sent(blocks_.size()), received(blocks_.size());
#pragma omp parallel for schedule(dynamic)
    for (std::ptrdiff_t n = 0; n < std::ptrdiff_t(blocks_.size()); ++n) {
        const auto block = std::size_t(n);
        sent[block] = border_of(blocks_[block], true);
        received[block] = border_of(blocks_[block], false);
    }
    sent_ = in_rounds(sent);
    received_ = in_rounds(received);
}

std::vector<EditedWord> BrickLayout::edit(const SpringEdit& edit) {
    const BrickShape& shape = plan_.shape;
    const glm::ivec3 size = size_of(shape);
    std::vector<std::pair<std::size_t, int>> lanes;  // (block, lane in it)
    for (const SpringEdit::Touched& touched : edit.touched) {
        const std::uint32_t at = voxel_[touched.particle];
        mask_[at] = touched.mask;
        const glm::ivec3 c(int(at) % dims_.x, int(at) / dims_.x % dims_.y, int(at) / (dims_.x * dims_.y));
        const glm::ivec3 brick = (c - low_) / size;
        const std::size_t block = block_at_[index_in(bricks_, brick)];
        const BrickBlock& b = blocks_[block];
        const int X = b.direction * (c.x - b.x), Y = c.y - b.y, Z = c.z - b.z;
        lanes.emplace_back(block, (Y / shape.ty * shape.wz + Z / shape.tz) * shape.wx + X / shape.tx);
    }
    std::sort(lanes.begin(), lanes.end());
    lanes.erase(std::unique(lanes.begin(), lanes.end()), lanes.end());
    std::vector<EditedWord> edited;
    std::vector<std::uint32_t> before(std::size_t(bits_.words_in_all()));
    for (const auto& [block, lane] : lanes) {
        const std::size_t at = block * std::size_t(shape.lanes()) + std::size_t(lane);
        for (std::size_t w = 0; w < before.size(); ++w) before[w] = masks_[w * lane_count() + at];
        write_masks(block, lane);
        for (std::size_t w = 0; w < before.size(); ++w) {
            const std::size_t word = w * lane_count() + at;
            if (masks_[word] != before[w]) edited.push_back({std::uint32_t(word), masks_[word]});
        }
    }
    return edited;
}

}  // namespace voxspring::layout
