#include "harness/base/text.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <utility>

namespace voxspring {
namespace {

/// Whether a byte of UTF-8 is the first one of a character.
bool begins_character(char byte) { return (static_cast<unsigned char>(byte) & 0xC0u) != 0x80u; }

}  // namespace

std::string percent_text(double fraction) {
    const double percent = 100 * fraction;
    return fmt::format("{:.{}f}%", percent, percent < 9.95 ? 1 : 0);
}

std::string joined(const std::vector<std::string>& words) {
    return fmt::format("{}", fmt::join(words, ", "));
}

std::string counted(std::uint64_t count, const std::string& noun) {
    return std::to_string(count) + " " + noun + (count == 1 ? "" : "s");
}

std::string fixed_text(double value, int digits) { return fmt::format("{:.{}f}", value, digits); }

std::string error_text(double value) { return fmt::format("{:.1e}", value); }

std::size_t character_count(std::string_view text) {
    return std::size_t(std::count_if(text.begin(), text.end(), begins_character));
}

std::size_t bytes_of_characters(std::string_view text, std::size_t count) {
    const auto end = std::find_if(text.begin(), text.end(),
                                  [&](char byte) { return begins_character(byte) && count-- == 0; });
    return std::size_t(end - text.begin());
}

std::string shell_word(const std::string& word) {
    const char* const plain = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789_@%+=:,./-";
    if (!word.empty() && word.find_first_not_of(plain) == std::string::npos) return word;
    std::string text;
    for (const char c : word) text += c == '\'' ? std::string("'\\''") : std::string(1, c);
    return "'" + text + "'";
}

std::string si(double value, const std::string& unit) {
    static const std::pair<double, const char*> prefixes[] = {
        {1e12, "T"}, {1e9, "G"}, {1e6, "M"}, {1e3, "k"}, {1, ""}, {1e-3, "m"}, {1e-6, "u"}, {1e-9, "n"}};
    if (value == 0) return "0 " + unit;
    const double size = std::abs(value);
    for (const auto& [scale, prefix] : prefixes) {
        if (size < 0.9995 * scale && scale > 1e-9) continue;
        const double scaled = size / scale;
        const int digits = scaled < 9.995 ? 2 : scaled < 99.95 ? 1 : 0;
        return fmt::format("{:.{}f} {}{}", value / scale, digits, prefix, unit);
    }
    return {};
}

std::string three_digits(double value) {
    return std::abs(value) < 999.5 ? fmt::format("{:.3g}", value) : fixed_text(value, 0);
}

}  // namespace voxspring
