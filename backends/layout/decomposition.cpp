#include "backends/layout/decomposition.h"

#include <algorithm>
#include <array>
#include <limits>
#include <optional>
#include <stdexcept>
#include <tuple>
#include <utility>

#include "backends/layout/boxes.h"
#include "backends/physics/huge_pages.h"
#include "backends/physics/neighbours.h"

namespace voxspring {
namespace {

using Brick = Decomposition::Brick;

/// The axes, the longest first. Among equally long axes z comes before y and y before x, since the layers
/// across z lie together in memory.
std::array<int, 3> axes_by_length(glm::ivec3 dims) {
    std::array<int, 3> axes = {2, 1, 0};
    std::stable_sort(axes.begin(), axes.end(), [&](int one, int other) { return dims[one] > dims[other]; });
    return axes;
}

/// How many components of a lattice spring's offset may differ from 0: 1 if there are only face springs, 2
/// with edge springs, 3 with corner springs.
int reach_of(const Problem& problem) {
    int reach = 0;
    for (const Direction& direction : directions()) {
        if ((problem.group_bits >> direction.bit & 1U) == 0) continue;
        const glm::ivec3 at = glm::abs(direction.offset);
        reach = std::max(reach, at.x + at.y + at.z);
    }
    return reach;
}

bool contains(const Brick& brick, glm::ivec3 at) {
    return glm::all(glm::greaterThanEqual(at, brick.begin)) && glm::all(glm::lessThan(at, brick.end));
}

Brick with_a_voxel_around(const Brick& brick) { return {brick.begin - 1, brick.end + 1}; }
Brick without_its_surface(const Brick& brick) { return {brick.begin + 1, brick.end - 1}; }

/// Whether the brick has a particle that a lattice spring may join to a particle at `at`. Springs that have
/// been cut count too, since they may be sutured.
bool may_be_joined(const Problem& problem, const Brick& brick, glm::ivec3 at) {
    if (!contains(with_a_voxel_around(brick), at)) return false;
    const Lattice& lattice = problem.lattice;
    return std::any_of(directions().begin(), directions().end(), [&](const Direction& direction) {
        const glm::ivec3 to = at + direction.offset;
        return (problem.group_bits >> direction.bit & 1U) != 0 && contains(brick, to) &&
               std::binary_search(lattice.voxel.begin(), lattice.voxel.end(),
                                  std::uint32_t(layout::index_in(lattice.dims, to)));
    });
}

/// The first layer of each of `parts` slabs and, as the last element, the number of layers. All slabs have
/// about the same number of particles, and each but the first begins at a layer with particles. The list is
/// empty if fewer than `parts` layers have particles.
std::vector<int> equal_parts(const std::vector<std::size_t>& particles_of_layer, int parts) {
    // Layers with particles, and the number of particles before each.
    std::vector<int> layer;
    std::vector<std::size_t> before;
    std::size_t sum = 0;
    for (std::size_t n = 0; n < particles_of_layer.size(); ++n) {
        if (particles_of_layer[n] == 0) continue;
        layer.push_back(int(n));
        before.push_back(sum);
        sum += particles_of_layer[n];
    }
    if (layer.size() < std::size_t(parts)) return {};
    std::vector<int> begins = {0};
    std::ptrdiff_t previous = 0;
    for (int part = 1; part < parts; ++part) {
        const double wanted = double(sum) * part / parts;
        auto at = std::lower_bound(before.begin(), before.end(), wanted,
                                   [](std::size_t particles, double w) { return double(particles) < w; }) -
                  before.begin();
        if (at == std::ptrdiff_t(before.size()) || (at > 0 && wanted - double(before[std::size_t(at - 1)]) <
                                                                  double(before[std::size_t(at)]) - wanted))
            --at;
        // Leave at least one layer with particles for the part before this one, for this part and for each
        // part after it.
        at = std::clamp(at, previous + 1, std::ptrdiff_t(layer.size()) - (parts - part));
        begins.push_back(layer[std::size_t(at)]);
        previous = at;
    }
    begins.push_back(int(particles_of_layer.size()));
    return begins;
}

/// Cuts a lattice into bricks, or says in refusal() why that is impossible.
class Bricks {
public:
    Bricks(const Lattice& lattice, glm::ivec3 subdomains)
        : lattice_(lattice),
          subdomains_(subdomains),
          axes_(axes_by_length(lattice.dims)),
          is_full_(lattice.voxel.size() == lattice.voxel_count()) {
        cut({glm::ivec3(0), lattice.dims}, is_full_ ? std::vector<std::uint32_t>() : lattice.voxel, 0);
    }
    const std::string& refusal() const { return refusal_; }
    const std::vector<Brick>& bricks() const { return bricks_; }
    /// Whether each voxel of the lattice has a particle.
    bool is_full() const { return is_full_; }
    /// The voxels with particles in each brick; empty for a full lattice.
    const std::vector<std::vector<std::uint32_t>>& voxels() const { return voxels_; }

private:
    /// Cuts `brick` across axes_[n] and the axes after it. `voxels`: the voxels of the brick that have
    /// particles; empty for a full lattice.
    void cut(const Brick& brick, std::vector<std::uint32_t> voxels, std::size_t n) {
        while (n < axes_.size() && subdomains_[axes_[n]] == 1) ++n;
        if (n == axes_.size()) {
            bricks_.push_back(brick);
            voxels_.push_back(std::move(voxels));
            return;
        }
        const int axis = axes_[n];
        const auto layer_of = [&](std::uint32_t voxel) {
            return std::size_t(lattice_.coordinates(voxel)[axis] - brick.begin[axis]);
        };
        std::vector<std::size_t> count(std::size_t(brick.end[axis] - brick.begin[axis]), is_full_ ? 1 : 0);
        for (const std::uint32_t voxel : voxels) ++count[layer_of(voxel)];
        const std::vector<int> begins = equal_parts(count, subdomains_[axis]);
        if (begins.empty()) return refuse(count, axis);
        std::vector<std::vector<std::uint32_t>> voxels_of(begins.size() - 1);
        for (const std::uint32_t voxel : voxels) {
            const auto next = std::upper_bound(begins.begin(), begins.end(), int(layer_of(voxel)));
            voxels_of[std::size_t(next - begins.begin() - 1)].push_back(voxel);
        }
        for (std::size_t part = 0; part < voxels_of.size(); ++part) {
            Brick piece = brick;
            piece.begin[axis] = brick.begin[axis] + begins[part];
            piece.end[axis] = brick.begin[axis] + begins[part + 1];
            cut(piece, std::move(voxels_of[part]), n + 1);
        }
    }
    void refuse(const std::vector<std::size_t>& count, int axis) {
        const auto occupied = std::ptrdiff_t(count.size()) - std::count(count.begin(), count.end(), 0U);
        refusal_ = "the body has " + std::to_string(occupied) + (occupied == 1 ? " layer" : " layers") +
                   " with particles along " + "xyz"[axis] + ", so it cannot be cut into " +
                   std::to_string(subdomains_[axis]) + " parts";
    }

    const Lattice& lattice_;
    const glm::ivec3 subdomains_;
    const std::array<int, 3> axes_;
    const bool is_full_;
    std::vector<Brick> bricks_;
    std::vector<std::vector<std::uint32_t>> voxels_;
    std::string refusal_;
};

std::optional<std::uint32_t> index_in(const std::vector<std::uint32_t>& ascending, std::uint32_t value) {
    const auto found = std::lower_bound(ascending.begin(), ascending.end(), value);
    if (found == ascending.end() || *found != value) return std::nullopt;
    return std::uint32_t(found - ascending.begin());
}

/// A brick beside the brick of a subdomain, and the border between the two subdomains.
struct Beside {
    Brick brick;
    Subdomain::Border border;
};

/// Makes one subdomain of a problem.
class Cutting {
public:
    Cutting(const Problem& whole, const Brick& brick, std::vector<Beside> beside)
        : whole_(whole), brick_(brick), beside_(std::move(beside)) {
        const glm::ivec3 dims = whole.lattice.dims;
        const Brick around = with_a_voxel_around(brick);
        with_ghosts_ = {glm::max(around.begin, glm::ivec3(0)), glm::min(around.end, dims)};
        std::tie(begin_, end_) = whole.lattice.particles_between(with_ghosts_.begin.z, with_ghosts_.end.z);
        Problem& problem = subdomain_.problem;
        problem.materials = whole.materials;
        problem.rest_length = whole.rest_length;
        problem.group_stiffness = whole.group_stiffness;
        problem.group_bits = whole.group_bits;
        problem.gravity = whole.gravity;
        problem.damping = whole.damping;
        problem.time_step = whole.time_step;
        problem.tool.stiffness = whole.tool.stiffness;
        problem.lattice.spacing = whole.lattice.spacing;
        problem.lattice.dims = with_ghosts_.end - with_ghosts_.begin;
        // Allocate enough at once: while a vector grows, it holds its elements twice.
        const std::size_t most = std::min(end_ - begin_, problem.lattice.voxel_count());
        reserve_in_huge_pages(subdomain_.particle, most);
        reserve_in_huge_pages(subdomain_.own, most);
        reserve_in_huge_pages(problem.rest_position, most);
        reserve_in_huge_pages(problem.lattice.voxel, most);
        reserve_in_huge_pages(problem.lattice.mask, most);
        reserve_in_huge_pages(problem.pinned, most);
    }

    Subdomain run() {
        const Lattice& lattice = whole_.lattice;
        for (std::size_t i = begin_; i < end_; ++i) {
            const glm::ivec3 at = lattice.coordinates(lattice.voxel[i]);
            if (!contains(with_ghosts_, at)) continue;
            const bool own = contains(brick_, at);
            if (own || may_be_joined(whole_, brick_, at)) take(std::uint32_t(i), at, own);
        }
        std::vector<std::uint8_t>& pinned = subdomain_.problem.pinned;
        if (std::find(pinned.begin(), pinned.end(), 1) == pinned.end()) pinned.clear();
        for (Beside& beside : beside_) {
            Subdomain::Border& border = beside.border;
            if (!border.sent.empty() || !border.received.empty())
                subdomain_.borders.push_back(std::move(border));
        }
        return std::move(subdomain_);
    }

private:
    void take(std::uint32_t i, glm::ivec3 at, bool own) {
        const auto here = std::uint32_t(subdomain_.particle.size());
        subdomain_.particle.push_back(i);
        if (own) subdomain_.own.push_back(here);
        share(here, at, own);

        Problem& problem = subdomain_.problem;
        problem.lattice.voxel.push_back(
            std::uint32_t(layout::index_in(problem.lattice.dims, at - with_ghosts_.begin)));
        const std::uint32_t mask = whole_.lattice.mask[i];
        problem.lattice.mask.push_back(own ? mask : (mask & (bits_to_own(at) | ACTIVE_BIT)) | PINNED_BIT);
        problem.rest_position.push_back(whole_.rest_position[i]);
        problem.pinned.push_back(!own || whole_.is_pinned(i) ? 1 : 0);
        if (!own) problem.ghosts.push_back(here);
        if (whole_.has_materials()) problem.material.push_back(whole_.material[i]);
        if (!whole_.load.empty()) problem.load.push_back(whole_.load[i]);
        if (own) take_hold_of(i, here);
    }

    /// Adds particle `here` to borders: one of this subdomain's own particles to `sent` for each subdomain
    /// that has it as a ghost; a ghost to `received` for the subdomain that steps it.
    void share(std::uint32_t here, glm::ivec3 at, bool own) {
        if (own && contains(without_its_surface(brick_), at)) return;
        for (auto& [brick, border] : beside_) {
            if (own && may_be_joined(whole_, brick, at)) border.sent.push_back(here);
            if (!own && contains(brick, at)) border.received.push_back(here);
        }
    }

    std::uint32_t bits_to_own(glm::ivec3 at) const {
        std::uint32_t bits = 0;
        for (const Direction& direction : directions()) {
            if (contains(brick_, at + direction.offset)) bits |= 1U << direction.bit;
        }
        return bits;
    }

    /// Lets the tool of this subdomain hold particle `here` if the tool of the whole problem holds it. In the
    /// whole problem the particle has number `i`.
    void take_hold_of(std::uint32_t i, std::uint32_t here) {
        const auto held = index_in(whole_.tool.particles, i);
        if (!held) return;
        Tool& tool = subdomain_.problem.tool;
        tool.particles.push_back(here);
        if (!whole_.tool.held.empty()) tool.held.push_back(whole_.tool.held[*held]);
    }

    const Problem& whole_;
    const Brick brick_;
    std::vector<Beside> beside_;
    Brick with_ghosts_{};
    std::size_t begin_ = 0, end_ = 0;  ///< the particles of the planes across z that with_ghosts_ has
    Subdomain subdomain_;
};

/// The changed spring with its ends as numbered in `subdomain`; empty if the subdomain steps neither end.
std::optional<ChangedSpring> changed_in(const Subdomain& subdomain, ChangedSpring changed) {
    const auto first = index_in(subdomain.particle, changed.spring.first);
    const auto second = index_in(subdomain.particle, changed.spring.second);
    if (!first || !second) return std::nullopt;
    if (!index_in(subdomain.own, *first) && !index_in(subdomain.own, *second)) return std::nullopt;
    changed.spring.first = *first;
    changed.spring.second = *second;
    return changed;
}

}  // namespace

State part_of(const State& state, const std::vector<std::uint32_t>& particles) {
    const auto of_these = [&](const std::vector<glm::dvec3>& all) {
        std::vector<glm::dvec3> part;
        if (all.empty()) return part;
        resize_in_huge_pages(part, particles.size());
#pragma omp parallel for
        for (std::ptrdiff_t n = 0; n < std::ptrdiff_t(particles.size()); ++n)
            part[std::size_t(n)] = all[particles[std::size_t(n)]];
        return part;
    };
    return {of_these(state.displacement), of_these(state.increment)};
}

void Subdomain::copy_own(const State& part, State& whole) const {
    for (const std::uint32_t i : own) {
        whole.displacement[particle[i]] = part.displacement[i];
        whole.increment[particle[i]] = part.increment[i];
    }
}

SpringEdit Subdomain::part_of(const SpringEdit& edit) const {
    SpringEdit part;
    std::vector<std::uint32_t> ends;
    const auto take = [&](const std::vector<ChangedSpring>& from, std::vector<ChangedSpring>& to) {
        for (const ChangedSpring& changed : from) {
            const auto here = changed_in(*this, changed);
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

SpringDifference Subdomain::part_of(const Problem& whole, const SpringDifference& edit) const {
    const auto take = [&](const SpringDifference::Springs& from, std::vector<ChangedSpring>& to) {
        for (const ChangedSpring& changed : changed_springs(whole, from)) {
            if (const auto here = changed_in(*this, changed)) to.push_back(*here);
        }
    };
    SpringEdit part;
    take(edit.removed, part.removed);
    take(edit.added, part.added);
    return part;
}

glm::ivec3 Decomposition::slabs(const Problem& problem, int subdomains) {
    glm::ivec3 all(1);
    all[axes_by_length(problem.lattice.dims).front()] = subdomains;
    return all;
}

glm::ivec3 Decomposition::bricks(const Problem& problem, int subdomains) {
    const glm::ivec3 slabs = Decomposition::slabs(problem, subdomains);
    glm::ivec3 best = slabs;
    std::size_t least = sent_by_busiest(problem, slabs);
    for (int x = 1; x <= subdomains; ++x) {
        for (int y = 1; x * y <= subdomains; ++y) {
            const glm::ivec3 cut(x, y, subdomains / (x * y));
            const int axes = (x > 1 ? 1 : 0) + (y > 1 ? 1 : 0) + (cut.z > 1 ? 1 : 0);
            if (axes < 2 || x * y * cut.z != subdomains) continue;
            const std::size_t sent = sent_by_busiest(problem, cut);
            if (sent >= least) continue;
            least = sent;
            best = cut;
        }
    }
    return best;
}

std::string Decomposition::refusal(const Problem& problem, glm::ivec3 subdomains) {
    if (problem.lattice.voxel_count() == 0)
        return "only a lattice can be cut into parts, but the particles of this scene lie on none";
    if (!problem.springs.empty())
        return "a body with springs that are not those of its lattice cannot be cut into parts, because "
               "a part may not know both of their particles";
    if (glm::any(glm::lessThan(subdomains, glm::ivec3(1))))
        return "a lattice must be cut into at least one part along each axis";
    return Bricks(problem.lattice, subdomains).refusal();
}

Decomposition::Decomposition(const Problem& problem, glm::ivec3 subdomains) : reach_(reach_of(problem)) {
    const Bricks bricks(problem.lattice, subdomains);
    if (!bricks.refusal().empty()) throw std::logic_error(bricks.refusal());
    bricks_ = bricks.bricks();
}

std::size_t Decomposition::sent_by_busiest(const Problem& problem, glm::ivec3 subdomains) {
    const Lattice& lattice = problem.lattice;
    const Bricks cut(lattice, subdomains);
    if (!cut.refusal().empty()) return std::numeric_limits<std::size_t>::max();
    const Decomposition decomposition(cut.bricks(), reach_of(problem));
    std::size_t busiest = 0;
    for (int from = 0; from < decomposition.count(); ++from) {
        std::size_t sent = 0;
        for (int to = 0; to < decomposition.count(); ++to) {
            const std::size_t most = decomposition.most_sent(from, to);
            if (most == 0) continue;
            const std::vector<std::uint32_t>& voxels = cut.voxels()[std::size_t(from)];
            const auto is_sent = [&](std::uint32_t voxel) {
                return may_be_joined(problem, decomposition.brick(to), lattice.coordinates(voxel));
            };
            sent += cut.is_full() ? most : std::size_t(std::count_if(voxels.begin(), voxels.end(), is_sent));
        }
        busiest = std::max(busiest, sent);
    }
    return busiest;
}

std::size_t Decomposition::most_sent(int from, int to) const {
    if (from == to) return 0;
    const Brick &own = brick(from), &theirs = brick(to);
    const Brick around = with_a_voxel_around(theirs);
    const glm::ivec3 shared = glm::min(own.end, around.end) - glm::max(own.begin, around.begin);
    if (glm::any(glm::lessThan(shared, glm::ivec3(1)))) return 0;
    int apart = 0;
    for (int axis = 0; axis < 3; ++axis)
        apart += own.end[axis] <= theirs.begin[axis] || theirs.end[axis] <= own.begin[axis] ? 1 : 0;
    return apart <= reach_ ? std::size_t(shared.x) * std::size_t(shared.y) * std::size_t(shared.z) : 0;
}

std::vector<std::uint32_t> Decomposition::own(const Problem& problem, int number) const {
    return particles_in(problem.lattice, brick(number));
}

std::vector<std::uint32_t> Decomposition::particles_in(const Lattice& lattice, const Brick& brick) {
    std::vector<std::uint32_t> particles;
    const auto [begin, end] = lattice.particles_between(brick.begin.z, brick.end.z);
    for (std::size_t i = begin; i < end; ++i) {
        if (contains(brick, lattice.coordinates(lattice.voxel[i]))) particles.push_back(std::uint32_t(i));
    }
    return particles;
}

Subdomain Decomposition::subdomain(const Problem& problem, int number) const {
    std::vector<Beside> beside;
    for (int other = 0; other < count(); ++other) {
        if (most_sent(number, other) > 0) beside.push_back({brick(other), {other, {}, {}}});
    }
    return Cutting(problem, brick(number), std::move(beside)).run();
}

Subdomain Decomposition::alone(const Problem& problem, const Brick& brick) {
    return Cutting(problem, brick, {}).run();
}

}  // namespace voxspring
