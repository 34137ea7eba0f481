#include "harness/results/counters.h"

#include <algorithm>
#include <array>
#include <stdexcept>
#include <utility>

#include "harness/base/text.h"

namespace voxspring {
namespace {

constexpr std::array unit_names = {"", "s", "B", "J", "W", "Hz", "1/s", "1/J"};
constexpr std::array better_names = {"less", "more", "neither"};

template <class Enum, std::size_t count>
Enum value_of(const std::array<const char*, count>& names, const std::string& text) {
    const auto found = std::find(names.begin(), names.end(), text);
    if (found == names.end())
        throw std::out_of_range("unknown unit or direction of a counter: '" + text + "'");
    return Enum(found - names.begin());
}

}  // namespace

std::string to_string(Unit unit) { return unit_names.at(std::size_t(unit)); }
Unit unit_of(const std::string& text) { return value_of<Unit>(unit_names, text); }
std::string to_string(Better better) { return better_names.at(std::size_t(better)); }
Better better_of(const std::string& text) { return value_of<Better>(better_names, text); }

std::string Counter::text() const {
    if (!value) return "-";
    if (unit == Unit::number) return three_digits(*value);
    const std::string of = to_string(unit);
    return si(*value, of.starts_with("1/") ? of.substr(1) : of);
}

void Counters::add(std::string name, std::optional<double> value, Unit unit, Better better) {
    if (find(name) != nullptr) throw std::logic_error("a row already has a counter " + name);
    counters_.push_back({std::move(name), value, unit, better});
}

const Counter* Counters::find(const std::string& name) const {
    const auto found =
        std::find_if(begin(), end(), [&](const Counter& counter) { return counter.name == name; });
    return found == end() ? nullptr : &*found;
}

double Counters::at(const std::string& name) const {
    const Counter* const found = find(name);
    if (found == nullptr || !found->value)
        throw std::out_of_range("a row has no known value of the counter " + name);
    return *found->value;
}

}  // namespace voxspring
