// A word's fourth number as a particle's bits (neighbours.h), and back. It is a normal number; in float64 the
// upper half of one makes it so (backends/layout/records/particle.h).
#ifdef VOXSPRING_FLOAT64
#define BITS_OF(number) unpackDouble2x32(number).x
#define WITH_BITS(bits) packDouble2x32(uvec2(bits, 0x3FF00000u))
#else
#define BITS_OF(number) floatBitsToUint(number)
#define WITH_BITS(bits) uintBitsToFloat(bits)
#endif
