// Numbers and words as text for people.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

namespace voxspring {

/// A fraction as a percentage: 0.12 as "12%", 0.013 as "1.3%".
std::string percent_text(double fraction);

/// The words with ", " between them.
std::string joined(const std::vector<std::string>& words);

/// A count with its noun: "1 step", "0 steps", "12 steps".
std::string counted(std::uint64_t count, const std::string& noun);

/// `value` with three significant digits and an SI prefix: "1.25 ms", "487 G/s", "0 s".
std::string si(double value, const std::string& unit);

/// A number without a unit: three significant digits, or all digits before the point, "0.004", "29449".
std::string three_digits(double value);

/// "1.25": `value` with `digits` digits after the point.
std::string fixed_text(double value, int digits);

/// `value` with two significant digits, like "1.2e-05".
std::string error_text(double value);

/// The number of characters of a text in UTF-8, each of which is taken to fill a column of a terminal.
std::size_t character_count(std::string_view text);

/// How many bytes the first `count` characters of a text in UTF-8 take: all bytes if it has no more
/// characters.
std::size_t bytes_of_characters(std::string_view text, std::size_t count);

/// `word` as a shell reads it: in quotes if it has characters that a shell treats specially.
std::string shell_word(const std::string& word);

}  // namespace voxspring
