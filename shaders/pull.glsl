// The force of a spring, by way of the inverse root (inverse_root.h): the arithmetic of the CUDA kernels
// (cuda/kernels/motion.h). Comes after motion.glsl.
#include "inverse_root.h"

// `steps` spacings; of none a zero that the compiler knows.
float spaced(int steps, float spacing) { return steps == 0 ? 0.0 : steps > 0 ? spacing : -spacing; }

// Rest deficits (spring.h) of lattice springs, by mask bit / 2.
#ifdef DEFICITS
uniform float rest_deficit[13];
#define DEFICIT(bit) rest_deficit[(bit) / 2]
#else
#define DEFICIT(bit) 0.0
#endif

// X_j - X_i of a lattice spring, and its rest deficit.
#define REST_OF(bit, dx, dy, dz) \
    vec4(spaced(dx, spacing.x), spaced(dy, spacing.y), spaced(dz, spacing.z), DEFICIT(bit))

// The force of a spring of stiffness 1 is xyz times w. `relative` is x_i - x_j or u_i - u_j, `rest` X_j - X_i
// and the rest deficit (spring.h), `rest_length` as measured_length() gives it or, by increments, as it is.
vec4 unit_pull(vec3 relative, vec4 rest, float rest_length) {
#ifdef ON_POSITIONS
    precise vec3 offset = relative;
#else
    // Less what is zero folds away, which plus zero would not.
    precise vec3 offset = relative - rest.xyz;
#endif
    precise float squared = squared_length(offset.x, offset.y, offset.z, shortest_squared);
#ifdef BY_INCREMENTS
    precise vec3 sum = offset - rest.xyz;
    precise float deficit = fma(-relative.x, sum.x, fma(-relative.y, sum.y, fma(-relative.z, sum.z, rest.w)));
    precise float density = unit_strain_density(squared, rest_length, deficit);
#else
    precise float density = unit_force_density(squared, rest_length, inverse_root(squared));
#endif
    return vec4(offset, density);
}

// xyz times w added to `sum`.
vec3 with_pull(vec4 pull, vec3 sum) {
    precise vec3 more =
        vec3(fma(pull.x, pull.w, sum.x), fma(pull.y, pull.w, sum.y), fma(pull.z, pull.w, sum.z));
    return more;
}
