#include "harness/base/files.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <system_error>

#include "harness/base/bad_input.h"

namespace voxspring {

bool write_all(int file, std::string_view text) {
    while (!text.empty()) {
        const ssize_t n = write(file, text.data(), text.size());
        if (n < 0 && errno == EINTR) continue;
        if (n < 0) return false;
        text.remove_prefix(std::size_t(n));
    }
    return true;
}

void sync_folder_of(const std::filesystem::path& file) {
    const std::filesystem::path folder = file.has_parent_path() ? file.parent_path() : ".";
    const int descriptor = open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    if (descriptor < 0) return;
    fsync(descriptor);
    close(descriptor);
}

void write_atomically(const std::filesystem::path& path, const std::string& text) {
    const auto fail = [&](const char* what) {
        throw std::system_error(errno, std::generic_category(), what + (" " + path.string()));
    };
    std::string temporary = path.string() + ".XXXXXX";
    const int file = mkstemp(temporary.data());
    if (file < 0) fail("cannot write");
    const bool written = write_all(file, text);
    // mkstemp makes the file private; a result is as readable as any file its user writes.
    const mode_t mask = umask(0);
    umask(mask);
    const bool done = written && fchmod(file, 0666 & ~mask) == 0 && fsync(file) == 0;
    const int error = errno;
    close(file);
    if (!done || std::rename(temporary.c_str(), path.c_str()) != 0) {
        if (!done) errno = error;
        const int reason = errno;
        unlink(temporary.c_str());
        errno = reason;
        fail("cannot write");
    }
    sync_folder_of(path);
}

void check_writable(const std::filesystem::path& path, const std::string& option,
                    const std::string& extension) {
    if (path.extension() != extension) {
        throw BadInput("command line", option, path.string(), "a path that ends in " + extension);
    }
    std::string probe = path.string() + ".XXXXXX";
    const int file = mkstemp(probe.data());
    if (file < 0) {
        throw BadInput(
            "command line", option, path.string(),
            std::string("a path in a folder that takes a new file (") + std::strerror(errno) + ")");
    }
    close(file);
    unlink(probe.c_str());
}

}  // namespace voxspring
