#include "backends/layout/slabs.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

#include "backends/physics/neighbours.h"

namespace voxspring {
namespace {

/// Of axes that are equally long the one whose layers lie together in memory.
int longest_axis(glm::ivec3 dims) {
    int axis = 2;
    if (dims.y > dims[axis]) axis = 1;
    if (dims.x > dims[axis]) axis = 0;
    return axis;
}

std::vector<std::size_t> particles_of_layers(const Lattice& lattice, int axis) {
    std::vector<std::size_t> count(std::size_t(lattice.dims[axis]), 0);
    for (const std::uint32_t voxel : lattice.voxel) ++count[std::size_t(lattice.coordinates(voxel)[axis])];
    return count;
}

/// The bits of the neighbours one layer up (`towards` 1) or down (-1).
std::uint32_t bits_towards(int axis, int towards) {
    std::uint32_t bits = 0;
    for (const Direction& direction : directions()) {
        if (direction.offset[axis] == towards) bits |= 1U << direction.bit;
    }
    return bits;
}

std::optional<std::uint32_t> index_in(const std::vector<std::uint32_t>& ascending, std::uint32_t value) {
    const auto found = std::lower_bound(ascending.begin(), ascending.end(), value);
    if (found == ascending.end() || *found != value) return std::nullopt;
    return std::uint32_t(found - ascending.begin());
}

/// Takes one slab out of a problem.
class Cutting {
public:
    /// Its own layers are [first, end).
    Cutting(const Problem& whole, int axis, int first, int end)
        : whole_(whole),
          axis_(axis),
          first_(first),
          end_(end),
          begin_(std::max(0, first - 1)),
          upward_(bits_towards(axis, 1)),
          downward_(bits_towards(axis, -1)) {
        Problem& problem = slab_.problem;
        problem.materials = whole.materials;
        problem.rest_length = whole.rest_length;
        problem.group_stiffness = whole.group_stiffness;
        problem.group_bits = whole.group_bits;
        problem.gravity = whole.gravity;
        problem.damping = whole.damping;
        problem.time_step = whole.time_step;
        problem.tool.stiffness = whole.tool.stiffness;
        problem.lattice.spacing = whole.lattice.spacing;
        problem.lattice.dims = whole.lattice.dims;
        problem.lattice.dims[axis] = std::min(whole.lattice.dims[axis], end + 1) - begin_;
    }

    Slab run(int number, int count) {
        if (number > 0) slab_.borders.push_back({number - 1, {}, {}});
        if (number + 1 < count) slab_.borders.push_back({number + 1, {}, {}});
        const Lattice& lattice = whole_.lattice;
        for (std::size_t i = 0; i < lattice.voxel.size(); ++i) {
            const glm::ivec3 at = lattice.coordinates(lattice.voxel[i]);
            if (at[axis_] >= begin_ && at[axis_] <= end_) take(std::uint32_t(i), at);
        }
        std::vector<std::uint8_t>& pinned = slab_.problem.pinned;
        if (std::find(pinned.begin(), pinned.end(), 1) == pinned.end()) pinned.clear();
        return std::move(slab_);
    }

private:
    void take(std::uint32_t i, glm::ivec3 at) {
        const int layer = at[axis_];
        const bool own = layer >= first_ && layer < end_;
        const auto here = std::uint32_t(slab_.particle.size());
        slab_.particle.push_back(i);
        if (own) slab_.own.push_back(here);
        if (layer < first_) slab_.borders.front().received.push_back(here);
        if (layer == end_) slab_.borders.back().received.push_back(here);
        if (layer == first_ && begin_ < first_) slab_.borders.front().sent.push_back(here);
        if (layer == end_ - 1 && end_ < whole_.lattice.dims[axis_]) slab_.borders.back().sent.push_back(here);

        Problem& problem = slab_.problem;
        at[axis_] -= begin_;
        const glm::ivec3 dims = problem.lattice.dims;
        problem.lattice.voxel.push_back((std::uint32_t(at.z) * std::uint32_t(dims.y) + std::uint32_t(at.y)) *
                                            std::uint32_t(dims.x) +
                                        std::uint32_t(at.x));
        const std::uint32_t mask = whole_.lattice.mask[i];
        const std::uint32_t to_own = layer < first_ ? upward_ : downward_;
        problem.lattice.mask.push_back(own ? mask : (mask & (to_own | ACTIVE_BIT)) | PINNED_BIT);
        problem.rest_position.push_back(whole_.rest_position[i]);
        problem.pinned.push_back(!own || whole_.is_pinned(i) ? 1 : 0);
        if (!own) problem.ghosts.push_back(here);
        if (whole_.has_materials()) problem.material.push_back(whole_.material[i]);
        if (!whole_.load.empty()) problem.load.push_back(whole_.load[i]);
        if (own) take_hold_of(i, here);
    }

    /// Each particle that the tool holds is held where it is stepped.
    void take_hold_of(std::uint32_t i, std::uint32_t here) {
        const auto held = index_in(whole_.tool.particles, i);
        if (!held) return;
        Tool& tool = slab_.problem.tool;
        tool.particles.push_back(here);
        if (!whole_.tool.held.empty()) tool.held.push_back(whole_.tool.held[*held]);
    }

    const Problem& whole_;
    const int axis_, first_, end_, begin_;
    const std::uint32_t upward_, downward_;
    Slab slab_;
};

/// A changed spring by its ends' numbers in a slab; nothing where none of them is the slab's own.
std::optional<ChangedSpring> part_of(const Slab& slab, ChangedSpring changed) {
    const auto first = index_in(slab.particle, changed.spring.first);
    const auto second = index_in(slab.particle, changed.spring.second);
    if (!first || !second) return std::nullopt;
    if (!index_in(slab.own, *first) && !index_in(slab.own, *second)) return std::nullopt;
    changed.spring.first = *first;
    changed.spring.second = *second;
    return changed;
}

}  // namespace

State Slab::part_of(const State& state) const {
    State part;
    for (const std::uint32_t i : particle) {
        part.displacement.push_back(state.displacement[i]);
        part.increment.push_back(state.increment[i]);
    }
    return part;
}

void Slab::copy_own(const State& part, State& whole) const {
    for (const std::uint32_t i : own) {
        whole.displacement[particle[i]] = part.displacement[i];
        whole.increment[particle[i]] = part.increment[i];
    }
}

SpringEdit Slab::part_of(const SpringEdit& edit) const {
    SpringEdit part;
    std::vector<std::uint32_t> ends;
    const auto take = [&](const std::vector<ChangedSpring>& from, std::vector<ChangedSpring>& to) {
        for (const ChangedSpring& changed : from) {
            const auto here = voxspring::part_of(*this, changed);
            if (!here) continue;
            to.push_back(*here);
            ends.insert(ends.end(), {here->spring.first, here->spring.second});
        }
    };
    take(edit.removed, part.removed);
    take(edit.added, part.added);
    std::sort(ends.begin(), ends.end());
    for (const SpringEdit::Touched& touched : edit.touched) {
        const auto here = index_in(particle, touched.particle);
        if (!here || !std::binary_search(ends.begin(), ends.end(), *here)) continue;
        const bool is_own = index_in(own, *here).has_value();
        std::uint32_t mask = touched.mask & (ACTIVE_BIT | PINNED_BIT);
        if (!is_own) mask |= PINNED_BIT;
        const auto begin = std::uint32_t(part.listed.size());
        for (ListedSpring spring : edit.springs_of(touched)) {
            const auto neighbour = index_in(particle, spring.neighbour);
            if (!neighbour || (!is_own && !index_in(own, *neighbour))) continue;
            spring.neighbour = *neighbour;
            mask |= 1U << spring.bit;
            part.listed.push_back(spring);
        }
        part.touched.push_back({*here, mask, begin, std::uint32_t(part.listed.size())});
    }
    return part;
}

std::string SlabCuts::refusal(const Problem& problem, int slabs) {
    if (problem.lattice.voxel_count() == 0) return "slabs are of a lattice, and the particles lie on none";
    if (!problem.springs.empty())
        return "a slab has ghosts of one layer of voxels, and springs beyond the lattice reach farther";
    const std::vector<std::size_t> layers =
        particles_of_layers(problem.lattice, longest_axis(problem.lattice.dims));
    const auto occupied = std::ptrdiff_t(layers.size()) - std::count(layers.begin(), layers.end(), 0U);
    if (slabs < 1 || occupied < slabs)
        return "a lattice whose longest axis has " + std::to_string(occupied) +
               " layers with particles cannot be cut into " + std::to_string(slabs) + " slabs";
    return {};
}

SlabCuts::SlabCuts(const Problem& problem, int slabs) : axis_(longest_axis(problem.lattice.dims)) {
    const std::vector<std::size_t> count = particles_of_layers(problem.lattice, axis_);
    // Layers with particles, and the particles before each: slabs begin at such layers.
    std::vector<int> layer;
    std::vector<std::size_t> before;
    std::size_t sum = 0;
    for (std::size_t n = 0; n < count.size(); ++n) {
        if (count[n] == 0) continue;
        layer.push_back(int(n));
        before.push_back(sum);
        sum += count[n];
    }
    first_.push_back(0);
    std::ptrdiff_t previous = 0;
    for (int s = 1; s < slabs; ++s) {
        const double wanted = double(sum) * s / slabs;
        auto at = std::lower_bound(before.begin(), before.end(), wanted,
                                   [](std::size_t particles, double w) { return double(particles) < w; }) -
                  before.begin();
        if (at == std::ptrdiff_t(before.size()) || (at > 0 && wanted - double(before[std::size_t(at - 1)]) <
                                                                  double(before[std::size_t(at)]) - wanted))
            --at;
        // Each slab has a layer with particles, those to come as well.
        at = std::clamp(at, previous + 1, std::ptrdiff_t(layer.size()) - (slabs - s));
        first_.push_back(layer[std::size_t(at)]);
        previous = at;
    }
    first_.push_back(problem.lattice.dims[axis_]);
}

std::vector<std::uint32_t> SlabCuts::own(const Problem& problem, int slab) const {
    const Lattice& lattice = problem.lattice;
    std::vector<std::uint32_t> own;
    for (std::size_t i = 0; i < lattice.voxel.size(); ++i) {
        const int layer = lattice.coordinates(lattice.voxel[i])[axis_];
        if (layer >= first_layer(slab) && layer < first_layer(slab + 1)) own.push_back(std::uint32_t(i));
    }
    return own;
}

Slab SlabCuts::slab(const Problem& problem, int number) const {
    return Cutting(problem, axis_, first_layer(number), first_layer(number + 1)).run(number, count());
}

}  // namespace voxspring
