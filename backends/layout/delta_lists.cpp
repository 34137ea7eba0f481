#include "backends/layout/delta_lists.h"

#include <algorithm>
#include <array>
#include <set>

#include "backends/layout/rounding.h"
#include "backends/layout/springs.h"
#include "backends/layout/work.h"

namespace voxspring::layout {
namespace {

// The number of unused words at either end of an array: in float32 they fill a cache line.
constexpr std::size_t guard_words = 8;

// Whether `middle` is the index of a particle, or one beyond either end. In that case the indices beside it
// are at most two beyond an end, where there are guard words.
bool within(std::int64_t middle, std::int64_t particles) { return middle >= -1 && middle <= particles; }

// Host threads build lists in chunks of this many particles, a multiple of a slice. No list goes on from one
// chunk to the next.
constexpr std::size_t chunk_particles = std::size_t(1) << 16;

/// The offset (dy, dz) of each row.
constexpr std::array<std::array<int, 2>, row_count> row_offsets = {{
#define OFFSET(row, dy, dz) {dy, dz},
    NEIGHBOUR_ROWS(OFFSET)
#undef OFFSET
}};

/// The list (RowDeltas) that a run of successive particles shares, while more particles join the run.
class GrowingList {
public:
    explicit GrowingList(std::int64_t begin) : begin_(begin) {}

    /// What a list must say about one row, to serve a particle.
    struct Wanted {
        bool any = false;          ///< whether the particle has a neighbour in the row
        std::int64_t middle = 0;   ///< the index that a neighbour at dx = 0 has or would have
        bool gap_matters = false;  ///< whether the particle has a neighbour at dx = 1
        bool gap = false;          ///< the bit of RowDeltas::gaps for this row
    };

    /// If this list can serve particle i too (of `particles` particles), adds it to the run and returns true.
    bool join(std::int64_t i, const std::array<Wanted, row_count>& wanted, std::int64_t particles) {
        GrowingList grown = *this;
        for (std::size_t r = 0; r < row_count; ++r) {
            const std::uint32_t bit = 1U << r;
            std::int32_t& delta = grown.list_.rows[r / 4].row[r % 4];
            const Wanted& row = wanted[r];
            if (!row.any) {
                // The kernel reads from this row even though the particle has no neighbour in it, and drops
                // what it read by the mask. So the index must be valid.
                if (!within(i + delta, particles)) return false;
                continue;
            }
            const auto needed = std::int32_t(row.middle - i);
            if ((known_ & bit) == 0) {
                if (!within(begin_ + needed, particles)) return false;
                grown.known_ |= bit;
                delta = needed;
            } else if (delta != needed) {
                return false;
            }
            if (!row.gap_matters) continue;
            const std::uint32_t gap = row.gap ? bit : 0;
            if ((gap_known_ & bit) != 0 && (list_.gaps & bit) != gap) return false;
            grown.gap_known_ |= bit;
            grown.list_.gaps |= gap;
        }
        *this = grown;
        return true;
    }
    /// A faster join() for particle i, which is at place x of its rows. `row`: the particles of each row of
    /// voxels; null: no row. This function looks only at the middle of each row. If it returns false, join()
    /// may still succeed.
    bool join_quickly(std::int64_t i, const std::array<const std::uint32_t*, row_count>& row, int x,
                      std::int64_t particles) {
        if (list_.gaps != 0) return false;
        for (std::size_t r = 0; r < row_count; ++r) {
            const std::int64_t middle = i + list_.rows[r / 4].row[r % 4];
            if (row[r] == nullptr ? !within(middle, particles) : std::int64_t(row[r][x]) != middle)
                return false;
        }
        // The list now says that no row has a gap. A later particle with a gap starts a new list.
        gap_known_ = (1U << row_count) - 1;
        return true;
    }
    const RowDeltas& list() const { return list_; }

private:
    std::int64_t begin_;
    std::uint32_t known_ = 0, gap_known_ = 0;
    RowDeltas list_{};
};

/// Finds the rows of voxels around a particle, and which particles are in them.
class RowReader {
public:
    RowReader(const Problem& problem, const std::vector<std::uint32_t>& particle)
        : lattice_(problem.lattice), particle_(particle) {
        for (std::size_t r = 0; r < row_count; ++r) {
            for (int dx = -1; dx <= 1; ++dx) {
                for (const Direction& direction : directions()) {
                    const bool here =
                        direction.offset == glm::ivec3(dx, row_offsets[r][0], row_offsets[r][1]);
                    if (here && (problem.group_bits >> direction.bit & 1U) != 0)
                        (dx == 0 ? middle_ : sides_)[r] = true;
                }
            }
        }
    }

    /// Goes to the particle in `voxel`.
    void go_to(std::uint32_t voxel) {
        const bool on = std::int64_t(voxel) == voxel_ + 1 && x_ + 1 < lattice_.dims.x;
        voxel_ = voxel;
        if (on) {
            ++x_;
            return;
        }
        const glm::ivec3 at = lattice_.coordinates(voxel);
        x_ = at.x;
        for (std::size_t r = 0; r < row_count; ++r) {
            const int y = at.y + row_offsets[r][0], z = at.z + row_offsets[r][1];
            const bool inside =
                (middle_[r] || sides_[r]) && y >= 0 && y < lattice_.dims.y && z >= 0 && z < lattice_.dims.z;
            row_[r] =
                inside ? particle_.data() + (std::size_t(z) * std::size_t(lattice_.dims.y) + std::size_t(y)) *
                                                std::size_t(lattice_.dims.x)
                       : nullptr;
        }
    }
    /// rows(): the particles in the voxels of each row around the particle; null if the row is outside of the
    /// lattice or not needed. x(): the particle's place along the rows.
    const std::array<const std::uint32_t*, row_count>& rows() const { return row_; }
    int x() const { return x_; }
    std::array<GrowingList::Wanted, row_count> wanted() const {
        std::array<GrowingList::Wanted, row_count> wanted{};
        for (std::size_t r = 0; r < row_count; ++r) {
            if (row_[r] == nullptr) continue;
            const auto at = [&](int x) { return x < 0 || x >= lattice_.dims.x ? no_particle : row_[r][x]; };
            const std::uint32_t before = sides_[r] ? at(x_ - 1) : no_particle;
            const std::uint32_t middle = at(x_);
            const std::uint32_t behind = sides_[r] ? at(x_ + 1) : no_particle;
            GrowingList::Wanted& row = wanted[r];
            row.any = before != no_particle || middle != no_particle || behind != no_particle;
            row.gap_matters = behind != no_particle;
            if (middle != no_particle) {
                row.middle = middle;
            } else if (before != no_particle) {
                row.middle = std::int64_t(before) + 1;
                row.gap = row.gap_matters;
            } else {
                row.middle = std::int64_t(behind) - 1;
            }
        }
        return wanted;
    }

private:
    const Lattice& lattice_;
    const std::vector<std::uint32_t>& particle_;
    std::array<bool, row_count> middle_{}, sides_{};  ///< per row: springs lead to dx = 0; to dx = -1 and 1
    /// The voxel of the latest particle. The initial value makes go_to() treat every first voxel as a new
    /// row.
    std::int64_t voxel_ = -2;
    int x_ = 0;
    std::array<const std::uint32_t*, row_count> row_{};
};

}  // namespace

Placement place_guarded(const Problem& problem) {
    return {.words = problem.particle_count() + 2 * guard_words, .first = guard_words};
}

DeltaLists compress_lists(const Problem& problem) {
    const std::size_t particles = problem.particle_count();
    DeltaLists compressed;
    compressed.slices.resize(units_of(particles, std::size_t(slice_particles)));
    const std::vector<std::uint32_t> particle = particle_of_voxel(problem.lattice);
    std::vector<std::vector<RowDeltas>> lists(units_of(particles, chunk_particles));
#pragma omp parallel for schedule(dynamic)
    for (std::ptrdiff_t n = 0; n < std::ptrdiff_t(lists.size()); ++n) {
        const auto chunk = std::size_t(n);
        RowReader rows(problem, particle);
        const std::size_t begin = chunk * chunk_particles;
        const std::size_t end = std::min(begin + chunk_particles, particles);
        GrowingList list{std::int64_t(begin)};
        for (std::size_t i = begin; i < end; ++i) {
            const auto here = std::int64_t(i), all = std::int64_t(particles);
            if (!particle.empty()) rows.go_to(problem.lattice.voxel[i]);
            if (i > begin && list.join_quickly(here, rows.rows(), rows.x(), all)) continue;
            const auto wanted = rows.wanted();
            if (i > begin && list.join(here, wanted, all)) continue;
            if (i > begin) lists[chunk].push_back(list.list());
            compressed.slices[i / slice_particles].starts |= 1U << i % slice_particles;
            list = GrowingList{here};
            list.join(here, wanted, all);
        }
        lists[chunk].push_back(list.list());
    }
    std::int32_t list = -1;
    for (Slice& slice : compressed.slices) {
        slice.list = list;
        list += std::popcount(slice.starts);
    }
    compressed.lists.reserve(std::size_t(list) + 1);
    for (const auto& of_chunk : lists)
        compressed.lists.insert(compressed.lists.end(), of_chunk.begin(), of_chunk.end());
    return compressed;
}

template <class Real>
OffLatticeLists<Real>::OffLatticeLists(const Problem& problem, const Placement& placement,
                                       Formulation formulation, std::span<Slice> slices)
    : formulation_(formulation), first_(placement.first), particles_(problem.particle_count()) {
    std::vector<std::uint32_t> count(particles_);
    for (const Spring& spring : problem.springs) {
        ++count[spring.first];
        ++count[spring.second];
    }
    for (std::uint32_t n = 0; n < slices.size(); ++n) {
        const auto begin = count.begin() + std::ptrdiff_t(n) * slice_particles;
        const auto end =
            count.begin() + std::ptrdiff_t(std::min((std::size_t(n) + 1) * slice_particles, particles_));
        const std::uint32_t most = *std::max_element(begin, end);
        slices[n].off_lattice_begin = slices[n].off_lattice_slots = 0;
        if (most > 0) extend(n, slices[n], most);
    }
    std::fill(count.begin(), count.end(), 0);
    for (const Spring& spring : problem.springs) {
        for (const std::uint32_t particle : {spring.first, spring.second})
            put(element(slices[particle / slice_particles], particle, count[particle]++), problem, particle,
                spring);
    }
}

template <class Real>
void OffLatticeLists<Real>::extend(std::uint32_t number, Slice& slice, std::uint32_t slots) {
    const Slice old = slice;
    slice.off_lattice_begin = std::uint32_t(columns());
    slice.off_lattice_slots = rounded_up(slots, std::uint32_t(off_lattice_chunk));
    const std::size_t size =
        (std::size_t(slice.off_lattice_begin) + slice.off_lattice_slots) * slice_particles;
    neighbour_.resize(size);
    constants_.resize(size, {0, 0});
    if (!on_positions(formulation_)) off_lattice_rest_.resize(size);
    for (std::uint32_t slot = 0; slot < slice.off_lattice_slots; ++slot) {
        for (std::uint32_t lane = 0; lane < slice_particles; ++lane) {
            const std::uint32_t particle = number * slice_particles + lane;
            const std::size_t to = element(slice, particle, slot);
            clear(to, particle);
            if (slot >= old.off_lattice_slots) continue;
            const std::size_t from = element(old, particle, slot);
            neighbour_[to] = neighbour_[from];
            constants_[to] = constants_[from];
            if (!off_lattice_rest_.empty()) off_lattice_rest_[to] = off_lattice_rest_[from];
        }
    }
}

template <class Real>
void OffLatticeLists<Real>::put(std::size_t element, const Problem& problem, std::uint32_t particle,
                                const Spring& spring) {
    const std::uint32_t neighbour = spring.first == particle ? spring.second : spring.first;
    neighbour_[element] = std::uint32_t(first_ + neighbour);
    constants_[element] = {Real(spring.stiffness), listed_length<Real>(spring, formulation_)};
    if (!on_positions(formulation_))
        off_lattice_rest_[element] =
            off_lattice_rest_of<Real>(problem, particle, neighbour, spring.rest_length);
}

template <class Real>
void OffLatticeLists<Real>::clear(std::size_t element, std::uint32_t particle) {
    // In an unused slot the neighbour is the particle itself. The last slice may have fewer particles than
    // lanes; in the slots of lanes without a particle the neighbour is the first particle.
    neighbour_[element] = std::uint32_t(first_ + (particle < particles_ ? particle : 0));
    constants_[element] = {0, 0};
    if (!off_lattice_rest_.empty()) off_lattice_rest_[element] = {};
}

template <class Real>
typename OffLatticeLists<Real>::Changes OffLatticeLists<Real>::change(const Problem& edited,
                                                                      const SpringEdit& edit,
                                                                      std::span<Slice> slices) {
    std::set<std::uint32_t> changed;
    for (const SpringEdit::Touched& touched : edit.touched) {
        const auto listed = edit.springs_of(touched);
        // In `listed` the springs beyond the lattice come last.
        const auto own = std::find_if(listed.begin(), listed.end(),
                                      [](const ListedSpring& spring) { return spring.bit < 0; });
        const auto count = std::uint32_t(listed.end() - own);
        const std::uint32_t number = touched.particle / slice_particles;
        Slice& slice = slices[number];
        if (count > slice.off_lattice_slots) extend(number, slice, count);
        if (slice.off_lattice_slots == 0) continue;
        changed.insert(number);
        for (std::uint32_t slot = 0; slot < slice.off_lattice_slots; ++slot) {
            const std::size_t at = element(slice, touched.particle, slot);
            if (slot < count) {
                const ListedSpring& spring = *(own + slot);
                put(at, edited, touched.particle,
                    Spring{touched.particle, spring.neighbour, spring.stiffness, spring.rest_length});
            } else {
                clear(at, touched.particle);
            }
        }
    }
    Changes changes;
    NeighbourLists<Real>& columns = changes.columns.lists;
    columns.shape = {.particle_stride = slice_particles, .slot_stride = 1, .slots = slice_particles};
    for (const std::uint32_t number : changed) {
        const Slice& slice = slices[number];
        changes.slices.push_back({number, slice});
        const auto append = [&](auto& to, const auto& from) {
            if (from.empty()) return;
            const auto begin = from.begin() + std::ptrdiff_t(element(slice, number * slice_particles, 0));
            to.insert(to.end(), begin, begin + std::ptrdiff_t(slice.off_lattice_slots) * slice_particles);
        };
        for (std::uint32_t slot = 0; slot < slice.off_lattice_slots; ++slot)
            changes.columns.particle.push_back(slice.off_lattice_begin + slot);
        append(columns.neighbour, neighbour_);
        append(columns.constants, constants_);
        append(columns.off_lattice_rest, off_lattice_rest_);
    }
    return changes;
}

template <class Real>
DeltaStep<Real> make_delta_step(const Problem& problem, const Placement& placement, Formulation formulation) {
    DeltaStep<Real> step{};
    static_cast<ImplicitStep<Real>&>(step) = make_implicit_step<Real>(problem, placement, formulation);
    step.particles = int(problem.particle_count());
    return step;
}

template <class Real>
StepWork delta_work(const Problem& problem, Formulation formulation) {
    StepWork work = implicit_work<Real>(problem, formulation);
    const std::uint64_t off_lattice_ends = 2 * count_springs(problem).beyond;
    work.read_once(units_of(problem.particle_count(), std::size_t(slice_particles)) * sizeof(Slice) +
                   off_lattice_ends * (sizeof(std::uint32_t) + sizeof(SpringConstants<Real>)) +
                   2 * off_lattice_rest_bytes<Real>(problem, formulation));
    work.operations += off_lattice_ends;  // each density times its stiffness
    return work;
}

#define FOR_PRECISION(Real)                                          \
    template class OffLatticeLists<Real>;                            \
    template StepWork delta_work<Real>(const Problem&, Formulation); \
    template DeltaStep<Real> make_delta_step(const Problem&, const Placement&, Formulation);
FOR_PRECISION(float)
FOR_PRECISION(double)
#undef FOR_PRECISION

}  // namespace voxspring::layout
