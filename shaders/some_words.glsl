// Words of some particles, for a pass that visits only those. COMPENSATED says that words have low parts.
// With TEXELS the state lies in textures, as in particle.glsl, and the index of a word is a texel, x in the
// lower half and y in the upper half.
#include "portable.h"

#ifdef TEXELS
layout(binding = 0) uniform sampler2D position;
layout(binding = 2) uniform sampler2D position_low;
#define TEXEL(word) ivec2((word)&0xFFFFu, (word) >> 16)
#define WORD(word) texelFetch(position, TEXEL(word), 0)
#define WORD_LOW(word) texelFetch(position_low, TEXEL(word), 0)
#else
// The state, as in compute.glsl.
layout(std430, binding = 0) restrict readonly buffer Words { Vec4 words[]; };
layout(std430, binding = 3) restrict readonly buffer WordsLow { Vec4 words_low[]; };
#define WORD(word) words[word]
#define WORD_LOW(word) words_low[word]
#endif
#ifdef COMPENSATED
#define LOW(word) WORD_LOW(word).xyz
#else
#define LOW(word) Vec3(0)
#endif
