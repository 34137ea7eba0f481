#include "harness/base/files.h"

#include <dlfcn.h>
#include <fcntl.h>
#include <link.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <climits>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <stdexcept>
#include <system_error>
#include <vector>

#include "backends/disk_cache.h"
#include "harness/base/bad_input.h"

namespace voxspring {
namespace {

// The path of the temporary file that write_atomically() is writing. It is an array because a signal handler
// removes the file, and must not use a std::string.
char unfinished_file[PATH_MAX];
volatile std::sig_atomic_t unfinished_file_is_known = 0;

/// While this object lives, remove_unfinished_file() removes the file at `path`. The destructor leaves the
/// file alone. A file whose path has PATH_MAX bytes or more is not removed.
class Unfinished {
public:
    explicit Unfinished(const std::string& path) {
        if (path.size() >= sizeof unfinished_file) return;
        path.copy(unfinished_file, path.size());
        unfinished_file[path.size()] = '\0';
        unfinished_file_is_known = 1;
    }
    Unfinished(const Unfinished&) = delete;
    Unfinished& operator=(const Unfinished&) = delete;
    ~Unfinished() { unfinished_file_is_known = 0; }
};

/// Returns a path that no file has: `path` and a suffix. The suffix contains the ID of this process, since
/// another process may look for such a path at the same time.
std::string unused_name_beside(const std::filesystem::path& path) {
    std::error_code error;
    const std::string stem = path.string() + "." + std::to_string(getpid()) + "-";
    int number = 0;
    while (std::filesystem::exists(std::filesystem::symlink_status(stem + std::to_string(number), error)))
        ++number;
    return stem + std::to_string(number);
}

/// Whether `path` is a pipe or a device. Pipes and devices are written in place, not replaced by a new file.
bool is_pipe_or_device(const std::filesystem::path& path) {
    struct stat status {};
    return stat(path.c_str(), &status) == 0 && !S_ISREG(status.st_mode) && !S_ISDIR(status.st_mode);
}

/// The file that `path` leads to through at most 40 symbolic links. That file need not exist.
std::filesystem::path behind_links(std::filesystem::path path) {
    constexpr int most = 40;  // Linux follows as many links
    std::error_code error;
    for (int links = 0; links < most && std::filesystem::is_symlink(path, error); ++links) {
        const std::filesystem::path target = std::filesystem::read_symlink(path, error);
        if (error) break;
        path = target.is_absolute() ? target : path.parent_path() / target;
    }
    return path;
}

}  // namespace

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

void write_atomically(const std::filesystem::path& asked, const std::string& text) {
    const auto fail = [&](const char* what) {
        throw std::system_error(errno, std::generic_category(), what + (" " + asked.string()));
    };
    if (is_pipe_or_device(asked)) {
        const int file = open(asked.c_str(), O_WRONLY | O_CLOEXEC);
        if (file < 0) fail("cannot write");
        const bool written = write_all(file, text);
        const int error = errno;
        close(file);
        if (written) return;
        errno = error;
        fail("cannot write");
    }
    const std::filesystem::path path = behind_links(asked);
    const std::string temporary = unused_name_beside(path);
    // The path is registered before the file exists, since a signal may come as soon as the file is created.
    const Unfinished unfinished(temporary);
    // The kernel removes the bits of the umask from 0666. This program cannot do so itself, since no
    // call reads the umask without changing it for all threads.
    const int file = open(temporary.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
    if (file < 0) fail("cannot write");
    const bool done = write_all(file, text) && fsync(file) == 0;
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

void remove_unfinished_file() {
    if (unfinished_file_is_known != 0) unlink(unfinished_file);
}

void occupy_standard_descriptors() {
    // open() returns the lowest number that is free. The mode is the wrong one, so that each use fails.
    for (int number = 0; number <= STDERR_FILENO; ++number) {
        if (fcntl(number, F_GETFD) < 0) (void)open("/dev/null", number == STDIN_FILENO ? O_WRONLY : O_RDONLY);
    }
}

void check_writable(const std::filesystem::path& path, const std::string& option,
                    const std::string& extension) {
    const auto refuse = [&](const std::string& accepted) {
        throw BadInput("command line", option, path.string(), accepted);
    };
    if (path.extension() != extension) refuse("a path that ends in " + extension);
    if (is_pipe_or_device(path)) return;
    std::error_code none;
    if (std::filesystem::is_directory(path, none)) refuse("the path of a file; this is a folder");
    const std::filesystem::path target = behind_links(path);
    if (std::filesystem::is_symlink(target, none)) refuse("a path whose links do not lead in a circle");
    // A longer name than that of write_atomically() might be refused, a shorter one accepted in vain.
    const std::string probe = unused_name_beside(target);
    const int file = open(probe.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
    if (file < 0)
        refuse(std::string("a path in a folder where a file can be created (") + std::strerror(errno) + ")");
    close(file);
    unlink(probe.c_str());
}

std::filesystem::path file_of_this_code() {
    Dl_info info{};
    void* map = nullptr;
    const auto* const here = reinterpret_cast<const void*>(&file_of_this_code);
    if (dladdr1(here, &info, &map, RTLD_DL_LINKMAP) != 0) {
        // The program itself has no name in this list, a shared library has its path.
        const char* const library = static_cast<const link_map*>(map)->l_name;
        if (library != nullptr && *library != 0) return library;
    }
    return "/proc/self/exe";
}

const std::string& fingerprint_of_code() {
    static const std::string fingerprint = [] {
        const std::filesystem::path file = file_of_this_code();
        std::ifstream program(file, std::ios::binary);
        std::vector<char> piece(std::size_t(1) << 16);
        Hash hash;
        while (program.read(piece.data(), std::streamsize(piece.size())) || program.gcount() > 0)
            hash.add(piece.data(), std::size_t(program.gcount()));
        if (!program.eof()) throw std::runtime_error("cannot read " + file.string());
        return hash.text();
    }();
    return fingerprint;
}

}  // namespace voxspring
