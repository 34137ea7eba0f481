// What is dear to compute and follows from its inputs alone, kept on disk under the hash of those inputs.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace voxspring {

/// FNV-1a of 128 bits, of bytes as this machine stores them (the cache does not travel).
class Hash {
public:
    void add(const void* bytes, std::size_t count);
    void add(std::string_view text);
    /// Of numbers and of vectors of them: no padding.
    template <class T>
    void add_number(const T& value) {
        add(&value, sizeof value);
    }
    template <class T>
    void add_numbers(const std::vector<T>& values) {
        add_number(values.size());
        add(values.data(), values.size() * sizeof(T));
    }
    /// 32 hexadecimal digits.
    std::string text() const;

private:
    __extension__ using Word = unsigned __int128;
    static constexpr Word word(std::uint64_t high, std::uint64_t low) { return Word(high) << 64 | low; }

    Word state_ = word(0x6c62272e07bb0142, 0x62b821756295c58d);
};

/// A folder of entries by name. No member throws: without a folder that can be written it finds nothing and
/// keeps nothing.
class DiskCache {
public:
    static constexpr std::uint64_t two_gib = std::uint64_t(2) << 30;

    /// $VOXSPRING_CACHE, else $XDG_CACHE_HOME/voxspring, else ~/.cache/voxspring; empty: no cache.
    static std::filesystem::path folder_of_user();

    explicit DiskCache(std::filesystem::path folder = folder_of_user(), std::uint64_t most_bytes = two_gib)
        : folder_(std::move(folder)), most_bytes_(most_bytes) {}

    /// What is kept under `name`. Nothing if there is none, or if its file is truncated or fails its
    /// checksum.
    std::optional<std::string> find(const std::string& name) const;
    /// Keeps it, so that a reader sees all of it or nothing; what was used longest ago goes until all fits
    /// into `most_bytes`. What takes more than half of them is not kept.
    void keep(const std::string& name, std::string_view content) const;

private:
    std::filesystem::path file(const std::string& name) const { return folder_ / (name + ".kept"); }
    void make_room() const;

    std::filesystem::path folder_;
    std::uint64_t most_bytes_;
};

}  // namespace voxspring
