// The files that `voxspring run --out` writes: one line a format in writers(), and series of them.
#pragma once

#include <cstdint>
#include <filesystem>
#include <glm/vec2.hpp>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "harness/export/snapshot.h"

namespace voxspring {

class Pictures;

/// A format.
struct Writer {
    std::string_view ending;  ///< of the file's name, with its dot
    std::string_view description;
    bool collected = false;                              ///< a series of it is listed in a .pvd file
    std::string (*contents)(const Snapshot&) = nullptr;  ///< the file's bytes; null: a picture, see Pictures
};
/// Every format, by ending.
const std::vector<Writer>& writers();
/// A line for each, for people.
std::string list_formats();

/// A picture's or a window's size, "640x480". Throws BadInput, as a value of --size.
glm::ivec2 parse_size(const std::string& text);

/// Of a folder of frames, where nothing says how many steps lie between them.
inline constexpr int max_frames = 50;

/// What `voxspring run` was asked to write.
struct ExportOptions {
    std::vector<std::filesystem::path> out;
    std::optional<int> every;                     ///< steps between the files of a series
    std::optional<std::filesystem::path> frames;  ///< folder of a series of pictures, made if it is missing
    std::optional<std::string> colour;            ///< of pictures: a Colouring; displacement
    std::optional<std::string> size;              ///< of pictures: WIDTHxHEIGHT; default_size
    std::optional<std::filesystem::path> tool_force;  ///< of a scene's tool, see ToolForces
};

/// The files that a run was asked for, each replaced in one step (write_atomically).
///
/// Without `every` each path of `out` is written once, after the last step. With it a path body.vtu stands
/// for a series body_000100.vtu, body_000200.vtu, ...: one after each `every` steps and one after the last
/// step; and for body.pvd where the format is collected, which lists with their times those that are
/// written, at any moment. `frames` stands for the series FRAMES/frame.png, without `every` of max_frames or
/// fewer.
///
/// The pictures of a series have one camera and one scale: where there are several, show look_at() every
/// snapshot that write() is going to get, first.
class Exports {
public:
    /// Throws BadInput where an ending is none of writers(), a folder takes no new file, there is an `every`
    /// but no path, two series would have one .pvd, or pictures are described of which there are none;
    /// Unavailable where there is no OpenGL to draw them with.
    Exports(const ExportOptions& options, int steps);
    ~Exports();
    Exports(const Exports&) = delete;
    Exports& operator=(const Exports&) = delete;

    /// The run ends after `step` steps, earlier than was said: that is where the last files are due.
    void end_at(int step) { steps_ = step; }
    /// What the latest write() wrote, without the .pvd of a series.
    const std::vector<std::filesystem::path>& written() const { return written_; }

    /// The next step after `step` after which write() is due.
    int next(int step) const;
    /// Whether there are pictures that have to look_at() a whole run before it is written.
    bool looks_ahead() const;
    void look_at(const Snapshot& snapshot);
    /// Throws std::system_error, and what Pictures throws.
    void write(const Snapshot& snapshot);

    /// Null without pictures.
    const Pictures* pictures() const { return pictures_.get(); }

private:
    struct File {
        std::filesystem::path path;
        const Writer* writer = nullptr;
        std::optional<int> every;
        std::string listed;  ///< what its .pvd has so far
    };
    static bool is_picture(const File& file) { return file.writer->contents == nullptr; }
    std::string name_in_series(const std::filesystem::path& path, std::int64_t step) const;
    bool is_due(const File& file, std::int64_t step) const;

    std::vector<File> files_;
    std::vector<std::filesystem::path> written_;
    std::unique_ptr<Pictures> pictures_;
    int steps_ = 0;
    std::size_t digits_ = 6;  ///< of a step in a series' names, at least
};

}  // namespace voxspring
