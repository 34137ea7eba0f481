// Numbers and tables as text for people.
#pragma once

#include <cstdint>
#include <nlohmann/json.hpp>
#include <ostream>
#include <string>
#include <vector>

namespace voxspring {

/// "12%", "1.3%" of a fraction, or "-" for what is not a number.
std::string percent_text(const nlohmann::json& fraction);

/// With commas between them.
std::string joined(const std::vector<std::string>& words);

/// "1 step", "0 steps", "12 steps".
std::string counted(std::uint64_t count, const std::string& noun);

/// Three significant digits with an SI prefix: "1.25 ms", "487 G/s".
std::string si(double value, const std::string& unit);

/// "1.25" with that many digits after the point.
std::string fixed_text(double value, int digits);

/// "1.2e-05", or "-" for what is not a number.
std::string error_text(const nlohmann::json& value);

/// Columns as wide as they must be, the first `names` of them to the left and the others, figures, to the
/// right.
void print_aligned(const std::vector<std::vector<std::string>>& rows, std::ostream& out,
                   std::size_t names = 2);

}  // namespace voxspring
