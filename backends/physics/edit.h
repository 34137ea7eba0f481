// Cuts and sutures: a change of a problem's springs, found once on the host and then applied by every backend
// to what it keeps of them.
//
// Shapes are in rest coordinates, where no backend has moved anything yet: what an edit changes is the same
// on every backend, and known before the first step.
#pragma once

#include <array>
#include <cstdint>
#include <glm/vec3.hpp>
#include <optional>
#include <span>
#include <utility>
#include <variant>
#include <vector>

#include "backends/physics/problem.h"

namespace voxspring {

/// Crosses the line between particles on different sides; a particle on the plane is on the side that the
/// normal points to.
struct Plane {
    glm::dvec3 point{0};
    glm::dvec3 normal{0, 0, 1};  ///< of any length but 0
};
/// Crosses a line that goes through one of the triangles, their borders included.
struct TrianglePatch {
    std::vector<std::array<glm::dvec3, 3>> triangles;
};
/// Holds the line between particles that are both within `radius` of the centre.
struct Ball {
    glm::dvec3 centre{0};
    double radius = 0;
};
using Shape = std::variant<Plane, TrianglePatch, Ball>;

/// Whether `shape` cuts a spring between particles at `a` and `b`.
bool cuts(const Shape& shape, const glm::dvec3& a, const glm::dvec3& b);

/// A spring that was taken away or added, `first` < `second`.
struct ChangedSpring {
    Spring spring;
    int bit;  ///< of the direction from `first` to `second`, an odd one; -1: a spring beyond the lattice

    friend bool operator==(const ChangedSpring&, const ChangedSpring&) = default;
};

/// A spring as one of its two particles lists it.
struct ListedSpring {
    std::uint32_t neighbour;
    int bit;  ///< of the direction to the neighbour; -1: a spring beyond the lattice
    double stiffness;
    double rest_length;

    friend bool operator==(const ListedSpring&, const ListedSpring&) = default;
};

/// One change of springs. Holds all that a backend needs in order to bring what it keeps up to date.
struct SpringEdit {
    /// A particle that lost or gained a spring, and what it has now.
    struct Touched {
        std::uint32_t particle;
        std::uint32_t mask;        ///< as in Lattice::mask; active and pinned bits alone without a lattice
        std::uint32_t begin, end;  ///< its springs in `listed`

        friend bool operator==(const Touched&, const Touched&) = default;
    };

    std::vector<ChangedSpring> removed;  ///< lattice springs first
    std::vector<ChangedSpring> added;    ///< likewise; lattice springs of each particle by direction
    std::vector<Touched> touched;        ///< each particle once, ascending
    /// Every spring of the touched particles: those of the lattice by direction, then those of
    /// Problem::springs in their order.
    std::vector<ListedSpring> listed;

    bool empty() const { return touched.empty(); }
    std::span<const ListedSpring> springs_of(const Touched& particle) const {
        return std::span(listed).subspan(particle.begin, particle.end - particle.begin);
    }
    /// Whether it adds a spring that no mask bit stands for.
    bool leaves_lattice() const { return !added.empty() && added.back().bit < 0; }

    friend bool operator==(const SpringEdit&, const SpringEdit&) = default;
};

/// What an edit changes, and no more, in a few bytes per spring: for scenes of thousands of edits. Together
/// with the problem as it was before the edit this says all that a SpringEdit says (SpringEditor::make()).
struct SpringDifference {
    /// Lattice springs from one particle to later ones: the (odd) mask bits of their directions.
    struct OnLattice {
        std::uint32_t particle;
        std::uint32_t bits;
    };
    /// In the order of the edit. A particle whose springs are not in the order of their directions is there
    /// several times.
    struct Springs {
        std::vector<OnLattice> on_lattice;
        std::vector<Spring> beyond;  ///< of Problem::springs

        bool empty() const { return on_lattice.empty() && beyond.empty(); }
    };
    Springs removed, added;

    SpringDifference() = default;
    /// Implicit: wherever an edit is kept, its difference is all that has to be.
    SpringDifference(const SpringEdit& edit);  // NOLINT(google-explicit-constructor)

    /// Whether it adds a spring that no mask bit stands for.
    bool leaves_lattice() const { return !added.beyond.empty(); }
};

/// The springs of a difference, one by one and in the order of its edit. `problem` is the one that was
/// edited, with or without the edit.
std::vector<ChangedSpring> changed_springs(const Problem& problem, const SpringDifference::Springs& springs);

/// Edits a problem's springs, in place, and says what each edit changed. Keeps a reference to the problem,
/// which nobody else may edit meanwhile.
class SpringEditor {
public:
    explicit SpringEditor(Problem& problem);

    /// Removes the springs that `shape` cuts.
    SpringEdit cut(const Shape& shape);
    /// Removes every spring between the two particles of a pair, in either order; pairs that none joins stay
    /// as they are.
    SpringEdit cut(std::span<const std::pair<std::uint32_t, std::uint32_t>> pairs);

    /// Joins the two faces of a cut again: every two particles whose spring `shape` would cut, which are at
    /// most `within` apart at rest, no spring joins, and both of which lack a lattice spring that `shape`
    /// would cut.
    SpringEdit suture(const Shape& shape, double within, std::optional<double> stiffness = {});

    /// Joins pairs of different particles; those that are joined stay as they are.
    ///
    /// The spring is at rest where the particles are. Between neighbours of a direction in use, and without a
    /// given stiffness, it is the lattice's; else it is one of Problem::springs, by default as stiff
    /// as a lattice spring of the first group between the two materials.
    SpringEdit suture(std::span<const std::pair<std::uint32_t, std::uint32_t>> pairs,
                      std::optional<double> stiffness = {});

    /// Adds springs that another edit of the same particles removed or added, each as it was. Those whose
    /// particles a spring joins already are left out. Undoes a cut, or repeats a suture.
    SpringEdit join(std::span<const ChangedSpring> springs);

    /// Makes an edit of which the difference was kept. The problem is as it was before that edit.
    SpringEdit make(const SpringDifference& difference);

private:
    /// For each voxel the particle in it, or no_particle; empty without a lattice.
    const std::vector<std::uint32_t>& particle_by_voxel() const { return springs_.particle_by_voxel(); }

    /// The particle one step along `direction`, or no_particle.
    std::uint32_t neighbour(std::uint32_t particle, const Direction& direction) const;
    /// Calls visit(i) for each particle whose springs `shape` might cut.
    template <class Visit>
    void visit_near(const Shape& shape, Visit visit) const;
    double longest_lattice_spring() const;
    std::optional<Direction> direction_between(std::uint32_t first, std::uint32_t second) const;
    /// Whether the lattice has a spring along `direction`.
    bool has_spring(std::uint32_t particle, const Direction& direction) const {
        return (problem_.lattice.mask[particle] >> direction.bit & 1U) != 0;
    }
    /// The spring of the lattice between `first` and `second`, which lies along `direction` from it.
    Spring lattice_spring(std::uint32_t first, std::uint32_t second, const Direction& direction) const;
    /// Leaves in `pairs`, ascending and each with its smaller particle first, those that no spring joins.
    void leave_out_joined(std::vector<std::pair<std::uint32_t, std::uint32_t>>& pairs) const;
    /// Applies the edit to the problem and completes it with what its particles have then.
    void finish(SpringEdit& edit);

    Problem& problem_;
    const LatticeSprings springs_;
};

/// Does to `problem` what `edit` did to a problem equal to it.
void apply(Problem& problem, const SpringEdit& edit);
void apply(Problem& problem, const SpringDifference& difference);

}  // namespace voxspring
