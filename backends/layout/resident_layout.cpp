#include "backends/layout/resident_layout.h"

#include <algorithm>
#include <array>
#include <glm/common.hpp>
#include <glm/vector_relational.hpp>
#include <iomanip>
#include <iterator>
#include <limits>
#include <numeric>
#include <sstream>
#include <unordered_map>

#include "backends/layout/rounding.h"
#include "backends/physics/addressing.h"

namespace voxspring::layout {
namespace {

constexpr std::size_t warp = 32;

// The unit in which particles are dealt out to blocks: one particle, or a row of up to 32 of them.
struct Item {
    glm::ivec3 at;
    std::uint32_t begin = 0, end = 0;  // range of particles
};

// Visits the particles that some block steps. Ghosts are left out: another part of the body steps them.
template <class Visit>
void visit_own(const Problem& problem, Visit visit) {
    auto ghost = problem.ghosts.begin();
    for (std::uint32_t i = 0; i < problem.particle_count(); ++i) {
        if (ghost != problem.ghosts.end() && *ghost == i) {
            ++ghost;
        } else {
            visit(i);
        }
    }
}

// The x at which rows begin: 0 or, in a part of a body, the first x of the particles that it steps.
int first_column(const Problem& problem) {
    if (problem.ghosts.empty()) return 0;
    int first = problem.lattice.dims.x;
    visit_own(problem, [&](std::uint32_t i) {
        first = std::min(first, problem.lattice.coordinates(problem.lattice.voxel[i]).x);
    });
    return first;
}

std::vector<Item> items_of(const Problem& problem, bool rows) {
    std::vector<Item> items;
    const int first = first_column(problem);
    visit_own(problem, [&](std::uint32_t i) {
        glm::ivec3 at = problem.lattice.coordinates(problem.lattice.voxel[i]);
        if (rows) at.x = (at.x - first) / int(warp);
        if (rows && !items.empty() && items.back().at == at) {
            items.back().end = i + 1;
        } else {
            items.push_back({at, i, i + 1});
        }
    });
    return items;
}

// Cuts items[begin, end) into `parts` parts whose numbers of items differ by one at most. Each cut is across
// the longest side.
void bisect(std::vector<Item>& items, std::size_t begin, std::size_t end, std::size_t parts,
            std::vector<std::vector<Item>>& out) {
    const auto first = items.begin() + std::ptrdiff_t(begin), last = items.begin() + std::ptrdiff_t(end);
    if (parts == 1) {
        out.emplace_back(first, last);
        return;
    }
    glm::ivec3 low = first->at, high = first->at;
    for (auto item = first; item != last; ++item) {
        low = glm::min(low, item->at);
        high = glm::max(high, item->at);
    }
    const glm::ivec3 sides = high - low;
    int axis = sides.y > sides.x ? 1 : 0;
    if (sides.z >= sides[axis]) axis = 2;
    // Ties are broken by the other axes, so parts do not depend on the order of the items.
    const auto key = [axis](const Item& item) {
        return std::array<int, 4>{item.at[axis], item.at.z, item.at.y, item.at.x};
    };
    std::sort(first, last, [&](const Item& a, const Item& b) { return key(a) < key(b); });
    const std::size_t middle = begin + (end - begin) * (parts / 2) / parts;
    bisect(items, begin, middle, parts / 2, out);
    bisect(items, middle, end, parts - parts / 2, out);
}

// The particles of each block in the order of its lanes. If `rows` is set, resident_none stands for a lane
// without a particle.
std::vector<std::vector<std::uint32_t>> deal_out(const Problem& problem, int max_blocks, bool rows) {
    std::vector<Item> items = items_of(problem, rows);
    const std::size_t most = std::min(std::size_t(max_blocks), items.size());
    std::size_t parts = most;
    if (rows) {
        // Some block must have at least `rows_per_block` rows. If every block takes this many, the fewest
        // blocks hold all rows.
        const std::size_t rows_per_block = units_of(items.size(), most);
        parts = units_of(items.size(), rows_per_block);
    }
    std::vector<std::vector<Item>> dealt;
    bisect(items, 0, items.size(), parts, dealt);
    std::vector<std::vector<std::uint32_t>> blocks;
    const auto first = std::size_t(first_column(problem));
    for (std::vector<Item>& part : dealt) {
        std::sort(part.begin(), part.end(), [](const Item& a, const Item& b) { return a.begin < b.begin; });
        std::vector<std::uint32_t>& lanes = blocks.emplace_back();
        for (const Item& item : part) {
            if (rows) lanes.resize(rounded_up(lanes.size(), warp), resident_none);
            const std::size_t row = lanes.size();
            for (std::uint32_t i = item.begin; i < item.end; ++i) {
                if (rows) {
                    const auto x =
                        std::size_t(problem.lattice.voxel[i]) % std::size_t(problem.lattice.dims.x) - first;
                    lanes.resize(row + x % warp, resident_none);
                }
                lanes.push_back(i);
            }
        }
    }
    return blocks;
}

// Whether rows of 32 waste no more than a tenth of their lanes.
bool rows_are_full(const Problem& problem) {
    return 10 * (problem.particle_count() - problem.ghosts.size()) >=
           9 * warp * items_of(problem, true).size();
}

// Assigns points to the banks of shared memory by a linear function of their coordinates. If the points of a
// warp are in different banks, then their neighbours in any one direction are in different banks too.
struct Banks {
    int y = 0, z = 0;
    std::size_t of(const glm::ivec3& at) const {
        return std::size_t(std::uint32_t(at.x + y * at.y + z * at.z) % warp);
    }
};

// The mask bit of each direction as a mirrored warp sees it (mirrored_y, mirrored_z). The first index says
// how the warp is mirrored: 0 not at all, 1 along y, 2 along z, 3 along both.
constexpr auto mirrored_bits = [] {
    std::array<std::array<int, neighbour_bits>, 4> bits{};
    for (unsigned how = 0; how < bits.size(); ++how) {
        const int y = (how & 1U) != 0 ? -1 : 1, z = (how & 2U) != 0 ? -1 : 1;
#define MIRROR(bit, dx, dy, dz) bits[how][bit] = bit_of(dx, y * (dy), z * (dz));
        FACE_NEIGHBOURS(MIRROR) EDGE_NEIGHBOURS(MIRROR) CORNER_NEIGHBOURS(MIRROR)
#undef MIRROR
    }
    return bits;
}();

// The mask bit that a warp uses in place of `bit`, if it is mirrored. `border`: its element of
// ResidentStep::border.
int mirrored(int bit, int border) {
    static_assert(mirrored_y == border_kind_bits + 1 && mirrored_z == 2 * mirrored_y);
    return mirrored_bits[std::size_t(border) / mirrored_y][std::size_t(bit)];
}

// Hands out slots, the indices of one block's points in shared memory.
class Slots {
public:
    explicit Slots(Banks banks) : banks_(banks) {}
    int take(const glm::ivec3& at) {
        const std::size_t bank = banks_.of(at);
        const std::size_t slot = taken_[bank]++ * warp + bank;
        size_ = std::max(size_, slot + 1);
        return int(slot);
    }
    std::size_t size() const { return size_; }

private:
    Banks banks_;
    std::array<std::size_t, warp> taken_{};
    std::size_t size_ = 0;
};

class Layout {
public:
    // `threads`: the number of threads per block if each has several particles; 0 if each has one.
    Layout(const Problem& problem, int pollers, bool overlap, int threads, bool rows,
           std::vector<std::vector<std::uint32_t>> blocks)
        : problem_(problem),
          particle_(particle_of_voxel(problem.lattice)),
          blocks_(std::move(blocks)),
          block_of_(problem.particle_count(), resident_none),
          overlap_(overlap) {
        out_.blocks = int(blocks_.size());
        out_.pollers = pollers;
        for (const auto& lanes : blocks_)
            out_.lanes = std::max(out_.lanes, int(rounded_up(lanes.size(), warp)));
        for (std::size_t b = 0; b < blocks_.size(); ++b) {
            for (const std::uint32_t i : blocks_[b]) {
                if (i != resident_none) block_of_[i] = std::uint32_t(b);
            }
        }
        if (threads == 0) return;
        out_.turns = std::max(2, units_of(out_.lanes, threads));
        out_.lanes = rounded_up(out_.lanes, out_.turns * int(warp));
        put_inner_first(rows ? warp : 1);
    }

    ResidentLayout make() {
        find_borders();
        find_keepers();
        publish();
        const std::size_t lanes = out_.lane_count();
        out_.particle.assign(lanes, resident_none);
        out_.lane.assign(problem_.particle_count(), resident_none);
        out_.own_slot.assign(lanes, 0);
        out_.neighbour_slot.assign(rounded_up(neighbour_bits, out_.turns > 1 ? slots_together : 1) * lanes,
                                   0);
        out_.border.assign(lanes / warp, mixed_border);
        std::vector<std::size_t> slots(blocks_.size());
#pragma omp parallel for schedule(dynamic)
        for (std::ptrdiff_t b = 0; b < std::ptrdiff_t(blocks_.size()); ++b)
            slots[std::size_t(b)] = place(std::size_t(b));
        out_.slots = int(rounded_up(*std::max_element(slots.begin(), slots.end()), warp));
        for (const std::uint8_t border : out_.border) out_.border_kinds |= 1U << (border & border_kind_bits);
        return std::move(out_);
    }

private:
    // Orders the particles of each block in units of `unit` particles. Units whose neighbours are all in the
    // block come first: threads step these while points of other blocks are on their way.
    void put_inner_first(std::size_t unit) {
        for (std::size_t b = 0; b < blocks_.size(); ++b) {
            std::vector<std::uint32_t> inner, outer;
            for (std::size_t first = 0; first < blocks_[b].size(); first += unit) {
                const auto begin = blocks_[b].begin() + std::ptrdiff_t(first);
                const auto end =
                    blocks_[b].begin() + std::ptrdiff_t(std::min(first + unit, blocks_[b].size()));
                const bool reaches = std::any_of(begin, end, [&](std::uint32_t i) {
                    return i != resident_none && bits_of(i, b).second != 0;
                });
                std::vector<std::uint32_t>& into = reaches ? outer : inner;
                into.insert(into.end(), begin, end);
                into.resize(rounded_up(into.size(), unit), resident_none);
            }
            inner.insert(inner.end(), outer.begin(), outer.end());
            blocks_[b] = std::move(inner);
        }
    }

    // The mask bits of particle i's neighbours within block b, and those of its neighbours in other blocks.
    std::pair<std::uint32_t, std::uint32_t> bits_of(std::uint32_t i, std::size_t b) const {
        std::uint32_t within = 0, beyond = 0;
        visit_neighbours(i, [&](std::uint32_t j, const Direction& direction) {
            (block_of_[j] == b ? within : beyond) |= 1U << direction.bit;
        });
        return {within, beyond};
    }

    glm::ivec3 at(std::uint32_t i) const { return problem_.lattice.coordinates(problem_.lattice.voxel[i]); }

    // Calls visit(j, direction) for each neighbour j of particle i that a lattice spring joins to i, or that
    // an edit may join to i.
    template <class Visit>
    void visit_neighbours(std::uint32_t i, Visit visit) const {
        const Lattice& lattice = problem_.lattice;
        const glm::ivec3 from = at(i);
        visit_directions(problem_.group_bits, [&](const Direction& direction) {
            const glm::ivec3 to = from + direction.offset;
            if (glm::any(glm::lessThan(to, glm::ivec3(0))) ||
                glm::any(glm::greaterThanEqual(to, lattice.dims)))
                return;
            const std::uint32_t j =
                particle_[std::size_t(std::ptrdiff_t(lattice.voxel[i]) + lattice.stride(direction))];
            if (j != no_particle) visit(j, direction);
        });
    }

    // Finds, for each block, the particles of other blocks to which its springs may lead, ascending.
    void find_borders() {
        reached_.resize(blocks_.size());
#pragma omp parallel for schedule(dynamic)
        for (std::ptrdiff_t n = 0; n < std::ptrdiff_t(blocks_.size()); ++n) {
            const auto b = std::size_t(n);
            std::vector<std::uint32_t>& reached = reached_[b];
            for (const std::uint32_t i : blocks_[b]) {
                if (i == resident_none) continue;
                visit_neighbours(i, [&](std::uint32_t j, const Direction&) {
                    if (block_of_[j] != b) reached.push_back(j);
                });
            }
            std::sort(reached.begin(), reached.end());
            reached.erase(std::unique(reached.begin(), reached.end()), reached.end());
        }
        std::size_t most = 0;
        for (const auto& reached : reached_) most = std::max(most, reached.size());
        out_.rounds = std::max(1, int(units_of(most, std::size_t(out_.pollers))));
    }

    // For each ghost, chooses the block that keeps it, which means that the block stores the ghost in memory:
    // the first block with a particle to which the ghost may have a spring.
    void find_keepers() {
        for (std::size_t b = 0; b < reached_.size(); ++b) {
            for (const std::uint32_t j : reached_[b]) {
                if (block_of_[j] == resident_none) keeper_.try_emplace(j, b);
            }
        }
    }

    // Gives each particle that another block needs an index in the exchange, through which blocks send
    // points. The particles of one block have consecutive indices, in the order of its lanes.
    void publish() {
        std::vector<std::uint8_t> is_reached(problem_.particle_count());
        for (const auto& reached : reached_) {
            for (const std::uint32_t j : reached) is_reached[j] = 1;
        }
        published_.assign(problem_.particle_count(), resident_none);
        out_.published.assign(out_.lane_count(), resident_none);
        for (std::size_t b = 0; b < blocks_.size(); ++b) {
            for (std::size_t lane = 0; lane < blocks_[b].size(); ++lane) {
                const std::uint32_t i = blocks_[b][lane];
                if (i == resident_none || is_reached[i] == 0) continue;
                published_[i] = out_.published_count++;
                out_.published[b * std::size_t(out_.lanes) + lane] = published_[i];
            }
        }
        // A ghost that no block needs gets no index, since the part that steps it will not send it.
        for (const std::uint32_t ghost : problem_.ghosts) {
            if (is_reached[ghost] != 0) published_[ghost] = out_.published_count++;
            out_.ghost_word.push_back(published_[ghost]);
        }
        const std::size_t polls =
            std::size_t(out_.rounds) * std::size_t(out_.blocks) * std::size_t(out_.pollers);
        out_.polled.assign(polls, resident_none);
        out_.polled_word.assign(polls, 0);
        out_.polled_slot.assign(polls, 0);
    }

    // Chooses the assignment of points to banks with which the block's warps have the fewest bank conflicts.
    Banks choose_banks(const std::vector<std::uint32_t>& lanes) const {
        std::vector<glm::ivec3> points;
        for (const std::uint32_t i : lanes) points.push_back(i == resident_none ? glm::ivec3(-1) : at(i));
        Banks best;
        std::size_t fewest = std::numeric_limits<std::size_t>::max();
        for (int y = 0; y < int(warp); ++y) {
            for (int z = 0; z < int(warp); ++z) {
                const Banks banks{y, z};
                std::size_t conflicts = 0;
                for (std::size_t first = 0; first < points.size() && conflicts < fewest; first += warp) {
                    std::array<std::size_t, warp> taken{};
                    std::size_t most = 0;
                    for (std::size_t n = first; n < std::min(first + warp, points.size()); ++n) {
                        if (lanes[n] != resident_none) most = std::max(most, ++taken[banks.of(points[n])]);
                    }
                    conflicts += most;
                }
                if (conflicts >= fewest) continue;
                fewest = conflicts;
                best = banks;
            }
        }
        return best;
    }

    // Fills in the tables of block b. Returns how many slots the block takes.
    std::size_t place(std::size_t b) {
        const std::vector<std::uint32_t>& lanes = blocks_[b];
        const std::size_t first = b * std::size_t(out_.lanes);
        Slots slots(choose_banks(lanes));
        std::unordered_map<std::uint32_t, int> slot_of;
        std::vector<std::size_t> idle;
        for (std::size_t lane = 0; lane < std::size_t(out_.lanes); ++lane) {
            const std::uint32_t i = lane < lanes.size() ? lanes[lane] : resident_none;
            if (i == resident_none) {
                idle.push_back(lane);
                continue;
            }
            out_.particle[first + lane] = i;
            out_.lane[i] = std::uint32_t(first + lane);
            out_.own_slot[first + lane] = std::uint16_t(slot_of[i] = slots.take(at(i)));
        }
        const std::vector<std::uint32_t>& reached = reached_[b];
        const auto pollers = std::size_t(out_.pollers);
        for (std::size_t n = 0; n < reached.size(); ++n) {
            const std::size_t poll = (n / pollers * blocks_.size() + b) * pollers + n % pollers;
            out_.polled[poll] = published_[reached[n]];
            const auto keeper = keeper_.find(reached[n]);
            const bool keeps = keeper != keeper_.end() && keeper->second == b;
            out_.polled_word[poll] = reached[n] | (keeps ? keeps_ghost : 0);
            out_.polled_slot[poll] = std::uint16_t(slot_of[reached[n]] = slots.take(at(reached[n])));
        }
        // Idle lanes write to a slot that no lane with a particle reads.
        const std::size_t size = slots.size() + (idle.empty() ? 0 : 1);
        for (const std::size_t lane : idle) out_.own_slot[first + lane] = std::uint16_t(slots.size());

        for (std::size_t row = 0; row < std::size_t(out_.lanes) / warp; ++row)
            out_.border[first / warp + row] = std::uint8_t(border_of(b, row * warp));
        for (std::size_t lane = 0; lane < std::size_t(out_.lanes); ++lane) {
            for (int bit = 0; bit < neighbour_bits; ++bit)
                out_.neighbour_slot[out_.slot_index(bit, first + lane)] = out_.own_slot[first + lane];
            if (lane >= lanes.size() || lanes[lane] == resident_none) continue;
            const int border = out_.border[(first + lane) / warp];
            visit_neighbours(lanes[lane], [&](std::uint32_t j, const Direction& direction) {
                const int bit = mirrored(direction.bit, border);
                out_.neighbour_slot[out_.slot_index(bit, first + lane)] = std::uint16_t(slot_of.at(j));
            });
        }
        return size;
    }

    // The element of ResidentStep::border for the warp whose lanes begin at `first`.
    int border_of(std::size_t b, std::size_t first) const {
        if (!overlap_ && out_.turns == 1) return mixed_border;
        const std::vector<std::uint32_t>& lanes = blocks_[b];
        std::uint32_t within = 0, beyond = 0;  // mask bits
        for (std::size_t lane = first; lane < std::min(first + warp, lanes.size()); ++lane) {
            if (lanes[lane] == resident_none) continue;
            const auto [here, elsewhere] = bits_of(lanes[lane], b);
            within |= here;
            beyond |= elsewhere;
        }
        if (out_.turns > 1) return beyond == 0 ? 0 : mixed_border;
        // A border is the set of directions whose springs wait for points of other blocks. If the warp has no
        // neighbours in a direction, its border may include that direction or not. The largest kind of border
        // that fits is taken, so that more warps of a block have the same kind and share its code.
        int best = mixed_border;
        for (int y = -1; y <= 1; ++y) {
            for (int z = -1; z <= 1; ++z) {
                std::uint32_t across = 0;
                for (const Direction& direction : directions()) {
                    const glm::ivec3 o = direction.offset;
                    if ((y != 0 && o.y == y) || (z != 0 && o.z == z)) across |= 1U << direction.bit;
                }
                if ((within & across) != 0 || (beyond & ~across) != 0) continue;
                const int kind = (y != 0 ? 2 : 0) + (z != 0 ? 1 : 0);
                if (best == mixed_border || kind > (best & border_kind_bits))
                    best = kind + (y < 0 ? mirrored_y : 0) + (z < 0 ? mirrored_z : 0);
            }
        }
        return best;
    }

    const Problem& problem_;
    const std::vector<std::uint32_t> particle_;  // per voxel: its particle
    std::vector<std::vector<std::uint32_t>> blocks_;
    std::vector<std::uint32_t> block_of_;  // per particle: its block; resident_none: a ghost
    bool overlap_;
    std::vector<std::vector<std::uint32_t>> reached_;
    std::unordered_map<std::uint32_t, std::size_t> keeper_;  // for each ghost the block that stores it
    std::vector<std::uint32_t> published_;
    ResidentLayout out_;
};

}  // namespace

ResidentLayout lay_out_resident(const Problem& problem, const ResidentCard& card, int pollers,
                                Partition partition, bool overlap) {
    const auto lay_out = [&](bool in_turns, bool rows) {
        return Layout(problem, pollers, overlap, in_turns ? card.threads : 0, rows,
                      deal_out(problem, card.blocks, rows))
            .make();
    };
    // Blocks get whole rows. On a card with few blocks, the rows of a block can take more lanes than a block
    // may have, although single particles, dealt out evenly, would fit. So bisection is tried after rows.
    std::vector<bool> in_rows = {partition == Partition::rows};
    if (partition == Partition::automatic && rows_are_full(problem)) in_rows = {true, false};
    const std::size_t own = problem.particle_count() - problem.ghosts.size();
    ResidentLayout layout;
    for (const bool in_turns : {false, true}) {
        if (!in_turns && own > std::size_t(card.blocks) * std::size_t(card.threads)) continue;
        for (const bool rows : in_rows) {
            layout = lay_out(in_turns, rows);
            layout.in_rows = rows;
            if (block_refusal(layout, card).empty()) return layout;
        }
    }
    return layout;
}

std::vector<std::uint16_t> slots_with(const ResidentLayout& layout, const std::vector<std::uint32_t>& mask) {
    std::vector<std::uint16_t> slot(layout.neighbour_slot.size());
    const std::size_t lanes = layout.lane_count();
    for (int bit = 0; bit < neighbour_bits; ++bit) {
        for (std::size_t lane = 0; lane < lanes; ++lane) {
            const std::uint32_t i = layout.particle[lane];
            const bool joined = i != resident_none && (mask[i] >> bit & 1U) != 0;
            const std::size_t at = layout.slot_index(mirrored(bit, layout.border[lane / warp]), lane);
            slot[at] = joined ? layout.neighbour_slot[at] : layout.own_slot[lane];
        }
    }
    return slot;
}

std::vector<std::uint16_t> own_slots_with(const ResidentLayout& layout,
                                          const std::vector<std::uint32_t>& mask) {
    std::vector<std::uint16_t> own = layout.own_slot;
    if (layout.turns == 1) return own;
    for (std::size_t lane = 0; lane < own.size(); ++lane) {
        const std::uint32_t i = layout.particle[lane];
        if (i != resident_none && (mask[i] & PINNED_BIT) != 0) own[lane] |= pinned_slot;
    }
    return own;
}

ResidentEdit resident_edit(const ResidentLayout& layout, const SpringEdit& edit) {
    ResidentEdit edited;
    edited.words.reserve(2 * (edit.removed.size() + edit.added.size()) + edit.touched.size());
    const auto look_at = [&](std::uint32_t particle, int bit) {
        if (layout.lane[particle] == resident_none) return;  // a ghost
        const auto touched = std::lower_bound(
            edit.touched.begin(), edit.touched.end(), particle,
            [](const SpringEdit::Touched& one, std::uint32_t i) { return one.particle < i; });
        const std::uint32_t lane = layout.lane[particle];
        const auto word = std::uint32_t(layout.slot_index(mirrored(bit, layout.border[lane / warp]), lane));
        const bool joined = (touched->mask >> bit & 1U) != 0;
        edited.words.push_back({word, joined ? layout.neighbour_slot[word] : layout.own_slot[lane]});
    };
    for (const auto* springs : {&edit.removed, &edit.added}) {
        for (const ChangedSpring& changed : *springs) {
            look_at(changed.spring.first, changed.bit);
            look_at(changed.spring.second, changed.bit ^ 1);
        }
    }
    edited.slots = edited.words.size();
    for (const SpringEdit::Touched& touched : edit.touched)
        edited.words.push_back({touched.particle, touched.mask});
    return edited;
}

double seconds_in_turns(const ResidentLayout& layout, double hertz) {
    // A thread reads up to 26 slots and 26 points for each of its particles, and springs within a block are
    // computed from both ends. So the time grows with the number of warps of particles that a quarter of a
    // multiprocessor steps. On 24 multiprocessors of an H100 at 1.98 GHz, with 12 such warps per quarter, a
    // step of the box of the paper was measured to take 4.3 us; points travelled between blocks during this
    // time. Barriers are taken to last as long as those of cuda_bricks.
    constexpr double measured_at = 1.98e9, measured = 4.3e-6, barriers = 0.15e-6;
    constexpr int warps_then = 12;
    const double cycles = (measured - barriers) * measured_at / warps_then;
    const int warps = layout.turns * units_of(layout.threads() / int(warp), 4);
    return (barriers * measured_at + warps * cycles) / hertz;
}

std::string outpaced_by_bricks(const ResidentLayout& layout, const std::optional<BrickPlan>& bricks,
                               double hertz) {
    if (layout.turns == 1 || !bricks) return {};
    const double own = seconds_in_turns(layout, hertz);
    if (bricks->seconds >= own) return {};
    const auto microseconds = [](double seconds) {
        std::ostringstream text;
        text << std::setprecision(2) << 1e6 * seconds << " us";
        return text.str();
    };
    return "each thread would step " + std::to_string(layout.turns) +
           " particles, so that a step is predicted to take " + microseconds(own) +
           ", but cuda_bricks is predicted to take " + microseconds(bricks->seconds);
}

std::string resident_refusal(const Problem& problem, int multiprocessors, bool launches_together) {
    // Checked first, because without it blocks that do not all run at once would wait for each other for
    // ever.
    if (!launches_together) return "the device has no cooperative launches";
    if (problem.particle_count() == 0) return "the scene has no particle";
    if (std::string why = implicit_refusal(problem); !why.empty()) return why;
    if (problem.has_materials())
        return "the resident kernel takes one stiffness per spring group, but the scene has several "
               "materials";
    const auto max_particles = std::size_t(multiprocessors) * max_resident_threads * max_resident_turns;
    const std::size_t own = problem.particle_count() - problem.ghosts.size();
    if (own > max_particles)
        return std::to_string(own) + " particles exceed the " + std::to_string(max_particles) + " that " +
               std::to_string(multiprocessors) +
               (multiprocessors == 1 ? " multiprocessor holds" : " multiprocessors hold");
    return {};
}

std::string block_refusal(const ResidentLayout& layout, const ResidentCard& card, ToolMode tool) {
    const auto beyond = [](int value, int most, const std::string& what) {
        return "a block would have " + std::to_string(value) + " " + what + ", and may have at most " +
               std::to_string(most);
    };
    const int turns = layout.turns > 1 ? max_resident_turns : 1;
    if (layout.lanes > card.threads * turns)
        return beyond(layout.lanes, card.threads * turns, "places for particles");
    const int rounds = layout.turns > 1 ? max_rounds_in_turns : max_resident_rounds;
    if (layout.rounds > rounds)
        return beyond(layout.rounds * layout.pollers, rounds * layout.pollers,
                      "places for neighbours in other blocks");
    const int slots = tool == ToolMode::ticks ? max_slots_in_ticks : max_resident_slots;
    if (layout.turns == 1 && layout.slots > slots) return beyond(layout.slots, slots, "points");
    if (layout.shared_bytes(tool) > card.shared_bytes)
        return beyond(int(layout.shared_bytes(tool)), int(card.shared_bytes), "bytes of shared memory");
    return {};
}

std::string sent_refusal(const std::vector<ResidentSending>& neighbours) {
    if (neighbours.size() < 2) return {};
    if (neighbours.size() > 2)
        return "a part of a body can send points to at most two other parts, but this one borders on " +
               std::to_string(neighbours.size()) + " others";
    const std::vector<std::uint32_t>&a = neighbours[0].particles, &b = neighbours[1].particles;
    std::vector<std::uint32_t> both;
    std::set_intersection(a.begin(), a.end(), b.begin(), b.end(), std::back_inserter(both));
    if (both.empty()) return {};
    return "a particle of this part is needed by both neighbours, but a thread can send it to one only";
}

std::vector<std::uint32_t> sent_by_lanes(const ResidentLayout& layout,
                                         const std::vector<ResidentSending>& neighbours) {
    std::vector<std::uint32_t> sent(layout.lane_count(), resident_none);
    for (std::size_t neighbour = 0; neighbour < neighbours.size(); ++neighbour) {
        const ResidentSending& sending = neighbours[neighbour];
        for (std::size_t n = 0; n < sending.particles.size(); ++n) {
            if (sending.words[n] == resident_none) continue;
            sent[layout.lane[sending.particles[n]]] =
                sending.words[n] | (neighbour == 0 ? 0 : second_neighbour);
        }
    }
    return sent;
}

std::vector<std::uint32_t> words_of_ghosts(const ResidentLayout& layout, const Problem& problem,
                                           const std::vector<std::uint32_t>& ghosts) {
    std::vector<std::uint32_t> words;
    for (const std::uint32_t ghost : ghosts) {
        const auto at = std::lower_bound(problem.ghosts.begin(), problem.ghosts.end(), ghost);
        words.push_back(layout.ghost_word[std::size_t(at - problem.ghosts.begin())]);
    }
    return words;
}

std::vector<std::uint32_t> held_by_lanes(const ResidentLayout& layout,
                                         const std::vector<std::uint32_t>& held) {
    std::vector<std::uint32_t> number(layout.particle.size(), resident_none);
    for (std::size_t lane = 0; lane < layout.particle.size(); ++lane) {
        const auto found = std::lower_bound(held.begin(), held.end(), layout.particle[lane]);
        if (found != held.end() && *found == layout.particle[lane])
            number[lane] = std::uint32_t(found - held.begin());
    }
    return number;
}

}  // namespace voxspring::layout
