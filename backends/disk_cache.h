// What is dear to compute and follows from its inputs alone, kept on disk from run to run.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <string_view>

namespace voxspring {

/// 128 bits of `text` in hexadecimal digits (FNV-1a). Not for secrets: for telling inputs apart.
std::string digest(std::string_view text);

/// A folder of entries in $VOXSPRING_CACHE, else $XDG_CACHE_HOME/voxspring, else ~/.cache/voxspring. Where
/// that cannot be read or written nothing is found and nothing kept, without a word: it only saves time.
class DiskCache {
public:
    /// `name`: of the folder.
    explicit DiskCache(const std::string& name);

    /// What was stored under `key`, a file name. An entry that is cut short or changed is none.
    std::optional<std::string> find(const std::string& key) const;
    /// A reader sees all of it or nothing.
    void store(const std::string& key, std::string_view content) const;

private:
    std::filesystem::path folder_;  ///< empty: there is none
};

}  // namespace voxspring
