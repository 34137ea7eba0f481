// What an invocation does for its particle, however it finds the neighbours: it adds up forces, integrates
// and writes. The arithmetic is that of the CUDA kernels (cuda/kernels/motion.h).
//
// A word has a particle's position x or displacement u in xyz and its bits in w (neighbours.h). A step reads
// `words`, the state at t, and overwrites `next_words`, the state at t - dt, with that at t + dt. Increments
// lie in separate arrays, which a step overwrites in place: the x components of all words, then the y
// components, then the z components, `pitch` elements apart.
#include "motion.glsl"
#include "pull.glsl"
#include "words.glsl"

#ifdef TEXTURE
layout(binding = 0) uniform samplerBuffer words;
layout(binding = 1) uniform samplerBuffer words_low;
#define WORD(index) texelFetch(words, index)
#define WORD_LOW(index) texelFetch(words_low, index)
#else
layout(std430, binding = 0) restrict readonly buffer Words { Vec4 words[]; };
layout(std430, binding = 3) restrict readonly buffer WordsLow { Vec4 words_low[]; };
#define WORD(index) words[index]
#define WORD_LOW(index) words_low[index]
#endif
layout(std430, binding = 1) restrict buffer NextWords { Vec4 next_words[]; };
layout(std430, binding = 2) restrict buffer Increments { Real increments[]; };
layout(std430, binding = 4) restrict writeonly buffer NextWordsLow { Vec4 next_words_low[]; };
layout(std430, binding = 5) restrict buffer IncrementsLow { Real increments_low[]; };
// The force on each word's particle besides those of springs and gravity: three numbers per word.
layout(std430, binding = 6) restrict readonly buffer Loads { Real loads[]; };
layout(std430, binding = 7) restrict readonly buffer InverseMasses { Real inverse_masses[]; };

UNIFORMS(ComputeUniforms, 18)
UNIFORM int pitch;
END_UNIFORMS

// Position x or displacement u of a particle. `low` is the part beyond the precision of `high`, for
// COMPENSATED only.
struct Point {
    Vec3 high;
    Vec3 low;
};

Point point_of(int index) {
#ifdef COMPENSATED
    return Point(WORD(index).xyz, WORD_LOW(index).xyz);
#else
    return Point(WORD(index).xyz, Vec3(0));
#endif
}

Vec3 between(Point from, Point to) {
    precise Vec3 relative = from.high - to.high;
#ifdef COMPENSATED
    relative += from.low - to.low;
#endif
    return relative;
}

Vec3 before_of(int index) {
#ifdef BY_INCREMENTS
    return Vec3(increments[index], increments[index + pitch], increments[index + 2 * pitch]);
#else
    return next_words[index].xyz;
#endif
}

// Writes the particle's state at t + dt, given the sum of its spring forces at t. `before` is the result of
// before_of(index): x or u at t - dt, or the increment.
void integrate_and_store(int index, Point here, uint bits, Vec3 before, Vec3 spring_force_sum) {
    precise Vec3 force = spring_force_sum;
    if (LOADS) force += Vec3(loads[3 * index], loads[3 * index + 1], loads[3 * index + 2]);
    Vec3 before_low = Vec3(0);
#ifdef COMPENSATED
    before_low =
        Vec3(increments_low[index], increments_low[index + pitch], increments_low[index + 2 * pitch]);
#endif
    Motion after = integrate(Motion(here.high, before, here.low, before_low), force,
                             MATERIALS ? inverse_masses[index] : inverse_mass, is_pinned(bits));
    next_words[index] = Vec4(after.here, WITH_BITS(bits));
#ifdef BY_INCREMENTS
    increments[index] = after.before.x;
    increments[index + pitch] = after.before.y;
    increments[index + 2 * pitch] = after.before.z;
#endif
#ifdef COMPENSATED
    next_words_low[index] = Vec4(after.here_low, 0);
    increments_low[index] = after.before_low.x;
    increments_low[index + pitch] = after.before_low.y;
    increments_low[index + 2 * pitch] = after.before_low.z;
#endif
}
