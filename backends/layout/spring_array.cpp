#include "backends/layout/spring_array.h"

#include <algorithm>
#include <set>

#include "backends/layout/particles.h"
#include "backends/layout/springs.h"
#include "backends/layout/work.h"

namespace voxspring::layout {

template <class Real>
SpringArrays<Real> list_every_spring(const Problem& problem, Formulation formulation) {
    const std::size_t total = count_springs(problem).total();
    SpringArrays<Real> springs;
    springs.ends.resize(total);
    springs.constants.resize(total);
    if (!problem.springs.empty() && !on_positions(formulation)) springs.off_lattice_rest.resize(total);
    auto& begin = springs.begin;
    for (const std::uint32_t mask : problem.lattice.mask) {
        // The odd bits point to a higher voxel, so this counts each spring once.
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
        if (!springs.off_lattice_rest.empty())
            springs.off_lattice_rest[s] =
                off_lattice_rest_of<Real>(problem, spring.first, spring.second, spring.rest_length);
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
            rest = off_lattice_rest_of<Real>(*listed_, spring.first, spring.second, spring.rest_length);
        edited.push_back({{spring.first, entry_of(spring.second, changed.bit, formulation_)},
                          range.first,
                          range.second,
                          {Real(stiffness), length},
                          rest,
                          !by_increments(formulation_)});
    };
    // If the edit both removes and adds a lattice spring that was listed at first, only the addition is
    // written.
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

template <class Real>
StepWork scatter_work(const Problem& problem, Formulation formulation) {
    StepWork work = motion_work<Real>(problem, formulation);
    const std::uint64_t springs = count_springs(problem).total();
    const std::uint64_t particles = problem.particle_count();
    const std::uint64_t force = particles * sizeof(Vector<Real>);
    // Each launch (one for springs, one for particles) reads and writes the force on every particle.
    const auto add_force = [&] {
        work.bytes += 2 * force;
        work.written_bytes += force;
    };
    add_force();
    work.footprint_bytes += force;
    if (springs == 0) return work;
    work.launches = 2;
    add_force();
    const std::uint64_t parts = formulation == Formulation::compensated ? 2 : 1;
    work.bytes += particles * parts * sizeof(ParticleRecord<Real>);
    work.read_once(springs * (sizeof(SpringEnds) + sizeof(SpringConstants<Real>)) +
                   off_lattice_rest_bytes<Real>(problem, formulation));
    // Per spring: 1 operation to multiply by the stiffness, 3 vector operations to compute the force and to
    // add it to both ends.
    work.operations += pull_operations<Real>(problem, formulation) + springs * (1 + 3 * vector_operations);
    return work;
}

// `Real` is a type, which cannot be put in parentheses.
// NOLINTBEGIN(bugprone-macro-parentheses)
#define FOR_PRECISION(Real)                                                            \
    template SpringArrays<Real> list_every_spring(const Problem&, Formulation);        \
    template std::vector<EditedSpring<Real>> SpringSlots::slots_of(const SpringEdit&); \
    template StepWork scatter_work<Real>(const Problem&, Formulation);                 \
    template ScatterStep<Real> make_scatter_step(const Problem&, const SpringArrays<Real>&);
// NOLINTEND(bugprone-macro-parentheses)
FOR_PRECISION(float)
FOR_PRECISION(double)
#undef FOR_PRECISION

}  // namespace voxspring::layout
