// A lattice cut into slabs, so that each part is stepped somewhere else: on another device, in another
// process.
//
// A slab is a problem of its own: the particles that it steps, and as ghosts those of one layer of voxels on
// either side, since no spring of the lattice reaches farther. Ghosts are pinned, for their motion comes from
// the slab that steps them: whoever runs a slab writes their places after every step (Backend::border()).
// A tool holds in each slab those of its particles that are stepped there.
// Particles keep their order and their rest positions, so that a backend which sums forces in the order of
// neighbours.h gives the bits that it gives for the whole.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "backends/physics/edit.h"
#include "backends/physics/problem.h"

namespace voxspring {

struct Slab {
    /// What one slab and the next have between them.
    struct Border {
        int slab;                         ///< on the other side
        std::vector<std::uint32_t> sent;  ///< particles of this slab that are ghosts there, ascending
        std::vector<std::uint32_t>
            received;  ///< ghosts here: what the other side has as `sent`, in that order
    };

    Problem problem;                      ///< of own particles and ghosts
    std::vector<std::uint32_t> particle;  ///< what each is in the whole problem, ascending
    std::vector<std::uint32_t> own;       ///< those of this slab's particles that it steps, ascending
    std::vector<Border> borders;          ///< with the slab before this one, then with the one behind

    /// `state` of the whole problem, as far as it lies here.
    State part_of(const State& state) const;
    /// Copies what this slab's own particles have in `part` to where they are in the `whole`.
    void copy_own(const State& part, State& whole) const;
    /// What an edit of the whole problem changes here: every spring that an own particle has at one of its
    /// ends. Both slabs at a border so make the same edit. The springs are the lattice's.
    SpringEdit part_of(const SpringEdit& edit) const;
};

/// How a problem is cut: across the longest axis of its lattice, between layers of voxels, so that each slab
/// has about as many particles as any other.
class SlabCuts {
public:
    /// Empty, or why `problem` cannot be cut into so many slabs.
    static std::string refusal(const Problem& problem, int slabs);

    /// For a problem that refusal() has nothing against.
    SlabCuts(const Problem& problem, int slabs);

    int count() const { return int(first_.size()) - 1; }
    int axis() const { return axis_; }
    /// The layers [first_layer(n), first_layer(n + 1)) are slab n's.
    int first_layer(int slab) const { return first_[std::size_t(slab)]; }

    /// Of the problem that was cut: the particles that the slab steps, ascending; and the slab itself.
    std::vector<std::uint32_t> own(const Problem& problem, int slab) const;
    Slab slab(const Problem& problem, int number) const;

private:
    int axis_;
    std::vector<int> first_;
};

}  // namespace voxspring
