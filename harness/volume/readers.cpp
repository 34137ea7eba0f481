#include "harness/volume/readers.h"

#include <algorithm>
#include <bit>
#include <string>
#include <system_error>

#include "harness/volume/text_header.h"

namespace voxspring {

void to_native_order(std::vector<std::byte>& data, ScalarType type, bool big_endian) {
    if (big_endian == (std::endian::native == std::endian::big)) return;
    const auto each = std::ptrdiff_t(bytes_of(type));
    for (auto scalar = data.begin(); scalar != data.end(); scalar += each)
        std::reverse(scalar, scalar + each);
}

std::filesystem::path partner_of(const std::filesystem::path& file) {
    const std::string name = file.string();
    const std::string lower = lower_case(name);
    const std::size_t packed = lower.ends_with(".gz") ? 3 : 0;
    const std::size_t dot = lower.rfind('.', lower.size() - packed - 1);
    if (dot == std::string::npos) return {};
    const std::string ending = lower.substr(dot, lower.size() - packed - dot);
    if (ending != ".hdr" && ending != ".img") return {};
    const bool is_header = ending == ".hdr";
    // The ending is first tried in capitals if the named file has capitals; a pair may also be x.IMG beside
    // x.hdr.
    const bool capitals = name[dot + 1] < 'a';
    const auto exists = [](const std::filesystem::path& path) {
        std::error_code error;
        return std::filesystem::is_regular_file(path, error);
    };
    // Finds x.hdr, x.img, x.hdr.gz or x.img.gz; empty if it does not exist.
    const auto found = [&](bool header, bool gzipped) -> std::filesystem::path {
        for (const bool in_capitals : {capitals, !capitals}) {
            const std::string stem = name.substr(0, dot);
            std::string wanted = std::string(header ? ".hdr" : ".img") + (gzipped ? ".gz" : "");
            if (in_capitals) wanted = upper_case(wanted);
            if (exists(stem + wanted)) return stem + wanted;
        }
        return {};
    };
    const bool gzipped = packed > 0;
    if (const auto alike = found(!is_header, gzipped); !alike.empty()) return alike;
    // A partner that is compressed differently is taken only if it does not belong to another file.
    return found(is_header, !gzipped).empty() ? found(!is_header, !gzipped) : std::filesystem::path{};
}

}  // namespace voxspring
