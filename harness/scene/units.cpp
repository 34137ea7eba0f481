#include "harness/scene/units.h"

#include <cmath>
#include <map>

#include "backends/physics/neighbours.h"
#include "harness/base/json.h"
#include "harness/base/text.h"
#include "harness/volume/dataset.h"
#include "harness/volume/text_header.h"

namespace voxspring {
namespace {

using Units = std::map<std::string, double>;

const Units lengths = {{"m", 1}, {"cm", 1e-2}, {"mm", 1e-3}, {"um", 1e-6}};

std::optional<double> quantity(const std::string& text, const Units& units) {
    const std::vector<std::string> parts = words(text);
    if (parts.empty() || parts.size() > 2) return {};
    const auto number = parse_number<double>(parts[0]);
    const auto unit = parts.size() == 2 ? units.find(parts[1]) : units.end();
    if (!number || (parts.size() == 2 && unit == units.end())) return {};
    const double value = parts.size() == 2 ? *number * unit->second : *number;
    // Written so that NaN, which fails every comparison, is refused.
    return value >= min_quantity && value <= max_quantity ? std::optional(value) : std::nullopt;
}

}  // namespace

// With nu = 1/4 both of Lame's constants are 2/5 E.
double Tissue::pressure_wave() const { return std::sqrt(1.2 * young / density); }
double Tissue::shear_wave() const { return std::sqrt(0.4 * young / density); }

std::string WorldUnits::force() const {
    const std::string known = length == "m" ? "N" : length == "mm" ? "mN" : length == "um" ? "uN" : "";
    return known.empty() ? "kg " + length + "/s^2" : known;
}

std::optional<std::array<double, 3>> isotropic_stiffness(double young, double spacing,
                                                         std::uint32_t group_bits) {
    const double scale = young * spacing;
    if (group_bits == (FACE_BITS | EDGE_BITS)) return {{scale / 2.5, scale / 2.5, scale / 2.5}};
    // The common factor follows from E = 5/2 (k2 + 4/3 k3) / h.
    if (group_bits == NEIGHBOUR_BITS) return {{scale * 16 / 30, scale * 8 / 30, scale * 3 / 30}};
    return {};
}

std::optional<double> metres_in(const std::string& unit) {
    const auto found = lengths.find(unit);
    return found == lengths.end() ? std::nullopt : std::optional(found->second);
}

std::string accepted_lengths() { return "the unit of lengths: m, cm, mm or um"; }

std::optional<double> pascals_of(const std::string& text) {
    return quantity(text, {{"Pa", 1}, {"kPa", 1e3}, {"MPa", 1e6}, {"GPa", 1e9}});
}

std::optional<double> kilograms_per_cubic_metre_of(const std::string& text) {
    return quantity(text, {{"kg/m3", 1}, {"g/cm3", 1e3}});
}

}  // namespace voxspring
