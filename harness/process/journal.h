// What a study has finished, written as soon as it is: what is there is not lost to whatever ends the
// process.
#pragma once

#include <chrono>
#include <filesystem>
#include <functional>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>

#include "harness/base/bad_input.h"

namespace voxspring {

/// What is finished cannot be written; the message says what that is. Nothing further is to be measured.
class Unwritten : public std::runtime_error {
    using std::runtime_error::runtime_error;
};

/// Where two JSON values first differ, and what either has there, as a user reads it.
struct Difference {
    std::string where;  ///< keys and, in lists, numbers from 1: "scenes 2 1"; empty: as a whole
    std::string there, here;
};
/// Of values that differ.
Difference first_difference(const nlohmann::json& there, const nlohmann::json& here);
/// Refuses what `there` has, at `key` of `file`.
BadInput refusal(const std::string& file, const std::string& key, const Difference& other,
                 const std::string& accepted);

/// Finished measurements by name. On disk a file of JSON lines, each with a check of its own: first what the
/// study is (an object), then one line a measurement.
class Journal {
public:
    /// In memory alone.
    Journal() = default;
    /// In `file`, which the journal of a study that was cut short is continued in if `resume`. Throws
    /// BadInput if another process writes it, if there is one and it is not to be resumed, if it is of
    /// another study (`study` differs), or if a line is not what was written; Unwritten if it cannot be read
    /// or written. A last line that is not complete is dropped, which note() says.
    Journal(std::filesystem::path file, const nlohmann::json& study, bool resume);
    Journal(const Journal&) = delete;
    Journal& operator=(const Journal&) = delete;

    /// Null if it is not finished.
    const nlohmann::json* find(const std::string& name) const;
    /// In which session, from 1, it was finished. Of what is finished.
    int session_of(const std::string& name) const { return finished_.at(name).first; }
    /// Keeps it; it is in the file when this returns, whatever then ends this process. The disk is waited for
    /// once a second at most: only an end of the whole machine loses more, the last moments of it. Throws
    /// Unwritten. JSON has neither infinity nor NaN: `value` is to have none.
    void keep(const std::string& name, nlohmann::json value);

    /// Each finished measurement, by name.
    void visit(
        const std::function<void(const std::string& name, const nlohmann::json& value)>& visitor) const;
    /// How many times the study has been begun or resumed, now included.
    int sessions() const { return session_; }
    /// What a user should know of the file; empty: nothing.
    const std::string& note() const { return note_; }
    /// The file has done its duty.
    void remove();

    static std::filesystem::path file_beside(const std::filesystem::path& result);

private:
    /// Of errno.
    Unwritten unwritten(const std::string& consequence) const;
    void open_locked();
    /// All of it but a last line that is not complete, which goes.
    std::string complete_lines();
    void read(const std::string& text, const nlohmann::json& study);
    void append(const nlohmann::json& line, const std::string& what);
    /// Waits for the disk, unless it was waited for a moment ago.
    bool sync_now_and_then();

    /// Closes what it has opened, which gives its lock back.
    struct Descriptor {
        int number = -1;
        ~Descriptor();
    };

    std::filesystem::path file_;  ///< empty: in memory alone
    Descriptor descriptor_;
    std::optional<std::chrono::steady_clock::time_point> synced_;
    int session_ = 1;
    std::string note_;
    std::map<std::string, std::pair<int, nlohmann::json>> finished_;
};

/// Those of one case, or of whatever else has names of its own.
class JournalScope {
public:
    JournalScope(Journal& journal, std::string prefix) : journal_(&journal), prefix_(std::move(prefix)) {}
    const nlohmann::json* find(const std::string& name) const { return journal_->find(prefix_ + name); }
    int session_of(const std::string& name) const { return journal_->session_of(prefix_ + name); }
    void keep(const std::string& name, nlohmann::json value) {
        journal_->keep(prefix_ + name, std::move(value));
    }

private:
    Journal* journal_;
    std::string prefix_;
};

}  // namespace voxspring
