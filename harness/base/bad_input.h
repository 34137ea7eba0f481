// BadInput, the exception for input of a user that cannot be used. Unless a caller catches it, the program
// exits with code 2.
#pragma once

#include <filesystem>
#include <stdexcept>
#include <string>
#include <string_view>

namespace voxspring {

/// The argument that tells the constructor of BadInput that a key is missing.
struct Missing {};
inline constexpr Missing missing;

/// Says `FILE: KEY: VALUE is not accepted; expected ACCEPTED`, or `FILE: KEY is missing; expected ACCEPTED`.
/// The message is one line of printable characters: control characters are escaped and long values are cut.
class BadInput : public std::runtime_error {
public:
    /// `file` is the file or argument that was read. `key` is the place in `file` (empty: the whole of it),
    /// `value` the text found in that place, and `accepted` a description of what would be accepted.
    BadInput(std::string_view file, std::string_view key, std::string_view value, std::string_view accepted);
    /// The error that `key` is missing in `file`.
    BadInput(std::string_view file, std::string_view key, Missing, std::string_view accepted);
};

/// The input is valid, but the body is too large for this machine's memory or for this program.
class TooLarge : public BadInput {
    using BadInput::BadInput;
};

/// Throws BadInput, which says that `accepted` was expected, unless `file` is a regular file. Pipes and
/// devices are refused because reading them might never end.
void require_regular_file(const std::filesystem::path& file, std::string_view accepted);

}  // namespace voxspring
