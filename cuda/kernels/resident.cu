// Macros: LANES threads per block have at most TURNS particles each, and POLLERS more threads wait for at
// most ROUNDS points of other blocks each. SLOTS: how many points each half of shared memory holds. BORDERS:
// the kinds of border in use, as bits. MASKED: 1 if springs need masks (ResidentShape::masked). TOOL: the
// name of a ToolMode. PART: 1 if the kernel steps a part of a body, beside kernels that step the others.
#include "cuda/kernels/entry.h"
#include "cuda/kernels/resident_block.h"

namespace voxspring::cuda {

static_assert(sizeof(Real) == sizeof(float), "a tagged point has room for three floats");

inline constexpr ResidentShape shape{LANES,       POLLERS,        ROUNDS,    SLOTS, BORDERS,
                                     MASKED != 0, ToolMode::TOOL, PART != 0, TURNS};
using Block = ResidentBlock<Terms, shape>;

/// Takes `count` steps, at least one. In ToolMode::ticks it takes the steps that the host orders instead. The
/// state is in `words` and `previous` or, by increments, `increment`, whose axes are `pitch` elements apart;
/// the state after the last step replaces it. Points are published with the tags `tag` + 1, `tag` + 2 and so
/// on. `launches`: how many launches have counted their blocks in `step.started_blocks`, this one included.
extern "C" __global__ void __launch_bounds__(Block::all_threads, 1)
    step(const __grid_constant__ Block::Step step, ParticleRecord<float>* words,
         ParticleRecord<float>* previous, float* increment, std::size_t pitch, int count, std::uint32_t tag,
         std::uint32_t launches) {
#if TURNS > 1  // may be more shared memory than a kernel may declare statically
    extern __shared__ __align__(16) unsigned char memory[];
    Block::Shared& shared = *reinterpret_cast<Block::Shared*>(memory);
#else
    __shared__ Block::Shared shared;
#endif
    Block(shared, step).run({words, previous, increment, pitch}, count, tag, launches);
}

}  // namespace voxspring::cuda
