// The lists of compute_explicit.comp. LIST_ACCESS says what a shader does with them: readonly or writeonly.
// Lists are vertical: slot s of all particles lies together, and slot s + 1 begins `slot_stride` elements
// later.
//
//     neighbours         list entries (neighbours.h) or, with ON_POSITIONS, only indices
//     constants          stiffness and rest length of each spring
//     off_lattice_rests  X_j - X_i (X: position at rest) and the rest deficit, for entries with OWN_DIRECTION
//
// With ADDRESSED (Vulkan) a list may be larger than a storage buffer: the bindings hold the address of each
// slot, so that no index needs 64 bits. The file that includes this one enables the extensions.
//
// A Place says where a particle's slot is, in any of the lists: LISTED(neighbours, PLACE(particle, slot)).
#ifdef ADDRESSED
layout(buffer_reference, std430) restrict LIST_ACCESS buffer NeighbourSlot { uint of[]; };
layout(buffer_reference, std430) restrict LIST_ACCESS buffer ConstantSlot { Vec2 of[]; };
layout(buffer_reference, std430) restrict LIST_ACCESS buffer OffLatticeRestSlot { Vec4 of[]; };
layout(std430, binding = 8) restrict readonly buffer Neighbours { uvec2 neighbour_slots[]; };
layout(std430, binding = 9) restrict readonly buffer Constants { uvec2 constant_slots[]; };
layout(std430, binding = 10) restrict readonly buffer OffLatticeRests { uvec2 off_lattice_rest_slots[]; };
#define neighbours(slot) NeighbourSlot(neighbour_slots[slot])
#define constants(slot) ConstantSlot(constant_slots[slot])
#define off_lattice_rests(slot) OffLatticeRestSlot(off_lattice_rest_slots[slot])
#define Place ivec2
#define PLACE(particle, slot) ivec2(particle, slot)
#define SLOTS_BEHIND(place, slots) (place + ivec2(0, slots))
#define LISTED(list, place) list(place.y).of[place.x]
#else
layout(std430, binding = 8) restrict LIST_ACCESS buffer Neighbours { uint neighbours[]; };
layout(std430, binding = 9) restrict LIST_ACCESS buffer Constants { Vec2 constants[]; };
layout(std430, binding = 10) restrict LIST_ACCESS buffer OffLatticeRests { Vec4 off_lattice_rests[]; };
#define Place int
#define PLACE(particle, slot) (particle + (slot)*slot_stride)
#define SLOTS_BEHIND(place, slots) (place + (slots)*slot_stride)
#define LISTED(list, place) list[place]
#endif
