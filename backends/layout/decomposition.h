// A lattice cut into parts, so that each part is stepped somewhere else: on another device, or in another
// process.
//
// A subdomain is a whole problem: the particles that it steps, which are those of a brick of voxels, and, as
// ghosts, the particles around them that a lattice spring may join to one of them. Ghosts are pinned, because
// their motion comes from the subdomain that steps them: the program that runs a subdomain writes their
// places after every step (BorderFacet::border()). In each subdomain a tool holds only those of its particles
// that are stepped there. Particles keep their order and their rest positions, so a backend which sums forces
// in the order of neighbours.h gives the same bits as for the whole.
#pragma once

#include <cstddef>
#include <cstdint>
#include <glm/glm.hpp>
#include <string>
#include <utility>
#include <vector>

#include "backends/physics/edit.h"
#include "backends/physics/problem.h"

namespace voxspring {

/// The part of `state` for these particles, in their order. Empty lists stay empty.
State part_of(const State& state, const std::vector<std::uint32_t>& particles);

struct Subdomain {
    /// The border between one subdomain and another.
    struct Border {
        int subdomain;                    ///< the one on the other side
        std::vector<std::uint32_t> sent;  ///< particles of this subdomain that are ghosts there, ascending
        std::vector<std::uint32_t>
            received;  ///< ghosts here: the particles that the other side has in `sent`, in that order
    };

    Problem problem;                      ///< of own particles and ghosts
    std::vector<std::uint32_t> particle;  ///< the number of each in the whole problem, ascending
    std::vector<std::uint32_t> own;       ///< the particles that are stepped here, ascending
    std::vector<Border> borders;          ///< borders that are not empty, by the subdomain on the other side

    /// The part of a `state` of the whole problem that belongs to this subdomain.
    State part_of(const State& state) const { return voxspring::part_of(state, particle); }
    /// Copies from `part` what belongs to this subdomain's own particles to their places in `whole`.
    void copy_own(const State& part, State& whole) const;
    /// The changes that an edit of the whole problem makes here: all springs with an own particle at one of
    /// their ends. So both subdomains at a border make the same edit. Only lattice springs may be edited.
    SpringEdit part_of(const SpringEdit& edit) const;
    /// The changes that an edit of `whole`, kept as its difference, makes here.
    SpringDifference part_of(const Problem& whole, const SpringDifference& edit) const;
};

/// How a problem is cut: between layers of voxels across its longest axis, then each of these slabs across
/// the next axis, and each of the resulting columns across the third, so that all subdomains have about the
/// same number of particles.
class Decomposition {
public:
    /// The voxels of a subdomain. `end` lies one beyond the last.
    struct Brick {
        glm::ivec3 begin, end;
    };

    /// The number of subdomains along each axis for `subdomains` slabs across the longest axis.
    static glm::ivec3 slabs(const Problem& problem, int subdomains);
    /// The number of subdomains along each axis for cuts across two or three axes, such that the busiest
    /// subdomain sends as few particles per step as possible. If slabs() sends no more, this returns the
    /// result of slabs().
    static glm::ivec3 bricks(const Problem& problem, int subdomains);
    /// Empty, or why `problem` cannot be cut into that many subdomains along each axis.
    static std::string refusal(const Problem& problem, glm::ivec3 subdomains);

    /// For a problem that refusal() accepts.
    Decomposition(const Problem& problem, glm::ivec3 subdomains);

    int count() const { return int(bricks_.size()); }
    const Brick& brick(int number) const { return bricks_[std::size_t(number)]; }
    /// How many particles of subdomain `from` would be ghosts of `to` if there were one in each voxel: an
    /// upper bound. 0 for subdomains that no spring may join.
    std::size_t most_sent(int from, int to) const;
    /// The particles that subdomain `number` steps, ascending; and the subdomain itself. `problem` is the
    /// problem that was cut.
    std::vector<std::uint32_t> own(const Problem& problem, int number) const;
    Subdomain subdomain(const Problem& problem, int number) const;

    /// The content of `brick` as the only subdomain: it has ghosts, but nothing moves them.
    static Subdomain alone(const Problem& problem, const Brick& brick);

private:
    Decomposition(std::vector<Brick> bricks, int reach) : bricks_(std::move(bricks)), reach_(reach) {}
    /// How many particles the busiest subdomain sends per step.
    static std::size_t sent_by_busiest(const Problem& problem, glm::ivec3 subdomains);

    std::vector<Brick> bricks_;
    int reach_;  ///< how many components of a spring's offset may differ from 0
};

}  // namespace voxspring
