// What a study has finished, on disk as soon as it is.
#pragma once

#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>
#include <string>

namespace voxspring {

/// Finished measurements by name, in memory.
class Journal {
public:
    /// Null if it is not finished.
    const nlohmann::json* find(const std::string& name) const;
    void keep(const std::string& name, nlohmann::json value);

private:
    std::map<std::string, nlohmann::json> finished_;
};

/// Those of one contender.
class Record {
public:
    Record(Journal& journal, std::string prefix) : journal_(&journal), prefix_(std::move(prefix)) {}
    const nlohmann::json* find(const std::string& name) const { return journal_->find(prefix_ + name); }
    void keep(const std::string& name, nlohmann::json value) {
        journal_->keep(prefix_ + name, std::move(value));
    }

private:
    Journal* journal_;
    std::string prefix_;
};

}  // namespace voxspring
