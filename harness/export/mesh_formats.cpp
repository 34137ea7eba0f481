#include <fmt/format.h>

#include <cstdint>
#include <glm/geometric.hpp>
#include <iterator>
#include <vector>

#include "harness/drawing/body_mesh.h"
#include "harness/export/export_formats.h"
#include "harness/export/vtk_file.h"
#include "harness/mesh/carried_mesh.h"

namespace voxspring {
namespace {

/// The surface of the voxels where it is now. A volume's placement, if any, applies.
CarriedMesh surface_of_voxels(const Snapshot& snapshot) {
    const BodyMesh mesh = mesh_of(snapshot.problem);
    const Placement* placement = placement_of(snapshot);
    CarriedMesh out;
    for (const BodyMesh::Vertex& vertex : mesh.vertices) {
        glm::dvec3 rest(vertex.rest), displacement(0);
        for (std::size_t n = 0; n < vertex.count; ++n)
            displacement += snapshot.state.displacement_of(mesh.particles[vertex.follows[n]]);
        displacement /= double(vertex.count);
        if (placement != nullptr) {
            rest = placement->origin + placement->to_file(rest);
            displacement = placement->to_file(displacement);
        }
        out.rest.push_back(rest);
        out.displacement.push_back(displacement);
    }
    for (const auto& [a, b, c, d] : mesh.faces) {
        out.triangles.push_back({a, b, c});
        out.triangles.push_back({a, c, d});
    }
    return out;
}

CarriedMesh surface_of(const Snapshot& snapshot) {
    return snapshot.scene.mesh
               ? carried(*snapshot.scene.mesh, snapshot.problem,
                         snapshot.state.in_full(snapshot.problem.particle_count()).displacement)
               : surface_of_voxels(snapshot);
}

std::vector<glm::dvec3> places(const CarriedMesh& mesh) {
    std::vector<glm::dvec3> places = mesh.rest;
    for (std::size_t n = 0; n < places.size(); ++n) places[n] += mesh.displacement[n];
    return places;
}

/// Adds the bytes of a number as they lie in memory (arrays.h).
template <class Number>
void append(std::string& bytes, const Number& number) {
    bytes.append(reinterpret_cast<const char*>(&number), sizeof number);
}

template <class Cell>
void add_cells(VtkFile& file, const std::vector<Cell>& cells, std::uint8_t type) {
    std::vector<std::int64_t> corners, offsets;
    for (const Cell& cell : cells) {
        corners.insert(corners.end(), cell.begin(), cell.end());
        offsets.push_back(std::int64_t(corners.size()));
    }
    file.array("connectivity", corners);
    file.array("offsets", offsets);
    file.array("types", std::vector<std::uint8_t>(cells.size(), type));
}

}  // namespace

std::string stl(const Snapshot& snapshot) {
    const CarriedMesh mesh = surface_of(snapshot);
    const std::vector<glm::dvec3> place = places(mesh);
    std::string bytes = fmt::format("{:<80.80}", fmt::format("voxspring, step {}", snapshot.step));
    append(bytes, std::uint32_t(mesh.triangles.size()));
    for (const auto& [a, b, c] : mesh.triangles) {
        const glm::dvec3 normal = glm::cross(place[b] - place[a], place[c] - place[a]);
        const double length = glm::length(normal);
        append(bytes, glm::vec3(length > 0 ? normal / length : glm::dvec3(0)));
        for (const std::uint32_t corner : {a, b, c}) append(bytes, glm::vec3(place[corner]));
        append(bytes, std::uint16_t{0});
    }
    return bytes;
}

std::string obj(const Snapshot& snapshot) {
    const CarriedMesh mesh = surface_of(snapshot);
    std::string text = fmt::format("# voxspring, step {}\n", snapshot.step);
    const auto end = std::back_inserter(text);
    for (const glm::dvec3& p : places(mesh)) fmt::format_to(end, "v {} {} {}\n", p.x, p.y, p.z);
    for (const auto& [a, b, c] : mesh.triangles) fmt::format_to(end, "f {} {} {}\n", a + 1, b + 1, c + 1);
    return text;
}

std::string ply(const Snapshot& snapshot) {
    const CarriedMesh mesh = surface_of(snapshot);
    std::string bytes = fmt::format(
        "ply\nformat binary_little_endian 1.0\ncomment voxspring, step {}\nelement vertex {}\nproperty "
        "double x\n"
        "property double y\nproperty double z\nelement face {}\nproperty list uchar uint vertex_indices\n"
        "end_header\n",
        snapshot.step, mesh.rest.size(), mesh.triangles.size());
    for (const glm::dvec3& place : places(mesh)) append(bytes, place);
    for (const Triangle& triangle : mesh.triangles) {
        bytes += '\3';
        append(bytes, triangle);
    }
    return bytes;
}

std::string mesh_vtu(const Snapshot& snapshot) {
    const CarriedMesh mesh = surface_of(snapshot);
    const bool is_solid = !mesh.tetrahedra.empty();
    VtkFile file("UnstructuredGrid");
    file.begin("UnstructuredGrid");
    add_time(file, snapshot);
    file.begin("Piece" + attribute("NumberOfPoints", mesh.rest.size()) +
               attribute("NumberOfCells", is_solid ? mesh.tetrahedra.size() : mesh.triangles.size()));
    file.begin("PointData");
    file.array("displacement", mesh.displacement);
    file.end();
    file.begin("Points");
    file.array("Points", places(mesh));
    file.end();
    file.begin("Cells");
    constexpr std::uint8_t triangle = 5, tetrahedron = 10;  // VTK's numbers
    if (is_solid) {
        add_cells(file, mesh.tetrahedra, tetrahedron);
    } else {
        add_cells(file, mesh.triangles, triangle);
    }
    for (int open = 0; open < 3; ++open) file.end();
    return file.bytes();
}

}  // namespace voxspring
