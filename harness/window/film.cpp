#include "harness/window/film.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <csignal>
#include <cstdlib>
#include <cstring>
#include <optional>
#include <stdexcept>
#include <string_view>
#include <utility>
#include <vector>

#include "harness/base/files.h"

namespace voxspring {
namespace {

std::optional<std::string> find_ffmpeg() {
    const char* path = std::getenv("PATH");
    std::string_view left = path == nullptr ? "" : path;
    while (!left.empty()) {
        const std::string_view folder = left.substr(0, left.find(':'));
        left.remove_prefix(std::min(left.size(), folder.size() + 1));
        const std::string program = std::string(folder) + "/ffmpeg";
        if (access(program.c_str(), X_OK) == 0) return program;
    }
    return std::nullopt;
}

}  // namespace

Film::Film(const std::filesystem::path& file, glm::ivec2 size) : file_(file) {
    check_writable(file, "--record", file.extension().string());
    const auto ffmpeg = find_ffmpeg();
    if (!ffmpeg) {
        folder_ = std::filesystem::path(file).replace_extension();
        std::filesystem::create_directories(folder_);
        return;
    }
    std::array<int, 2> ends{};
    if (pipe2(ends.data(), O_CLOEXEC) != 0) throw std::runtime_error("no pipe to ffmpeg");
    // Width and height are made even, as most formats require.
    std::vector<std::string> words = {*ffmpeg,
                                      "-y",
                                      "-loglevel",
                                      "error",
                                      "-f",
                                      "rawvideo",
                                      "-pixel_format",
                                      "rgba",
                                      "-video_size",
                                      fmt::format("{}x{}", size.x, size.y),
                                      "-framerate",
                                      std::to_string(film_rate),
                                      "-i",
                                      "-",
                                      "-vf",
                                      "crop=trunc(iw/2)*2:trunc(ih/2)*2",
                                      "-pix_fmt",
                                      "yuv420p",
                                      "-threads",
                                      "1",
                                      file.string()};
    std::vector<char*> arguments;
    for (std::string& word : words) arguments.push_back(word.data());
    arguments.push_back(nullptr);
    posix_spawn_file_actions_t actions;
    posix_spawn_file_actions_init(&actions);
    posix_spawn_file_actions_adddup2(&actions, ends[0], STDIN_FILENO);
    // ffmpeg gets a new process group, which Ctrl-C does not reach, so that it finishes the film.
    posix_spawnattr_t attributes;
    posix_spawnattr_init(&attributes);
    posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETPGROUP);
    const int failed =
        posix_spawn(&ffmpeg_, ffmpeg->c_str(), &actions, &attributes, arguments.data(), environ);
    posix_spawn_file_actions_destroy(&actions);
    posix_spawnattr_destroy(&attributes);
    close(ends[0]);
    pipe_ = ends[1];
    if (failed != 0) {
        close(pipe_);
        throw std::runtime_error("ffmpeg cannot be started: " + std::string(std::strerror(failed)));
    }
    // If ffmpeg ends early, writing to its pipe must fail rather than end this process.
    std::signal(SIGPIPE, SIG_IGN);
}

Film::~Film() {
    if (pipe_ >= 0) close(pipe_);
    if (ffmpeg_ > 0) waitpid(ffmpeg_, nullptr, 0);
}

void Film::add(const Image& image, double seconds) {
    while (wants(seconds)) {
        ++pictures_;
        if (ffmpeg_ < 0) {
            write_atomically(folder_ / fmt::format("frame_{:06}.png", pictures_), encode_png(image, {}));
        } else if (!write_all(pipe_,
                              {reinterpret_cast<const char*>(image.pixels.data()), image.pixels.size()})) {
            throw std::runtime_error("ffmpeg has ended before the film: is " + file_.string() +
                                     " a format that it knows?");
        }
    }
}

std::string Film::finish() {
    const double seconds = double(pictures_) / film_rate;
    if (ffmpeg_ < 0)
        return fmt::format(
            "{} pictures in {}, for there is no ffmpeg here; where there is one: ffmpeg -framerate {} "
            "-i {}/frame_%06d.png {}",
            pictures_, folder_.string(), film_rate, folder_.string(), file_.string());
    close(std::exchange(pipe_, -1));
    int status = 0;
    waitpid(std::exchange(ffmpeg_, -1), &status, 0);
    if (!WIFEXITED(status) || WEXITSTATUS(status) != 0)
        throw std::runtime_error("ffmpeg could not write " + file_.string());
    return fmt::format("{}, {:.1f} s", file_.string(), seconds);
}

}  // namespace voxspring
