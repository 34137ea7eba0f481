// Blocks of voxels that rest, which an implicit kernel leaves out of a step.
//
// A step of a block depends on its particles and on those of the blocks around it. If the latest step changed
// no bit of these particles, the next one would change none either, and is left out (term_resting). x(t) and
// x(t - dt) of such a block are equal, so both buffers already hold what the step would write. A block in
// which a step changes something lists itself and its neighbours for the next step, which takes only listed
// blocks. Before the first step, unless there is a tool, a check of all blocks, which moves no particle,
// lists those that this step takes. After an edit, for example, the host lists all blocks (Resting::wake()).
#pragma once

#include "backends/layout/records/implicit.h"
#include "cuda/kernels/terms.h"

namespace voxspring::cuda {

/// A block and the 26 around it.
inline constexpr int blocks_around = 27;

/// Block `number`, from 0, of the block `origin` and the 26 around it. A block has x * y * z voxels.
VOXSPRING_HOST_DEVICE inline BlockOrigin around(const ActiveBlocks& blocks, const BlockOrigin& origin,
                                                int number, int x, int y, int z) {
    const int dx = number % 3 - 1, dy = number / 3 % 3 - 1, dz = number / 9 - 1;
    return {origin.x + dx * x, origin.y + dy * y, origin.z + dz * z,
            origin.place + dx + dy * blocks.row + dz * blocks.slice};
}

#ifdef __CUDACC__
__device__ inline unsigned thread_of_block() {
    return threadIdx.x + blockDim.x * (threadIdx.y + blockDim.y * threadIdx.z);
}

/// One of the blocks that around() numbers. Thread n of a block looks at number n.
struct BlockAround {
    BlockOrigin origin;
    /// Already listed for the next step. Also set for a place without particles, and in threads beyond the
    /// last number.
    bool listed;
};

__device__ inline BlockAround look_around(const ActiveBlocks& blocks, const BlockOrigin& origin) {
    const unsigned thread = thread_of_block();
    if (thread >= blocks_around) return {{}, true};
    const BlockOrigin other =
        around(blocks, origin, int(thread), int(blockDim.x), int(blockDim.y), int(blockDim.z));
    return {other, __ldcg(blocks.next_marks + other.place) != 0};
}

/// Lists the block and those around it for the next step if a particle of the block changed. To be called by
/// all its threads after its step. `changed`: whether the thread's particle has changed.
__device__ inline void list_for_next_step(const ActiveBlocks& blocks, const BlockOrigin& origin,
                                          const BlockAround& other, bool changed) {
    const unsigned thread = thread_of_block();
    if (__syncthreads_or(int(changed)) != 0 && thread < 32) {
        const bool is_new = !other.listed && atomicExch(blocks.next_marks + other.origin.place, 1U) == 0;
        const unsigned all_new = __ballot_sync(~0U, int(is_new));
        unsigned first = 0;
        if (thread == 0 && all_new != 0) first = atomicAdd(blocks.next_count, unsigned(__popc(all_new)));
        first = __shfl_sync(~0U, first, 0);
        if (is_new) blocks.next[first + unsigned(__popc(all_new & ((1U << thread) - 1)))] = other.origin;
    }
    if (thread == 0) blocks.now_marks[origin.place] = 0;
}

/// Calls step_block(origin) for each block of the list; step_block() returns whether the thread's particle
/// changed. Only the device knows the length of the list, so each block of threads goes on taking blocks
/// until the list ends.
template <class StepBlock>
__device__ void for_each_active_block(const ActiveBlocks& blocks, StepBlock step_block) {
    // The count and `now` are loaded together here, marks and particles together below. If few blocks move,
    // a step takes as long as the loads that a thread waits for one after the other. `now` has an element for
    // each block of threads, so it may be read before the count is known.
    const unsigned count = *blocks.now_count;
    BlockOrigin origin = blocks.now[blockIdx.x];
    // The last block of threads that reads the count empties the list. The vote makes sure that all threads
    // of the block have read the count before.
    const unsigned taken = __syncthreads_or(int(count != 0)) != 0 ? count : 0;
    if (thread_of_block() == 0 && atomicInc(blocks.readers, gridDim.x - 1) == gridDim.x - 1) {
        *blocks.taken = taken;
        *blocks.now_count = 0;
    }
    for (unsigned b = blockIdx.x; b < count;) {
        const BlockAround other = look_around(blocks, origin);
        list_for_next_step(blocks, origin, other, step_block(origin));
        b += gridDim.x;
        if (b < count) origin = blocks.now[b];
    }
}
#else
/// list_for_next_step() for the host, where blocks run one after another.
inline void list_for_next_step(const ActiveBlocks& blocks, const BlockOrigin& origin, int x, int y, int z,
                               bool changed) {
    for (int n = 0; n < blocks_around && changed; ++n) {
        const BlockOrigin other = around(blocks, origin, n, x, y, z);
        if (blocks.next_marks[other.place] != 0) continue;
        blocks.next_marks[other.place] = 1;
        blocks.next[(*blocks.next_count)++] = other;
    }
    blocks.now_marks[origin.place] = 0;
}
#endif

}  // namespace voxspring::cuda
