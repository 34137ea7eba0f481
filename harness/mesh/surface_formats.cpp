// Reads surfaces of triangles or polygons from STL, OBJ and PLY files.
#include <cmath>
#include <map>
#include <optional>
#include <set>

#include "harness/mesh/mesh_parser.h"

namespace voxspring {
namespace {

/// An STL file states three points per triangle. Equal ones become one vertex.
Mesh with_shared_points(const std::vector<glm::dvec3>& corners) {
    Mesh mesh;
    const std::vector<std::uint32_t> first = welded(corners);
    std::vector<std::uint32_t> number(corners.size());
    for (std::size_t n = 0; n < corners.size(); ++n) {
        if (first[n] == n) {
            number[n] = std::uint32_t(mesh.points.size());
            mesh.points.push_back(corners[n]);
        }
        number[n] = number[first[n]];
    }
    for (std::size_t n = 0; n + 2 < corners.size(); n += 3)
        mesh.triangles.push_back({number[n], number[n + 1], number[n + 2]});
    return mesh;
}

template <class Number>
glm::dvec3 point(MeshBytes& bytes, NumberLayout layout) {
    glm::dvec3 p;
    constexpr const char* what = "a coordinate of a vertex";
    for (int axis = 0; axis < 3; ++axis) {
        p[axis] = double(bytes.number<Number>(layout, what));
        // Since NaN does not equal itself, welded() would take quadratic time for many.
        if (std::isnan(p[axis])) bytes.refuse("nan", what);
    }
    return p;
}

/// A type of PLY's numbers: reads one as a double.
using PlyType = double (*)(MeshBytes& bytes, NumberLayout layout);

template <class Number>
double ply_number(MeshBytes& bytes, NumberLayout layout) {
    constexpr const char* what = "a number, as the header says";
    return layout == NumberLayout::text ? bytes.number<double>(layout, what)
                                        : double(bytes.number<Number>(layout, what));
}

PlyType ply_type(const MeshBytes& bytes, std::string_view name) {
    static const std::map<std::string_view, PlyType> types = {
        {"char", ply_number<std::int8_t>},     {"int8", ply_number<std::int8_t>},
        {"uchar", ply_number<std::uint8_t>},   {"uint8", ply_number<std::uint8_t>},
        {"short", ply_number<std::int16_t>},   {"int16", ply_number<std::int16_t>},
        {"ushort", ply_number<std::uint16_t>}, {"uint16", ply_number<std::uint16_t>},
        {"int", ply_number<std::int32_t>},     {"int32", ply_number<std::int32_t>},
        {"uint", ply_number<std::uint32_t>},   {"uint32", ply_number<std::uint32_t>},
        {"float", ply_number<float>},          {"float32", ply_number<float>},
        {"double", ply_number<double>},        {"float64", ply_number<double>}};
    const auto found = types.find(name);
    if (found == types.end())
        bytes.refuse(
            name, "a type of PLY: char, uchar, short, ushort, int, uint, float, double, or int8 to float64");
    return found->second;
}

struct PlyProperty {
    std::string_view name;
    PlyType type = nullptr;
    PlyType count = nullptr;  ///< type of the length of a list; null: the property is no list
};

struct PlyElement {
    std::string_view name;
    std::uint64_t count = 0;
    std::vector<PlyProperty> properties{};
};

struct PlyHeader {
    NumberLayout layout = NumberLayout::text;
    std::vector<PlyElement> elements{};
};

PlyHeader ply_header(MeshBytes& bytes) {
    PlyHeader header;
    if (bytes.line() != "ply") bytes.refuse("another first line", "a PLY file, whose first line is ply");
    for (std::string_view key; (key = bytes.word()) != "end_header";) {
        if (key == "format") {
            const std::string_view name = bytes.word();
            if (name == "binary_little_endian") {
                header.layout = NumberLayout::little;
            } else if (name == "binary_big_endian") {
                header.layout = NumberLayout::big;
            } else if (name != "ascii") {
                bytes.refuse(name, "ascii, binary_little_endian or binary_big_endian");
            }
            bytes.line();
        } else if (key == "element") {
            const std::string_view name = bytes.word();
            header.elements.push_back(
                {name, bytes.number<std::uint64_t>(NumberLayout::text, "a number of elements")});
        } else if (key == "property") {
            if (header.elements.empty()) bytes.refuse(key, "\"element\" before the first \"property\"");
            PlyProperty property;
            std::string_view type = bytes.word();
            if (type == "list") {
                property.count = ply_type(bytes, bytes.word());
                type = bytes.word();
            }
            property.type = ply_type(bytes, type);
            property.name = bytes.word();
            header.elements.back().properties.push_back(property);
        } else if (key == "comment" || key == "obj_info") {
            bytes.line();
        } else {
            bytes.refuse(key.empty() ? "the end of the file" : key,
                         "format, element, property, comment or end_header");
        }
    }
    bytes.line();
    return header;
}

}  // namespace

Mesh read_stl(MeshBytes& bytes) {
    constexpr std::size_t header = 80, each = 50;
    const std::size_t size = bytes.left();
    MeshBytes ahead = bytes;
    std::vector<glm::dvec3> corners;
    // A binary file may also begin with "solid", so the length of the file decides whether it is binary.
    const bool is_text = ahead.word() == "solid";
    std::optional<std::uint32_t> count;
    if (size >= header + 4) {
        ahead = bytes;
        ahead.skip(header);
        count = ahead.number<std::uint32_t>(NumberLayout::little, "a number of triangles");
    }
    if (count && size == header + 4 + each * std::uint64_t(*count)) {
        for (std::uint32_t n = 0; n < *count; ++n) {
            ahead.skip(3 * sizeof(float));  // the normal, which the corners give as well
            for (int corner = 0; corner < 3; ++corner)
                corners.push_back(point<float>(ahead, NumberLayout::little));
            ahead.skip(2);
        }
        return with_shared_points(corners);
    }
    if (!is_text && !count)
        bytes.refuse(std::to_string(size) + " bytes", "a text that begins with solid, or a binary STL file");
    if (!is_text)
        ahead.refuse(std::to_string(*count) + " triangles in a file of " + std::to_string(size) + " bytes",
                     "a binary STL file, of 50 bytes per triangle and 84 before them, or a text that begins "
                     "with solid");
    bytes.line();  // the name, which may be any words
    for (std::string_view word; !(word = bytes.word()).empty();) {
        if (word == "vertex") corners.push_back(point<double>(bytes, NumberLayout::text));
        if (word == "solid") bytes.line();
        if (word == "endfacet" && corners.size() % 3 != 0)
            bytes.refuse("a facet that does not have three vertices", "triangles");
    }
    if (corners.size() % 3 != 0) bytes.refuse("the end of the file", "three vertices of a facet");
    return with_shared_points(corners);
}

Mesh read_obj(MeshBytes& bytes) {
    Mesh mesh;
    std::vector<std::uint32_t> corners;
    while (bytes.left() > 0) {
        const std::string_view text = bytes.line();
        MeshBytes line(text, bytes.file());
        const std::string_view key = line.word();
        const auto number = [&]<class Number>(std::string_view word, Number& value) {
            if (!MeshBytes::parse(word, value))
                bytes.refuse(text, key == "v" ? "v and three coordinates" : "f and the indices of vertices");
        };
        if (key == "v") {
            glm::dvec3& p = mesh.points.emplace_back();
            for (int axis = 0; axis < 3; ++axis) number(line.word(), p[axis]);
        } else if (key == "f") {
            corners.clear();
            for (std::string_view word; !(word = line.word()).empty();) {
                std::int64_t index = 0;
                number(word.substr(0, word.find('/')), index);
                // Negative numbers count back from the latest vertex, which is -1.
                corners.push_back(
                    vertex_index(index < 0 ? std::int64_t(mesh.points.size()) + index : index - 1));
            }
            add_polygon(mesh, corners);
        }
    }
    return mesh;
}

Mesh read_ply(MeshBytes& bytes) {
    const PlyHeader header = ply_header(bytes);
    Mesh mesh;
    std::vector<std::uint32_t> corners;
    for (const PlyElement& element : header.elements) {
        if (element.properties.empty()) continue;  // its elements take no bytes
        const bool is_vertex = element.name == "vertex", is_face = element.name == "face";
        std::set<std::string_view> axes;
        for (const PlyProperty& property : element.properties) {
            if (property.count == nullptr && property.name.size() == 1) axes.insert(property.name);
        }
        if (is_vertex && !(axes.contains("x") && axes.contains("y") && axes.contains("z")))
            bytes.refuse("vertices without x, y and z", "the properties x, y and z of vertex");
        for (std::uint64_t n = 0; n < element.count; ++n) {
            glm::dvec3 p(0);
            for (const PlyProperty& property : element.properties) {
                if (property.count == nullptr) {
                    const double value = property.type(bytes, header.layout);
                    const std::size_t axis = std::string_view("xyz").find(property.name);
                    if (is_vertex && property.name.size() == 1 && axis < 3) p[int(axis)] = value;
                    continue;
                }
                const std::int64_t length = whole(bytes, property.count(bytes, header.layout));
                const bool is_polygon =
                    is_face && (property.name == "vertex_indices" || property.name == "vertex_index");
                corners.clear();
                for (std::int64_t k = 0; k < length; ++k) {
                    const double value = property.type(bytes, header.layout);
                    if (is_polygon) corners.push_back(vertex_index(whole(bytes, value)));
                }
                if (is_polygon) add_polygon(mesh, corners);
            }
            if (is_vertex) mesh.points.push_back(p);
        }
    }
    return mesh;
}

}  // namespace voxspring
