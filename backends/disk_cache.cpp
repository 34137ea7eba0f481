#include "backends/disk_cache.h"

// The hash is compiled in line, so its library is not needed.
#define XXH_INLINE_ALL
#include <unistd.h>
#include <xxhash.h>

#include <algorithm>
#include <cstdlib>
#include <exception>
#include <fstream>
#include <system_error>

namespace voxspring {
namespace {

namespace fs = std::filesystem;

}  // namespace

struct Hash::State {
    XXH3_state_t xxh3;
};

Hash::Hash() : state_(std::make_unique<State>()) { XXH3_128bits_reset(&state_->xxh3); }

Hash::~Hash() = default;

void Hash::add(const void* bytes, std::size_t count) {
    if (count > 0) XXH3_128bits_update(&state_->xxh3, bytes, count);
}

void Hash::add(std::string_view text) {
    add_number(text.size());
    add(text.data(), text.size());
}

std::string Hash::text() const {
    const XXH128_hash_t sum = XXH3_128bits_digest(&state_->xxh3);
    std::string digits;
    for (const std::uint64_t half : {sum.high64, sum.low64}) {
        for (int shift = 60; shift >= 0; shift -= 4) digits += "0123456789abcdef"[half >> shift & 15U];
    }
    return digits;
}

std::string hash_of(std::string_view text) {
    Hash hash;
    hash.add(text.data(), text.size());
    return hash.text();
}

fs::path DiskCache::folder_of_user() {
    const auto variable = [](const char* name) {
        const char* value = std::getenv(name);
        return std::string(value == nullptr ? "" : value);
    };
    if (const std::string own = variable("VOXSPRING_CACHE"); !own.empty()) return own;
    if (const std::string xdg = variable("XDG_CACHE_HOME"); !xdg.empty()) return fs::path(xdg) / "voxspring";
    if (const std::string home = variable("HOME"); !home.empty()) return fs::path(home) / ".cache/voxspring";
    return {};
}

std::optional<std::string> DiskCache::find(const std::string& name) const {
    if (folder_.empty()) return std::nullopt;
    std::error_code error;
    const std::uintmax_t size = fs::file_size(file(name), error);
    if (error || size < hash_digits) return std::nullopt;
    std::ifstream in(file(name), std::ios::binary);
    std::string content(size, '\0');
    if (!in.read(content.data(), std::streamsize(size))) return std::nullopt;
    const std::string sum = content.substr(size - hash_digits);
    content.resize(size - hash_digits);
    if (hash_of(content) != sum) return std::nullopt;
    // Marks the file as used now: make_room() deletes the files that were used longest ago.
    fs::last_write_time(file(name), fs::file_time_type::clock::now(), error);
    return content;
}

void DiskCache::keep(const std::string& name, std::string_view content) const {
    if (folder_.empty() || content.size() > max_bytes_ / 2) return;
    try {
        fs::create_directories(folder_);
        std::string temporary = file(name).string() + ".XXXXXX";
        const int descriptor = mkstemp(temporary.data());
        if (descriptor < 0) return;
        close(descriptor);
        std::ofstream out(temporary, std::ios::binary);
        out << content << hash_of(content);
        out.close();
        if (out) {
            fs::rename(temporary, file(name));
        } else {
            fs::remove(temporary);
        }
        make_room();
    } catch (const std::exception&) {
        // On a full or read-only disk nothing is kept, and later processes compute the content again.
    }
}

void DiskCache::make_room() const {
    struct Entry {
        fs::file_time_type used;
        std::uint64_t bytes;
        fs::path path;
    };
    std::vector<Entry> entries;
    std::uint64_t total = 0;
    for (const fs::directory_entry& found : fs::directory_iterator(folder_)) {
        // Files of an interrupted keep() count as well: NAME.kept.XXXXXX.
        if (!found.is_regular_file() || found.path().filename().string().find(".kept") == std::string::npos)
            continue;
        entries.push_back({found.last_write_time(), found.file_size(), found.path()});
        total += entries.back().bytes;
    }
    std::sort(entries.begin(), entries.end(), [](const Entry& a, const Entry& b) { return a.used < b.used; });
    for (const Entry& entry : entries) {
        if (total <= max_bytes_) break;
        std::error_code ignored;
        if (fs::remove(entry.path, ignored)) total -= entry.bytes;
    }
}

}  // namespace voxspring
