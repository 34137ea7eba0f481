// The terms that a scene needs, as constants that a compiler folds. OpenGL's host writes them as macros.
// Vulkan's host sets them when it makes a pipeline (constants 0 to 2 are the extents of a work group). A term
// is true if the scene has it or, with `terms=all`, always; DEFICITS is true only by increments.
#ifdef VULKAN
layout(constant_id = 3) const bool DAMPING = true;
layout(constant_id = 4) const bool GRAVITY = true;
layout(constant_id = 5) const bool PINS = true;
layout(constant_id = 6) const bool LOADS = true;
layout(constant_id = 7) const bool MATERIALS = true;
// Whether lattice springs are stressed at rest, and the formulation is by increments, whose forces need that
// stress.
layout(constant_id = 8) const bool DEFICITS = true;
// Whether the scene has springs to face, edge and corner neighbours.
layout(constant_id = 9) const bool FACES = true;
layout(constant_id = 10) const bool EDGES = true;
layout(constant_id = 11) const bool CORNERS = true;
#endif
