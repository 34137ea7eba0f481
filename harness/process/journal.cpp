#include "harness/process/journal.h"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <nlohmann/json.hpp>
#include <optional>
#include <string_view>
#include <system_error>

#include "backends/disk_cache.h"
#include "harness/base/files.h"
#include "harness/base/json.h"

namespace voxspring {
namespace {

constexpr int version = 2;
constexpr std::string_view check_key = R"({"check":")";
/// The line of the journal for `object`, which must not be empty. The line begins with a checksum of its
/// rest.
std::string line_of(const nlohmann::json& object) {
    const std::string rest = "," + json_text(object).substr(1);
    return std::string(check_key) + hash_of(rest) + "\"" + rest + "\n";
}

/// The object in `line`; empty if the line does not match its checksum. `line` is given without its newline.
std::optional<nlohmann::json> object_of(std::string_view line) {
    const std::size_t rest = check_key.size() + hash_digits + 1;
    if (line.size() < rest || !line.starts_with(check_key) ||
        line.substr(check_key.size(), hash_digits) != hash_of(line.substr(rest)))
        return std::nullopt;
    return parsed_json(line);
}

/// The text that stands for null, and for a missing value if only one of two compared objects has a key.
const std::string nothing = "nothing";

/// `value` as text, without quotes and brackets.
std::string plain_text(const nlohmann::json& value) {
    if (value.is_null()) return nothing;
    if (value.is_string()) return value.get<std::string>();
    if (!value.is_structured()) return json_text(value);
    std::string text;
    for (const auto& item : value) text += (text.empty() ? "" : ", ") + plain_text(item);
    return text.empty() ? "none" : text;
}

}  // namespace

Difference first_difference(const nlohmann::json& there, const nlohmann::json& here) {
    const auto within = [&](const std::string& key, const auto& at) {
        Difference inner = first_difference(there.at(at), here.at(at));
        return Difference{inner.where.empty() ? key : key + " " + inner.where, inner.there, inner.here};
    };
    if (there.is_object() && here.is_object()) {
        for (const auto& [key, value] : here.items()) {
            if (!there.contains(key)) return {key, nothing, plain_text(value)};
            if (there.at(key) != value) return within(key, key);
        }
        for (const auto& [key, value] : there.items()) {
            if (!here.contains(key)) return {key, plain_text(value), nothing};
        }
    } else if (there.is_array() && here.is_array() && there.size() == here.size()) {
        for (std::size_t i = 0; i < there.size(); ++i) {
            if (there[i] != here[i]) return within(std::to_string(i + 1), i);
        }
    }
    return {"", plain_text(there), plain_text(here)};
}

BadInput refusal(const std::string& file, const std::string& key, const Difference& other,
                 const std::string& accepted) {
    return other.there == nothing ? BadInput(file, key, missing, accepted)
                                  : BadInput(file, key, other.there, accepted);
}

std::filesystem::path Journal::file_beside(const std::filesystem::path& result) {
    return result.string() + ".journal";
}

Journal::Journal(std::filesystem::path file, const nlohmann::json& study, bool resume)
    : file_(std::move(file)) {
    open_locked();
    std::error_code none;
    if (!resume && std::filesystem::file_size(file_, none) > 0)
        throw BadInput(file_.string(), "journal", "an interrupted study",
                       "--resume, which continues it, or no such file: delete it to begin again");
    if (const std::string text = complete_lines(); text.empty()) {
        append({{"journal", version}, {"study", study}}, "the description of the study");
        sync_folder_of(file_);
    } else {
        read(text, study);
    }
}

Journal::Descriptor::~Descriptor() {
    if (number >= 0) close(number);
}

std::string Journal::complete_lines() {
    std::string text;
    std::array<char, 1 << 16> buffer{};
    for (;;) {
        const ssize_t n = ::read(descriptor_.number, buffer.data(), buffer.size());
        if (n < 0 && errno == EINTR) continue;
        // An error must not be mistaken for the end of the file: unread lines would be dropped.
        if (n < 0) throw Unwritten("cannot read " + file_.string() + ": " + std::strerror(errno));
        if (n == 0) break;
        text.append(buffer.data(), std::size_t(n));
    }
    const std::size_t complete = text.rfind('\n') + 1;  // 0 if there is no complete line
    if (complete < text.size()) {
        note_ = file_.string() + ": the last line was cut short and is dropped";
        text.resize(complete);
        if (ftruncate(descriptor_.number, off_t(complete)) != 0) throw unwritten("");
    }
    return text;
}

Unwritten Journal::unwritten(const std::string& consequence) const {
    return Unwritten("cannot write " + file_.string() + ": " + std::strerror(errno) + consequence);
}

void Journal::open_locked() {
    descriptor_.number = open(file_.c_str(), O_RDWR | O_CREAT | O_APPEND | O_CLOEXEC, 0666);
    if (descriptor_.number < 0) throw unwritten("");
    struct flock lock {};
    lock.l_type = F_WRLCK;
    lock.l_whence = SEEK_SET;
    if (fcntl(descriptor_.number, F_SETLK, &lock) == 0 || (errno != EACCES && errno != EAGAIN)) return;
    const bool known = fcntl(descriptor_.number, F_GETLK, &lock) == 0 && lock.l_type != F_UNLCK;
    throw BadInput(
        file_.string(), "journal",
        "a journal that " + (known ? "process " + std::to_string(lock.l_pid) : "another process") + " writes",
        "a journal that no other process writes: wait for that study, or give this one another --out");
}

void Journal::read(const std::string& text, const nlohmann::json& study) {
    std::size_t number = 0;
    for (std::size_t begin = 0, end = 0; begin < text.size(); begin = end + 1) {
        end = text.find('\n', begin);
        ++number;
        const auto object = object_of(std::string_view(text).substr(begin, end - begin));
        if (!object)
            throw BadInput(file_.string(), "line " + std::to_string(number), text.substr(begin, end - begin),
                           "the line as it was written: the file is corrupt; delete it to begin again");
        if (number > 1) {
            session_ = std::max(session_, object->at("session").get<int>() + 1);
            earlier_seconds_ = object->at("elapsed_seconds");
            finished_[object->at("name")] = object->at("value");
            continue;
        }
        if (object->value("journal", 0) != version)
            throw BadInput(file_.string(), "journal", json_text(*object),
                           "version " + std::to_string(version));
        const nlohmann::json now = parsed_json(json_text(study));  // as read back from a file
        for (const auto& [key, value] : now.items()) {
            const nlohmann::json there = object->at("study").value(key, nlohmann::json());
            if (there == value) continue;
            const Difference other = first_difference(there, value);
            throw refusal(file_.string(), other.where.empty() ? key : key + " " + other.where, other,
                          other.here + ", which this study has; delete the file to begin again");
        }
    }
}

const nlohmann::json* Journal::find(const std::string& name) const {
    const auto found = finished_.find(name);
    return found == finished_.end() ? nullptr : &found->second;
}

void Journal::visit(
    const std::function<void(const std::string& name, const nlohmann::json& value)>& visitor) const {
    for (const auto& [name, value] : finished_) visitor(name, value);
}

double Journal::elapsed_seconds() const { return earlier_seconds_ + seconds_since(begin_); }

void Journal::keep(const std::string& name, nlohmann::json value) {
    if (descriptor_.number >= 0)
        append(
            {{"name", name}, {"session", session_}, {"elapsed_seconds", elapsed_seconds()}, {"value", value}},
            name);
    finished_[name] = std::move(value);
}

void Journal::append(const nlohmann::json& object, const std::string& what) {
    const std::string line = line_of(object);
    if (!write_all(descriptor_.number, line) || !sync_now_and_then())
        throw unwritten("; the file lacks " + what + " and what would follow: --resume continues from there");
}

/// Syncs at most once per second, since syncing takes milliseconds and a measurement may take less.
bool Journal::sync_now_and_then() {
    constexpr std::chrono::seconds pause(1);
    const auto now = Clock::now();
    if (synced_ && now - *synced_ < pause) return true;
    synced_ = now;
    return fdatasync(descriptor_.number) == 0;
}

void Journal::remove() {
    if (descriptor_.number < 0) return;
    std::error_code none;
    std::filesystem::remove(file_, none);
    close(std::exchange(descriptor_.number, -1));
}

}  // namespace voxspring
