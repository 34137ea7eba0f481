// Cuts and sutures change a problem's springs. The host finds each change once, and every backend applies it
// to its own data about springs.
//
// Shapes are compared with where particles are at rest, which does not depend on how a backend moves them. So
// an edit changes the same springs on every backend, and these are known before the first step.
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

/// Cuts the line between two particles on different sides of it. A particle on the plane counts to the side
/// that the normal points to.
struct Plane {
    glm::dvec3 point{0};
    glm::dvec3 normal{0, 0, 1};  ///< of any length but 0
};
/// Cuts a line that goes through one of the triangles, their borders included.
struct TrianglePatch {
    std::vector<std::array<glm::dvec3, 3>> triangles;
};
/// Cuts the line between two particles that are both within `radius` of the centre.
struct Ball {
    glm::dvec3 centre{0};
    double radius = 0;
};
using Shape = std::variant<Plane, TrianglePatch, Ball>;

/// Whether `shape` cuts a spring between particles at `a` and `b`.
bool cuts(const Shape& shape, const glm::dvec3& a, const glm::dvec3& b);

/// A spring that an edit removes or adds, between particles `first` < `second`.
struct ChangedSpring {
    Spring spring;
    /// Mask bit of the direction from `first` to `second`, always odd; -1: a spring beyond the lattice.
    int bit;

    friend bool operator==(const ChangedSpring&, const ChangedSpring&) = default;
};

/// A spring as seen from one of its two particles.
struct ListedSpring {
    std::uint32_t neighbour;
    int bit;  ///< mask bit of the direction to the neighbour; -1: a spring beyond the lattice
    double stiffness;
    double rest_length;

    friend bool operator==(const ListedSpring&, const ListedSpring&) = default;
};

/// One change of springs. It holds all that a backend needs to update its data about springs.
struct SpringEdit {
    /// A particle that lost or gained a spring, with its bits and springs after the edit.
    struct Touched {
        std::uint32_t particle;
        std::uint32_t mask;        ///< as in Lattice::mask; without a lattice only active and pinned bits
        std::uint32_t begin, end;  ///< range of its springs in `listed`

        friend bool operator==(const Touched&, const Touched&) = default;
    };

    std::vector<ChangedSpring> removed;  ///< lattice springs first
    /// Lattice springs first. suture() orders these, and the others, by `first` and then by `second`.
    std::vector<ChangedSpring> added;
    std::vector<Touched> touched;  ///< each particle once, ascending
    /// The springs of each touched particle, one particle after the other: its lattice springs by direction,
    /// then its springs of Problem::springs in their order.
    std::vector<ListedSpring> listed;

    bool empty() const { return touched.empty(); }
    std::span<const ListedSpring> springs_of(const Touched& particle) const {
        return std::span(listed).subspan(particle.begin, particle.end - particle.begin);
    }
    /// Whether the edit adds a spring beyond the lattice.
    bool leaves_lattice() const { return !added.empty() && added.back().bit < 0; }

    friend bool operator==(const SpringEdit&, const SpringEdit&) = default;
};

/// Only the springs that an edit removes and adds, in a few bytes per spring, for scenes of thousands of
/// edits. SpringEditor::make() makes the SpringEdit from this and the problem before the edit.
struct SpringDifference {
    /// Lattice springs from `particle` to later particles. `bits`: their mask bits, all odd.
    struct OnLattice {
        std::uint32_t particle;
        std::uint32_t bits;
    };
    /// Springs in the order of the edit. A particle appears several times in `on_lattice` if the edit does
    /// not list its springs one after another in the order of their directions.
    struct Springs {
        std::vector<OnLattice> on_lattice;
        std::vector<Spring> beyond;  ///< springs of Problem::springs

        bool empty() const { return on_lattice.empty() && beyond.empty(); }
    };
    Springs removed, added;

    SpringDifference() = default;
    /// Implicit, so that an edit can be passed to code that keeps only its difference.
    SpringDifference(const SpringEdit& edit);  // NOLINT(google-explicit-constructor)

    /// Whether the edit adds a spring beyond the lattice.
    bool leaves_lattice() const { return !added.beyond.empty(); }
};

/// Lists the springs of a difference one by one, in the order of its edit. `problem` is the edited problem,
/// as it was before the edit or is after it.
std::vector<ChangedSpring> changed_springs(const Problem& problem, const SpringDifference::Springs& springs);

/// Edits a problem's springs in place, and says what each edit changed. Keeps a reference to the problem,
/// which nothing else may edit meanwhile.
class SpringEditor {
public:
    explicit SpringEditor(Problem& problem);

    /// Removes the springs that `shape` cuts.
    SpringEdit cut(const Shape& shape);
    /// Removes the springs that join the two particles of each pair, whichever comes first in the pair. Pairs
    /// that no spring joins stay as they are.
    SpringEdit cut(std::span<const std::pair<std::uint32_t, std::uint32_t>> pairs);

    /// Closes a cut: adds a spring between every two particles that (a) are at most `within` apart at rest,
    /// (b) have no spring between them, (c) have a line between them that `shape` cuts, and (d) have each
    /// lost a lattice spring that `shape` cuts. Without a lattice it adds none. `stiffness`: as for the
    /// suture() of pairs below.
    SpringEdit suture(const Shape& shape, double within, std::optional<double> stiffness = {});

    /// Joins each pair of different particles with a spring. Pairs that are joined already stay as they are.
    ///
    /// If the two are lattice neighbours in a direction in use, the spring is a lattice spring, unless
    /// `stiffness` is given and differs from that of a lattice spring. Otherwise it is one of
    /// Problem::springs: its rest length is the distance at rest, and its default stiffness that of a lattice
    /// spring of the first group in use.
    SpringEdit suture(std::span<const std::pair<std::uint32_t, std::uint32_t>> pairs,
                      std::optional<double> stiffness = {});

    /// Undoes a cut or repeats a suture: adds springs that another edit of the same particles removed or
    /// added, each as it was. A spring is left out if another one joins its particles already.
    SpringEdit join(std::span<const ChangedSpring> springs);

    /// Makes an edit from its difference. The problem must be as it was before that edit.
    SpringEdit make(const SpringDifference& difference);

private:
    /// The particle in each voxel, or no_particle. Empty without a lattice.
    const std::vector<std::uint32_t>& particle_by_voxel() const { return springs_.particle_by_voxel(); }

    /// The neighbour of `particle` in `direction`, or no_particle if there is none.
    std::uint32_t neighbour(std::uint32_t particle, const Direction& direction) const;
    /// Calls visit(i) for each particle whose springs `shape` might cut.
    template <class Visit>
    void visit_near(const Shape& shape, Visit visit) const;
    double longest_lattice_spring() const;
    std::optional<Direction> direction_between(std::uint32_t first, std::uint32_t second) const;
    /// Whether `particle` has a lattice spring along `direction`.
    bool has_spring(std::uint32_t particle, const Direction& direction) const {
        return (problem_.lattice.mask[particle] >> direction.bit & 1U) != 0;
    }
    /// The lattice spring between `first` and `second`, which lies along `direction` from `first`.
    Spring lattice_spring(std::uint32_t first, std::uint32_t second, const Direction& direction) const;
    /// Removes from `pairs` those that a spring joins already. `pairs` must ascend, with the smaller particle
    /// first in each pair.
    void leave_out_joined(std::vector<std::pair<std::uint32_t, std::uint32_t>>& pairs) const;
    /// Applies the edit to the problem, and fills in `touched` and `listed`.
    void finish(SpringEdit& edit);

    Problem& problem_;
    const LatticeSprings springs_;
};

/// Applies `edit`, which was made for an equal problem, to `problem`.
void apply(Problem& problem, const SpringEdit& edit);
void apply(Problem& problem, const SpringDifference& difference);

}  // namespace voxspring
