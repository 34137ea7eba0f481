// Cuts and sutures change a problem's springs. The host finds out once which springs change, and every
// backend applies these changes to its own tables of springs.
//
// A shape cuts springs by where their ends are at rest, not by where a backend has moved them. So an edit by
// a shape changes the same springs on every backend, whenever it is made.
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

/// Cuts the line between two particles on different sides of it. A particle on the plane counts as on the
/// side to which the normal points.
struct Plane {
    glm::dvec3 point{0};
    glm::dvec3 normal{0, 0, 1};  ///< of any length but 0
};
/// Cuts the line between two particles if it goes through one of the triangles, borders included.
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
    /// Mask bit of the direction from `first` to `second`, which is always odd; -1: not a lattice spring.
    int bit;

    friend bool operator==(const ChangedSpring&, const ChangedSpring&) = default;
};

/// A spring as seen from one of its two particles.
struct ListedSpring {
    std::uint32_t neighbour;
    int bit;  ///< mask bit of the direction to the neighbour; -1: not a lattice spring
    double stiffness;
    double rest_length;

    friend bool operator==(const ListedSpring&, const ListedSpring&) = default;
};

/// One cut or suture. It holds all that a backend needs to update its tables of springs.
struct SpringEdit {
    /// A particle that lost or gained a spring, with its mask and springs after the edit.
    struct Touched {
        std::uint32_t particle;
        std::uint32_t mask;        ///< as in Lattice::mask; without a lattice only active and pinned bits
        std::uint32_t begin, end;  ///< range of its springs in `listed`

        friend bool operator==(const Touched&, const Touched&) = default;
    };

    std::vector<ChangedSpring> removed;  ///< lattice springs first
    /// Lattice springs first. suture() orders the lattice springs, and the others, by `first` and then by
    /// `second`.
    std::vector<ChangedSpring> added;
    std::vector<Touched> touched;  ///< each particle once, ascending
    /// The springs of each touched particle, one particle after the other: its lattice springs by direction,
    /// then its springs of Problem::springs in their order.
    std::vector<ListedSpring> listed;

    bool empty() const { return touched.empty(); }
    std::span<const ListedSpring> springs_of(const Touched& particle) const {
        return std::span(listed).subspan(particle.begin, particle.end - particle.begin);
    }
    /// Whether the edit adds a spring that is not a lattice spring (Problem::springs).
    bool leaves_lattice() const { return !added.empty() && added.back().bit < 0; }

    friend bool operator==(const SpringEdit&, const SpringEdit&) = default;
};

/// The springs that an edit removes and adds, without anything else: at most 24 bytes per spring, for scenes
/// of thousands of edits. SpringEditor::make() makes the SpringEdit from this and the problem before the
/// edit.
struct SpringDifference {
    /// Lattice springs from `particle` to later particles. `bits`: their mask bits, all odd.
    struct OnLattice {
        std::uint32_t particle;
        std::uint32_t bits;
    };
    /// Springs in the order of the edit. `on_lattice` has several elements for a particle if the edit does
    /// not list that particle's springs one after another in the order of their directions.
    struct Springs {
        std::vector<OnLattice> on_lattice;
        std::vector<Spring> beyond;  ///< springs of Problem::springs

        bool empty() const { return on_lattice.empty() && beyond.empty(); }
    };
    Springs removed, added;

    SpringDifference() = default;
    /// An implicit conversion, so that an edit can be passed to a function that takes a difference.
    SpringDifference(const SpringEdit& edit);  // NOLINT(google-explicit-constructor)

    /// Whether the edit adds a spring that is not a lattice spring (Problem::springs).
    bool leaves_lattice() const { return !added.beyond.empty(); }
};

/// Lists the springs of a difference one by one, in the order of its edit. `problem` is the edited problem,
/// either before or after the edit.
std::vector<ChangedSpring> changed_springs(const Problem& problem, const SpringDifference::Springs& springs);

/// Edits a problem's springs in place, and returns what each edit changed. Keeps a reference to the problem.
/// Nothing else may edit the problem while the editor is in use.
class SpringEditor {
public:
    explicit SpringEditor(Problem& problem);

    /// Removes the springs that `shape` cuts.
    SpringEdit cut(const Shape& shape);
    /// Removes the springs that join the two particles of each pair, in whichever order the pair names them.
    /// Pairs that no spring joins are ignored.
    SpringEdit cut(std::span<const std::pair<std::uint32_t, std::uint32_t>> pairs);

    /// Closes a cut: adds a spring between every two particles that (a) are at most `within` apart at rest,
    /// (b) have no spring between them, (c) have a line between them that `shape` cuts, and (d) have each
    /// lost a lattice spring that `shape` cuts. Without a lattice it adds none. `stiffness` means the same as
    /// for the suture() of pairs below.
    SpringEdit suture(const Shape& shape, double within, std::optional<double> stiffness = {});

    /// Joins each pair of different particles with a spring. Pairs that a spring joins already are ignored.
    ///
    /// If the two are lattice neighbours in a direction in use, the new spring is a lattice spring, unless
    /// `stiffness` is given and differs from that of a lattice spring. Otherwise the new spring is added to
    /// Problem::springs: its rest length is the distance at rest, and its default stiffness is that of a
    /// lattice spring of the first group in use or, if none is in use, of a face spring.
    SpringEdit suture(std::span<const std::pair<std::uint32_t, std::uint32_t>> pairs,
                      std::optional<double> stiffness = {});

    /// Undoes a cut or repeats a suture: adds `springs`, which another edit of the same particles removed or
    /// added, each as it was. A spring is left out if another one joins its particles already.
    SpringEdit join(std::span<const ChangedSpring> springs);

    /// Makes an edit from its difference. The problem must be as it was before that edit.
    SpringEdit make(const SpringDifference& difference);

private:
    /// The particle in each voxel, or no_particle. Empty without a lattice.
    const std::vector<std::uint32_t>& particle_by_voxel() const { return springs_.particle_by_voxel(); }

    /// The neighbour of `particle` in `direction`, or no_particle if there is none.
    std::uint32_t neighbour(std::uint32_t particle, const Direction& direction) const;
    /// Calls visit(i) for each particle with lattice springs that `shape` might cut.
    template <class Visit>
    void visit_near(const Shape& shape, Visit visit) const;
    /// An upper bound of the distance at rest between the ends of a lattice spring. Its rest length may be
    /// another.
    double longest_lattice_spring() const;
    std::optional<Direction> direction_between(std::uint32_t first, std::uint32_t second) const;
    /// Whether `particle` has a lattice spring along `direction`.
    bool has_spring(std::uint32_t particle, const Direction& direction) const {
        return (problem_.lattice.mask[particle] >> direction.bit & 1U) != 0;
    }
    /// The lattice spring between `first` and `second`, which lies along `direction` from `first`.
    Spring lattice_spring(std::uint32_t first, std::uint32_t second, const Direction& direction) const;
    /// Removes from `pairs` the pairs that a spring joins already. `pairs` must be in ascending order, with
    /// the smaller particle first in each pair.
    void leave_out_joined(std::vector<std::pair<std::uint32_t, std::uint32_t>>& pairs) const;
    /// Applies `edit` to the problem, and fills in its lists `touched` and `listed`.
    void finish(SpringEdit& edit);

    Problem& problem_;
    const LatticeSprings springs_;
};

/// Applies an edit, which was made for an equal problem, to `problem`.
void apply(Problem& problem, const SpringEdit& edit);
void apply(Problem& problem, const SpringDifference& difference);

}  // namespace voxspring
