#include "harness/export.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <set>
#include <utility>

#include "harness/bad_input.h"
#include "harness/export_formats.h"
#include "harness/result.h"

namespace voxspring {
namespace {

/// The shortest text that reads back as the same bits.
template <class Number>
void append_number(std::string& text, Number number) {
    std::array<char, 32> digits{};
    const auto end = std::to_chars(digits.data(), digits.data() + digits.size(), number).ptr;
    text.append(digits.data(), end);
}

std::string csv(const Snapshot& snapshot) {
    const Problem& problem = snapshot.problem;
    const std::vector<glm::dvec3> position = positions(snapshot);
    const std::vector<glm::dvec3> velocity = velocities(snapshot);
    std::string text =
        "voxel_x,voxel_y,voxel_z,x,y,z,displacement_x,displacement_y,displacement_z,velocity_x,velocity_y,"
        "velocity_z\n";
    for (std::size_t i = 0; i < problem.particle_count(); ++i) {
        const glm::ivec3 voxel = problem.lattice.coordinates(problem.lattice.voxel[i]);
        for (int axis = 0; axis < 3; ++axis) {
            if (axis > 0) text += ',';
            append_number(text, voxel[axis]);
        }
        for (const glm::dvec3& v : {position[i], snapshot.state.displacement[i], velocity[i]}) {
            for (int axis = 0; axis < 3; ++axis) {
                text += ',';
                append_number(text, v[axis]);
            }
        }
        text += '\n';
    }
    return text;
}

std::string escaped(const std::string& text) {
    std::string out;
    for (const char c : text) {
        switch (c) {
            case '&':
                out += "&amp;";
                break;
            case '<':
                out += "&lt;";
                break;
            case '"':
                out += "&quot;";
                break;
            default:
                out += c;
        }
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
    const auto found =
        std::find_if(all.begin(), all.end(), [&](const Writer& w) { return path.extension() == w.ending; });
    if (found == all.end())
        throw BadInput("command line", "--out", path.string(), "a path that ends in one of " + endings());
    return *found;
}

std::filesystem::path collection_of(std::filesystem::path path) { return path.replace_extension(".pvd"); }

}  // namespace

std::vector<glm::dvec3> positions(const Snapshot& snapshot) {
    std::vector<glm::dvec3> position = snapshot.problem.rest_position;
    for (std::size_t i = 0; i < position.size(); ++i) position[i] += snapshot.state.displacement[i];
    return position;
}

std::vector<glm::dvec3> velocities(const Snapshot& snapshot) {
    std::vector<glm::dvec3> velocity = snapshot.state.increment;
    for (glm::dvec3& v : velocity) v /= snapshot.problem.time_step;
    return velocity;
}

const std::vector<Writer>& writers() {
    static const std::vector<Writer> all = {
        {".csv", "one line a particle: voxel, position, displacement, velocity", false, csv},
        {".npz", "numpy arrays: particles, springs, grid and time", false, npz},
        {".vti", "ParaView's grid: a point a voxel", true, vti},
        {".vtu", "ParaView's body: a point a particle where it is now, a line a spring", true, vtu},
    };
    return all;
}

std::string list_formats() {
    std::string text;
    for (const Writer& writer : writers())
        text += "\n" + std::string(writer.ending) + ": " + std::string(writer.description);
    return text;
}

Exports::Exports(const std::vector<std::filesystem::path>& out, std::optional<int> every, int steps)
    : every_(every), steps_(steps) {
    if (every && out.empty()) {
        throw BadInput("command line", "--every", std::to_string(*every),
                       "an --out beside it, which names the series: a path that ends in one of " + endings());
    }
    std::set<std::filesystem::path> collections;
    for (const std::filesystem::path& path : out) {
        const Writer& writer = writer_of(path);
        check_writable(path, "--out", std::string(writer.ending));
        if (every && writer.collected && !collections.insert(collection_of(path)).second) {
            throw BadInput("command line", "--out", path.string(),
                           "a name of its own for each series: another one has " +
                               collection_of(path).filename().string() + " already");
        }
        files_.push_back({path, &writer, {}});
    }
}

int Exports::next(int step) const { return every_ && *every_ < steps_ - step ? step + *every_ : steps_; }

std::string Exports::name_in_series(const std::filesystem::path& path, std::int64_t step) const {
    // As many digits in each name, so that they sort by step.
    const std::size_t digits = std::max<std::size_t>(6, std::to_string(steps_).size());
    std::string number = std::to_string(step);
    number.insert(0, digits - number.size(), '0');
    return path.stem().string() + "_" + number + path.extension().string();
}

void Exports::write(const Snapshot& snapshot) {
    for (File& file : files_) {
        const std::string contents = file.writer->contents(snapshot);
        if (!every_) {
            write_atomically(file.path, contents);
            continue;
        }
        const std::string name = name_in_series(file.path, snapshot.step);
        write_atomically(file.path.parent_path() / name, contents);
        if (!file.writer->collected) continue;
        file.listed += R"(    <DataSet timestep=")";
        append_number(file.listed, snapshot.time);
        file.listed += R"(" part="0" file=")" + escaped(name) + "\"/>\n";
        write_atomically(collection_of(file.path),
                         "<?xml version=\"1.0\"?>\n<VTKFile type=\"Collection\" version=\"0.1\">\n"
                         "  <Collection>\n" +
                             file.listed + "  </Collection>\n</VTKFile>\n");
    }
}

}  // namespace voxspring
