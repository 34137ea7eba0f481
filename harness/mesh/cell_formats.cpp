// Reads meshes of triangles, polygons and tetrahedra (cells) from VTK's legacy files and Gmsh's files. Nodes
// of a cell that are not its corners are left out.
#include <fmt/format.h>

#include <array>
#include <map>
#include <optional>
#include <unordered_map>

#include "harness/mesh/mesh_parser.h"
#include "harness/volume/text_header.h"

namespace voxspring {
namespace {

/// Adds a note if `others`, the number of cells that are left out, is not 0. Gmsh's points and lines of up to
/// three nodes are not counted.
void note_others(Mesh& mesh, std::size_t others) {
    if (others > 0)
        mesh.notes.push_back(
            fmt::format("{} cells that are not triangles, quadrangles or tetrahedra are left out", others));
}

// --- VTK ----------------------------------------------------------------------------------------------

double vtk_number(MeshBytes& bytes, NumberLayout layout, std::string_view type) {
    constexpr const char* what = "a number";
    if (layout == NumberLayout::text || type == "double") return bytes.number<double>(layout, what);
    if (type == "float") return double(bytes.number<float>(layout, what));
    if (type == "int") return bytes.number<std::int32_t>(layout, what);
    if (type == "unsigned_int") return bytes.number<std::uint32_t>(layout, what);
    if (type == "long" || type == "vtktypeint64" || type == "vtkIdType")
        return double(bytes.number<std::int64_t>(layout, what));
    if (type == "short") return bytes.number<std::int16_t>(layout, what);
    if (type == "char") return bytes.number<std::int8_t>(layout, what);
    if (type == "unsigned_char") return bytes.number<std::uint8_t>(layout, what);
    bytes.refuse(type,
                 "a type of VTK: double, float, int, unsigned_int, long, vtktypeint64, vtkIdType, short, "
                 "char or unsigned_char");
}

std::int64_t vtk_integer(MeshBytes& bytes, NumberLayout layout, std::string_view type) {
    return whole(bytes, vtk_number(bytes, layout, type));
}

using Cells = std::vector<std::vector<std::uint32_t>>;

class VtkReader {
public:
    explicit VtkReader(MeshBytes& bytes) : bytes_(bytes) {}

    Mesh read() {
        if (!bytes_.line().starts_with("# vtk DataFile Version"))
            bytes_.refuse("another first line", "a VTK file, which begins with # vtk DataFile Version");
        bytes_.line();  // a title
        const std::string_view layout = bytes_.word();
        if (layout != "ASCII" && layout != "BINARY") bytes_.refuse(layout, "ASCII or BINARY");
        if (layout == "BINARY") layout_ = NumberLayout::big;
        if (bytes_.word() != "DATASET") bytes_.refuse("no dataset", "DATASET");
        const std::string_view type = bytes_.word();
        if (type != "POLYDATA" && type != "UNSTRUCTURED_GRID")
            bytes_.refuse(type, "POLYDATA or UNSTRUCTURED_GRID");
        for (std::string_view key; !(key = bytes_.word()).empty();) {
            if (key == "POINT_DATA" || key == "CELL_DATA") break;  // these sections come last
            section(key);
        }
        return finish();
    }

private:
    std::uint64_t count() { return bytes_.number<std::uint64_t>(NumberLayout::text, "a count"); }

    void section(std::string_view key) {
        if (key == "POINTS") {
            const std::uint64_t points = count();
            const std::string_view type = begin_data();
            for (std::uint64_t n = 0; n < points; ++n) {
                glm::dvec3& p = mesh_.points.emplace_back();
                for (int axis = 0; axis < 3; ++axis) p[axis] = vtk_number(bytes_, layout_, type);
            }
        } else if (key == "CELLS") {
            cells_ = cells();
        } else if (key == "POLYGONS") {
            polygons_ = cells();
        } else if (key == "VERTICES" || key == "LINES" || key == "TRIANGLE_STRIPS") {
            others_ += cells().size();
        } else if (key == "CELL_TYPES") {
            const std::uint64_t types = count();
            bytes_.line();
            for (std::uint64_t n = 0; n < types; ++n) types_.push_back(vtk_integer(bytes_, layout_, "int"));
        } else if (key == "METADATA") {
            bytes_.line();
            while (bytes_.left() > 0 && !bytes_.line().empty()) {
            }
        } else if (key == "FIELD") {
            bytes_.word();
            const std::uint64_t arrays = count();
            for (std::uint64_t n = 0; n < arrays; ++n) {
                bytes_.word();
                const std::uint64_t components = count(), tuples = count();
                const std::string_view type = begin_data();
                for (std::uint64_t t = 0; t < tuples; ++t) {
                    for (std::uint64_t c = 0; c < components; ++c) (void)vtk_number(bytes_, layout_, type);
                    if (components == 0) break;
                }
            }
        } else {
            bytes_.refuse(key, "POINTS, CELLS, CELL_TYPES, POLYGONS, FIELD or METADATA");
        }
    }

    /// Reads the type at the end of a line. The data begins on the next line.
    std::string_view begin_data() {
        const std::string_view type = bytes_.word();
        bytes_.line();
        return type;
    }

    Cells cells() {
        const std::uint64_t first = count(), second = count();
        bytes_.line();
        Cells all;
        MeshBytes ahead = bytes_;
        if (ahead.word() != "OFFSETS") {
            for (std::uint64_t n = 0; n < first; ++n) {
                const std::int64_t corners = vtk_integer(bytes_, layout_, "int");
                auto& cell = all.emplace_back();
                for (std::int64_t k = 0; k < corners; ++k)
                    cell.push_back(vertex_index(vtk_integer(bytes_, layout_, "int")));
            }
            return all;
        }
        // VTK files of version 5 and later have two lists: OFFSETS says where each cell begins, and
        // CONNECTIVITY has the corners of all cells.
        bytes_ = ahead;
        const std::string_view offset_type = begin_data();
        std::vector<std::int64_t> offsets;
        for (std::uint64_t n = 0; n < first; ++n)
            offsets.push_back(vtk_integer(bytes_, layout_, offset_type));
        if (bytes_.word() != "CONNECTIVITY") bytes_.refuse("another word", "CONNECTIVITY");
        const std::string_view type = begin_data();
        std::vector<std::uint32_t> corners;
        for (std::uint64_t n = 0; n < second; ++n)
            corners.push_back(vertex_index(vtk_integer(bytes_, layout_, type)));
        for (std::size_t n = 1; n < offsets.size(); ++n) {
            if (offsets[n] < offsets[n - 1] || offsets[n] > std::int64_t(corners.size()))
                bytes_.refuse(std::to_string(offsets[n]),
                              "offsets that never descend, each at most the number of corners");
            all.emplace_back(corners.begin() + offsets[n - 1], corners.begin() + offsets[n]);
        }
        return all;
    }

    Mesh finish() {
        for (const auto& polygon : polygons_) add_polygon(mesh_, polygon);
        if (types_.size() != cells_.size())
            bytes_.refuse(fmt::format("{} types of {} cells", types_.size(), cells_.size()),
                          "one entry of CELL_TYPES per cell of CELLS");
        for (std::size_t n = 0; n < cells_.size(); ++n) {
            const std::vector<std::uint32_t>& cell = cells_[n];
            // VTK's numbers: triangle 5, polygon 7, quadrangle 9, tetrahedron 10; quadratic triangle 22,
            // quadrangle 23, tetrahedron 24.
            const std::int64_t type = types_[n];
            const std::size_t corners = type == 5 || type == 22                               ? 3
                                        : type == 9 || type == 23 || type == 10 || type == 24 ? 4
                                        : type == 7                                           ? cell.size()
                                                                                              : 0;
            if (corners == 0 || cell.size() < corners) {
                ++others_;
            } else if (type == 10 || type == 24) {
                mesh_.tetrahedra.push_back({cell[0], cell[1], cell[2], cell[3]});
            } else {
                add_polygon(mesh_, std::vector(cell.begin(), cell.begin() + std::ptrdiff_t(corners)));
            }
        }
        note_others(mesh_, others_);
        return std::move(mesh_);
    }

    MeshBytes& bytes_;
    NumberLayout layout_ = NumberLayout::text;
    Mesh mesh_;
    Cells cells_, polygons_;
    std::vector<std::int64_t> types_;
    std::size_t others_ = 0;
};

// --- Gmsh ---------------------------------------------------------------------------------------------

/// Reads Gmsh's versions 2 and 4.1, as text and binary.
class GmshReader {
public:
    explicit GmshReader(MeshBytes& bytes) : bytes_(bytes) {}

    Mesh read() {
        while (bytes_.left() > 0) {
            const std::string key = trimmed(bytes_.line());
            if (key == "$MeshFormat") {
                read_format();
            } else if (key == "$Nodes" || key == "$Elements") {
                if (!version_) bytes_.refuse(key, "$MeshFormat before it");
                if (key == "$Nodes") {
                    *version_ < 3 ? nodes_of_2() : nodes_of_4();
                } else {
                    *version_ < 3 ? elements_of_2() : elements_of_4();
                }
            }
        }
        if (!version_) bytes_.refuse("no $MeshFormat", "a file of Gmsh");
        note_others(mesh_, others_);
        return std::move(mesh_);
    }

private:
    void read_format() {
        version_ = bytes_.number<double>(NumberLayout::text, "a version");
        const int type = bytes_.number<int>(NumberLayout::text, "0 (text) or 1 (binary)");
        const int size = bytes_.number<int>(NumberLayout::text, "the bytes of a number");
        if (!((*version_ >= 2 && *version_ < 3) || *version_ == 4.1) || size != 8)
            bytes_.refuse(fmt::format("version {:g} with sizes of {} bytes", *version_, size),
                          "version 2 or 4.1 with sizes of 8 bytes, which Gmsh saves");
        bytes_.line();
        if (type == 0) return;
        layout_ = NumberLayout::little;
        MeshBytes ahead = bytes_;
        if (ahead.number<std::int32_t>(layout_, "the number 1") != 1) layout_ = NumberLayout::big;
        if (bytes_.number<std::int32_t>(layout_, "the number 1") != 1)
            bytes_.refuse("another number", "the number 1, which tells the order of bytes");
    }

    std::int32_t small() { return bytes_.number<std::int32_t>(layout_, "a whole number"); }
    std::uint64_t large() { return bytes_.number<std::uint64_t>(layout_, "a whole number from 0 on"); }
    glm::dvec3 point() {
        glm::dvec3 p;
        for (int axis = 0; axis < 3; ++axis) p[axis] = bytes_.number<double>(layout_, "a coordinate");
        return p;
    }
    std::uint64_t text_count() {
        const auto count = bytes_.number<std::uint64_t>(NumberLayout::text, "a count");
        bytes_.line();
        return count;
    }

    void add_node(std::uint64_t tag, const glm::dvec3& p) {
        index_.emplace(tag, std::uint32_t(mesh_.points.size()));
        mesh_.points.push_back(p);
    }

    void nodes_of_2() {
        const std::uint64_t count = text_count();
        for (std::uint64_t n = 0; n < count; ++n) {
            const std::int32_t tag = small();
            add_node(std::uint64_t(tag), point());
        }
    }

    void nodes_of_4() {
        const std::uint64_t blocks = large();
        for (int n = 0; n < 3; ++n) (void)large();
        std::vector<std::uint64_t> tags;
        for (std::uint64_t b = 0; b < blocks; ++b) {
            const std::int32_t dimension = small();
            (void)small();
            const bool is_parametric = small() != 0;
            const std::uint64_t count = large();
            tags.clear();
            for (std::uint64_t n = 0; n < count; ++n) tags.push_back(large());
            for (const std::uint64_t tag : tags) {
                add_node(tag, point());
                for (std::int32_t d = 0; is_parametric && d < std::min(dimension, 3); ++d)
                    (void)bytes_.number<double>(layout_, "a parameter");
            }
        }
    }

    /// The number of nodes of an element of this type.
    int nodes_of(std::int32_t type) const {
        static const std::map<int, int> nodes = {{1, 2},   {2, 3},   {3, 4},   {4, 4},   {5, 8},   {6, 6},
                                                 {7, 5},   {8, 3},   {9, 6},   {10, 9},  {11, 10}, {12, 27},
                                                 {13, 18}, {14, 14}, {15, 1},  {16, 8},  {17, 20}, {18, 15},
                                                 {19, 13}, {20, 9},  {21, 10}, {22, 12}, {23, 15}, {24, 15},
                                                 {25, 21}, {26, 4},  {27, 5},  {28, 6},  {29, 20}, {30, 35}};
        const auto found = nodes.find(type);
        if (found == nodes.end())
            bytes_.refuse(fmt::format("elements of type {}", type), "elements of Gmsh's types 1 to 30");
        return found->second;
    }

    template <class ReadTag>
    void add_element(std::int32_t type, int nodes, const ReadTag& read_tag) {
        std::array<std::uint32_t, 4> corner{};
        for (int n = 0; n < nodes; ++n) {
            const auto found = index_.find(read_tag());
            if (n < 4) corner[std::size_t(n)] = found == index_.end() ? vertex_index(-1) : found->second;
        }
        // Gmsh's numbers: triangles 2, 9 and 21, quadrangles 3, 10 and 16, tetrahedra 4, 11 and 29.
        if (type == 2 || type == 9 || type == 21) {
            mesh_.triangles.push_back({corner[0], corner[1], corner[2]});
        } else if (type == 3 || type == 10 || type == 16) {
            add_polygon(mesh_, corner);
        } else if (type == 4 || type == 11 || type == 29) {
            mesh_.tetrahedra.push_back(corner);
        } else if (nodes > 3) {
            ++others_;  // points and lines with up to three nodes need no note
        }
    }

    void elements_of_2() {
        const std::uint64_t count = text_count();
        const auto node = [&] { return std::uint64_t(small()); };
        for (std::uint64_t n = 0; n < count;) {
            // In a text file each element states its type and its number of tags. A binary file states both
            // once for several elements.
            std::uint64_t block = 1;
            if (layout_ == NumberLayout::text) (void)small();
            const std::int32_t type = small();
            if (layout_ != NumberLayout::text) block = std::uint64_t(std::max(1, small()));
            const std::int32_t tags = small();
            const int nodes = nodes_of(type);
            for (std::uint64_t b = 0; b < block; ++b, ++n) {
                if (layout_ != NumberLayout::text) (void)small();
                for (std::int32_t t = 0; t < tags; ++t) (void)small();
                add_element(type, nodes, node);
            }
        }
    }

    void elements_of_4() {
        const std::uint64_t blocks = large();
        for (int n = 0; n < 3; ++n) (void)large();
        for (std::uint64_t b = 0; b < blocks; ++b) {
            (void)small();
            (void)small();
            const std::int32_t type = small();
            const std::uint64_t count = large();
            const int nodes = nodes_of(type);
            for (std::uint64_t n = 0; n < count; ++n) {
                (void)large();
                add_element(type, nodes, [&] { return large(); });
            }
        }
    }

    MeshBytes& bytes_;
    std::optional<double> version_;
    NumberLayout layout_ = NumberLayout::text;
    std::unordered_map<std::uint64_t, std::uint32_t> index_;  ///< index of the vertex, by the node's tag
    Mesh mesh_;
    std::size_t others_ = 0;
};

}  // namespace

Mesh read_vtk(MeshBytes& bytes) { return VtkReader(bytes).read(); }
Mesh read_gmsh(MeshBytes& bytes) { return GmshReader(bytes).read(); }

}  // namespace voxspring
