// The force of a spring, computed with inverse_root() (inverse_root.h) and the arithmetic of the CUDA kernels
// (cuda/kernels/motion.h). To be included after motion.glsl.
#include "inverse_root.h"

// `steps` (-1, 0 or 1) times the spacing. For 0 steps the result is a zero that the compiler knows.
Real spaced(int steps, Real spacing) { return steps == 0 ? Real(0) : steps > 0 ? spacing : -spacing; }

// Rest deficits of lattice springs, by mask bit / 2: squared rest length minus squared distance at rest
// (spring.h).
UNIFORMS(PullUniforms, 17)
UNIFORM Real rest_deficit[13];
END_UNIFORMS
#define DEFICIT(bit) (DEFICITS ? rest_deficit[(bit) / 2] : Real(0))

// X_j - X_i of a lattice spring, where X is a position at rest, and the spring's rest deficit.
#define REST_OF(bit, dx, dy, dz) \
    Vec4(spaced(dx, spacing.x), spaced(dy, spacing.y), spaced(dz, spacing.z), DEFICIT(bit))

// Returns the force of a spring of stiffness 1 as a vector xyz and a factor w. `relative` is x_i - x_j or
// u_i - u_j. `rest` is X_j - X_i and the rest deficit (spring.h). `rest_length` is the result of
// measured_length() or, by increments, the rest length itself.
Vec4 unit_pull(Vec3 relative, Vec4 rest, Real rest_length) {
#ifdef ON_POSITIONS
    precise Vec3 offset = relative;
#else
    // X_j - X_i is subtracted, not X_i - X_j added: the compiler folds away the subtraction of a zero, but
    // not the addition of a zero.
    precise Vec3 offset = relative - rest.xyz;
#endif
    precise Real squared = squared_length(offset.x, offset.y, offset.z, shortest_squared);
#ifdef BY_INCREMENTS
    precise Vec3 sum = offset - rest.xyz;
    precise Real deficit = fma(-relative.x, sum.x, fma(-relative.y, sum.y, fma(-relative.z, sum.z, rest.w)));
    precise Real density = unit_strain_density(squared, rest_length, deficit);
#else
    precise Real density = unit_force_density(squared, rest_length, inverse_root(squared));
#endif
    return Vec4(offset, density);
}

// Adds xyz times w to `sum`.
Vec3 with_pull(Vec4 pull, Vec3 sum) {
    precise Vec3 more =
        Vec3(fma(pull.x, pull.w, sum.x), fma(pull.y, pull.w, sum.y), fma(pull.z, pull.w, sum.z));
    return more;
}
