// The hash by which a device compares two of its states bit by bit, for C++, CUDA and GLSL.
//
// Each word of 32 bits is mixed with its place in the state, and the results are added up. The sum does not
// depend on the order in which threads add. Different words at one place always give different results, so a
// single wrong word always changes the sum. The hash consists of two such sums with different seeds.
#ifndef VOXSPRING_STATE_HASH_H
#define VOXSPRING_STATE_HASH_H

#define STATE_HASH_SUMS 2

#ifdef VOXSPRING_GLSL
#define HashWord uint
#define HASH_FUNCTION HashWord
#else
#include "portable.h"

namespace voxspring {

using HashWord = unsigned;
#define HASH_FUNCTION VOXSPRING_HOST_DEVICE inline HashWord
#endif

/// A one-to-one mapping of words in which every bit of the argument changes about half of the bits of the
/// result (Wellons, "lowbias32").
HASH_FUNCTION mixed_word(HashWord word) {
    word = (word ^ (word >> 16)) * 0x7FEB352Du;
    word = (word ^ (word >> 15)) * 0x846CA68Bu;
    return word ^ (word >> 16);
}

/// What the word at `place` of the array with number `array` adds to sum number `sum`.
HASH_FUNCTION hashed_word(HashWord word, HashWord place, HashWord array, HashWord sum) {
    HashWord seed = mixed_word(array * HashWord(STATE_HASH_SUMS) + sum + 1u);
    return mixed_word(word ^ mixed_word(place + seed));
}

#ifndef VOXSPRING_GLSL
}  // namespace voxspring
#endif
#endif
