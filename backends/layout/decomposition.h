// A lattice is cut into parts (subdomains), each of which may be stepped on another device or in another
// process.
//
// A subdomain is itself a Problem. It steps the particles of a brick of voxels. Around them it has ghosts:
// the particles that a lattice spring may join to a particle of the brick. Ghosts are pinned, because another
// subdomain steps them: after every step their places come from there (BorderFacet). The tool of a subdomain
// holds only particles that this subdomain steps. Particles keep their order and their rest positions, so a
// backend that sums forces in the order of neighbours.h computes the same bits as for the whole problem.
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

/// The part of `state` for `particles`, in their order. Empty lists stay empty.
State part_of(const State& state, const std::vector<std::uint32_t>& particles);

struct Subdomain {
    /// The border between this subdomain and another.
    struct Border {
        int subdomain;                    ///< number of the other subdomain
        std::vector<std::uint32_t> sent;  ///< own particles that are ghosts there, ascending
        /// Ghosts of this subdomain that the other one steps, in the order in which it has them in `sent`.
        std::vector<std::uint32_t> received;
    };

    Problem problem;                      ///< with the subdomain's own particles and its ghosts
    std::vector<std::uint32_t> particle;  ///< per particle: its number in the whole problem, ascending
    std::vector<std::uint32_t> own;       ///< the particles that this subdomain steps, ascending
    std::vector<Border> borders;          ///< borders that are not empty, in ascending order of `subdomain`

    /// The part of `state`, a state of the whole problem, that belongs to this subdomain.
    State part_of(const State& state) const { return voxspring::part_of(state, particle); }
    /// Copies this subdomain's own particles from `part`, its state, to `whole`. No list of either state may
    /// be empty.
    void copy_own(const State& part, State& whole) const;
    /// The part of an edit of the whole problem that concerns this subdomain: the changes of all springs with
    /// an own particle at one end or both. So both subdomains change a spring across their border. Only
    /// lattice springs may be edited.
    SpringEdit part_of(const SpringEdit& edit) const;
    /// Does the same for the difference of an edit. `whole` is the whole problem.
    SpringDifference part_of(const Problem& whole, const SpringDifference& edit) const;
};

/// How a problem is cut: into slabs across its longest axis, then each slab across the next longest axis,
/// then each of the resulting columns across the third axis, so that all subdomains have about the same
/// number of particles.
class Decomposition {
public:
    /// The box of voxels of a subdomain, from `begin` to `end` (exclusive).
    struct Brick {
        glm::ivec3 begin, end;
    };

    /// How many subdomains there are along each axis if a problem is cut into `subdomains` slabs across its
    /// longest axis.
    static glm::ivec3 slabs(const Problem& problem, int subdomains);
    /// How many subdomains there should be along each axis if a problem is cut across two or three axes. The
    /// subdomain that sends the most particles per step then sends as few as possible. Returns slabs() if no
    /// such cut sends fewer than slabs do.
    static glm::ivec3 bricks(const Problem& problem, int subdomains);
    /// Empty, or why `problem` cannot be cut into `subdomains` subdomains along each axis.
    static std::string refusal(const Problem& problem, glm::ivec3 subdomains);

    /// Cuts a problem for which refusal() is empty.
    Decomposition(const Problem& problem, glm::ivec3 subdomains);

    int count() const { return int(bricks_.size()); }
    const Brick& brick(int number) const { return bricks_[std::size_t(number)]; }
    /// An upper bound of the number of particles of subdomain `from` that are ghosts in `to`. It is 0 if the
    /// two bricks are too far apart for a lattice spring.
    std::size_t most_sent(int from, int to) const;
    /// own(): the particles of `problem` that subdomain `number` steps, ascending. subdomain(): that
    /// subdomain itself. `problem` is the problem that was cut.
    std::vector<std::uint32_t> own(const Problem& problem, int number) const;
    Subdomain subdomain(const Problem& problem, int number) const;

    /// The particles of `lattice` in `brick`, ascending.
    static std::vector<std::uint32_t> particles_in(const Lattice& lattice, const Brick& brick);
    /// Makes a subdomain of `brick` alone. It has ghosts but no borders, so nothing moves the ghosts.
    static Subdomain alone(const Problem& problem, const Brick& brick);

private:
    Decomposition(std::vector<Brick> bricks, int reach) : bricks_(std::move(bricks)), reach_(reach) {}
    /// The number of particles that the busiest subdomain sends per step.
    static std::size_t sent_by_busiest(const Problem& problem, glm::ivec3 subdomains);

    std::vector<Brick> bricks_;
    int reach_;  ///< how many components of a spring's offset may differ from 0
};

}  // namespace voxspring
