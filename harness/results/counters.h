// Counters: the metrics of a row of a result that have no member in Row. The code that measures a counter
// adds it to Row::counters. Files, tables and scripts then have it without further code.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace voxspring {

enum class Unit : std::uint8_t { number, second, byte, joule, watt, hertz, per_second, per_joule };
/// The symbol of the unit: "s", "B", ...; empty for a number without a unit.
std::string to_string(Unit unit);
Unit unit_of(const std::string& text);

/// Whether a smaller or a larger value is the better one.
enum class Better : std::uint8_t { less, more, neither };
std::string to_string(Better better);
Better better_of(const std::string& text);

struct Counter {
    std::string name;             ///< its key in the row's JSON: "ghost_bytes"
    std::optional<double> value;  ///< empty: not known
    Unit unit = Unit::number;
    Better better = Better::neither;

    /// The value for people: "1.25 MB", "0.004" if it has no unit, or "-".
    std::string text() const;
};

/// The counters of a row, in the order in which they were added.
class Counters {
public:
    void add(std::string name, std::optional<double> value, Unit unit, Better better);
    /// The counter of this name; null if there is none.
    const Counter* find(const std::string& name) const;
    /// The value of the counter `name`. Throws std::out_of_range if there is no such counter, or if its value
    /// is not known.
    double at(const std::string& name) const;

    auto begin() const { return counters_.begin(); }
    auto end() const { return counters_.end(); }

private:
    std::vector<Counter> counters_;
};

}  // namespace voxspring
