#include "harness/process/journal.h"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <csignal>
#include <cstring>
#include <optional>
#include <string_view>
#include <system_error>

#include "backends/disk_cache.h"
#include "harness/base/bad_input.h"
#include "harness/base/files.h"

namespace voxspring {
namespace {

constexpr int version = 1;
constexpr std::string_view check_key = R"({"check":")";
/// `object`, which is not empty, with the check of all that follows it in front.
std::string line_of(const nlohmann::json& object) {
    const std::string rest =
        "," + object.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace).substr(1);
    return std::string(check_key) + hash_of(rest) + "\"" + rest + "\n";
}

/// The object of a line without its end; nothing if it is not as it was written.
std::optional<nlohmann::json> object_of(std::string_view line) {
    const std::size_t rest = check_key.size() + hash_digits + 1;
    if (line.size() < rest || !line.starts_with(check_key) ||
        line.substr(check_key.size(), hash_digits) != hash_of(line.substr(rest)))
        return std::nullopt;
    return nlohmann::json::parse(line);
}

std::string short_text(const nlohmann::json& value) {
    return value.is_string() ? value.get<std::string>() : value.dump();
}

}  // namespace

std::filesystem::path Journal::file_beside(const std::filesystem::path& result) {
    return result.string() + ".journal";
}

Journal::Journal(std::filesystem::path file, const nlohmann::json& study, bool resume)
    : file_(std::move(file)) {
    // A file that may grow no further is an error to report, not the end of the process.
    std::signal(SIGXFSZ, SIG_IGN);
    std::error_code none;
    const bool left = std::filesystem::exists(file_, none) && std::filesystem::file_size(file_, none) > 0;
    if (left && !resume)
        throw BadInput(file_.string(), "journal", "of a study that was cut short",
                       "--resume, which goes on with it; or no such file: delete it to begin again");
    open_locked();
    std::string text;
    std::array<char, 1 << 16> buffer{};
    for (ssize_t n = 0; (n = ::read(descriptor_, buffer.data(), buffer.size())) > 0;)
        text.append(buffer.data(), std::size_t(n));
    const std::size_t complete = text.rfind('\n') + 1;  // 0 where there is no line
    if (complete < text.size()) {
        note_ = file_.string() + ": the last line was cut short and is dropped";
        text.resize(complete);
        if (ftruncate(descriptor_, off_t(complete)) != 0) throw unwritten("");
    }
    if (text.empty()) {
        append({{"journal", version}, {"study", study}}, "what the study is");
        sync_folder_of(file_);
    } else {
        read(text, study);
    }
}

Journal::~Journal() {
    if (descriptor_ >= 0) close(descriptor_);
}

Unwritten Journal::unwritten(const std::string& consequence) const {
    return Unwritten("cannot write " + file_.string() + ": " + std::strerror(errno) + consequence);
}

void Journal::open_locked() {
    descriptor_ = open(file_.c_str(), O_RDWR | O_CREAT | O_APPEND | O_CLOEXEC, 0666);
    if (descriptor_ < 0) throw unwritten("");
    struct flock lock {};
    lock.l_type = F_WRLCK;
    lock.l_whence = SEEK_SET;
    if (fcntl(descriptor_, F_SETLK, &lock) != 0 && (errno == EACCES || errno == EAGAIN))
        throw BadInput(file_.string(), "journal", "of a study that is running", "one that no process writes");
}

void Journal::read(const std::string& text, const nlohmann::json& study) {
    std::size_t number = 0;
    for (std::size_t begin = 0, end = 0; begin < text.size(); begin = end + 1) {
        end = text.find('\n', begin);
        ++number;
        const auto object = object_of(std::string_view(text).substr(begin, end - begin));
        if (!object)
            throw BadInput(file_.string(), "line " + std::to_string(number), text.substr(begin, end - begin),
                           "what was written there: the file is corrupt; delete it to begin again");
        if (number > 1) {
            const int session = object->at("session");
            session_ = std::max(session_, session + 1);
            finished_[object->at("name")] = {session, object->at("value")};
            continue;
        }
        if (object->value("journal", 0) != version)
            throw BadInput(file_.string(), "journal", object->dump(), "version " + std::to_string(version));
        for (const auto& [key, value] : study.items()) {
            const nlohmann::json there = object->at("study").value(key, nlohmann::json());
            if (there != value)
                throw BadInput(file_.string(), key, short_text(there),
                               short_text(value) + ", which this study has; delete the file to begin again");
        }
    }
}

const nlohmann::json* Journal::find(const std::string& name) const {
    const auto found = finished_.find(name);
    return found == finished_.end() ? nullptr : &found->second.second;
}

void Journal::visit(
    const std::function<void(const std::string& name, const nlohmann::json& value)>& visitor) const {
    for (const auto& [name, finished] : finished_) visitor(name, finished.second);
}

void Journal::keep(const std::string& name, nlohmann::json value) {
    if (descriptor_ >= 0) append({{"name", name}, {"session", session_}, {"value", value}}, name);
    finished_[name] = {session_, std::move(value)};
}

void Journal::append(const nlohmann::json& object, const std::string& what) {
    const std::string line = line_of(object);
    if (!write_all(descriptor_, line) || fdatasync(descriptor_) != 0)
        throw unwritten("; it misses " + what + " and is complete up to there: --resume goes on with it");
}

void Journal::remove() {
    if (descriptor_ < 0) return;
    std::error_code none;
    std::filesystem::remove(file_, none);
    close(std::exchange(descriptor_, -1));
}

}  // namespace voxspring
