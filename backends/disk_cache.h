// A cache on disk for results that are slow to compute and depend only on their inputs. The hash of the
// inputs names an entry.
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

/// An XXH3 hash of 128 bits. Numbers are hashed as this machine stores them, so a cache is of use only on
/// machines of the same byte order.
class Hash {
public:
    Hash();
    ~Hash();
    Hash(const Hash&) = delete;
    Hash& operator=(const Hash&) = delete;

    void add(const void* bytes, std::size_t count);
    void add(std::string_view text);
    /// Adds a number or a vector of numbers to the hash. The number's type must not have padding bytes.
    template <class T>
    void add_number(const T& value) {
        add(&value, sizeof value);
    }
    template <class T>
    void add_numbers(const std::vector<T>& values) {
        add_number(values.size());
        add(values.data(), values.size() * sizeof(T));
    }
    /// The hash as 32 hexadecimal digits.
    std::string text() const;

private:
    struct State;
    std::unique_ptr<State> state_;
};

/// The hash of the bytes of one text: 32 hexadecimal digits.
std::string hash_of(std::string_view text);
inline constexpr std::size_t hash_digits = 32;

/// A folder of entries by name. No member throws: an entry that cannot be read is not found, and one that
/// cannot be written is not kept.
class DiskCache {
public:
    static constexpr std::uint64_t two_gib = std::uint64_t(2) << 30;

    /// $VOXSPRING_CACHE, or else $XDG_CACHE_HOME/voxspring, or else ~/.cache/voxspring. Empty: no cache.
    static std::filesystem::path folder_of_user();

    explicit DiskCache(std::filesystem::path folder = folder_of_user(), std::uint64_t max_bytes = two_gib)
        : folder_(std::move(folder)), max_bytes_(max_bytes) {}

    /// The content kept under `name`. There is none if there is no such entry, or if its file is truncated or
    /// fails its checksum.
    std::optional<std::string> find(const std::string& name) const;
    /// Keeps `content` so that a reader sees all of it or nothing. Entries that were used longest ago are
    /// deleted until all fit into `max_bytes`. Content of more than half of `max_bytes` is not kept.
    void keep(const std::string& name, std::string_view content) const;

private:
    std::filesystem::path file(const std::string& name) const { return folder_ / (name + ".kept"); }
    void make_room() const;

    std::filesystem::path folder_;
    std::uint64_t max_bytes_;
};

}  // namespace voxspring
