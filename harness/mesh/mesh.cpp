#include "harness/mesh/mesh.h"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <fstream>
#include <glm/geometric.hpp>

#include "harness/base/memory.h"
#include "harness/base/text.h"
#include "harness/mesh/mesh_parser.h"
#include "harness/volume/dataset.h"
#include "harness/volume/text_header.h"

namespace voxspring {
namespace {

struct Format {
    std::string ending;
    Mesh (*read)(MeshBytes&);
};

const std::vector<Format>& formats() {
    static const std::vector<Format> all = {
        {".stl", read_stl}, {".obj", read_obj}, {".ply", read_ply}, {".vtk", read_vtk}, {".msh", read_gmsh}};
    return all;
}

template <class Cell>
void check_indices(const Mesh& mesh, const std::vector<Cell>& cells, const char* what) {
    for (std::size_t n = 0; n < cells.size(); ++n) {
        for (const std::uint32_t index : cells[n]) {
            if (index < mesh.points.size()) continue;
            throw BadInput(mesh.file, fmt::format("{} {}", what, n + 1), "a vertex that the file lacks",
                           fmt::format("the numbers of its {} vertices", mesh.points.size()));
        }
    }
}

void check(const Mesh& mesh) {
    if (mesh.triangles.empty() && mesh.tetrahedra.empty()) {
        throw BadInput(mesh.file, "",
                       fmt::format("a mesh of {} vertices and no triangle", mesh.points.size()),
                       "triangles that enclose a body, or tetrahedra");
    }
    for (std::size_t n = 0; n < mesh.points.size(); ++n) {
        for (int axis = 0; axis < 3; ++axis) {
            const double value = mesh.points[n][axis];
            if (std::abs(value) <= max_quantity) continue;
            throw BadInput(mesh.file, fmt::format("vertex {}, {}", n + 1, "xyz"[axis]),
                           fmt::format("{:g}", value),
                           fmt::format("a number of magnitude up to {:g}", max_quantity));
        }
    }
    check_indices(mesh, mesh.triangles, "triangle");
    check_indices(mesh, mesh.tetrahedra, "tetrahedron");
}

/// The faces that belong to only one tetrahedron, counter-clockwise from outside.
std::vector<Triangle> boundary_of(const Mesh& mesh) {
    struct Face {
        Triangle key, corners;
    };
    std::vector<Face> faces;
    faces.reserve(4 * mesh.tetrahedra.size());
    const std::vector<std::uint32_t> same = welded(mesh.points);
    for (const Tetrahedron& t : mesh.tetrahedra) {
        const auto& p = mesh.points;
        const bool is_turned =
            glm::dot(glm::cross(p[t[1]] - p[t[0]], p[t[2]] - p[t[0]]), p[t[3]] - p[t[0]]) < 0;
        for (const auto& [a, b, c] : {std::array{0, 2, 1}, {0, 1, 3}, {1, 2, 3}, {0, 3, 2}}) {
            Triangle corners = {t[std::size_t(a)], t[std::size_t(b)], t[std::size_t(c)]};
            if (is_turned) std::swap(corners[1], corners[2]);
            Triangle key = {same[corners[0]], same[corners[1]], same[corners[2]]};
            std::sort(key.begin(), key.end());
            faces.push_back({key, corners});
        }
    }
    std::stable_sort(faces.begin(), faces.end(), [](const Face& a, const Face& b) { return a.key < b.key; });
    std::vector<Triangle> boundary;
    for (std::size_t n = 0; n < faces.size();) {
        std::size_t end = n + 1;
        while (end < faces.size() && faces[end].key == faces[n].key) ++end;
        if (end == n + 1) boundary.push_back(faces[n].corners);
        n = end;
    }
    return boundary;
}

}  // namespace

std::string_view MeshBytes::line() {
    const std::string_view rest = bytes_.substr(at_);
    const std::size_t end = std::min(rest.find('\n'), rest.size());
    at_ += std::min(end + 1, rest.size());
    std::string_view text = rest.substr(0, end);
    if (text.ends_with('\r')) text.remove_suffix(1);
    return text;
}

std::string_view MeshBytes::word() {
    const auto is_blank = [&](std::size_t n) {
        return bytes_[n] == ' ' || (bytes_[n] >= '\t' && bytes_[n] <= '\r');
    };
    while (at_ < bytes_.size() && is_blank(at_)) ++at_;
    const std::size_t begin = at_;
    while (at_ < bytes_.size() && !is_blank(at_)) ++at_;
    return bytes_.substr(begin, at_ - begin);
}

void MeshBytes::skip(std::size_t count) {
    if (count > left()) refuse("the end of the file", fmt::format("{} bytes more", count));
    at_ += count;
}

void MeshBytes::refuse(std::string_view value, std::string_view accepted) const {
    const auto line = 1 + std::count(bytes_.begin(), bytes_.begin() + std::ptrdiff_t(at_), '\n');
    throw BadInput(file_, fmt::format("line {}, byte {}", line, at_), value, accepted);
}

bool is_mesh_name(const std::string& name) { return format_of(name, formats()) != nullptr; }

std::string mesh_endings() { return endings_of(formats()); }

Mesh parse_mesh(std::string_view text, const std::string& file) {
    const Format* format = format_of(file, formats());
    if (format == nullptr)
        throw BadInput(file, "file name", file, "a mesh, whose name ends in " + mesh_endings());
    MeshBytes bytes(text, file);
    Mesh mesh = format->read(bytes);
    mesh.file = file;
    check(mesh);
    if (!mesh.tetrahedra.empty()) {
        if (!mesh.triangles.empty())
            mesh.notes.push_back("the boundary of the tetrahedra is the body's surface; left out: " +
                                 counted(mesh.triangles.size(), "triangle"));
        mesh.triangles = boundary_of(mesh);
    }
    if (mesh.triangles.empty())
        throw BadInput(file, "", fmt::format("{} tetrahedra without a boundary", mesh.tetrahedra.size()),
                       "tetrahedra of four different vertices, each tetrahedron once");
    return mesh;
}

Mesh read_mesh(const std::filesystem::path& path) {
    const std::string file = path.string();
    require_regular_file(path, "a mesh");
    std::ifstream stream(path, std::ios::binary);
    if (!stream) throw BadInput(file, "", "an unreadable file", "a file that can be read");
    // The data made from a file takes up to 16 times the bytes of the file.
    const std::uint64_t size = std::filesystem::file_size(path), most = memory_limit() / 16;
    if (size > most)
        throw TooLarge(file, "size", fmt::format("{} bytes", size),
                       fmt::format("at most {} bytes on this machine", most));
    std::string text(size, '\0');
    if (!stream.read(text.data(), std::streamsize(size)))
        throw BadInput(file, "", "an unreadable file", "a file that can be read");
    return parse_mesh(text, file);
}

std::vector<std::uint32_t> welded(const std::vector<glm::dvec3>& points) {
    constexpr std::uint32_t none = 0xFFFFFFFF;
    std::vector<std::uint32_t> first(points.size());
    // An open hash table of indices, at most half full.
    const std::size_t slots = std::bit_ceil(2 * points.size() + 1);
    std::vector<std::uint32_t> table(slots, none);
    for (std::size_t n = 0; n < points.size(); ++n) {
        const glm::dvec3 p = points[n] + 0.0;  // -0 becomes 0
        std::uint64_t hash = 0;
        for (int axis = 0; axis < 3; ++axis) {
            hash = (hash ^ std::bit_cast<std::uint64_t>(p[axis])) * 0x9E3779B97F4A7C15U;
            hash ^= hash >> 32;
        }
        std::size_t slot = hash & (slots - 1);
        while (table[slot] != none && points[table[slot]] != points[n]) slot = (slot + 1) & (slots - 1);
        if (table[slot] == none) table[slot] = std::uint32_t(n);
        first[n] = table[slot];
    }
    return first;
}

}  // namespace voxspring
