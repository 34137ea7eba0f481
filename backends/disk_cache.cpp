#include "backends/disk_cache.h"

#include <unistd.h>

#include <cstdint>
#include <cstdlib>
#include <fstream>
#include <iomanip>
#include <sstream>
#include <system_error>

namespace voxspring {
namespace {

std::filesystem::path root() {
    const auto variable = [](const char* name) {
        const char* value = std::getenv(name);
        return std::filesystem::path(value == nullptr ? "" : value);
    };
    if (const auto own = variable("VOXSPRING_CACHE"); !own.empty()) return own;
    if (const auto cache = variable("XDG_CACHE_HOME"); !cache.empty()) return cache / "voxspring";
    if (const auto home = variable("HOME"); !home.empty()) return home / ".cache" / "voxspring";
    return {};
}

constexpr std::size_t digest_size = 32;

}  // namespace

std::string digest(std::string_view text) {
    // FNV-1a with 128 bits: prime 2^88 + 0x13B, offset basis of the definition.
    __extension__ using Wide = unsigned __int128;
    const Wide prime = (Wide(1) << 88) + 0x13B;
    Wide hash = (Wide(0x6c62272e07bb0142) << 64) + 0x62b821756295c58d;
    for (const char c : text) hash = (hash ^ static_cast<unsigned char>(c)) * prime;
    std::ostringstream digits;
    digits << std::hex << std::setfill('0') << std::setw(16) << std::uint64_t(hash >> 64) << std::setw(16)
           << std::uint64_t(hash);
    return digits.str();
}

DiskCache::DiskCache(const std::string& name) {
    if (const auto cache = root(); !cache.empty()) folder_ = cache / name;
}

std::optional<std::string> DiskCache::find(const std::string& key) const {
    if (folder_.empty()) return std::nullopt;
    std::ifstream file(folder_ / key, std::ios::binary);
    std::ostringstream text;
    if (!file || !(text << file.rdbuf())) return std::nullopt;
    const std::string entry = text.str();
    if (entry.size() < digest_size) return std::nullopt;
    std::string content = entry.substr(digest_size);
    if (digest(content) != entry.substr(0, digest_size)) return std::nullopt;
    return content;
}

void DiskCache::store(const std::string& key, std::string_view content) const {
    if (folder_.empty()) return;
    std::error_code error;
    std::filesystem::create_directories(folder_, error);
    std::string temporary = (folder_ / key).string() + ".XXXXXX";
    const int file = mkstemp(temporary.data());
    if (file < 0) return;
    close(file);
    std::ofstream out(temporary, std::ios::binary);
    out << digest(content) << content;
    out.close();
    if (out) std::filesystem::rename(temporary, folder_ / key, error);
    if (!out || error) std::filesystem::remove(temporary, error);
}

}  // namespace voxspring
