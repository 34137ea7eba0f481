// Reads meshes: surfaces of triangles as STL, OBJ and PLY, triangles or tetrahedra as VTK and Gmsh.
//
// Files are not trusted: no memory is allocated because of a number that a file states, every index is
// checked and every coordinate is finite. The order of the vertices is that of the file, so that the deformed
// mesh can replace the original one.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <glm/vec3.hpp>
#include <string>
#include <string_view>
#include <vector>

namespace voxspring {

using Triangle = std::array<std::uint32_t, 3>;
using Tetrahedron = std::array<std::uint32_t, 4>;

/// A mesh in the coordinates of its file, in the file's unit of length.
struct Mesh {
    std::string file{};  ///< the name in messages
    std::vector<glm::dvec3> points{};
    /// The surface. Seen from outside, its triangles are counter-clockwise if they are so in the file.
    /// Polygons are divided into fans. For a mesh of tetrahedra: the faces that belong to only one
    /// tetrahedron, facing outwards.
    std::vector<Triangle> triangles{};
    std::vector<Tetrahedron> tetrahedra{};
    std::vector<std::string> notes{};  ///< for the user, like Scene::notes
};

/// Reads a mesh; its format follows from its name. Throws BadInput.
Mesh read_mesh(const std::filesystem::path& file);
/// Reads a mesh from the bytes of `file`, whose name gives the format and appears in messages.
Mesh parse_mesh(std::string_view bytes, const std::string& file);
/// Whether read_mesh() accepts a file with this name.
bool is_mesh_name(const std::string& name);
/// The endings of the names that is_mesh_name() accepts, for messages: ".stl, .obj, ... or .msh".
std::string mesh_endings();

/// For each point the index of the first point at the same place.
std::vector<std::uint32_t> welded(const std::vector<glm::dvec3>& points);

}  // namespace voxspring
