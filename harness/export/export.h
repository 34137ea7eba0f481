// The files that `voxspring run --out` writes, alone or in series. Each format is one line in writers().
#pragma once

#include <cstdint>
#include <filesystem>
#include <glm/vec2.hpp>
#include <glm/vec3.hpp>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "harness/export/export_formats.h"

namespace voxspring {

class Pictures;

/// A file format.
struct Writer {
    std::string_view ending;  ///< ending of the file's name, with its dot
    std::string_view description;
    bool collected = false;  ///< whether a .pvd file lists the files of a series
    /// Returns the file's bytes. Null: the format is a picture, see Pictures.
    std::string (*contents)(const Snapshot&) = nullptr;
};
/// All formats, sorted by ending.
const std::vector<Writer>& writers();
/// A line for each format, for users to read.
std::string list_formats();

/// Parses the size of a picture or a window, "640x480". Throws BadInput, which names --size.
glm::ivec2 parse_size(const std::string& text);

/// The largest number of pictures in the series `frames` of a run without `every`.
inline constexpr int max_frames = 50;

/// The export options of `voxspring run`.
struct ExportOptions {
    std::vector<std::filesystem::path> out;
    /// Steps between the files of a series, and between the lines of `tool_force`; absent: only `frames` is a
    /// series.
    std::optional<int> every;
    std::optional<std::filesystem::path> frames;  ///< folder of a series of pictures, created if missing
    /// What the colours of pictures show, a Colouring; absent: displacement.
    std::optional<std::string> colour;
    /// Size of the pictures, WIDTHxHEIGHT; absent: default_size.
    std::optional<std::string> size;
    /// File of the force on the scene's tool, see ToolForces.
    std::optional<std::filesystem::path> tool_force;
};

/// Writes the states and pictures that a run was asked for. Each file is replaced atomically
/// (write_atomically), unless it is a pipe or a device.
///
/// Without `every` each path of `out` is written once, after the last step. With it a path body.vtu stands
/// for a series body_000100.vtu, body_000200.vtu, ...: a file after every `every` steps and one after the
/// last step. For ParaView's formats there is also a file body.pvd, which at any moment lists the files
/// written so far and their times. `frames` is always a series, FRAMES/frame_000100.png and so on; without
/// `every` it has at most max_frames files.
///
/// The pictures of a series share a camera and a scale. If looks_ahead(), pass to look_at() every snapshot
/// that write() will get, before the first write().
class Exports {
public:
    /// Throws BadInput if an ending is not in writers(), a folder is not writable, `every` is given without
    /// `out`, `frames` or `tool_force`, two series would share a .pvd file, `tool_force` would overwrite a
    /// file of `out`, or options of pictures are malformed or given without a picture. Throws Unavailable if
    /// there is no OpenGL to draw pictures with.
    Exports(const ExportOptions& options, int steps);
    ~Exports();
    Exports(const Exports&) = delete;
    Exports& operator=(const Exports&) = delete;

    /// Says that the run goes on from another run's state after `step` steps: a .pvd that exists keeps its
    /// entries up to that step.
    void resume_from(int step);
    /// Says that the run ends early, after `step` steps: the last files are then due after this step.
    void end_at(int step) { steps_ = step; }
    /// The files that the latest write() wrote, without the .pvd of a series.
    const std::vector<std::filesystem::path>& written() const { return written_; }

    /// The number of steps, larger than `step`, after which write() is due next.
    int next(int step) const;
    /// Whether look_at() needs all snapshots of the run before the first is written.
    bool looks_ahead() const;
    void look_at(const Snapshot& snapshot);
    /// Writes the files that are due. Throws std::system_error, and what Pictures and the formats throw.
    void write(const Snapshot& snapshot);

    /// The object that draws the pictures; null if no picture was asked for.
    const Pictures* pictures() const { return pictures_.get(); }

private:
    struct File {
        std::filesystem::path path;
        const Writer* writer = nullptr;
        std::optional<int> every;
        std::string listed;  ///< entries so far of the .pvd file of the series
    };
    /// Whether write() writes `file`, or one of its series, to `path`.
    bool is_written_to(const File& file, const std::filesystem::path& path) const;
    static bool is_picture(const File& file) { return file.writer->contents == nullptr; }
    std::string name_in_series(const File& file, std::int64_t step) const;
    bool is_due(const File& file, std::int64_t step) const;

    std::vector<File> files_;
    std::vector<std::filesystem::path> written_;
    std::unique_ptr<Pictures> pictures_;
    int steps_ = 0;
    std::size_t digits_ = 6;  ///< least number of digits of the step in names of a series
};

/// Records the force on a scene's tool during a run. The file is a CSV table: a line that names the columns,
/// then a line after every `every` steps and after the last step.
///
///     step, time                   step and time of the scene; the force is that of the step that ends then
///     x, y, z                      how far the tool had moved in that step since it took hold (a length)
///     force_x, force_y, force_z    force on the tool, see ToolFacet::tool_force() (mass times length per
///                                  time squared)
///
/// Numbers are the shortest texts that read back as the same bits.
class ToolForces {
public:
    /// `every` is the number of steps between lines; absent: the steps between two moves of the tool. The run
    /// ends after `steps` steps. Throws BadInput if the path does not end in .csv or is not writable, or if
    /// the scene has no tool. The scene must outlive this.
    ToolForces(std::filesystem::path path, const Scene& scene, std::optional<int> every, int steps);

    /// The number of steps, larger than `step`, after which the next line is due.
    int next(int step) const;
    /// Adds the line for step `step`, which is at least 1, unless the table has reached that step: a run of
    /// two passes has all lines after the first.
    void add(int step, const glm::dvec3& force);
    /// Replaces the file atomically. Throws std::system_error.
    void write() const;

    const std::filesystem::path& path() const { return path_; }

private:
    std::filesystem::path path_;
    const Scene& scene_;
    int every_;
    int steps_;
    int last_ = 0;  ///< the step of the last line
    std::string text_ = "step,time,x,y,z,force_x,force_y,force_z\n";
};

}  // namespace voxspring
