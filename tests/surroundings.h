// What tests find around them: folders, variables of the environment, and refusals of input.
#pragma once

#include <cstdlib>
#include <exception>
#include <filesystem>
#include <fstream>
#include <optional>
#include <stdexcept>
#include <string>
#include <system_error>
#include <utility>

#include "harness/base/bad_input.h"

namespace voxspring::testing {

/// The message of the error of this kind with which `action` ends; empty if it ends without one.
template <class Error = std::exception, class Action>
std::string message_of(const Action& action) {
    try {
        action();
    } catch (const Error& error) {
        return error.what();
    }
    return {};
}

/// The message with which `use` refuses an input, or "accepted".
template <class Use>
std::string refusal(const Use& use) {
    const std::string message = message_of<BadInput>(use);
    return message.empty() ? "accepted" : message;
}

/// What `use` refuses: "KEY: VALUE" or "KEY is missing", without the name of the file and what is expected
/// instead; or "accepted".
template <class Use>
std::string refused(const Use& use) {
    const std::string message = refusal(use);
    const auto begin = message.find(": "), end = message.find("; expected ");
    if (end == std::string::npos) return message;
    const std::string text = message.substr(begin + 2, end - begin - 2);
    return text.substr(0, text.rfind(" is not accepted"));
}

/// A temporary folder that is removed with the object.
class TemporaryFolder {
public:
    TemporaryFolder() {
        std::string name = (std::filesystem::temp_directory_path() / "voxspring-XXXXXX").string();
        if (mkdtemp(name.data()) == nullptr) throw std::runtime_error("no temporary folder");
        path_ = name;
    }
    ~TemporaryFolder() {
        std::error_code ignored;
        std::filesystem::remove_all(path_, ignored);
    }
    TemporaryFolder(const TemporaryFolder&) = delete;
    TemporaryFolder& operator=(const TemporaryFolder&) = delete;

    std::string write(const std::string& name, const std::string& bytes) const {
        const std::filesystem::path file = path_ / name;
        std::ofstream(file, std::ios::binary) << bytes;
        return file.string();
    }
    const std::filesystem::path& path() const { return path_; }

private:
    std::filesystem::path path_;
};

/// Sets an environment variable for its lifetime.
class Variable {
public:
    Variable(std::string name, const std::string& value) : name_(std::move(name)) {
        if (const char* before = std::getenv(name_.c_str())) before_ = before;
        setenv(name_.c_str(), value.c_str(), 1);
    }
    Variable(const Variable&) = delete;
    Variable& operator=(const Variable&) = delete;
    ~Variable() {
        if (before_) {
            setenv(name_.c_str(), before_->c_str(), 1);
        } else {
            unsetenv(name_.c_str());
        }
    }

private:
    const std::string name_;
    std::optional<std::string> before_;
};

}  // namespace voxspring::testing
