// Physical units. A scene may give Young's modulus and density, from which the stiffness of springs and the
// mass of particles follow.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace voxspring {

/// The material of the voxels with one label.
struct Tissue {
    std::string label;   ///< empty if the body has one label
    double young = 0;    ///< Young's modulus in Pa
    double density = 0;  ///< in kg/m^3

    double pressure_wave() const;  ///< speed in m/s
    double shear_wave() const;     ///< speed in m/s
};

/// The units of a scene that gives Young's modulus. Times are in seconds, masses in kg and lengths in
/// `length`. So forces are in kg times `length` per s^2, and stiffness is in N/m.
struct WorldUnits {
    std::string length;  ///< the unit of length, for example "mm"
    double metres = 1;   ///< metres per unit of length
    std::vector<Tissue> tissues;

    std::string force() const;  ///< the unit of forces: "mN" if lengths are in mm
};

/// Poisson's ratio of an isotropic lattice of springs. Central forces allow no other.
inline constexpr double poisson_ratio = 0.25;

/// The stiffness of each spring group with which a cubic lattice of this spacing has Young's modulus `young`
/// and is isotropic, for small strain. All three are linear in young * spacing. `group_bits` are the mask
/// bits of the groups in use. Empty if no positive stiffness of these groups makes the lattice isotropic, or
/// if some motion would strain no spring.
///
/// A lattice has C_1111 = (k1 + 2 k2 + 4/3 k3) / h and C_1122 = C_1212 = (k2 + 4/3 k3) / h. It is isotropic
/// if C_1111 = 3 C_1122, which means k1 = k2 + 8/3 k3; then E = 5/2 C_1122. With three groups one ratio is
/// free: we take k1 : k2 : k3 = 16 : 8 : 3. In the next term of the dispersion relation, which makes short
/// waves slower, sum k L^4 n_x^4 n_y^2 is then three times sum k L^4 n_x^2 n_y^2 n_z^2, as in an isotropic
/// medium.
std::optional<std::array<double, 3>> isotropic_stiffness(double young, double spacing,
                                                         std::uint32_t group_bits);

/// The length of a unit ("m", "cm", "mm" or "um") in metres. Empty for other words.
std::optional<double> metres_in(const std::string& unit);
std::string accepted_lengths();

/// Converts a text such as "5 kPa" to Pa. A number without a unit is in Pa. Empty for any other text, and for
/// a value outside [min_quantity, max_quantity].
std::optional<double> pascals_of(const std::string& text);
/// Converts a text such as "1.05 g/cm3" to kg/m^3 in the same way.
std::optional<double> kilograms_per_cubic_metre_of(const std::string& text);
inline constexpr const char* accepted_young =
    "a modulus from 1e-12 to 1e12 Pa, or with its unit: \"5 kPa\" (Pa, kPa, MPa, GPa)";
inline constexpr const char* accepted_density =
    "a density from 1e-12 to 1e12 kg/m3, or with its unit: \"1.05 g/cm3\" (kg/m3, g/cm3)";

}  // namespace voxspring
