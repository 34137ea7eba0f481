#include "backends/physics/edit.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <glm/common.hpp>
#include <glm/geometric.hpp>
#include <limits>
#include <set>

#include "backends/physics/neighbours.h"
#include "backends/physics/spring.h"

namespace voxspring {
namespace {

bool above(const glm::dvec3& point, const glm::dvec3& normal, const glm::dvec3& x) {
    return glm::dot(normal, x - point) >= 0;
}

/// Six times the signed volume of the tetrahedron a, b, c, d. Exchanging c and d gives exactly the negative,
/// so that no line can slip between two triangles that share an edge.
double volume(const glm::dvec3& a, const glm::dvec3& b, const glm::dvec3& c, const glm::dvec3& d) {
    return glm::dot(glm::cross(c - a, d - a), b - a);
}

bool goes_through(const std::array<glm::dvec3, 3>& t, const glm::dvec3& a, const glm::dvec3& b) {
    const glm::dvec3 normal = glm::cross(t[1] - t[0], t[2] - t[0]);
    if (above(t[0], normal, a) == above(t[0], normal, b)) return false;
    const double u = volume(a, b, t[0], t[1]);
    const double v = volume(a, b, t[1], t[2]);
    const double w = volume(a, b, t[2], t[0]);
    return (u >= 0 && v >= 0 && w >= 0) || (u <= 0 && v <= 0 && w <= 0);
}

struct Cuts {
    const glm::dvec3 &a, &b;

    bool operator()(const Plane& plane) const {
        return above(plane.point, plane.normal, a) != above(plane.point, plane.normal, b);
    }
    bool operator()(const TrianglePatch& patch) const {
        return std::any_of(patch.triangles.begin(), patch.triangles.end(),
                           [&](const auto& triangle) { return goes_through(triangle, a, b); });
    }
    bool operator()(const Ball& ball) const {
        return glm::distance(a, ball.centre) <= ball.radius && glm::distance(b, ball.centre) <= ball.radius;
    }
};

constexpr double infinity = std::numeric_limits<double>::infinity();

struct Box {
    glm::dvec3 low{infinity};  ///< by default the box is empty
    glm::dvec3 high{-infinity};

    void include(const glm::dvec3& point) {
        low = glm::min(low, point);
        high = glm::max(high, point);
    }
    bool meets(const Box& other) const {
        return low.x <= other.high.x && other.low.x <= high.x && low.y <= other.high.y &&
               other.low.y <= high.y && low.z <= other.high.z && other.low.z <= high.z;
    }
};

using Triangle = std::array<glm::dvec3, 3>;

Box box_of(const Triangle& triangle) {
    Box box;
    for (const glm::dvec3& corner : triangle) box.include(corner);
    return box;
}

struct Bounds {
    Box operator()(const Plane&) const { return {glm::dvec3(-infinity), glm::dvec3(infinity)}; }
    Box operator()(const TrianglePatch& patch) const {
        Box box;
        for (const Triangle& triangle : patch.triangles) {
            for (const glm::dvec3& corner : triangle) box.include(corner);
        }
        return box;
    }
    Box operator()(const Ball& ball) const { return {ball.centre - ball.radius, ball.centre + ball.radius}; }
};

/// A box that is wider than `box` by more than rounding in goes_through() can move what lies in `box`.
/// Rounding grows with coordinates.
Box widened(const Box& box) {
    const glm::dvec3 reach = glm::max(glm::abs(box.low), glm::abs(box.high));
    const double margin = 1e-9 * std::max({reach.x, reach.y, reach.z});
    return {box.low - margin, box.high + margin};
}

/// The triangles of a patch in a tree of boxes, so that a line is compared only with triangles near it. The
/// boxes of triangles and of lines are widened. So a line whose box misses a box of the tree also misses the
/// triangles in it.
class TriangleTree {
public:
    explicit TriangleTree(const TrianglePatch& patch) : triangles_(patch.triangles) {
        if (!triangles_.empty()) build(0, triangles_.size());
    }

    bool cuts(const glm::dvec3& a, const glm::dvec3& b) const {
        Box line;
        line.include(a);
        line.include(b);
        return any_near(line, [&](const Triangle& triangle) { return goes_through(triangle, a, b); });
    }
    /// Whether the patch might cut a line that lies within `box`. If false, it certainly does not. If true,
    /// there are triangles near the box, which need not cut the line.
    bool may_cut_within(const Box& box) const {
        return any_near(box, [](const Triangle&) { return true; });
    }

private:
    /// Whether holds(triangle) is true for at least one of the triangles near `box`.
    template <class Holds>
    bool any_near(const Box& box, const Holds& holds) const {
        const Box wide = widened(box);
        for (std::size_t n = 0; n < nodes_.size();) {
            const Node& node = nodes_[n];
            if (!node.box.meets(wide)) {
                n = node.next;
                continue;
            }
            for (std::size_t t = node.first; t < node.end; ++t) {
                if (holds(triangles_[t])) return true;
            }
            ++n;
        }
        return false;
    }

    /// A node of the tree. Nodes are stored in depth-first order: the children of a node follow it.
    struct Node {
        Box box;
        std::size_t next = 0;            ///< index of the first node after this node's subtree
        std::size_t first = 0, end = 0;  ///< the node's range of `triangles_`; empty unless it is a leaf
    };
    static constexpr std::size_t max_in_leaf = 4;

    void build(std::size_t first, std::size_t end) {
        const std::size_t index = nodes_.size();
        nodes_.emplace_back();
        Box box, centres;
        for (std::size_t t = first; t < end; ++t) {
            const Box own = box_of(triangles_[t]);
            const Box wide = widened(own);
            box.include(wide.low);
            box.include(wide.high);
            centres.include(own.low + own.high);
        }
        if (end - first <= max_in_leaf) {
            nodes_[index] = {box, index + 1, first, end};
            return;
        }
        const glm::dvec3 extent = centres.high - centres.low;
        const int axis = extent.x >= extent.y && extent.x >= extent.z ? 0 : extent.y >= extent.z ? 1 : 2;
        const auto centre = [axis](const Triangle& t) {
            return std::min({t[0][axis], t[1][axis], t[2][axis]}) +
                   std::max({t[0][axis], t[1][axis], t[2][axis]});
        };
        const auto begin = triangles_.begin();
        const std::size_t middle = first + (end - first) / 2;
        std::nth_element(
            begin + std::ptrdiff_t(first), begin + std::ptrdiff_t(middle), begin + std::ptrdiff_t(end),
            [&](const Triangle& one, const Triangle& other) { return centre(one) < centre(other); });
        build(first, middle);
        build(middle, end);
        nodes_[index] = {box, nodes_.size(), 0, 0};
    }

    std::vector<Triangle> triangles_;
    std::vector<Node> nodes_;
};

/// Evaluates cuts() of one shape for many lines.
class Cutter {
public:
    explicit Cutter(const Shape& shape) : shape_(shape) {
        if (const auto* patch = std::get_if<TrianglePatch>(&shape)) tree_.emplace(*patch);
    }
    bool operator()(const glm::dvec3& a, const glm::dvec3& b) const {
        return tree_ ? tree_->cuts(a, b) : cuts(shape_, a, b);
    }
    /// Whether the shape may cut a line that begins at `a` and is at most `length` long.
    bool may_cut_from(const glm::dvec3& a, double length) const {
        return !tree_ || tree_->may_cut_within({a - length, a + length});
    }

private:
    const Shape& shape_;
    std::optional<TriangleTree> tree_;
};

bool is_one_of(const Spring& spring, const std::vector<ChangedSpring>& sorted) {
    const auto before = [](const auto& a, const auto& b) {
        return std::pair(a.first, a.second) < std::pair(b.first, b.second);
    };
    const auto found = std::lower_bound(
        sorted.begin(), sorted.end(), spring,
        [&](const ChangedSpring& changed, const Spring& s) { return before(changed.spring, s); });
    return found != sorted.end() && !before(spring, found->spring);
}

using Pair = std::pair<std::uint32_t, std::uint32_t>;

/// The pairs in ascending order, each once and with its smaller particle first.
std::vector<Pair> in_order(std::span<const Pair> pairs) {
    std::vector<Pair> ordered;
    for (const auto& [a, b] : pairs) ordered.emplace_back(std::min(a, b), std::max(a, b));
    std::sort(ordered.begin(), ordered.end());
    ordered.erase(std::unique(ordered.begin(), ordered.end()), ordered.end());
    return ordered;
}

double default_stiffness(const Problem& problem, std::uint32_t first, std::uint32_t second) {
    for (const Direction& direction : directions()) {
        if ((problem.group_bits >> direction.bit & 1U) != 0)
            return problem.spring_stiffness(first, second, direction);
    }
    return problem.spring_stiffness(first, second, directions().front());
}

}  // namespace

bool cuts(const Shape& shape, const glm::dvec3& a, const glm::dvec3& b) {
    return std::visit(Cuts{a, b}, shape);
}

SpringEditor::SpringEditor(Problem& problem) : problem_(problem), springs_(problem) {}

std::uint32_t SpringEditor::neighbour(std::uint32_t particle, const Direction& direction) const {
    const Lattice& lattice = problem_.lattice;
    const glm::ivec3 at = lattice.coordinates(lattice.voxel[particle]) + direction.offset;
    if (at.x < 0 || at.y < 0 || at.z < 0) return no_particle;
    if (at.x >= lattice.dims.x || at.y >= lattice.dims.y || at.z >= lattice.dims.z) return no_particle;
    return particle_by_voxel()[std::size_t(std::ptrdiff_t(lattice.voxel[particle]) +
                                           lattice.stride(direction))];
}

double SpringEditor::longest_lattice_spring() const { return glm::length(problem_.lattice.spacing); }

template <class Visit>
void SpringEditor::visit_near(const Shape& shape, Visit visit) const {
    const Lattice& lattice = problem_.lattice;
    if (lattice.voxel.empty()) return;
    const Box box = std::visit(Bounds{}, shape);
    // A body may be anywhere in space: `origin` is where voxel (0, 0, 0) is.
    const glm::dvec3 origin = problem_.rest_position.front() -
                              glm::dvec3(lattice.coordinates(lattice.voxel.front())) * lattice.spacing;
    // Only from particles in the voxels `low` to `high` can a lattice spring reach the shape.
    const double reach = longest_lattice_spring();
    const glm::dvec3 first(0), last(lattice.dims - 1);
    const glm::ivec3 low(glm::clamp(glm::floor((box.low - origin - reach) / lattice.spacing), first, last));
    const glm::ivec3 high(glm::clamp(glm::ceil((box.high - origin + reach) / lattice.spacing), first, last));
    for (int z = low.z; z <= high.z; ++z) {
        for (int y = low.y; y <= high.y; ++y) {
            const std::size_t row =
                (std::size_t(z) * std::size_t(lattice.dims.y) + std::size_t(y)) * std::size_t(lattice.dims.x);
            for (int x = low.x; x <= high.x; ++x) {
                const std::uint32_t i = particle_by_voxel()[row + std::size_t(x)];
                if (i != no_particle) visit(i);
            }
        }
    }
}

std::optional<Direction> SpringEditor::direction_between(std::uint32_t first, std::uint32_t second) const {
    const Lattice& lattice = problem_.lattice;
    if (lattice.voxel.empty()) return {};
    const glm::ivec3 offset =
        lattice.coordinates(lattice.voxel[second]) - lattice.coordinates(lattice.voxel[first]);
    for (const Direction& direction : directions()) {
        if (direction.offset == offset && (problem_.group_bits >> direction.bit & 1U) != 0) return direction;
    }
    return {};
}

Spring SpringEditor::lattice_spring(std::uint32_t first, std::uint32_t second,
                                    const Direction& direction) const {
    return {first, second, problem_.spring_stiffness(first, second, direction),
            problem_.rest_length[std::size_t(direction.bit)]};
}

SpringEdit SpringEditor::cut(const Shape& shape) {
    SpringEdit edit;
    const Cutter crosses(shape);
    const auto& x = problem_.rest_position;
    if (!particle_by_voxel().empty()) {
        const double longest = longest_lattice_spring();
        visit_near(shape, [&](std::uint32_t i) {
            if (!crosses.may_cut_from(x[i], longest)) return;
            springs_.of(i, [&](std::uint32_t j, const Direction& direction) {
                if (crosses(x[i], x[j]))
                    edit.removed.push_back({lattice_spring(i, j, direction), direction.bit});
            });
        });
    }
    for (const Spring& spring : problem_.springs) {
        if (crosses(x[spring.first], x[spring.second])) edit.removed.push_back({spring, -1});
    }
    finish(edit);
    return edit;
}

SpringEdit SpringEditor::cut(std::span<const Pair> pairs) {
    const std::vector<Pair> wanted = in_order(pairs);
    SpringEdit edit;
    for (const auto& [first, second] : wanted) {
        const auto direction = direction_between(first, second);
        if (direction && has_spring(first, *direction))
            edit.removed.push_back({lattice_spring(first, second, *direction), direction->bit});
    }
    for (const Spring& spring : problem_.springs) {
        if (std::binary_search(wanted.begin(), wanted.end(), Pair(spring.first, spring.second)))
            edit.removed.push_back({spring, -1});
    }
    finish(edit);
    return edit;
}

SpringEdit SpringEditor::suture(const Shape& shape, double within, std::optional<double> stiffness) {
    if (particle_by_voxel().empty()) return {};
    const Cutter crosses(shape);
    const auto& x = problem_.rest_position;
    std::set<std::uint32_t> faces;
    const double longest = longest_lattice_spring();
    visit_near(shape, [&](std::uint32_t i) {
        if (!crosses.may_cut_from(x[i], longest)) return;
        visit_directions(problem_.group_bits & ~problem_.lattice.mask[i], [&](const Direction& direction) {
            const std::uint32_t j = neighbour(i, direction);
            if (j != no_particle && crosses(x[std::min(i, j)], x[std::max(i, j)])) faces.insert(i);
        });
    });
    std::vector<std::pair<std::uint32_t, std::uint32_t>> pairs;
    const glm::dvec3 all(problem_.lattice.dims);
    const glm::ivec3 reach(glm::min(glm::ceil(within / problem_.lattice.spacing), all));
    for (const std::uint32_t i : faces) {
        const glm::ivec3 at = problem_.lattice.coordinates(problem_.lattice.voxel[i]);
        const glm::ivec3 low = glm::max(at - reach, glm::ivec3(0));
        const glm::ivec3 high = glm::min(at + reach, problem_.lattice.dims - 1);
        for (int z = low.z; z <= high.z; ++z) {
            for (int y = low.y; y <= high.y; ++y) {
                for (int other = low.x; other <= high.x; ++other) {
                    const std::uint32_t j = particle_by_voxel()[std::size_t(
                        (std::ptrdiff_t(z) * problem_.lattice.dims.y + y) * problem_.lattice.dims.x + other)];
                    // In an empty voxel j is no_particle, which is not in `faces`. Only j > i is taken, so
                    // that each pair is found once.
                    if (j <= i || !faces.contains(j) || glm::distance(x[i], x[j]) > within) continue;
                    if (crosses(x[i], x[j])) pairs.emplace_back(i, j);
                }
            }
        }
    }
    return suture(pairs, stiffness);
}

SpringEdit SpringEditor::suture(std::span<const Pair> pairs, std::optional<double> stiffness) {
    std::vector<Pair> wanted = in_order(pairs);
    leave_out_joined(wanted);

    std::vector<ChangedSpring> on_lattice, beyond;
    for (const auto& [first, second] : wanted) {
        const auto direction = direction_between(first, second);
        if (direction) {
            const Spring spring = lattice_spring(first, second, *direction);
            if (stiffness.value_or(spring.stiffness) == spring.stiffness) {
                on_lattice.push_back({spring, direction->bit});
                continue;
            }
        }
        const double length = glm::distance(problem_.rest_position[first], problem_.rest_position[second]);
        const double k = stiffness.value_or(default_stiffness(problem_, first, second));
        beyond.push_back({{first, second, k, length}, -1});
    }
    SpringEdit edit;
    edit.added = std::move(on_lattice);
    edit.added.insert(edit.added.end(), beyond.begin(), beyond.end());
    finish(edit);
    return edit;
}

SpringEdit SpringEditor::join(std::span<const ChangedSpring> springs) {
    std::vector<Pair> apart;
    for (const ChangedSpring& changed : springs)
        apart.emplace_back(changed.spring.first, changed.spring.second);
    apart = in_order(apart);
    leave_out_joined(apart);

    SpringEdit edit;
    for (const ChangedSpring& changed : springs) {
        if (std::binary_search(apart.begin(), apart.end(), Pair(changed.spring.first, changed.spring.second)))
            edit.added.push_back(changed);
    }
    std::stable_partition(edit.added.begin(), edit.added.end(),
                          [](const ChangedSpring& changed) { return changed.bit >= 0; });
    finish(edit);
    return edit;
}

SpringEdit SpringEditor::make(const SpringDifference& difference) {
    SpringEdit edit;
    edit.removed = changed_springs(problem_, difference.removed);
    edit.added = changed_springs(problem_, difference.added);
    finish(edit);
    return edit;
}

void SpringEditor::leave_out_joined(std::vector<Pair>& pairs) const {
    std::vector<Pair> joined;
    for (const Spring& spring : problem_.springs) {
        const Pair pair(spring.first, spring.second);
        if (std::binary_search(pairs.begin(), pairs.end(), pair)) joined.push_back(pair);
    }
    std::sort(joined.begin(), joined.end());
    std::erase_if(pairs, [&](const Pair& pair) {
        const auto direction = direction_between(pair.first, pair.second);
        return (direction && has_spring(pair.first, *direction)) ||
               std::binary_search(joined.begin(), joined.end(), pair);
    });
}

void SpringEditor::finish(SpringEdit& edit) {
    apply(problem_, edit);

    std::vector<std::uint32_t> particles;
    for (const auto* list : {&edit.removed, &edit.added}) {
        for (const ChangedSpring& changed : *list) {
            particles.push_back(changed.spring.first);
            particles.push_back(changed.spring.second);
        }
    }
    std::sort(particles.begin(), particles.end());
    particles.erase(std::unique(particles.begin(), particles.end()), particles.end());

    // For each touched particle, its springs beyond the lattice in the order of Problem::springs.
    std::vector<std::vector<ListedSpring>> beyond(particles.size());
    const auto list = [&](std::uint32_t particle, std::uint32_t other, const Spring& spring) {
        const auto at = std::lower_bound(particles.begin(), particles.end(), particle);
        if (at == particles.end() || *at != particle) return;
        beyond[std::size_t(at - particles.begin())].push_back(
            {other, -1, spring.stiffness, spring.rest_length});
    };
    if (!particles.empty()) {
        for (const Spring& spring : problem_.springs) {
            list(spring.first, spring.second, spring);
            list(spring.second, spring.first, spring);
        }
    }
    for (std::size_t n = 0; n < particles.size(); ++n) {
        const std::uint32_t i = particles[n];
        const std::uint32_t mask = !problem_.lattice.mask.empty()
                                       ? problem_.lattice.mask[i]
                                       : ACTIVE_BIT | (problem_.is_pinned(i) ? PINNED_BIT : 0U);
        const auto begin = std::uint32_t(edit.listed.size());
        springs_.all_of(i, [&](std::uint32_t j, const Direction& direction) {
            edit.listed.push_back({j, direction.bit, problem_.spring_stiffness(i, j, direction),
                                   problem_.rest_length[std::size_t(direction.bit)]});
        });
        edit.listed.insert(edit.listed.end(), beyond[n].begin(), beyond[n].end());
        edit.touched.push_back({i, mask, begin, std::uint32_t(edit.listed.size())});
    }
}

SpringDifference::SpringDifference(const SpringEdit& edit) {
    const auto take = [](const std::vector<ChangedSpring>& from, Springs& to) {
        for (const auto& [spring, bit] : from) {
            if (bit < 0) {
                to.beyond.push_back(spring);
                continue;
            }
            const std::uint32_t flag = 1U << bit;
            const bool goes_on = !to.on_lattice.empty() && to.on_lattice.back().particle == spring.first &&
                                 to.on_lattice.back().bits < flag;
            if (goes_on) {
                to.on_lattice.back().bits |= flag;
            } else {
                to.on_lattice.push_back({spring.first, flag});
            }
        }
        to.on_lattice.shrink_to_fit();
        to.beyond.shrink_to_fit();
    };
    take(edit.removed, removed);
    take(edit.added, added);
}

std::vector<ChangedSpring> changed_springs(const Problem& problem, const SpringDifference::Springs& springs) {
    const Lattice& lattice = problem.lattice;
    const bool is_full = lattice.voxel.size() == lattice.voxel_count();
    std::vector<ChangedSpring> changed;
    std::size_t count = springs.beyond.size();
    for (const auto& [particle, bits] : springs.on_lattice) count += std::size_t(std::popcount(bits));
    changed.reserve(count);
    for (const auto& [particle, bits] : springs.on_lattice) {
        // Clang before version 16 cannot capture a structured binding in a lambda.
        const std::uint32_t first = particle;
        visit_directions(bits, [&](const Direction& direction) {
            const auto voxel =
                std::uint32_t(std::ptrdiff_t(lattice.voxel[first]) + lattice.stride(direction));
            const auto second = is_full ? voxel
                                        : std::uint32_t(std::lower_bound(lattice.voxel.begin() + first,
                                                                         lattice.voxel.end(), voxel) -
                                                        lattice.voxel.begin());
            changed.push_back({{first, second, problem.spring_stiffness(first, second, direction),
                                problem.rest_length[std::size_t(direction.bit)]},
                               direction.bit});
        });
    }
    for (const Spring& spring : springs.beyond) changed.push_back({spring, -1});
    return changed;
}

void apply(Problem& problem, const SpringDifference& difference) {
    SpringEdit edit;
    edit.removed = changed_springs(problem, difference.removed);
    edit.added = changed_springs(problem, difference.added);
    apply(problem, edit);
}

void apply(Problem& problem, const SpringEdit& edit) {
    std::vector<ChangedSpring> removed;  // springs beyond the lattice
    for (const ChangedSpring& changed : edit.removed) {
        if (changed.bit < 0) {
            removed.push_back(changed);
            continue;
        }
        problem.lattice.mask[changed.spring.first] &= ~(1U << changed.bit);
        problem.lattice.mask[changed.spring.second] &= ~(1U << (changed.bit ^ 1));
    }
    if (!removed.empty()) {
        std::sort(removed.begin(), removed.end(), [](const ChangedSpring& a, const ChangedSpring& b) {
            return std::pair(a.spring.first, a.spring.second) < std::pair(b.spring.first, b.spring.second);
        });
        std::erase_if(problem.springs, [&](const Spring& spring) { return is_one_of(spring, removed); });
    }
    for (const ChangedSpring& changed : edit.added) {
        if (changed.bit < 0) {
            problem.springs.push_back(changed.spring);
            continue;
        }
        problem.lattice.mask[changed.spring.first] |= 1U << changed.bit;
        problem.lattice.mask[changed.spring.second] |= 1U << (changed.bit ^ 1);
    }
}

}  // namespace voxspring
