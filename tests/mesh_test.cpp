// Meshes: what is read of their files, what is inside of them, and how a body carries them.
#include "harness/mesh/mesh.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <omp.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <glm/geometric.hpp>
#include <glm/mat3x3.hpp>
#include <map>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "backends/physics/neighbours.h"
#include "harness/mesh/carried_mesh.h"
#include "harness/mesh/surface.h"
#include "harness/mesh/voxelise.h"
#include "harness/mesh/winding.h"
#include "harness/volume/volume.h"
#include "tests/surroundings.h"

namespace voxspring::testing {
namespace {

using ::testing::AllOf;
using ::testing::EndsWith;
using ::testing::HasSubstr;

constexpr SceneSizeLimits limits{1 << 24, 1 << 24};

// --- Meshes whose volume is known, and bytes of files -----------------------------------------------------

/// The box from 0 to `size`, of twelve triangles. Vertex n is at the corner whose bits are n, x lowest.
Mesh box_mesh(const glm::dvec3& size = glm::dvec3(1), const glm::dvec3& at = glm::dvec3(0)) {
    Mesh mesh{.file = "box.obj"};
    for (int n = 0; n < 8; ++n) mesh.points.push_back(at + size * glm::dvec3(n & 1, n >> 1 & 1, n >> 2));
    for (const auto& [a, b, c, d] : {std::array<std::uint32_t, 4>{0, 2, 3, 1},
                                     {4, 5, 7, 6},
                                     {0, 1, 5, 4},
                                     {2, 6, 7, 3},
                                     {0, 4, 6, 2},
                                     {1, 3, 7, 5}}) {
        mesh.triangles.push_back({a, b, c});
        mesh.triangles.push_back({a, c, d});
    }
    return mesh;
}

/// A mesh whose triangles are each cut into four, `times` times. `move` gives each new vertex its place.
Mesh divided(Mesh mesh, int times, const std::function<glm::dvec3(glm::dvec3)>& move = {}) {
    for (; times > 0; --times) {
        std::map<std::pair<std::uint32_t, std::uint32_t>, std::uint32_t> middle;
        const auto between = [&](std::uint32_t a, std::uint32_t b) {
            const auto [found, is_new] = middle.try_emplace(std::minmax(a, b), mesh.points.size());
            if (is_new) mesh.points.push_back((mesh.points[a] + mesh.points[b]) / 2.0);
            return found->second;
        };
        std::vector<Triangle> all;
        for (const auto& [a, b, c] : mesh.triangles) {
            const std::uint32_t ab = between(a, b), bc = between(b, c), ca = between(c, a);
            for (const Triangle& t : {Triangle{a, ab, ca}, {b, bc, ab}, {c, ca, bc}, {ab, bc, ca}})
                all.push_back(t);
        }
        mesh.triangles = std::move(all);
    }
    if (move) {
        for (glm::dvec3& p : mesh.points) p = move(p);
    }
    return mesh;
}

/// A polyhedron of 12 * 4^times triangles in a ball of radius 1 around the origin, made of a box.
Mesh ball_mesh(int times) {
    return divided(box_mesh(glm::dvec3(2), glm::dvec3(-1)), times,
                   [](const glm::dvec3& p) { return glm::normalize(p); });
}

void append(Mesh& mesh, const Mesh& other) {
    const auto first = std::uint32_t(mesh.points.size());
    mesh.points.insert(mesh.points.end(), other.points.begin(), other.points.end());
    for (const auto& [a, b, c] : other.triangles) mesh.triangles.push_back({a + first, b + first, c + first});
}

void turn_over(Mesh& mesh) {
    for (Triangle& triangle : mesh.triangles) std::swap(triangle[1], triangle[2]);
}

/// By the divergence theorem, exact for a closed mesh.
double volume_of(const Mesh& mesh) {
    double volume = 0;
    for (const auto& [a, b, c] : mesh.triangles)
        volume += glm::dot(mesh.points[a], glm::cross(mesh.points[b], mesh.points[c])) / 6;
    return volume;
}

template <class Number>
void put(std::string& bytes, Number number, bool big_endian = false) {
    auto* first = reinterpret_cast<char*>(&number);
    if (big_endian) std::reverse(first, first + sizeof number);
    bytes.append(first, sizeof number);
}

// --- Files --------------------------------------------------------------------------------------------

std::string line_of(const glm::dvec3& p) { return fmt::format("{:f} {:f} {:f}\n", p.x, p.y, p.z); }

/// Adds numbers to a file, as text or as bytes.
struct Numbers {
    std::string& file;
    bool as_text, big;

    void operator()(auto... numbers) const {
        const auto add = [&](auto number) {
            if (as_text) {
                file += std::to_string(number) + " ";
            } else {
                put(file, number, big);
            }
        };
        (add(numbers), ...);
    }
};

std::string ascii_stl(const Mesh& mesh) {
    std::string text = "solid vertex of a facet\n";
    for (const Triangle& triangle : mesh.triangles) {
        text += "facet normal 0 0 0\nouter loop\n";
        for (const std::uint32_t c : triangle) text += "vertex " + line_of(mesh.points[c]);
        text += "endloop\nendfacet\n";
    }
    return text + "endsolid\n";
}

/// Its header begins like a text, as some programs write it.
std::string binary_stl(const Mesh& mesh) {
    std::string bytes = "solid box" + std::string(71, ' ');
    put(bytes, std::uint32_t(mesh.triangles.size()));
    for (const Triangle& triangle : mesh.triangles) {
        bytes += std::string(12, '\0');
        for (const std::uint32_t c : triangle) {
            for (int axis = 0; axis < 3; ++axis) put(bytes, float(mesh.points[c][axis]));
        }
        bytes += std::string(2, '\0');
    }
    return bytes;
}

std::string ply_file(const Mesh& mesh, const std::string& layout) {
    std::string bytes = fmt::format(
        "ply\nformat {} 1.0\ncomment end of a header\nelement vertex {}\nproperty uchar quality\n"
        "property double z\nproperty float y\nproperty float x\nelement face {}\n"
        "property list uchar float texcoord\nproperty list uchar short vertex_index\nend_header\n",
        layout, mesh.points.size(), mesh.triangles.size());
    const Numbers add{bytes, layout == "ascii", layout == "binary_big_endian"};
    for (const glm::dvec3& p : mesh.points) add(std::uint8_t{7}, p.z, float(p.y), float(p.x));
    for (const auto& [a, b, c] : mesh.triangles)
        add(std::uint8_t{1}, 0.5F, std::uint8_t{3}, std::int16_t(a), std::int16_t(b), std::int16_t(c));
    return bytes;
}

/// The box by quadrangles; numbers from the end, and with textures and normals.
constexpr const char* obj_file =
    "# a box\no box\nv 0 0 0\nv 1 0 0\nv 0 1 0 0.5 0.5 0.5\nv 1 1 0\nv 0 0 1\nv +1 0 1\nv 0 1 1\r\nv 1 1 "
    "1.0e0\n"
    "vt 0 0\nvn 0 0 1\ns off\nf 1 3 4 2\nf 5/1 6/1 8/1 7/1\nf 1//1 2//1 6//1 5//1\nf -6/1/1 -2/1/1 -1/1/1 "
    "-5/1/1\n"
    "f 1 5 7 3\nf 2 4 8 6\n";

/// The box as six tetrahedra around its diagonal, some of them turned over.
const std::vector<Tetrahedron> tetrahedra_of_box = {{0, 1, 3, 7}, {0, 3, 2, 7}, {0, 2, 6, 7},
                                                    {0, 6, 4, 7}, {0, 4, 5, 7}, {0, 1, 5, 7}};

/// A line for each tetrahedron: its number, or what all of them begin with, and its corners, counted from 1.
std::string cells_as_text(bool numbered) {
    std::string text;
    for (int number = 1; const auto& [a, b, c, d] : tetrahedra_of_box)
        text += fmt::format("{} {} {} {} {}\n", numbered ? std::to_string(number++) : "9 4 2 0 1", a + 1,
                            b + 1, c + 1, d + 1);
    return text;
}

std::string points_as_text(bool numbered) {
    std::string text;
    for (int number = 1; const glm::dvec3& p : box_mesh().points)
        text += (numbered ? fmt::format("{} ", number++) : "") + line_of(p);
    return text;
}

std::string vtk_file(bool binary) {
    std::string file = std::string("# vtk DataFile Version 4.2\na box\n") + (binary ? "BINARY" : "ASCII") +
                       "\nDATASET UNSTRUCTURED_GRID\nFIELD FieldData 1\nTimeValue 1 1 double\n";
    const Numbers add{file, !binary, true};
    add(0.5);
    file += "\nPOINTS 8 float\n";
    for (const glm::dvec3& p : box_mesh().points) add(float(p.x), float(p.y), float(p.z));
    file += "\nMETADATA\nINFORMATION 0\n\nCELLS 7 33\n";
    add(2, 0, 1);  // a line
    for (const auto& [a, b, c, d] : tetrahedra_of_box) add(4, int(a), int(b), int(c), int(d));
    file += "\nCELL_TYPES 7\n";
    add(3, 10, 10, 10, 10, 10, 10);
    return file + "\nCELL_DATA 7\nSCALARS x int\n";
}

std::string vtk_5_file() {
    return "# vtk DataFile Version 5.1\na box\nASCII\nDATASET POLYDATA\nPOINTS 8 double\n" +
           points_as_text(false) +
           "POLYGONS 7 24\nOFFSETS vtktypeint64\n0 4 8 12 16 20 24\n"
           "CONNECTIVITY vtktypeint64\n0 2 3 1 4 5 7 6 0 1 5 4 2 6 7 3 0 4 6 2 1 3 7 5\n";
}

std::string gmsh_2_file(bool binary) {
    std::string file = std::string("$MeshFormat\n2.2 ") + (binary ? "1" : "0") + " 8\n";
    if (!binary) {
        return file + "$EndMeshFormat\n$Nodes\n8\n" + points_as_text(true) +
               "$EndNodes\n$Elements\n8\n1 15 2 0 1 1\n2 2 2 0 1 1 2 3\n" + cells_as_text(false) +
               "$EndElements\n";
    }
    const Numbers add{file, false, false};
    add(1);
    file += "\n$EndMeshFormat\n$Nodes\n8\n";
    for (int number = 1; const glm::dvec3& p : box_mesh().points) add(number++, p.x, p.y, p.z);
    file += "\n$EndNodes\n$Elements\n6\n";
    add(4, 6, 2);
    for (const auto& [a, b, c, d] : tetrahedra_of_box)
        add(9, 0, 1, int(a + 1), int(b + 1), int(c + 1), int(d + 1));
    return file + "\n$EndElements\n";
}

std::string gmsh_4_file() {
    return "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$Entities\n1 0 0 0\n$EndEntities\n$Nodes\n1 8 1 8\n3 1 0 "
           "8\n"
           "1\n2\n3\n4\n5\n6\n7\n8\n" +
           points_as_text(false) + "$EndNodes\n$Elements\n2 7 1 7\n2 1 2 1\n1 1 2 3\n3 1 4 6\n" +
           cells_as_text(true) + "$EndElements\n";
}

struct File {
    std::string name, bytes;
};

std::vector<File> files_of_a_box() {
    return {{"text.stl", ascii_stl(box_mesh())},
            {"binary.STL", binary_stl(box_mesh())},
            {"quads.obj", obj_file},
            {"text.ply", ply_file(box_mesh(), "ascii")},
            {"little.ply", ply_file(box_mesh(), "binary_little_endian")},
            {"big.ply", ply_file(box_mesh(), "binary_big_endian")},
            {"text.vtk", vtk_file(false)},
            {"binary.vtk", vtk_file(true)},
            {"polygons.vtk", vtk_5_file()},
            {"text2.msh", gmsh_2_file(false)},
            {"binary2.msh", gmsh_2_file(true)},
            {"text4.msh", gmsh_4_file()}};
}

TEST(MeshFile, OfABoxIsABoxInEveryFormat) {
    for (const File& file : files_of_a_box()) {
        SCOPED_TRACE(file.name);
        const Mesh mesh = parse_mesh(file.bytes, file.name);
        EXPECT_EQ(mesh.triangles.size(), 12);
        ASSERT_EQ(mesh.points.size(), 8);
        // In an STL file the first use of a vertex makes its number.
        if (!file.name.ends_with(".stl") && !file.name.ends_with(".STL")) {
            EXPECT_EQ(mesh.points, box_mesh().points);
        }
        EXPECT_DOUBLE_EQ(volume_of(mesh), 1);
        const bool is_solid =
            file.name.ends_with(".msh") || file.name == "text.vtk" || file.name == "binary.vtk";
        EXPECT_EQ(mesh.tetrahedra.size(), is_solid ? 6 : 0);
        // These two files have a triangle beside their tetrahedra.
        const bool is_mixed = file.name == "text2.msh" || file.name == "text4.msh";
        const bool is_told = std::count(mesh.notes.begin(), mesh.notes.end(),
                                        "the boundary of the tetrahedra is the body's surface; left out: "
                                        "1 triangle") == 1;
        EXPECT_EQ(is_told, is_mixed);
    }
}

TEST(MeshFile, CutShortAtAnyByteIsRefusedOrWhole) {
    for (const File& file : files_of_a_box()) {
        SCOPED_TRACE(file.name);
        for (std::size_t size = 0; size < file.bytes.size(); ++size) {
            (void)refusal([&] { (void)parse_mesh(std::string_view(file.bytes).substr(0, size), file.name); });
        }
    }
}

TEST(MeshFile, ThatCannotBeReadIsRefusedInASentence) {
    const struct {
        const char *name, *text, *part;
    } cases[] = {
        {"none.obj", "", "0 vertices and no triangle"},
        {"points.obj", "v 0 0 0\nv 1 0 0\n", "2 vertices and no triangle"},
        {"nan.obj", "v 0 0 0\nv 1 nan 0\nv 0 1 0\nf 1 2 3\n", "vertex 2, y: nan"},
        {"large.obj", "v 0 0 0\nv 1 1e300 0\nv 0 1 0\nf 1 2 3\n", "vertex 2, y: 1e+300"},
        {"index.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4\n", "triangle 1: a vertex that the file lacks"},
        {"zero.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 0 1 2\n", "triangle 1: a vertex that the file lacks"},
        {"before.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf -4 1 2\n", "triangle 1: a vertex that the file lacks"},
        {"word.obj", "v 0 0 zero\n", "v 0 0 zero"},
        {"open.stl", "solid\nfacet\nvertex 0 0 0\nvertex 1 0 0\n", "three vertices of a facet"},
        {"short.stl", "binary", "a binary STL file"},
        {"nan.stl", "solid\nfacet\nvertex 0 0 nan\n", "line 3, byte 26: nan"},
        {"length.ply",
         "ply\nformat ascii 1.0\nelement face 1\nproperty list float int vertex_indices\nend_header\n"
         "-1 0 1 2\n",
         "-1 is not accepted; expected a whole number from 0 on"},
        {"half.ply",
         "ply\nformat ascii 1.0\nelement face 1\nproperty list uchar float vertex_indices\nend_header\n"
         "3 0 1.5 2\n",
         "1.5 is not accepted; expected a whole number from 0 on"},
        {"count.ply",
         "ply\nformat ascii 1.0\nelement vertex 4000000000\nproperty float x\nproperty float y\n"
         "property float z\nend_header\n0 0 0\n",
         "the end of the file"},
        {"axis.ply", "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nend_header\n0\n",
         "x, y and z"},
        {"type.ply", "ply\nformat ascii 1.0\nelement vertex 1\nproperty half x\nend_header\n0\n", "half"},
        {"grid.vtk", "# vtk DataFile Version 3.0\n\nASCII\nDATASET STRUCTURED_POINTS\n", "STRUCTURED_POINTS"},
        {"old.msh", "$MeshFormat\n1 0 8\n", "version 2 or 4.1"},
        {"node.msh",
         "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n1\n1 0 0 0\n$EndNodes\n$Elements\n1\n"
         "1 4 0 1 1 1 5\n$EndElements\n",
         "tetrahedron 1: a vertex that the file lacks"},
        {"flat.msh",
         "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n1\n1 0 0 0\n$EndNodes\n$Elements\n1\n"
         "1 4 0 1 1 1 1\n$EndElements\n",
         "1 tetrahedra without a boundary"},
    };
    for (const auto& [name, text, part] : cases) {
        SCOPED_TRACE(name);
        EXPECT_THAT(refusal([&, &of = text, &called = name] { (void)parse_mesh(of, called); }),
                    AllOf(HasSubstr(part), HasSubstr(name)));
    }
}

// --- Inside and outside -------------------------------------------------------------------------------

TEST(WindingTree, IsCloseToTheSumOfSolidAngles) {
    // A soup: triangles without neighbours, half of them turned over, some large.
    std::mt19937 generator(5);
    std::uniform_real_distribution<double> uniform(-1, 1);
    const auto vector = [&] {
        return glm::dvec3(uniform(generator), uniform(generator), uniform(generator));
    };
    std::vector<Corners> soup;
    for (int n = 0; n < 3000; ++n) {
        const glm::dvec3 at = vector();
        const double size = n % 50 == 0 ? 0.5 : 0.05;
        soup.push_back({at, at + size * vector(), at + size * vector()});
    }
    for (const Mesh& mesh : {ball_mesh(4)}) {
        for (const auto& [a, b, c] : mesh.triangles)
            soup.push_back({mesh.points[a], mesh.points[b], mesh.points[c]});
    }
    const WindingTree tree(soup);
    double largest = 0;
    for (int n = 0; n < 500; ++n) {
        const glm::dvec3 point = 1.5 * vector();
        double sum = 0;
        for (const Corners& triangle : soup) sum += winding_of(triangle, point);
        largest = std::max(largest, std::abs(tree.at(point) - sum));
    }
    EXPECT_LT(largest, 0.02);
    EXPECT_GT(largest, 1e-6);  // it does approximate
}

TEST(Surface, CountsWhatItMeets) {
    Mesh mesh = box_mesh();
    mesh.triangles.pop_back();
    append(mesh, box_mesh(glm::dvec3(1), {3, 0, 0}));
    mesh.triangles.push_back({0, 1, 1});
    append(mesh, {.points = {{0, 0, 0}, {1, 0, 0}, {0.5, -1, 0}}, .triangles = {{0, 1, 2}}});  // a fin
    const MeshFacts facts = surface_of(mesh).facts;
    EXPECT_EQ(facts.vertices, 17);
    EXPECT_EQ(facts.triangles, 25);
    EXPECT_EQ(facts.parts, 2);
    EXPECT_EQ(facts.flat, 1);
    EXPECT_EQ(facts.non_manifold_edges, 1);
    EXPECT_EQ(facts.open_edges, 3 + 2);
    EXPECT_EQ(facts.high, glm::dvec3(4, 1, 1));
}

TEST(Surface, WithCapsIsClosed) {
    std::mt19937 generator(3);
    Mesh mesh = ball_mesh(3);
    std::shuffle(mesh.triangles.begin(), mesh.triangles.end(), generator);
    mesh.triangles.resize(mesh.triangles.size() / 2);
    const Surface surface = surface_of(mesh);
    std::map<std::pair<std::uint32_t, std::uint32_t>, int> net;
    for (const auto* triangles : {&surface.triangles, &surface.caps}) {
        for (const Triangle& t : *triangles) {
            for (std::size_t k = 0; k < 3; ++k) {
                const std::uint32_t a = t[k], b = t[(k + 1) % 3];
                net[std::minmax(a, b)] += a < b ? 1 : -1;
            }
        }
    }
    for (const auto& [edge, count] : net) EXPECT_EQ(count, 0);
}

double body_volume(const Mesh& mesh, double pitch = 0.05) {
    return voxelise(mesh, pitch, default_fill, limits).source.body_volume;
}

TEST(Voxels, MeasureTheShareOfABoxExactly) {
    // Its faces along x lie within voxels.
    const Voxelised box = voxelise(box_mesh({2.2, 1, 1}), 0.25, default_fill, limits);
    EXPECT_EQ(box.grid.dims, glm::ivec3(9, 4, 4));
    EXPECT_NEAR(box.source.volume, 2.2, 1e-6);  // float32 shares
    EXPECT_NEAR(box.source.facts.volume, 2.2, 1e-12);
    // The outermost voxels along x are 0.9 full.
    EXPECT_NEAR(box.source.body_volume, 9 * 0.25, 1e-12);
    EXPECT_NEAR(voxelise(box_mesh({2.2, 1, 1}), 0.25, 0.91, limits).source.body_volume, 7 * 0.25, 1e-12);
    EXPECT_NEAR(box.source.origin.x, 1.1 - 4 * 0.25, 1e-12);
}

TEST(Voxels, OfABallHaveItsVolumeHoweverItIsTriangulated) {
    const double exact = 4 * std::numbers::pi / 3;
    const Mesh ball = ball_mesh(5);
    EXPECT_NEAR(body_volume(ball), exact, 0.01 * exact);
    Mesh inverted = ball;
    turn_over(inverted);
    EXPECT_EQ(body_volume(inverted), body_volume(ball));

    Mesh flipped = ball;  // a patch of it is turned over
    for (std::size_t n = 0; n < flipped.triangles.size() / 3; ++n)
        std::swap(flipped.triangles[n][0], flipped.triangles[n][1]);
    EXPECT_EQ(body_volume(flipped), body_volume(ball));

    Mesh stitched = ball;  // a patch of it shares no vertex, lies elsewhere by little, and is turned over
    const auto is_in_patch = [&](const Triangle& t) { return stitched.points[t[0]].z > 0.8; };
    Mesh patch{.points = stitched.points, .triangles = {}};
    for (glm::dvec3& p : patch.points) p *= 1.001;
    std::copy_if(stitched.triangles.begin(), stitched.triangles.end(), std::back_inserter(patch.triangles),
                 is_in_patch);
    std::erase_if(stitched.triangles, is_in_patch);
    turn_over(patch);
    append(stitched, patch);
    EXPECT_NEAR(body_volume(stitched), exact, 0.01 * exact);

    Mesh doubled = ball;  // two balls that overlap: each point counts once
    append(doubled, ball);
    for (std::size_t n = ball.points.size(); n < doubled.points.size(); ++n) doubled.points[n].x += 1;
    const double lens = std::numbers::pi * (4 + 1) * (2 - 1) * (2 - 1) / 12;
    EXPECT_NEAR(body_volume(doubled), 2 * exact - lens, 0.01 * exact);

    for (const bool is_inverted : {false, true}) {
        Mesh hollow = ball, cavity = ball;
        for (glm::dvec3& p : cavity.points) p /= 2.0;
        turn_over(cavity);
        append(hollow, cavity);
        if (is_inverted) turn_over(hollow);
        EXPECT_NEAR(body_volume(hollow), exact * 7 / 8, 0.01 * exact) << is_inverted;
    }
}

TEST(Voxels, OfAnOpenBallAreClosedByAFilm) {
    const double exact = 4 * std::numbers::pi / 3;
    Mesh open = ball_mesh(5);
    // Nine holes, of a tenth of the radius to a quarter.
    std::erase_if(open.triangles, [&](const Triangle& t) {
        const glm::dvec3& p = open.points[t[0]];
        for (int n = 0; n < 9; ++n) {
            const glm::dvec3 hole =
                glm::normalize(glm::dvec3(std::cos(2.4 * n), std::sin(2.4 * n), n / 4.0 - 1));
            if (glm::distance(p, hole) < 0.1 + 0.02 * n) return true;
        }
        return false;
    });
    const Voxelised body = voxelise(open, 0.05, default_fill, limits);
    EXPECT_EQ(body.source.facts.holes, 9);
    EXPECT_NEAR(body.source.volume, exact, 0.01 * exact);
    EXPECT_NEAR(body.source.body_volume, exact, 0.01 * exact);
    // Where the caps' winding number matters, lines and a sum of all solid angles agree.
    const Mesh half = [] {
        Mesh mesh = ball_mesh(3);
        std::erase_if(mesh.triangles, [&](const Triangle& t) {
            return mesh.points[t[0]].x + mesh.points[t[1]].x + 0.5 * std::sin(9 * mesh.points[t[2]].y) > 0;
        });
        return mesh;
    }();
    const Voxelised bowl = voxelise(half, 0.1, default_fill, limits);
    std::size_t differ = 0, active = 0;
    for (std::size_t n = 0; n < bowl.grid.label.size(); ++n) {
        const glm::ivec3 dims = bowl.grid.dims;
        const glm::dvec3 at(int(n) % dims.x, int(n) / dims.x % dims.y, int(n) / (dims.x * dims.y));
        double winding = 0;
        for (const auto& [a, b, c] : half.triangles)
            winding +=
                winding_of({half.points[a], half.points[b], half.points[c]}, bowl.source.origin + 0.1 * at);
        active += bowl.grid.label[n];
        differ += (winding > 0.5) != (bowl.grid.label[n] == 1);
    }
    // The centre of a voxel that is cut in two halves may lie on either side.
    EXPECT_LT(differ, active / 30);
}

TEST(Voxels, AreTheSameWithOneThread) {
    Mesh open = ball_mesh(4);
    open.triangles.resize(open.triangles.size() * 3 / 4);
    const Voxelised parallel = voxelise(open, 0.07, default_fill, limits);
    const int threads = omp_get_max_threads();
    omp_set_num_threads(1);
    const Voxelised serial = voxelise(open, 0.07, default_fill, limits);
    omp_set_num_threads(threads);
    EXPECT_EQ(parallel.grid.label, serial.grid.label);
    EXPECT_EQ(parallel.source.volume, serial.source.volume);
}

TEST(Voxels, NobodyCanMakeAreRefusedWithASuggestion) {
    const auto refusal = [](const Mesh& mesh, std::optional<double> pitch) {
        return testing::refusal([&] { (void)voxelise(mesh, pitch, default_fill, limits); });
    };
    const Mesh box = box_mesh(glm::dvec3(100));
    EXPECT_THAT(refusal(box, 1000), HasSubstr("about 1.6: the mesh is 100 x 100 x 100"));
    EXPECT_THAT(refusal(box, 0.1), HasSubstr("about 1.6: the mesh is 100 x 100 x 100"));
    EXPECT_THAT(refusal(box, 1e-9), HasSubstr("about 1.6"));
    EXPECT_EQ(refusal(box, std::nullopt), "accepted");
    EXPECT_THAT(refusal(box_mesh(glm::dvec3(1e-20)), std::nullopt),
                AllOf(HasSubstr("a mesh of 1e-20 x 1e-20 x 1e-20"), HasSubstr("a smaller unit of length")));
    EXPECT_THAT(refusal(box, 0.1), EndsWith("and at most 16777216 voxels fit here"));
    // A wire has few voxels, but too many along x. The pitch for its thinnest side would give even more.
    EXPECT_EQ(
        refusal(box_mesh({2e6, 1, 1}), 1),
        "box.obj: --pitch: 1, a grid of 2e+06 x 1 x 1 is not accepted; expected about 3.1e+04: the mesh "
        "is 2e+06 x 1 x 1 in its file's unit of length, and a grid has at most 1048576 voxels along "
        "each axis");
    const Mesh sheet{
        .file = "sheet.stl", .points = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}, .triangles = {{0, 1, 2}}};
    EXPECT_THAT(refusal(sheet, std::nullopt), HasSubstr("enclose nothing"));
    Mesh folded{
        .file = "folded.stl", .points = {{0, 0, 0}, {0, 1, 0}, {0, 0, 1}, {1, 1, 1}}, .triangles = {}};
    folded.triangles.assign(100'000, {0, 1, 2});
    folded.triangles.push_back({0, 1, 3});
    EXPECT_THAT(refusal(folded, 1e-3 * 4), HasSubstr("cross the mesh too often"));
}

// --- Another pitch for voxels -------------------------------------------------------------------------

TEST(Resampling, KeepsWhatFillsMostOfAVoxel) {
    LabelledGrid labelled{{{4, 2, 2}, glm::dvec3(1), {1, 1, 2, 0, 1, 0, 2, 0, 2, 2, 0, 0, 1, 2, 0, 0}},
                          {numbered_label(5), numbered_label(6)}};
    LabelledGrid same = labelled;
    EXPECT_EQ(resample(same, 1, 0.5, "x.nrrd", limits), glm::dvec3(0));
    EXPECT_EQ(same.grid.label, labelled.grid.label);

    LabelledGrid coarse = labelled;
    EXPECT_EQ(resample(coarse, 2, 0.5, "x.nrrd", limits), glm::dvec3(0.5));
    // Four of seven voxels on the left are of the first label; on the right two of eight are active.
    EXPECT_EQ(coarse.grid.label, std::vector<std::uint8_t>({1, 0}));
    coarse = labelled;
    resample(coarse, 2, 0.25, "x.nrrd", limits);
    EXPECT_EQ(coarse.grid.label, std::vector<std::uint8_t>({1, 2}));

    LabelledGrid flat{{{3, 3, 1}, {1, 1, 2}, std::vector<std::uint8_t>(9, 1)}, {numbered_label(1)}};
    EXPECT_EQ(resample(flat, 0.5, 0.5, "x.nrrd", limits), glm::dvec3(-0.25, -0.25, -0.75));
    EXPECT_EQ(flat.grid.dims, glm::ivec3(6, 6, 4));
    EXPECT_EQ(std::count(flat.grid.label.begin(), flat.grid.label.end(), 1), 144);

    // A pitch that divides nothing: the body of 3 lies in the middle of two voxels of 2, each 3/4 full.
    LabelledGrid odd{{{3, 1, 1}, {1, 2, 2}, {1, 1, 1}}, {numbered_label(1)}};
    EXPECT_EQ(resample(odd, 2, 0.75, "x.nrrd", limits), glm::dvec3(0, 0, 0));
    EXPECT_EQ(odd.grid.label, std::vector<std::uint8_t>({1, 1}));
    LabelledGrid empty{{{3, 1, 1}, {1, 2, 2}, {1, 1, 1}}, {numbered_label(1)}};
    EXPECT_THROW(resample(empty, 2, 0.76, "x.nrrd", limits), BadInput);
    EXPECT_THROW(resample(labelled, 1e-5, 0.5, "x.nrrd", limits), TooLarge);
}

TEST(Resampling, SaysWhichLimitAGridExceeds) {
    LabelledGrid wire{{{4, 1, 1}, {1, 1e-6, 1e-6}, {1, 1, 1, 1}}, {numbered_label(1)}};
    EXPECT_EQ(
        refusal([&] { resample(wire, 2e-6, 0.5, "x.nrrd", limits); }),
        "x.nrrd: --pitch: 2e-06, a grid of 2e+06 x 1 x 1 is not accepted; expected a larger one: the "
        "volume is 4 x 1e-06 x 1e-06 in its unit of length, and a grid has at most 1048576 voxels along "
        "each axis");
    LabelledGrid block{{{4, 1, 1}, glm::dvec3(1), {1, 1, 1, 1}}, {numbered_label(1)}};
    EXPECT_THAT(refusal([&] { resample(block, 1e-3, 0.5, "x.nrrd", limits); }),
                EndsWith("and at most 16777216 voxels fit here"));
}

// --- Meshes that a body carries -----------------------------------------------------------------------

struct Body {
    MeshInGrid source;
    Problem problem;
};

Body body_of(const Mesh& mesh, double pitch) {
    Voxelised voxelised = voxelise(mesh, pitch, default_fill, limits);
    return {std::move(voxelised.source), make_lattice_problem(voxelised.grid, FACE_BITS | EDGE_BITS)};
}

/// Where a particle is in the mesh's coordinates.
glm::dvec3 place(const Body& body, std::size_t i) {
    return body.source.origin + body.problem.rest_position[i];
}

TEST(CarriedMesh, FollowsAnAffineMotionToRounding) {
    const glm::dmat3 gradient(0.1, 0.2, -0.3, 0.05, -0.1, 0.4, 0.3, 0.1, 0.2);
    const auto moved = [&](const glm::dvec3& p) { return glm::dvec3(1, 2, 3) + gradient * p; };
    for (const double pitch : {0.1, 0.23, 0.4}) {
        const Body body = body_of(ball_mesh(4), pitch);
        std::vector<glm::dvec3> displacement;
        std::vector<double> value;
        for (std::size_t i = 0; i < body.problem.particle_count(); ++i) {
            displacement.push_back(moved(place(body, i)));
            value.push_back(displacement.back().y);
        }
        const CarriedMesh mesh = carried(body.source, body.problem, displacement, value);
        EXPECT_EQ(mesh.triangles, body.source.mesh.triangles);
        EXPECT_EQ(mesh.copies, 0);
        for (std::size_t v = 0; v < mesh.rest.size(); ++v) {
            // Some roundings of numbers near 10; thin layers weigh little, which costs some more.
            EXPECT_LT(glm::distance(mesh.displacement[v], moved(mesh.rest[v])), 1e-9) << v;
            EXPECT_NEAR(mesh.value[v], moved(mesh.rest[v]).y, 1e-9);
        }
    }
}

TEST(CarriedMesh, OfASheetMovesAsTheSheetDoes) {
    const Body body = body_of(divided(box_mesh({2, 2, 0.1}), 3), 0.1);
    ASSERT_EQ(body.problem.lattice.dims.z, 1);
    std::vector<glm::dvec3> displacement;
    for (std::size_t i = 0; i < body.problem.particle_count(); ++i)
        displacement.push_back({0, 0, place(body, i).x});
    const CarriedMesh mesh = carried(body.source, body.problem, displacement);
    for (std::size_t v = 0; v < mesh.rest.size(); ++v)
        EXPECT_NEAR(mesh.displacement[v].z, mesh.rest[v].x, 1e-9);
}

TEST(CarriedMesh, FarFromTheBodyFollowsTheNearestParticle) {
    Mesh mesh = box_mesh();
    append(mesh, box_mesh(glm::dvec3(0.01), {3, 0, 0}));  // too small for a voxel
    const Body body = body_of(mesh, 0.1);
    std::vector<glm::dvec3> displacement(body.problem.particle_count(), glm::dvec3(0, 1, 0));
    const CarriedMesh carried_mesh = carried(body.source, body.problem, displacement);
    for (const glm::dvec3& u : carried_mesh.displacement) EXPECT_LT(glm::distance(u, {0, 1, 0}), 1e-12);
}

TEST(CarriedMesh, ScalesDisplacementsToItsUnit) {
    Body body = body_of(ball_mesh(2), 0.2);
    body.problem.lattice.spacing *= 1000;
    const std::vector<glm::dvec3> displacement(body.problem.particle_count(), glm::dvec3(500, 0, 0));
    for (const glm::dvec3& u : carried(body.source, body.problem, displacement).displacement)
        EXPECT_NEAR(u.x, 0.5, 1e-12);
}

TEST(CarriedMesh, PartsWhereTheLatticeIsCut) {
    Body body = body_of(divided(box_mesh({2, 1, 1}), 4), 0.1);
    Mesh& mesh = body.source.mesh;
    mesh.tetrahedra = {{0, 1, 2, 4}};  // much larger than a voxel: it stays whole
    Problem& problem = body.problem;
    // A cut through half of the height, at x = 1, and the springs that a suture would put in its place.
    std::vector<Spring> sewn;
    const std::vector<std::uint32_t> at = particle_of_voxel(problem.lattice);
    const auto is_left = [&](std::size_t i) { return place(body, i).x < 1; };
    for (std::size_t i = 0; i < problem.particle_count(); ++i) {
        visit_directions(problem.lattice.mask[i], [&](const Direction& direction) {
            const std::size_t j =
                at[std::size_t(std::ptrdiff_t(problem.lattice.voxel[i]) + problem.lattice.stride(direction))];
            if (is_left(i) == is_left(j) || std::max(place(body, i).z, place(body, j).z) >= 0.5) return;
            problem.lattice.mask[i] &= ~(1U << unsigned(direction.bit));
            if (i < j) sewn.push_back({std::uint32_t(i), std::uint32_t(j), 2, 1});
        });
    }
    std::vector<glm::dvec3> displacement;
    for (std::size_t i = 0; i < problem.particle_count(); ++i)
        displacement.push_back({is_left(i) ? -1.0 : 1.0, 0, 0});
    const CarriedMesh parted = carried(body.source, problem, displacement);
    EXPECT_GT(parted.copies, 10);
    EXPECT_EQ(parted.rest.size(), mesh.points.size() + parted.copies);
    // A live view binds the mesh once, and then moves it alike.
    const BoundMesh bound(body.source, problem);
    EXPECT_EQ(bound.triangles, parted.triangles);
    ASSERT_EQ(bound.rest.size(), parted.rest.size());
    const std::vector<glm::dvec3> moved = bound.at_vertices<glm::dvec3>(displacement);
    const double scale = body.source.pitch / problem.lattice.spacing.x;
    for (std::size_t v = 0; v < moved.size(); ++v) {
        // Weights are float32, and some of them are a few times larger than their sum, which is one.
        EXPECT_LT(glm::distance(scale * moved[v], parted.displacement[v]), 1e-6);
        EXPECT_LT(glm::distance(body.source.origin + scale * bound.rest[v], parted.rest[v]), 1e-12);
    }
    EXPECT_EQ(parted.tetrahedra, mesh.tetrahedra);
    // Below the end of the cut, less the box of a vertex, every triangle goes with one side.
    std::size_t near = 0;
    for (const Triangle& t : parted.triangles) {
        const glm::dvec3 centroid = (parted.rest[t[0]] + parted.rest[t[1]] + parted.rest[t[2]]) / 3.0;
        if (centroid.z > 0.2 || std::abs(centroid.x - 1) > 0.2) continue;
        ++near;
        for (const std::uint32_t v : t) EXPECT_NEAR(parted.displacement[v].x, centroid.x < 1 ? -1 : 1, 1e-12);
    }
    EXPECT_GT(near, 20);
    // Above it nothing is parted.
    for (std::size_t v = mesh.points.size(); v < parted.rest.size(); ++v) EXPECT_LT(parted.rest[v].z, 0.75);
    // A suture closes the mesh again, also one whose springs are not those of the lattice.
    problem.springs = sewn;
    EXPECT_EQ(carried(body.source, problem, displacement).copies, 0u);
}

}  // namespace
}  // namespace voxspring::testing
