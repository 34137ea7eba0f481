// Records what a window shows as a film.
#pragma once

#include <sys/types.h>

#include <cstdint>
#include <filesystem>
#include <glm/vec2.hpp>
#include <string>

#include "harness/export/image.h"

namespace voxspring {

/// Pictures per second of film.
inline constexpr int film_rate = 30;

/// If ffmpeg is installed the result is the file itself, in the format that ffmpeg chooses by its ending.
/// Otherwise it is a folder, named like the file without its ending, with frame_000001.png and so on.
class Film {
public:
    /// All pictures must have this size. Throws BadInput if the folder is not writable, and
    /// std::runtime_error.
    Film(const std::filesystem::path& file, glm::ivec2 size);
    ~Film();
    Film(const Film&) = delete;
    Film& operator=(const Film&) = delete;

    /// Whether the film needs a picture when it has run for `seconds`.
    bool wants(double seconds) const { return double(pictures_) <= seconds * film_rate; }
    /// Adds the picture that is visible after `seconds`. It also stands in for all pictures missed before.
    /// Throws std::runtime_error if it cannot be written.
    void add(const Image& image, double seconds);
    /// Finishes the file and returns a description of the result: "film.mp4, 12.5 s". Throws
    /// std::runtime_error.
    std::string finish();

private:
    std::filesystem::path file_, folder_;
    pid_t ffmpeg_ = -1;
    int pipe_ = -1;
    std::int64_t pictures_ = 0;
};

}  // namespace voxspring
