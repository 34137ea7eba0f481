#include "harness/base/bad_input.h"

#include <fmt/format.h>

#include <cstddef>

namespace voxspring {
namespace {

/// `text` with control characters escaped ("\x0a"), cut after about `longest` bytes.
std::string printable(std::string_view text, std::size_t longest) {
    std::string out;
    for (const char c : text) {
        if (out.size() >= longest) {
            // Removes the last UTF-8 character, since the cut may have left only half of it.
            while (!out.empty() && (static_cast<unsigned char>(out.back()) & 0xC0u) == 0x80u) out.pop_back();
            if (!out.empty() && (static_cast<unsigned char>(out.back()) & 0x80u) != 0) out.pop_back();
            return out + "...";
        }
        const auto byte = static_cast<unsigned char>(c);
        const bool is_control = byte < 0x20 || byte == 0x7F;
        out += is_control ? fmt::format("\\x{:02x}", byte) : std::string(1, c);
    }
    return out;
}

}  // namespace

BadInput::BadInput(std::string_view file, std::string_view key, std::string_view value,
                   std::string_view accepted)
    : std::runtime_error(printable(file, 500) + ": " + (key.empty() ? "" : printable(key, 200) + ": ") +
                         printable(value, 80) + " is not accepted; expected " + printable(accepted, 1000)) {}

BadInput::BadInput(std::string_view file, std::string_view key, Missing, std::string_view accepted)
    : std::runtime_error(printable(file, 500) + ": " + printable(key, 200) + " is missing; expected " +
                         printable(accepted, 1000)) {}

void require_regular_file(const std::filesystem::path& file, std::string_view accepted) {
    std::error_code error;
    const std::filesystem::file_status status = std::filesystem::status(file, error);
    if (std::filesystem::is_regular_file(status)) return;
    const bool is_missing = status.type() == std::filesystem::file_type::not_found;
    const std::string what = std::filesystem::is_directory(status) ? "a folder"
                             : std::filesystem::exists(status)     ? "a pipe or a device"
                             : is_missing                          ? "a missing file"
                                          : "an unreadable file (" + error.message() + ")";
    throw BadInput(file.string(), "", what, accepted);
}

}  // namespace voxspring
