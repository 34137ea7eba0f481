// Converts a word's fourth number to a particle's bits (neighbours.h), and back. A particle's number is never
// subnormal or NaN: for that reason its upper half in float64 is that of 1.0
// (backends/layout/records/particle.h).
#ifdef VOXSPRING_FLOAT64
#define BITS_OF(number) unpackDouble2x32(number).x
#define WITH_BITS(bits) packDouble2x32(uvec2(bits, 0x3FF00000u))
#else
#define BITS_OF(number) floatBitsToUint(number)
#define WITH_BITS(bits) uintBitsToFloat(bits)
#endif
