// What is dear to compute and follows from its inputs alone, kept on disk under the hash of those inputs.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace voxspring {

/// XXH3 of 128 bits, of bytes as this machine stores them (the cache does not travel).
class Hash {
public:
    Hash();
    ~Hash();
    Hash(const Hash&) = delete;
    Hash& operator=(const Hash&) = delete;

    void add(const void* bytes, std::size_t count);
    void add(std::string_view text);
    /// Takes numbers and vectors of them, which have no padding.
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
    struct State;
    std::unique_ptr<State> state_;
};

/// The hash of the bytes of one text: 32 hexadecimal digits.
std::string hash_of(std::string_view text);
inline constexpr std::size_t hash_digits = 32;

/// A folder of entries by name. No member throws: without a folder that can be written it finds nothing and
/// keeps nothing.
class DiskCache {
public:
    static constexpr std::uint64_t two_gib = std::uint64_t(2) << 30;

    /// $VOXSPRING_CACHE, else $XDG_CACHE_HOME/voxspring, else ~/.cache/voxspring; empty: no cache.
    static std::filesystem::path folder_of_user();

    explicit DiskCache(std::filesystem::path folder = folder_of_user(), std::uint64_t max_bytes = two_gib)
        : folder_(std::move(folder)), max_bytes_(max_bytes) {}

    /// What is kept under `name`. Nothing if there is none, or if its file is truncated or fails its
    /// checksum.
    std::optional<std::string> find(const std::string& name) const;
    /// Keeps it, so that a reader sees all of it or nothing; what was used longest ago goes until all fits
    /// into `max_bytes`. What takes more than half of them is not kept.
    void keep(const std::string& name, std::string_view content) const;

private:
    std::filesystem::path file(const std::string& name) const { return folder_ / (name + ".kept"); }
    void make_room() const;

    std::filesystem::path folder_;
    std::uint64_t max_bytes_;
};

}  // namespace voxspring
