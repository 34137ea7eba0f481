// The journal of a study. Every measurement is written as soon as it is finished, so that it survives the end
// of the process.
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

/// The journal cannot be read or written; the message says what it lacks. The study must stop measuring.
class Unwritten : public std::runtime_error {
    using std::runtime_error::runtime_error;
};

/// Where two JSON values, `there` and `here`, first differ, and what each has in that place, for users.
struct Difference {
    std::string where;  ///< keys and, in lists, numbers from 1: "scenes 2 1"; empty: the values as a whole
    std::string there, here;
};
/// The first difference of two values, which must differ.
Difference first_difference(const nlohmann::json& there, const nlohmann::json& here);
/// The error that the journal `file` has `other.there` (or nothing) at `key`, instead of `accepted`.
BadInput refusal(const std::string& file, const std::string& key, const Difference& other,
                 const std::string& accepted);

/// Finished measurements by name. On disk this is a file of JSON lines, each with a checksum: first an object
/// that describes the study, then one line per measurement.
class Journal {
public:
    /// A journal in memory only.
    Journal() = default;
    /// A journal in `file`. With `resume` it continues the journal of a study that was interrupted. Throws
    /// BadInput if another process writes the file, if a journal exists and `resume` is false, if it is the
    /// journal of another study (`study` differs), or if a line does not match its checksum; Unwritten if the
    /// file cannot be read or written. An incomplete last line is dropped, and note() says so.
    Journal(std::filesystem::path file, const nlohmann::json& study, bool resume);
    Journal(const Journal&) = delete;
    Journal& operator=(const Journal&) = delete;

    /// The measurement `name`; null if it is not finished.
    const nlohmann::json* find(const std::string& name) const;
    /// Keeps a measurement. When this returns, the value is in the file and survives the end of this process.
    /// The file is synced to the disk at most once per second, so a crash of the whole machine may lose the
    /// last moments. Throws Unwritten. `value` must have no infinity and no NaN, since JSON has neither.
    void keep(const std::string& name, nlohmann::json value);

    /// Calls `visitor` for each finished measurement, sorted by name.
    void visit(
        const std::function<void(const std::string& name, const nlohmann::json& value)>& visitor) const;
    /// How many times the study has been started or resumed, including this time.
    int sessions() const { return session_; }
    /// How long the journal has been open in this session, plus in each earlier one until it last kept
    /// something.
    double elapsed_seconds() const;
    /// What a user should know about the file; usually empty.
    const std::string& note() const { return note_; }
    /// Deletes the journal's file. To be called once the result is written.
    void remove();

    static std::filesystem::path file_beside(const std::filesystem::path& result);

private:
    /// The error that errno describes.
    Unwritten unwritten(const std::string& consequence) const;
    void open_locked();
    /// Returns the text of the file. Cuts off an incomplete last line, also in the file.
    std::string complete_lines();
    void read(const std::string& text, const nlohmann::json& study);
    void append(const nlohmann::json& line, const std::string& what);
    /// Syncs the file to the disk, unless that was done within the last second. Returns false on failure.
    bool sync_now_and_then();

    /// A file descriptor. The destructor closes it, which releases the lock on the file.
    struct Descriptor {
        int number = -1;
        ~Descriptor();
    };

    std::filesystem::path file_;  ///< empty: in memory only
    Descriptor descriptor_;
    std::optional<std::chrono::steady_clock::time_point> synced_;
    int session_ = 1;
    const std::chrono::steady_clock::time_point begin_ = std::chrono::steady_clock::now();
    double earlier_seconds_ = 0;
    std::string note_;
    std::map<std::string, nlohmann::json> finished_;
};

/// The measurements whose names begin with a prefix: for example all of one case.
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
