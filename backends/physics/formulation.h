// How a backend stores the state of a simulation and makes a step. The result of a step depends on it,
// because different numbers are rounded.
#pragma once

#include <cstdint>

#include "backends/physics/portable.h"

#ifndef __CUDACC_RTC__  // kernels need only the names
#include <array>
#include <string>
#endif

namespace voxspring {

/// | formulation | state of a particle | step |
/// | --- | --- | --- |
/// | paper | x, x_previous | paper_position(), the paper's equation 4 |
/// | position | x, x_previous | next_position() |
/// | displacement | u = x - X, u_previous | next_position() of u |
/// | increment | u, v = u - u_previous | v += increment_change(), u += v, forces by strain_density() |
/// | compensated | u and v, each a high and a low part | as increment, sums by split_high(), split_low() |
///
/// X is the position at rest. The functions are those of spring.h; for spring forces GPUs use inverse_root.h
/// instead. `paper` and `position` take spring forces from spring_force() of x_i - x_j, `displacement` from
/// spring_force() of (X_i - X_j) + (u_i - u_j).
/// `compensated` computes u_i - u_j as the difference of the high parts plus the difference of the low parts.
enum class Formulation : std::uint8_t { paper, position, displacement, increment, compensated };

#ifndef __CUDACC_RTC__
/// All formulations, in the order of the enumeration.
inline constexpr std::array all_formulations = {Formulation::paper, Formulation::position,
                                                Formulation::displacement, Formulation::increment,
                                                Formulation::compensated};

/// The name of a formulation, for example "position".
std::string to_string(Formulation formulation);
#endif

/// With the tuning parameter rest=flush, formulations by increments set components of u and v to zero if
/// their absolute value is less than this many spacings (Problem::shortest_spacing()). Without this, the
/// faint tails of a motion, which reach everywhere, would keep particles from ever coming to rest exactly.
inline constexpr double flushed_below = 1e-12;

/// Whether the state consists of positions x; otherwise it consists of displacements u.
VOXSPRING_HOST_DEVICE constexpr bool on_positions(Formulation formulation) {
    return formulation <= Formulation::position;
}
/// Whether the state has the increment v instead of the previous x or u. In that case strain_density() gives
/// the forces.
VOXSPRING_HOST_DEVICE constexpr bool by_increments(Formulation formulation) {
    return formulation >= Formulation::increment;
}

}  // namespace voxspring
