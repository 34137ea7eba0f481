// The journal of a study: a file to which every measurement is written as soon as it is finished, so that an
// interrupted study can be resumed.
#pragma once

#include <filesystem>
#include <functional>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>

#include "harness/base/bad_input.h"
#include "harness/base/clock.h"

namespace voxspring {

/// The journal cannot be read or written. The message gives the reason and, if a measurement could not be
/// written, its name. The study must stop measuring.
class Unwritten : public std::runtime_error {
    using std::runtime_error::runtime_error;
};

/// The place at which two JSON values first differ, and the text of each at that place, for users.
struct Difference {
    std::string where;  ///< keys and, in lists, numbers from 1: "scenes 2 1"; empty: the values as a whole
    /// The text of the first and of the second value. "nothing": there is no such key, or its value is null.
    std::string there, here;
};
/// The first difference of two JSON values, which must differ.
Difference first_difference(const nlohmann::json& there, const nlohmann::json& here);
/// The error that `accepted` was expected at `key` of the journal `file`, but `other.there` is there. If that
/// is "nothing", the error says that there is no value.
BadInput refusal(const std::string& file, const std::string& key, const Difference& other,
                 const std::string& accepted);

/// The finished measurements of a study, by name. The file has one JSON object per line, each with a
/// checksum. The first line describes the study. Each further line is a measurement.
class Journal {
public:
    /// A journal without a file, in memory only.
    Journal() = default;
    /// A journal in `file`. With `resume` it continues the journal of a study that was interrupted. Throws
    /// BadInput if another process writes the file, if a journal exists and `resume` is false, if the file is
    /// a journal of another version or another study (`study` differs), or if a line does not match its
    /// checksum. Throws Unwritten if the file cannot be read or written. An incomplete last line is dropped,
    /// and note() says so.
    Journal(std::filesystem::path file, const nlohmann::json& study, bool resume);
    Journal(const Journal&) = delete;
    Journal& operator=(const Journal&) = delete;

    /// The measurement `name`; null if the journal does not have it.
    const nlohmann::json* find(const std::string& name) const;
    /// Adds a measurement. When this returns, the value is in the file and survives the end of this process.
    /// The file is synced to the disk at most once per second, so a crash of the whole machine may lose the
    /// latest measurements. Throws Unwritten. `value` must not contain infinity or NaN, since JSON has
    /// neither.
    void keep(const std::string& name, nlohmann::json value);

    /// Calls `visitor` for each finished measurement, sorted by name.
    void visit(
        const std::function<void(const std::string& name, const nlohmann::json& value)>& visitor) const;
    /// How many times the study has been started or resumed, including this time. An earlier time without a
    /// finished measurement does not count.
    int sessions() const { return session_; }
    /// The time that the study has taken so far: how long this session has been going on, plus for each
    /// earlier session the time until its last keep().
    double elapsed_seconds() const;
    /// A note for the user about the file, if an incomplete line was dropped; otherwise empty.
    const std::string& note() const { return note_; }
    /// Deletes the journal's file. Call this once the result of the study is written.
    void remove();

    /// The file of the journal of the study whose result goes to the file `result`.
    static std::filesystem::path file_beside(const std::filesystem::path& result);

private:
    /// The error that the file cannot be written, for the reason in errno. `consequence` ends the message.
    Unwritten unwritten(const std::string& consequence) const;
    void open_locked();
    /// Returns the text of the file without an incomplete last line, which is also cut off in the file.
    std::string complete_lines();
    void read(const std::string& text, const nlohmann::json& study);
    void append(const nlohmann::json& line, const std::string& what);
    /// Syncs the file to the disk, unless the last sync was less than a second ago. Returns false on failure.
    bool sync_now_and_then();

    /// A file descriptor. The destructor closes it, which releases the lock on the file.
    struct Descriptor {
        int number = -1;
        ~Descriptor();
    };

    std::filesystem::path file_;  ///< empty: in memory only
    Descriptor descriptor_;
    std::optional<Clock::time_point> synced_;
    int session_ = 1;
    const Clock::time_point begin_ = Clock::now();
    double earlier_seconds_ = 0;
    std::string note_;
    std::map<std::string, nlohmann::json> finished_;
};

/// The measurements of a journal whose names begin with a prefix, for example all those of one case.
class JournalScope {
public:
    JournalScope(Journal& journal, std::string prefix) : journal_(&journal), prefix_(std::move(prefix)) {}
    const nlohmann::json* find(const std::string& name) const { return journal_->find(prefix_ + name); }
    void keep(const std::string& name, nlohmann::json value) {
        journal_->keep(prefix_ + name, std::move(value));
    }

private:
    Journal* journal_;
    std::string prefix_;
};

}  // namespace voxspring
