// A lattice cut into parts, so that each is stepped somewhere else: on another device, in another process.
//
// A subdomain is a whole problem: the particles that it steps, those of a brick of voxels, and as ghosts
// those around it that a spring of the lattice may join to one of them. Ghosts are pinned, for their motion
// comes from the subdomain that steps them: what runs a subdomain writes their places after every step
// (Backend::border()). A tool holds in each subdomain those of its particles that are stepped there.
// Particles keep their order and their rest positions, so that a backend which sums forces in the order of
// neighbours.h gives the bits that it gives for the whole.
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

/// What these particles have in `state`, in their order. Lists that are empty stay so.
State part_of(const State& state, const std::vector<std::uint32_t>& particles);

struct Subdomain {
    /// What one subdomain and another have between them.
    struct Border {
        int subdomain;                    ///< on the other side
        std::vector<std::uint32_t> sent;  ///< particles of this subdomain that are ghosts there, ascending
        std::vector<std::uint32_t>
            received;  ///< ghosts here: what the other side has as `sent`, in that order
    };

    Problem problem;                      ///< of own particles and ghosts
    std::vector<std::uint32_t> particle;  ///< what each is in the whole problem, ascending
    std::vector<std::uint32_t> own;       ///< those of these particles that are stepped here, ascending
    std::vector<Border> borders;          ///< those that are not empty, by the subdomain on the other side

    /// `state` of the whole problem, as far as it lies here.
    State part_of(const State& state) const { return voxspring::part_of(state, particle); }
    /// Copies what this subdomain's own particles have in `part` to where they are in the `whole`.
    void copy_own(const State& part, State& whole) const;
    /// What an edit of the whole problem changes here: every spring that an own particle has at one of its
    /// ends. Both subdomains at a border so make the same edit. The springs are the lattice's.
    SpringEdit part_of(const SpringEdit& edit) const;
    /// The same of an edit of `whole`, kept as its difference.
    SpringDifference part_of(const Problem& whole, const SpringDifference& edit) const;
};

/// How a problem is cut: between layers of voxels across its longest axis, then each of these slabs across
/// the next, and its columns across the third, so that each subdomain has about as many particles as any
/// other.
class Decomposition {
public:
    /// The voxels of a subdomain: `end` is beyond the last.
    struct Brick {
        glm::ivec3 begin, end;
    };

    /// Into so many subdomains across the longest axis alone.
    static glm::ivec3 slabs(const Problem& problem, int subdomains);
    /// Into so many, across two axes or three, that the one which sends most particles in a step sends as few
    /// as it can; slabs() where it sends no fewer than there.
    static glm::ivec3 bricks(const Problem& problem, int subdomains);
    /// Empty, or why `problem` cannot be cut into so many along each axis.
    static std::string refusal(const Problem& problem, glm::ivec3 subdomains);

    /// For a problem that refusal() has nothing against.
    Decomposition(const Problem& problem, glm::ivec3 subdomains);

    int count() const { return int(bricks_.size()); }
    const Brick& brick(int number) const { return bricks_[std::size_t(number)]; }
    /// How many particles of the subdomain `from` are ghosts of `to` at most, if there were one in each
    /// voxel; 0 of those that no spring may join.
    std::size_t most_sent(int from, int to) const;
    /// The particles of the problem `problem`, which was cut, that the subdomain steps, ascending; and the
    /// subdomain itself.
    std::vector<std::uint32_t> own(const Problem& problem, int number) const;
    Subdomain subdomain(const Problem& problem, int number) const;

    /// What lies in `brick`, as the only subdomain: with ghosts, and with nothing beside it that moves them.
    static Subdomain alone(const Problem& problem, const Brick& brick);

private:
    Decomposition(std::vector<Brick> bricks, int reach) : bricks_(std::move(bricks)), reach_(reach) {}
    /// How many particles the subdomain sends in a step that sends most.
    static std::size_t sent_by_busiest(const Problem& problem, glm::ivec3 subdomains);

    std::vector<Brick> bricks_;
    int reach_;  ///< along how many axes at once springs lead
};

}  // namespace voxspring
