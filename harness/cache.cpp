#include "harness/cache.h"

#include <algorithm>
#include <cstdlib>
#include <cstring>
#include <exception>
#include <fstream>
#include <sstream>
#include <system_error>

#include "harness/result.h"

namespace voxspring {
namespace {

namespace fs = std::filesystem;

constexpr std::string_view heading = "voxspring state 1\n";
constexpr std::size_t checksum_digits = 32;
static_assert(sizeof(glm::dvec3) == 3 * sizeof(double));

std::string checksum(std::string_view bytes) {
    Hash hash;
    hash.add(bytes);
    return hash.text();
}

std::string_view bytes_of(const std::vector<glm::dvec3>& vectors) {
    return {reinterpret_cast<const char*>(vectors.data()), vectors.size() * sizeof(glm::dvec3)};
}

std::size_t file_size(std::size_t particles) {
    return heading.size() + 2 * particles * sizeof(glm::dvec3) + checksum_digits;
}

}  // namespace

void Hash::add(const void* bytes, std::size_t count) {
    constexpr Word prime = word(std::uint64_t(1) << 24, 0x13b);
    const auto* byte = static_cast<const unsigned char*>(bytes);
    for (std::size_t i = 0; i < count; ++i) state_ = (state_ ^ byte[i]) * prime;
}

void Hash::add(std::string_view text) {
    add_number(text.size());
    add(text.data(), text.size());
}

std::string Hash::text() const {
    std::string digits;
    for (int shift = 124; shift >= 0; shift -= 4)
        digits += "0123456789abcdef"[unsigned(state_ >> shift) & 15u];
    return digits;
}

fs::path StateCache::folder_of_user() {
    const auto variable = [](const char* name) {
        const char* value = std::getenv(name);
        return std::string(value == nullptr ? "" : value);
    };
    if (const std::string own = variable("VOXSPRING_CACHE"); !own.empty()) return own;
    if (const std::string xdg = variable("XDG_CACHE_HOME"); !xdg.empty()) return fs::path(xdg) / "voxspring";
    if (const std::string home = variable("HOME"); !home.empty()) return fs::path(home) / ".cache/voxspring";
    return {};
}

std::optional<State> StateCache::find(const std::string& name, std::size_t particles) const {
    if (folder_.empty()) return std::nullopt;
    std::error_code ignored;
    if (fs::file_size(file(name), ignored) != file_size(particles) || ignored) return std::nullopt;
    std::ifstream in(file(name), std::ios::binary);
    std::string text(file_size(particles), '\0');
    if (!in.read(text.data(), std::streamsize(text.size()))) return std::nullopt;
    const std::string_view all = text;
    const std::string_view content = all.substr(0, all.size() - checksum_digits);
    if (!content.starts_with(heading) || checksum(content) != all.substr(content.size())) return std::nullopt;
    State state;
    const char* from = text.data() + heading.size();
    for (auto* vectors : {&state.displacement, &state.increment}) {
        vectors->resize(particles);
        if (particles > 0) std::memcpy(vectors->data(), from, particles * sizeof(glm::dvec3));
        from += particles * sizeof(glm::dvec3);
    }
    // What was used last goes last.
    fs::last_write_time(file(name), fs::file_time_type::clock::now(), ignored);
    return state;
}

void StateCache::keep(const std::string& name, const State& state) const {
    if (folder_.empty() || file_size(state.displacement.size()) > most_bytes_ / 2) return;
    try {
        fs::create_directories(folder_);
        std::string text(heading);
        text += bytes_of(state.displacement);
        text += bytes_of(state.increment);
        text += checksum(text);
        write_atomically(file(name), text);
        make_room();
    } catch (const std::exception&) {
        // A full or read-only disk costs time, not the result.
    }
}

void StateCache::make_room() const {
    struct Entry {
        fs::file_time_type used;
        std::uint64_t bytes;
        fs::path path;
    };
    std::vector<Entry> entries;
    std::uint64_t total = 0;
    for (const fs::directory_entry& found : fs::directory_iterator(folder_)) {
        // Those of an interrupted write_atomically() as well: NAME.state.XXXXXX.
        if (!found.is_regular_file() || found.path().filename().string().find(".state") == std::string::npos)
            continue;
        entries.push_back({found.last_write_time(), found.file_size(), found.path()});
        total += entries.back().bytes;
    }
    std::sort(entries.begin(), entries.end(), [](const Entry& a, const Entry& b) { return a.used < b.used; });
    for (const Entry& entry : entries) {
        if (total <= most_bytes_) break;
        std::error_code ignored;
        if (fs::remove(entry.path, ignored)) total -= entry.bytes;
    }
}

}  // namespace voxspring
