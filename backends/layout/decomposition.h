// A lattice cut into parts, so that each is stepped elsewhere: on another device or in another process.
//
// A subdomain is a whole problem. It steps the particles of a brick of voxels. Around them it has ghosts: the
// particles that a lattice spring may join to one of the brick. Ghosts are pinned, because another subdomain
// steps them: the program that runs a subdomain writes their places after every step (BorderFacet::border()).
// The tool of a subdomain holds only particles that are stepped there. Particles keep their order and their
// rest positions, so a backend which sums forces in the order of neighbours.h gives the bits of the whole.
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
        int subdomain;                    ///< number of the one on the other side
        std::vector<std::uint32_t> sent;  ///< particles of this subdomain that are ghosts there, ascending
        std::vector<std::uint32_t>
            received;  ///< ghosts here: the particles that the other side has in `sent`, in that order
    };

    Problem problem;                      ///< its particles: own ones and ghosts
    std::vector<std::uint32_t> particle;  ///< per particle: its number in the whole problem, ascending
    std::vector<std::uint32_t> own;       ///< the particles that are stepped here, ascending
    std::vector<Border> borders;          ///< borders that are not empty, in ascending order of `subdomain`

    /// The part of a `state` of the whole problem that belongs to this subdomain.
    State part_of(const State& state) const { return voxspring::part_of(state, particle); }
    /// Copies the own particles of `part`, a state of this subdomain, to `whole`. Neither has empty lists.
    void copy_own(const State& part, State& whole) const;
    /// The changes that an edit of the whole problem makes here: to all springs with an own particle at one
    /// of their ends. So a spring across a border is changed on both sides. Only lattice springs may be
    /// edited.
    SpringEdit part_of(const SpringEdit& edit) const;
    /// The changes that an edit makes here, from its difference. `whole` is the whole problem.
    SpringDifference part_of(const Problem& whole, const SpringDifference& edit) const;
};

/// How a problem is cut: into slabs across its longest axis, then each slab across the next longest, then
/// each of the resulting columns across the third, so that all have about the same number of particles.
class Decomposition {
public:
    /// The voxels of a subdomain. `end` lies one beyond the last.
    struct Brick {
        glm::ivec3 begin, end;
    };

    /// The number of subdomains along each axis for `subdomains` slabs across the longest axis.
    static glm::ivec3 slabs(const Problem& problem, int subdomains);
    /// The number of subdomains along each axis for cuts across two or three axes, such that the subdomain
    /// that sends the most particles per step sends as few as possible. Returns slabs() if none sends fewer.
    static glm::ivec3 bricks(const Problem& problem, int subdomains);
    /// Empty, or why `problem` cannot be cut into that many subdomains along each axis.
    static std::string refusal(const Problem& problem, glm::ivec3 subdomains);

    /// Cuts a problem for which refusal() is empty.
    Decomposition(const Problem& problem, glm::ivec3 subdomains);

    int count() const { return int(bricks_.size()); }
    const Brick& brick(int number) const { return bricks_[std::size_t(number)]; }
    /// How many particles of subdomain `from` would be ghosts in `to` if every voxel had a particle: an upper
    /// bound. It is 0 if no spring can join the two subdomains.
    std::size_t most_sent(int from, int to) const;
    /// own(): the particles of `problem` that subdomain `number` steps, ascending. subdomain(): that
    /// subdomain. `problem` is the problem that was cut.
    std::vector<std::uint32_t> own(const Problem& problem, int number) const;
    Subdomain subdomain(const Problem& problem, int number) const;

    /// Makes `brick` the only subdomain: it has ghosts but no borders, so nothing moves the ghosts.
    static Subdomain alone(const Problem& problem, const Brick& brick);

private:
    Decomposition(std::vector<Brick> bricks, int reach) : bricks_(std::move(bricks)), reach_(reach) {}
    /// The number of particles that the busiest subdomain sends per step.
    static std::size_t sent_by_busiest(const Problem& problem, glm::ivec3 subdomains);

    std::vector<Brick> bricks_;
    int reach_;  ///< how many components of a spring's offset may differ from 0
};

}  // namespace voxspring
