#include "backends/layout/layout.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <glm/geometric.hpp>
#include <set>
#include <sstream>

#include "backends/physics/inverse_root.h"
#include "backends/physics/spring.h"

namespace voxspring::cuda {
namespace {

// Signed, as OpenMP's loops were made for.
std::ptrdiff_t count_of(const Problem& problem) { return std::ptrdiff_t(problem.particle_count()); }

template <class Real>
Vector<Real> vector_of(const glm::dvec3& v) {
    return {Real(v.x), Real(v.y), Real(v.z)};
}

template <class Real>
glm::dvec3 dvec_of(const Vector<Real>& v) {
    return {double(v.x), double(v.y), double(v.z)};
}

template <class Real>
glm::dvec3 low_part(const glm::dvec3& v) {
    return v - dvec_of(vector_of<Real>(v));
}

std::size_t rounded_up(std::size_t value, std::uint32_t multiple) {
    return (value + multiple - 1) / multiple * multiple;
}

// 128 bytes of list entries: columns of vertical lists begin on a cache line.
constexpr std::uint32_t pitch_multiple = 32;

ListShape make_shape(std::size_t particles, std::uint32_t slots, ListLayout layout) {
    if (layout == ListLayout::concatenated)
        return {.particle_stride = slots, .slot_stride = 1, .slots = slots};
    return {.particle_stride = 1,
            .slot_stride = std::uint32_t(rounded_up(particles, pitch_multiple)),
            .slots = slots};
}

template <class Real>
void start_lists(NeighbourLists<Real>& lists, const Problem& problem, std::uint32_t slots,
                 ListLayout layout) {
    lists.shape = make_shape(problem.particle_count(), slots, layout);
    lists.neighbour.resize(list_size(problem.particle_count(), slots, layout));
    lists.bits = state_bits(problem);
}

// RestSpring has the offset from the neighbour, SpringRest that to it.
template <class Real>
SpringRest<Real> packed_rest(const RestSpring& rest) {
    return {vector_of<Real>(-rest.offset), Real(rest.deficit)};
}

// What names neighbour `index`, which lies in the direction of mask bit `bit`; negative: in none.
std::uint32_t entry_of(std::uint32_t index, int bit, Formulation formulation) {
    if (on_positions(formulation)) return index;
    return index | (bit < 0 ? OWN_DIRECTION : std::uint32_t(bit)) << LISTED_INDEX_BITS;
}

// An unused slot holds its own particle.
template <class Real>
void fill_unused(NeighbourLists<Real>& lists, std::uint32_t row, std::uint32_t particle, std::uint32_t begin,
                 std::uint32_t end, Formulation formulation) {
    for (std::uint32_t slot = begin; slot < end; ++slot)
        lists.neighbour[lists.shape.at(row, slot)] = entry_of(particle, NO_DIRECTION, formulation);
}

std::uint32_t mask_of(const Problem& problem, std::size_t particle) {
    return problem.lattice.mask.empty() ? 0 : problem.lattice.mask[particle];
}

constexpr std::array<std::uint32_t, 3> group_masks = {FACE_BITS, EDGE_BITS, CORNER_BITS};
constexpr std::array<std::uint32_t, 3> group_slots = {6, 12, 8};

// Where each group begins in a list, and where the last one ends.
std::array<std::uint32_t, 4> group_slots_of(const Problem& problem) {
    std::array<std::uint32_t, 4> first{};
    for (std::size_t g = 0; g < 3; ++g)
        first[g + 1] = first[g] + ((problem.group_bits & group_masks[g]) != 0 ? group_slots[g] : 0);
    first[3] = std::max(first[3], 1U);
    return first;
}

}  // namespace

Placement place_on_grid(const Lattice& lattice) {
    const std::size_t slice = std::size_t(lattice.dims.x) * std::size_t(lattice.dims.y);
    // Voxel 0 begins on a cache line.
    const std::size_t guard = (slice + std::size_t(lattice.dims.x) + 1 + 7) / 8 * 8;
    return {.words = lattice.voxel_count() + 2 * guard, .first = guard, .voxel = &lattice.voxel};
}

Placement place_compact(const Problem& problem) { return {.words = problem.particle_count()}; }

std::size_t increment_pitch(const Placement& placement) {
    return rounded_up(placement.words, pitch_multiple);
}

template <class Real>
PackedState<Real> pack(const Problem& problem, const State& state, const Placement& placement,
                       std::span<const std::uint32_t> bits, Formulation formulation) {
    const bool increments = by_increments(formulation), split = formulation == Formulation::compensated;
    PackedState<Real> packed;
    packed.current.resize(placement.words);
    if (!increments) packed.previous.resize(placement.words);
    if (split) packed.current_low.resize(placement.words);
    const std::size_t pitch = increment_pitch(placement);
    if (increments) packed.increment.resize(3 * pitch);
    if (split) packed.increment_low.resize(3 * pitch);
#pragma omp parallel for
    for (std::ptrdiff_t n = 0; n < count_of(problem); ++n) {
        const auto i = std::size_t(n);
        const std::size_t at = placement.at(i);
        glm::dvec3 point = state.displacement[i];
        if (on_positions(formulation)) point += problem.rest_position[i];
        packed.current[at] = {vector_of<Real>(point), bits[i]};
        if (!increments) packed.previous[at] = {vector_of<Real>(point - state.increment[i]), bits[i]};
        if (split) packed.current_low[at] = {vector_of<Real>(low_part<Real>(point)), 0};
        for (std::size_t axis = 0; axis < 3; ++axis) {
            const double v = state.increment[i][int(axis)];
            if (increments) packed.increment[axis * pitch + at] = Real(v);
            if (split) packed.increment_low[axis * pitch + at] = Real(v - double(Real(v)));
        }
    }
    return packed;
}

template <class Real>
State unpack(const Problem& problem, const PackedState<Real>& packed, const Placement& placement,
             Formulation formulation) {
    const bool increments = by_increments(formulation), split = formulation == Formulation::compensated;
    const std::size_t pitch = increment_pitch(placement);
    State state = state_at_rest(problem);
#pragma omp parallel for
    for (std::ptrdiff_t n = 0; n < count_of(problem); ++n) {
        const auto i = std::size_t(n);
        const std::size_t at = placement.at(i);
        const glm::dvec3 point = dvec_of(packed.current[at].position);
        state.displacement[i] = on_positions(formulation) ? point - problem.rest_position[i] : point;
        if (!increments) state.increment[i] = point - dvec_of(packed.previous[at].position);
        if (split) state.displacement[i] += dvec_of(packed.current_low[at].position);
        for (std::size_t axis = 0; axis < 3; ++axis) {
            double& v = state.increment[i][int(axis)];
            if (increments) v = double(packed.increment[axis * pitch + at]);
            if (split) v += double(packed.increment_low[axis * pitch + at]);
        }
    }
    return state;
}

template <class Real>
std::vector<Vector<Real>> pack_load(const Problem& problem, const Placement& placement) {
    if (problem.load.empty()) return {};
    std::vector<Vector<Real>> load(placement.words, Vector<Real>{0, 0, 0});
    for (std::size_t i = 0; i < problem.particle_count(); ++i)
        load[placement.at(i)] = vector_of<Real>(problem.load[i]);
    return load;
}

template <class Real>
std::vector<Real> pack_inverse_masses(const Problem& problem, const Placement& placement) {
    if (!problem.has_materials()) return {};
    std::vector<Real> inverse(placement.words);
    for (std::size_t i = 0; i < problem.particle_count(); ++i)
        inverse[placement.at(i)] = Real(1 / problem.material_of(i).mass);
    return inverse;
}

template <class Real>
std::vector<Real> pack_compliance(const Problem& problem, const Placement& placement) {
    if (!problem.has_materials()) return {};
    std::vector<Real> compliance(placement.words);
    for (std::size_t i = 0; i < problem.particle_count(); ++i)
        compliance[placement.at(i)] = Real(1 / problem.material_of(i).stiffness);
    return compliance;
}

template <class Real>
Motion<Real> make_motion(const Problem& problem) {
    return {.gravity = vector_of<Real>(problem.gravity),
            .inverse_mass = Real(1 / problem.materials.front().mass),
            .inverse_masses = nullptr,
            .load = nullptr,
            .damping = Real(problem.damping),
            .retained = Real(1 - problem.damping),
            .doubled = Real(2 - problem.damping),
            .time_step_squared = Real(problem.time_step * problem.time_step),
            .shortest_squared = Real(problem.shortest_squared())};
}

double squared_rest_length(const Problem& problem, const Direction& direction) {
    const glm::dvec3 offset = glm::dvec3(direction.offset) * problem.lattice.spacing;
    const double rest_length = problem.rest_length[std::size_t(direction.bit)];
    const double squared = glm::dot(offset, offset);
    return rest_length == std::sqrt(squared) ? squared : rest_length * rest_length;
}

template <class Real>
Real listed_length(const Problem& problem, const Direction& direction, Formulation formulation) {
    const RestSpring rest = rest_spring(problem, direction);
    if (by_increments(formulation)) return Real(rest.length);
    if (on_positions(formulation) || rest.deficit != 0) return Real(squared_rest_length(problem, direction));
    const Vector<Real> offset = vector_of<Real>(rest.offset);
    return squared_length(offset.x, offset.y, offset.z, Real(problem.shortest_squared()));
}

template <class Real>
Real listed_length(const Spring& spring, Formulation formulation) {
    return Real(by_increments(formulation) ? spring.rest_length : spring.rest_length * spring.rest_length);
}

template <class Real>
SpringRest<Real> own_rest_of(const Problem& problem, std::uint32_t particle, std::uint32_t neighbour,
                             double rest_length) {
    return packed_rest<Real>(rest_spring(problem, Spring{particle, neighbour, 0, rest_length}));
}

template <class Real>
std::array<SpringRest<Real>, direction_codes> rest_by_code(const Problem& problem) {
    std::array<SpringRest<Real>, direction_codes> rest{};
    if (problem.lattice.voxel_count() == 0) return rest;
    for (const Direction& direction : directions())
        rest[std::size_t(direction.bit)] = packed_rest<Real>(rest_spring(problem, direction));
    return rest;
}

std::string beyond_entries(const Problem& problem, Formulation formulation) {
    if (on_positions(formulation) || problem.particle_count() <= LISTED_INDEX) return {};
    return std::to_string(problem.particle_count()) + " particles exceed the " +
           std::to_string(LISTED_INDEX) + " that a list entry with a direction can name";
}

std::string beyond_groups(const Problem& problem) {
    if (problem.lattice.voxel_count() == 0) return "the network lies on no regular grid";
    if (!problem.springs.empty()) return "springs between particles that are no grid neighbours";
    if (problem.has_materials()) return "several materials give the springs of a group several stiffnesses";
    for (const Direction& a : directions()) {
        for (const Direction& b : directions()) {
            const bool used = (problem.group_bits >> a.bit & problem.group_bits >> b.bit & 1U) != 0;
            if (used && a.group == b.group &&
                squared_rest_length(problem, a) != squared_rest_length(problem, b))
                return "the springs of a group have several rest lengths";
        }
    }
    return {};
}

std::size_t list_size(std::size_t particles, std::uint32_t slots, ListLayout layout) {
    const ListShape shape = make_shape(particles, slots, layout);
    return layout == ListLayout::vertical ? std::size_t(shape.slot_stride) * slots : particles * slots;
}

std::uint32_t slots_by_groups(const Problem& problem) { return group_slots_of(problem)[3]; }

std::uint32_t slots_by_springs(const Problem& problem) {
    std::vector<std::uint32_t> degree(problem.particle_count());
    for (std::size_t i = 0; i < degree.size(); ++i)
        degree[i] = std::uint32_t(std::popcount(mask_of(problem, i) & NEIGHBOUR_BITS));
    for (const Spring& spring : problem.springs) {
        ++degree[spring.first];
        ++degree[spring.second];
    }
    const std::uint32_t most = degree.empty() ? 0 : *std::max_element(degree.begin(), degree.end());
    return std::uint32_t(rounded_up(std::max(most, 1U), list_chunk));
}

namespace {

// Fills list `row` with a particle's springs: visit(add) calls add(bit, neighbour) for each.
template <class Real, class Visit>
void fill_by_groups(NeighbourLists<Real>& lists, std::uint32_t row, std::uint32_t particle,
                    const std::array<std::uint32_t, 4>& first, Formulation formulation, Visit visit) {
    std::array<std::uint32_t, 3> count{};
    visit([&](int bit, std::uint32_t neighbour) {
        const auto g = std::size_t(directions()[std::size_t(bit)].group);
        lists.neighbour[lists.shape.at(row, first[g] + count[g]++)] = entry_of(neighbour, bit, formulation);
    });
    for (std::size_t g = 0; g < 3; ++g) {
        lists.bits[row] |= count[g] << GroupCounters::shift(int(g));
        fill_unused(lists, row, particle, first[g] + count[g], first[g + 1], formulation);
    }
}

// Appends to list `row`, whose bits count its springs. Returns where.
template <class Real>
std::size_t append(NeighbourLists<Real>& lists, std::uint32_t row, std::uint32_t entry, double stiffness,
                   Real rest_length) {
    const std::size_t at = lists.shape.at(row, lists.bits[row] & list_count_bits);
    lists.neighbour[at] = entry;
    lists.constants[at] = {Real(stiffness), rest_length};
    ++lists.bits[row];
    return at;
}

// Appends a spring beyond the lattice to the list `row` of `particle`.
template <class Real>
void append_own(NeighbourLists<Real>& lists, const Problem& problem, std::uint32_t row,
                std::uint32_t particle, const Spring& spring, Formulation formulation) {
    const std::uint32_t neighbour = spring.first == particle ? spring.second : spring.first;
    const std::size_t at = append(lists, row, entry_of(neighbour, -1, formulation), spring.stiffness,
                                  listed_length<Real>(spring, formulation));
    if (!on_positions(formulation))
        lists.own_rest[at] = own_rest_of<Real>(problem, particle, neighbour, spring.rest_length);
}

template <class Real>
std::array<Real, neighbour_count> listed_lengths(const Problem& problem, Formulation formulation) {
    std::array<Real, neighbour_count> lengths{};
    for (const Direction& direction : directions())
        lengths[std::size_t(direction.bit)] = listed_length<Real>(problem, direction, formulation);
    return lengths;
}

// Makes room for what list_by_springs() has beside neighbours.
template <class Real>
void start_constants(NeighbourLists<Real>& lists, const Problem& problem, Formulation formulation) {
    lists.constants.resize(lists.neighbour.size(), {0, 0});
    if (!problem.springs.empty() && !on_positions(formulation)) lists.own_rest.resize(lists.neighbour.size());
}

template <class Real>
EditedLists<Real> start_edited(const SpringEdit& edit, std::uint32_t slots) {
    EditedLists<Real> edited;
    edited.lists.shape = make_shape(edit.touched.size(), slots, ListLayout::concatenated);
    edited.lists.neighbour.resize(edit.touched.size() * slots);
    for (const SpringEdit::Touched& touched : edit.touched) {
        edited.particle.push_back(touched.particle);
        edited.lists.bits.push_back(touched.mask & (ACTIVE_BIT | PINNED_BIT));
    }
    return edited;
}

}  // namespace

template <class Real>
NeighbourLists<Real> list_by_groups(const Problem& problem, ListLayout layout, Formulation formulation) {
    NeighbourLists<Real> lists;
    start_lists(lists, problem, slots_by_groups(problem), layout);
    const auto first = group_slots_of(problem);
    std::copy_n(first.begin(), 3, lists.first_slot.begin());
    const LatticeSprings springs(problem);
#pragma omp parallel for
    for (std::ptrdiff_t n = 0; n < count_of(problem); ++n) {
        const auto i = std::uint32_t(n);
        fill_by_groups(lists, i, i, first, formulation, [&](auto add) {
            springs.all_of(i, [&](std::uint32_t j, const Direction& direction) { add(direction.bit, j); });
        });
    }
    return lists;
}

template <class Real>
NeighbourLists<Real> list_by_springs(const Problem& problem, ListLayout layout, Formulation formulation) {
    NeighbourLists<Real> lists;
    start_lists(lists, problem, slots_by_springs(problem), layout);
    start_constants(lists, problem, formulation);
    const auto lengths = listed_lengths<Real>(problem, formulation);
    const LatticeSprings springs(problem);
#pragma omp parallel for
    for (std::ptrdiff_t n = 0; n < count_of(problem); ++n) {
        const auto i = std::uint32_t(n);
        springs.all_of(i, [&](std::uint32_t j, const Direction& direction) {
            append(lists, i, entry_of(j, direction.bit, formulation),
                   problem.spring_stiffness(i, j, direction), lengths[std::size_t(direction.bit)]);
        });
    }
    for (const Spring& spring : problem.springs) {
        append_own(lists, problem, spring.first, spring.first, spring, formulation);
        append_own(lists, problem, spring.second, spring.second, spring, formulation);
    }
#pragma omp parallel for
    for (std::ptrdiff_t n = 0; n < count_of(problem); ++n) {
        const auto i = std::uint32_t(n);
        fill_unused(lists, i, i, lists.bits[i] & list_count_bits, lists.shape.slots, formulation);
    }
    return lists;
}

std::uint32_t longest_list(const SpringEdit& edit) {
    std::uint32_t longest = 0;
    for (const SpringEdit::Touched& touched : edit.touched)
        longest = std::max(longest, touched.end - touched.begin);
    return longest;
}

template <class Real>
EditedLists<Real> edited_by_groups(const Problem& problem, const SpringEdit& edit, std::uint32_t slots,
                                   Formulation formulation) {
    EditedLists<Real> edited = start_edited<Real>(edit, slots);
    const auto first = group_slots_of(problem);
    for (std::uint32_t row = 0; row < edit.touched.size(); ++row) {
        fill_by_groups(edited.lists, row, edit.touched[row].particle, first, formulation, [&](auto add) {
            for (const ListedSpring& s : edit.springs_of(edit.touched[row])) add(s.bit, s.neighbour);
        });
    }
    return edited;
}

template <class Real>
EditedLists<Real> edited_by_springs(const Problem& problem, const SpringEdit& edit, std::uint32_t slots,
                                    Formulation formulation) {
    EditedLists<Real> edited = start_edited<Real>(edit, slots);
    start_constants(edited.lists, problem, formulation);
    const auto lengths = listed_lengths<Real>(problem, formulation);
    for (std::uint32_t row = 0; row < edit.touched.size(); ++row) {
        const std::uint32_t particle = edit.touched[row].particle;
        for (const ListedSpring& s : edit.springs_of(edit.touched[row])) {
            if (s.bit < 0) {
                append_own(edited.lists, problem, row, particle,
                           Spring{particle, s.neighbour, s.stiffness, s.rest_length}, formulation);
            } else {
                append(edited.lists, row, entry_of(s.neighbour, s.bit, formulation), s.stiffness,
                       lengths[std::size_t(s.bit)]);
            }
        }
        fill_unused(edited.lists, row, particle, edited.lists.bits[row] & list_count_bits, slots,
                    formulation);
    }
    return edited;
}

template <class Real>
SpringArrays<Real> list_every_spring(const Problem& problem, Formulation formulation) {
    const std::size_t total = count_springs(problem).total();
    SpringArrays<Real> springs;
    springs.ends.resize(total);
    springs.constants.resize(total);
    if (!problem.springs.empty() && !on_positions(formulation)) springs.own_rest.resize(total);
    auto& begin = springs.begin;
    for (const std::uint32_t mask : problem.lattice.mask) {
        // Each spring once: the odd bits point to a higher voxel.
        for (std::size_t bit = 1; bit < neighbour_count; bit += 2) begin[bit + 1] += mask >> bit & 1U;
    }
    for (std::size_t bit = 0; bit < neighbour_count; ++bit) begin[bit + 1] += begin[bit];

    const auto particle = particle_of_voxel(problem.lattice);
#pragma omp parallel for schedule(dynamic)
    for (int bit = 1; bit < neighbour_count; bit += 2) {
        const Direction& direction = directions()[std::size_t(bit)];
        const Real length = listed_length<Real>(problem, direction, formulation);
        std::size_t s = begin[std::size_t(bit)];
        for (std::size_t i = 0; i < problem.lattice.mask.size(); ++i) {
            if ((problem.lattice.mask[i] >> bit & 1U) == 0) continue;
            const std::uint32_t j = particle[std::size_t(std::ptrdiff_t(problem.lattice.voxel[i]) +
                                                         problem.lattice.stride(direction))];
            springs.ends[s] = {std::uint32_t(i), entry_of(j, bit, formulation)};
            springs.constants[s++] = {Real(problem.spring_stiffness(i, j, direction)), length};
        }
    }
    std::size_t s = begin[neighbour_count];
    for (const Spring& spring : problem.springs) {
        springs.ends[s] = {spring.first, entry_of(spring.second, -1, formulation)};
        if (!springs.own_rest.empty())
            springs.own_rest[s] = own_rest_of<Real>(problem, spring.first, spring.second, spring.rest_length);
        springs.constants[s++] = {Real(spring.stiffness), listed_length<Real>(spring, formulation)};
    }
    return springs;
}

SpringSlots::SpringSlots(const Problem& problem, const std::array<std::size_t, neighbour_count + 1>& begin,
                         Formulation formulation)
    : listed_(&problem),
      formulation_(formulation),
      begin_(begin),
      used_(begin.back() + problem.springs.size()) {
    std::size_t slot = begin.back();
    for (const Spring& spring : problem.springs)
        others_.emplace(std::pair(spring.first, spring.second), slot++);
}

bool SpringSlots::was_listed(const ChangedSpring& changed) const {
    return changed.bit >= 0 && (listed_->lattice.mask[changed.spring.first] >> changed.bit & 1U) != 0;
}

SpringSlots::Range SpringSlots::remove(const ChangedSpring& changed, std::vector<std::size_t>& freed) {
    if (was_listed(changed)) return {begin_[std::size_t(changed.bit)], begin_[std::size_t(changed.bit) + 1]};
    const auto found = others_.find({changed.spring.first, changed.spring.second});
    const std::size_t slot = found->second;
    others_.erase(found);
    freed.push_back(slot);
    return {slot, slot};
}

SpringSlots::Range SpringSlots::add(const ChangedSpring& changed) {
    if (was_listed(changed)) return {begin_[std::size_t(changed.bit)], begin_[std::size_t(changed.bit) + 1]};
    std::size_t slot = used_;
    if (free_.empty()) {
        ++used_;
    } else {
        slot = free_.back();
        free_.pop_back();
    }
    others_.emplace(std::pair(changed.spring.first, changed.spring.second), slot);
    return {slot, slot};
}

template <class Real>
std::vector<EditedSpring<Real>> SpringSlots::slots_of(const SpringEdit& edit) {
    std::vector<EditedSpring<Real>> edited;
    edited.reserve(edit.removed.size() + edit.added.size());
    const auto write = [&](const ChangedSpring& changed, Range range, double stiffness) {
        const Spring& spring = changed.spring;
        const bool own = changed.bit < 0;
        const Real length =
            own ? listed_length<Real>(spring, formulation_)
                : listed_length<Real>(*listed_, directions()[std::size_t(changed.bit)], formulation_);
        SpringRest<Real> rest{};
        if (own && !on_positions(formulation_))
            rest = own_rest_of<Real>(*listed_, spring.first, spring.second, spring.rest_length);
        edited.push_back({{spring.first, entry_of(spring.second, changed.bit, formulation_)},
                          range.first,
                          range.second,
                          {Real(stiffness), length},
                          rest,
                          !by_increments(formulation_)});
    };
    // A listed spring that goes and comes back stays.
    std::set<std::pair<std::uint32_t, int>> back;
    for (const ChangedSpring& changed : edit.added) {
        if (!edit.removed.empty() && was_listed(changed)) back.emplace(changed.spring.first, changed.bit);
    }
    std::vector<std::size_t> freed;
    for (const ChangedSpring& changed : edit.removed) {
        if (!was_listed(changed) || !back.contains({changed.spring.first, changed.bit}))
            write(changed, remove(changed, freed), 0);
    }
    for (const ChangedSpring& changed : edit.added) write(changed, add(changed), changed.spring.stiffness);
    free_.insert(free_.end(), freed.begin(), freed.end());
    return edited;
}

std::vector<std::uint32_t> state_bits(const Problem& problem) {
    std::vector<std::uint32_t> bits(problem.particle_count(), ACTIVE_BIT);
    for (std::size_t i = 0; i < bits.size(); ++i) {
        if (problem.is_pinned(i)) bits[i] |= PINNED_BIT;
    }
    return bits;
}

template <class Real>
ImplicitStep<Real> make_implicit_step(const Problem& problem, const Placement& placement,
                                      Formulation formulation) {
    ImplicitStep<Real> step{};
    step.nx = problem.lattice.dims.x;
    step.ny = problem.lattice.dims.y;
    step.nz = problem.lattice.dims.z;
    step.first = int(placement.first);
    step.group_bits = problem.group_bits;
    step.spacing = vector_of<Real>(problem.lattice.spacing);
    for (std::size_t b = 0; b < 13; ++b) {
        const Direction& direction = directions()[2 * b];
        step.rest_length[b] = listed_length<Real>(problem, direction, formulation);
        step.deficit[b] = Real(rest_spring(problem, direction).deficit);
    }
    for (std::size_t g = 0; g < 3; ++g) step.stiffness[g] = Real(problem.group_stiffness[g]);
    step.motion = make_motion<Real>(problem);
    return step;
}

template <class Real>
ExplicitStep<Real> make_explicit_step(const Problem& problem, const NeighbourLists<Real>& lists,
                                      Formulation formulation) {
    ExplicitStep<Real> step{};
    step.particles = int(problem.particle_count());
    step.group_bits = problem.group_bits;
    step.shape = lists.shape;
    for (std::size_t g = 0; g < 3; ++g) {
        step.first_slot[g] = lists.first_slot[g];
        step.stiffness[g] = Real(problem.group_stiffness[g]);
    }
    // beyond_groups() compared the others of the group.
    for (const Direction& direction : directions())
        step.rest_length[std::size_t(direction.group)] = listed_length<Real>(problem, direction, formulation);
    std::ranges::copy(rest_by_code<Real>(problem), step.rest);
    step.motion = make_motion<Real>(problem);
    return step;
}

template <class Real>
ScatterStep<Real> make_scatter_step(const Problem& problem, const SpringArrays<Real>& springs) {
    ScatterStep<Real> step{};
    step.particles = int(problem.particle_count());
    step.group_bits = problem.group_bits;
    step.springs = springs.ends.size();
    std::ranges::copy(rest_by_code<Real>(problem), step.rest);
    step.motion = make_motion<Real>(problem);
    return step;
}

std::uint32_t terms_of(const Problem& problem) {
    return (problem.has_materials() ? term_materials : 0) | (problem.damping != 0 ? term_damping : 0) |
           (problem.has_gravity() ? term_gravity : 0) | (problem.pinned.empty() ? 0 : term_pins) |
           (problem.load.empty() ? 0 : term_loads);
}

BlockShape BlockShape::parse(const std::string& text) {
    BlockShape shape;
    std::istringstream stream(text);
    char separator = 0;
    stream >> shape.x >> separator >> shape.y >> separator >> shape.z;
    shape.y = std::max(shape.y, 1);
    shape.z = std::max(shape.z, 1);
    return shape;
}

namespace {

int whole_blocks(int extent, int block) { return (extent + block - 1) / block; }

}  // namespace

BlockGrid::BlockGrid(const Lattice& lattice, BlockShape shape)
    : shape_(shape),
      row_(std::size_t(whole_blocks(lattice.dims.x, shape.x)) + 2),
      slice_((std::size_t(whole_blocks(lattice.dims.y, shape.y)) + 2) * row_),
      places_((std::size_t(whole_blocks(lattice.dims.z, shape.z)) + 2) * slice_) {}

std::vector<BlockOrigin> list_blocks(const Lattice& lattice, BlockShape shape) {
    const BlockGrid grid(lattice, shape);
    std::vector<std::uint8_t> active(grid.places());
    for (const std::uint32_t voxel : lattice.voxel) active[grid.place_of(lattice, voxel)] = 1;
    std::vector<BlockOrigin> origins;
    for (int z = 0; z * shape.z < lattice.dims.z; ++z) {
        for (int y = 0; y * shape.y < lattice.dims.y; ++y) {
            for (int x = 0; x * shape.x < lattice.dims.x; ++x) {
                const std::size_t place = grid.place(x, y, z);
                if (active[place] != 0)
                    origins.push_back({x * shape.x, y * shape.y, z * shape.z, int(place)});
            }
        }
    }
    return origins;
}

std::vector<BlockOrigin> active_blocks(const Lattice& lattice, BlockShape shape) {
    std::vector<BlockOrigin> origins = list_blocks(lattice, shape);
    const std::int64_t x = whole_blocks(lattice.dims.x, shape.x), y = whole_blocks(lattice.dims.y, shape.y),
                       z = whole_blocks(lattice.dims.z, shape.z);
    constexpr int most_blocks = 65535;  // along y and z
    if (std::int64_t(origins.size()) == x * y * z && y <= most_blocks && z <= most_blocks) return {};
    return origins;
}

#define FOR_PRECISION(Real)                                                                         \
    template Real listed_length(const Spring&, Formulation);                                        \
    template SpringRest<Real> own_rest_of(const Problem&, std::uint32_t, std::uint32_t, double);    \
    template PackedState<Real> pack(const Problem&, const State&, const Placement&,                 \
                                    std::span<const std::uint32_t>, Formulation);                   \
    template State unpack(const Problem&, const PackedState<Real>&, const Placement&, Formulation); \
    template std::vector<Vector<Real>> pack_load(const Problem&, const Placement&);                 \
    template std::vector<Real> pack_inverse_masses(const Problem&, const Placement&);               \
    template std::vector<Real> pack_compliance(const Problem&, const Placement&);                   \
    template Motion<Real> make_motion(const Problem&);                                              \
    template NeighbourLists<Real> list_by_groups(const Problem&, ListLayout, Formulation);          \
    template NeighbourLists<Real> list_by_springs(const Problem&, ListLayout, Formulation);         \
    template EditedLists<Real> edited_by_groups(const Problem&, const SpringEdit&, std::uint32_t,   \
                                                Formulation);                                       \
    template EditedLists<Real> edited_by_springs(const Problem&, const SpringEdit&, std::uint32_t,  \
                                                 Formulation);                                      \
    template ImplicitStep<Real> make_implicit_step(const Problem&, const Placement&, Formulation);  \
    template ExplicitStep<Real> make_explicit_step(const Problem&, const NeighbourLists<Real>&,     \
                                                   Formulation);                                    \
    template ScatterStep<Real> make_scatter_step(const Problem&, const SpringArrays<Real>&);        \
    template SpringArrays<Real> list_every_spring(const Problem&, Formulation);                     \
    template std::vector<EditedSpring<Real>> SpringSlots::slots_of(const SpringEdit&);
FOR_PRECISION(float)
FOR_PRECISION(double)
#undef FOR_PRECISION

}  // namespace voxspring::cuda
