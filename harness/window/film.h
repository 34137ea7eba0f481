// A film of what a window shows.
#pragma once

#include <sys/types.h>

#include <cstdint>
#include <filesystem>
#include <glm/vec2.hpp>
#include <string>

#include "harness/export/image.h"

namespace voxspring {

/// As many pictures a second as a film has.
inline constexpr int film_rate = 30;

/// Where ffmpeg is found, the file itself, in whatever format its ending asks ffmpeg for; else a folder of
/// its name without ending, with frame_000001.png and so on.
class Film {
public:
    /// Of pictures of that size. Throws BadInput where the folder takes no new file, std::runtime_error.
    Film(const std::filesystem::path& file, glm::ivec2 size);
    ~Film();
    Film(const Film&) = delete;
    Film& operator=(const Film&) = delete;

    /// Whether a film that has run for `seconds` lacks a picture.
    bool wants(double seconds) const { return double(pictures_) <= seconds * film_rate; }
    /// What is seen from there on until the next: it stands for all that were missed before it. Throws
    /// std::runtime_error where it cannot be written.
    void add(const Image& image, double seconds);
    /// Finishes the file and says what has become of it: "film.mp4, 12.5 s". Throws std::runtime_error.
    std::string finish();

private:
    std::filesystem::path file_, folder_;
    pid_t ffmpeg_ = -1;
    int pipe_ = -1;
    std::int64_t pictures_ = 0;
};

}  // namespace voxspring
