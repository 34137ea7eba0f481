#include "harness/export/export.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <map>
#include <set>
#include <system_error>
#include <utility>

#include "harness/base/bad_input.h"
#include "harness/base/files.h"
#include "harness/export/pictures.h"

namespace voxspring {
namespace {

std::string escaped(const std::string& text) {
    static const std::map<char, std::string> entities = {{'&', "&amp;"}, {'<', "&lt;"}, {'"', "&quot;"}};
    std::string out;
    for (const char c : text) {
        const auto entity = entities.find(c);
        out += entity == entities.end() ? std::string(1, c) : entity->second;
    }
    return out;
}

std::string endings() {
    std::string text;
    for (const Writer& writer : writers()) text += (text.empty() ? "" : ", ") + std::string(writer.ending);
    return text;
}

const Writer& writer_of(const std::filesystem::path& path) {
    const auto& all = writers();
    const std::string name = path.filename().string();
    // The longer of two matching endings counts: "body.mesh.vtu" also ends in ".vtu". A name that is only an
    // ending does not match.
    auto found = all.end();
    for (auto writer = all.begin(); writer != all.end(); ++writer) {
        if (name.size() > writer->ending.size() && name.ends_with(writer->ending) &&
            (found == all.end() || writer->ending.size() > found->ending.size()))
            found = writer;
    }
    if (found == all.end())
        throw BadInput("command line", "--out", path.string(), "a path that ends in one of " + endings());
    return *found;
}

Colouring parse_colouring(const std::string& text) {
    if (const auto colouring = colouring_called(text)) return *colouring;
    throw BadInput("command line", "--colour", text, "displacement or error");
}

/// The next multiple of `every` beyond `step`, or `last` if that comes before it. Nothing here overflows.
int next_multiple(int step, int every, int last) {
    const int left = every - step % every;
    return left <= last - step ? step + left : last;
}

std::filesystem::path collection_of(std::filesystem::path path) { return path.replace_extension(".pvd"); }

/// The number after the last '_' of a name in a series, which is its step; -1 if there is no '_'.
long long step_in(const std::string& name) {
    const std::size_t at = name.rfind('_');
    return at == std::string::npos ? -1 : std::strtoll(name.c_str() + at + 1, nullptr, 10);
}

/// One spelling for all paths of a file: "a.csv", "./a.csv", "/home/me/a.csv" and a link to it. A path that
/// cannot be followed stays as it is; check_writable() refuses it.
std::filesystem::path in_full(const std::filesystem::path& path) {
    std::error_code error;
    const auto full = std::filesystem::weakly_canonical(std::filesystem::absolute(path), error);
    return error ? path : full;
}

}  // namespace

glm::ivec2 parse_size(const std::string& text) {
    glm::ivec2 size(0);
    int read = 0;
    if (std::sscanf(text.c_str(), "%5dx%5d%n", &size.x, &size.y, &read) != 2 ||
        std::size_t(read) != text.size() || std::min(size.x, size.y) < min_picture_side ||
        std::max(size.x, size.y) > max_picture_side) {
        throw BadInput("command line", "--size", text,
                       "WIDTHxHEIGHT in pixels, each from " + std::to_string(min_picture_side) + " to " +
                           std::to_string(max_picture_side));
    }
    return size;
}

const std::vector<Writer>& writers() {
    static const std::vector<Writer> all = {
        {".csv", "one line per particle: voxel, position, displacement, velocity", false, csv},
        {".mesh.vtu", "like .stl, for ParaView, with displacements; tetrahedra if the scene's mesh has them",
         true, mesh_vtu},
        {".npz", "numpy arrays: particles, springs, grid and time", false, npz},
        {".obj", "like .stl, as text", false, obj},
        {".ply", "like .stl, in float64", false, ply},
        {".png", "a picture of the body, drawn by OpenGL: see --colour and --size", false, nullptr},
        {".stl", "the scene's mesh, deformed; without a mesh, the surface of the voxels", false, stl},
        {".vti", "a grid for ParaView: one point per voxel", true, vti},
        {".vtu", "the body for ParaView: one point per particle where it is now, one line per spring", true,
         vtu},
    };
    return all;
}

std::string list_formats() {
    std::string text;
    for (const Writer& writer : writers())
        text += "\n" + std::string(writer.ending) + ": " + std::string(writer.description);
    return text;
}

Exports::Exports(const ExportOptions& options, int steps)
    : steps_(steps), digits_(std::max<std::size_t>(6, std::to_string(steps).size())) {
    const auto& every = options.every;
    if (every && options.out.empty() && !options.frames && !options.tool_force) {
        throw BadInput(
            "command line", "--every", std::to_string(*every),
            "--out with a path that ends in one of " + endings() + ", --frames or --tool-force as well");
    }
    std::set<std::filesystem::path> collections;
    for (const std::filesystem::path& path : options.out) {
        const Writer& writer = writer_of(path);
        check_writable(path, "--out", path.extension().string());
        if (every && writer.collected && !collections.insert(in_full(collection_of(path))).second) {
            throw BadInput("command line", "--out", path.string(),
                           "a different name for each series: " + collection_of(path).filename().string() +
                               " lists another series already");
        }
        files_.push_back({path, &writer, every, {}});
        if (options.tool_force && is_written_to(files_.back(), *options.tool_force))
            throw BadInput("command line", "--tool-force", options.tool_force->string(),
                           "another file than that of --out, which would be overwritten");
    }
    if (options.frames) {
        const std::filesystem::path path = *options.frames / "frame.png";
        std::error_code error;  // check_writable says what is wrong with the folder
        std::filesystem::create_directories(*options.frames, error);
        check_writable(path, "--frames", ".png");
        files_.push_back({path, &writer_of(path), every.value_or((steps - 1) / max_frames + 1), {}});
    }
    const bool any = std::any_of(files_.begin(), files_.end(), is_picture);
    for (const auto& [name, value] : {std::pair{"--colour", options.colour}, {"--size", options.size}}) {
        if (!any && value) {
            throw BadInput("command line", name, *value, "an --out that ends in .png, or --frames, as well");
        }
    }
    const Colouring colouring = options.colour ? parse_colouring(*options.colour) : Colouring::displacement;
    const glm::ivec2 size = options.size ? parse_size(*options.size) : default_size;
    if (any) pictures_ = std::make_unique<Pictures>(colouring, size);
}

bool Exports::is_written_to(const File& file, const std::filesystem::path& path) const {
    const std::filesystem::path asked = in_full(path), own = in_full(file.path);
    if (!file.every) return asked == own;
    const std::string name = asked.filename().string();
    const long long step = step_in(name);
    return asked.parent_path() == own.parent_path() && step > 0 && step <= steps_ && is_due(file, step) &&
           name == name_in_series(file, step);
}

Exports::~Exports() = default;

int Exports::next(int step) const {
    int next = steps_;
    for (const File& file : files_) {
        if (file.every) next = std::min(next, next_multiple(step, *file.every, steps_));
    }
    return next;
}

bool Exports::is_due(const File& file, std::int64_t step) const {
    return step == steps_ || (file.every && step % *file.every == 0);
}

bool Exports::looks_ahead() const {
    return std::any_of(files_.begin(), files_.end(),
                       [](const File& file) { return is_picture(file) && file.every; });
}

void Exports::look_at(const Snapshot& snapshot) {
    if (std::any_of(files_.begin(), files_.end(),
                    [&](const File& file) { return is_picture(file) && is_due(file, snapshot.step); })) {
        pictures_->look_at(snapshot);
    }
}

std::string Exports::name_in_series(const File& file, std::int64_t step) const {
    const std::string name = file.path.filename().string();
    const std::string_view ending = file.writer->ending;
    // All names have the same number of digits, so that they sort by step.
    return fmt::format("{}_{:0{}}{}", name.substr(0, name.size() - ending.size()), step, digits_, ending);
}

void Exports::resume_from(int step) {
    for (File& file : files_) {
        if (!file.every || !file.writer->collected) continue;
        std::ifstream collection(collection_of(file.path));
        for (std::string line; std::getline(collection, line);) {
            if (const long long of = step_in(line); of >= 0 && of <= step) file.listed += line + "\n";
        }
    }
}

void Exports::write(const Snapshot& snapshot) {
    written_.clear();
    for (File& file : files_) {
        if (!is_due(file, snapshot.step)) continue;
        const std::string contents =
            is_picture(file) ? pictures_->png(snapshot) : file.writer->contents(snapshot);
        const std::string name =
            file.every ? name_in_series(file, snapshot.step) : file.path.filename().string();
        written_.push_back(file.path.parent_path() / name);
        write_atomically(written_.back(), contents);
        if (!file.every || !file.writer->collected) continue;
        const std::string entry = fmt::format("    <DataSet timestep=\"{}\" part=\"0\" file=\"{}\"/>\n",
                                              snapshot.time, escaped(name));
        // A run that is interrupted right after a file was due writes that file again.
        if (!file.listed.ends_with(entry)) file.listed += entry;
        write_atomically(collection_of(file.path),
                         "<?xml version=\"1.0\"?>\n<VTKFile type=\"Collection\" version=\"0.1\">\n"
                         "  <Collection>\n" +
                             file.listed + "  </Collection>\n</VTKFile>\n");
    }
}

ToolForces::ToolForces(std::filesystem::path path, const Scene& scene, std::optional<int> every, int steps)
    : path_(std::move(path)), scene_(scene), every_(every.value_or(scene.tool_motion.every)), steps_(steps) {
    check_writable(path_, "--tool-force", ".csv");
    if (!scene.problem.has_tool())
        throw BadInput("command line", "--tool-force", path_.string(),
                       "a scene with a tool, whose force is recorded: " + scene.name + " has none");
}

int ToolForces::next(int step) const { return next_multiple(step, every_, steps_); }

void ToolForces::add(int step, const glm::dvec3& force) {
    if (step <= last_) return;
    last_ = step;
    const double time_step = scene_.problem.time_step;
    const glm::dvec3 at = scene_.tool_motion.at_step(step - 1, time_step);
    text_ += fmt::format("{},{},{},{},{},{},{},{}\n", step, step * time_step, at.x, at.y, at.z, force.x,
                         force.y, force.z);
}

void ToolForces::write() const { write_atomically(path_, text_); }

}  // namespace voxspring
