#include "harness/export/export_formats.h"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <minizip/zip.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cstdint>
#include <glm/geometric.hpp>
#include <iterator>
#include <limits>
#include <memory>
#include <new>
#include <stdexcept>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "backends/cpu/perturbed_reference.h"
#include "backends/physics/neighbours.h"
#include "backends/physics/spring.h"
#include "harness/drawing/body_mesh.h"
#include "harness/export/arrays.h"
#include "harness/mesh/carried_mesh.h"

namespace voxspring {
namespace {

/// The placement of the grid in the coordinates of the volume file or mesh, or null if there is none.
const Placement* placement_of(const Snapshot& snapshot) {
    const auto& volume = snapshot.scene.volume;
    return volume && volume->placement ? &*volume->placement : nullptr;
}

/// Rest position plus displacement, one element per particle.
std::vector<glm::dvec3> positions(const Snapshot& snapshot) {
    std::vector<glm::dvec3> position = snapshot.problem.rest_position;
    for (std::size_t i = 0; i < position.size(); ++i) position[i] += snapshot.state.displacement[i];
    return position;
}

/// The springs of a problem in the order of list_springs(), with an array per quantity.
struct SpringArrays {
    std::vector<std::uint32_t> ends;  ///< two per spring
    std::vector<double> rest_length, stiffness, tension;
};

SpringArrays spring_arrays(const Snapshot& snapshot) {
    const Problem& problem = snapshot.problem;
    const std::vector<glm::dvec3>& displacement = snapshot.state.displacement;
    const double shortest_squared = problem.shortest_squared();
    SpringArrays all;
    const std::size_t count = count_springs(problem).total();
    all.ends.reserve(2 * count);
    for (auto* values : {&all.rest_length, &all.stiffness, &all.tension}) values->reserve(count);
    const auto add = [&](std::uint32_t i, std::uint32_t j, double stiffness, const RestSpring& rest) {
        const glm::dvec3 relative = displacement[i] - displacement[j];
        all.ends.insert(all.ends.end(), {i, j});
        all.rest_length.push_back(rest.length);
        all.stiffness.push_back(stiffness);
        all.tension.push_back(
            -glm::length(rest.offset + relative) *
            strain_density(relative, rest.offset, rest.length, rest.deficit, stiffness, shortest_squared));
    };
    std::array<RestSpring, neighbour_count> rest{};
    for (const Direction& direction : directions())
        rest[std::size_t(direction.bit)] = rest_spring(problem, direction);
    const LatticeSprings lattice(problem);
    for (std::size_t i = 0; i < problem.lattice.mask.size(); ++i) {
        lattice.of(i, [&](std::uint32_t j, const Direction& direction) {
            add(std::uint32_t(i), j, problem.spring_stiffness(i, j, direction),
                rest[std::size_t(direction.bit)]);
        });
    }
    for (const Spring& spring : problem.springs)
        add(spring.first, spring.second, spring.stiffness, rest_spring(problem, spring));
    return all;
}

std::vector<double> masses(const Problem& problem) {
    std::vector<double> mass(problem.particle_count());
    for (std::size_t i = 0; i < mass.size(); ++i) mass[i] = problem.material_of(i).mass;
    return mass;
}

/// `values`, or a zero per particle if `values` is empty.
std::vector<std::uint8_t> or_zeros(const std::vector<std::uint8_t>& values, const Problem& problem) {
    return values.empty() ? std::vector<std::uint8_t>(problem.particle_count()) : values;
}

/// Converts vectors from the grid's axes to the coordinates of the volume file or mesh, if it places the
/// grid.
std::vector<glm::dvec3> in_file(const Snapshot& snapshot, std::vector<glm::dvec3> vectors) {
    if (const Placement* placement = placement_of(snapshot)) {
        for (glm::dvec3& v : vectors) v = placement->to_file(v);
    }
    return vectors;
}

std::vector<glm::ivec3> voxels(const Lattice& lattice) {
    std::vector<glm::ivec3> voxel;
    voxel.reserve(lattice.voxel.size());
    for (const std::uint32_t index : lattice.voxel) voxel.push_back(lattice.coordinates(index));
    return voxel;
}

/// Scatters values of particles to voxels; inactive voxels get Value{}.
template <class Value>
std::vector<Value> on_grid(const Lattice& lattice, const std::vector<Value>& of_particle) {
    std::vector<Value> grid(lattice.voxel_count(), Value{});
    for (std::size_t i = 0; i < of_particle.size(); ++i) grid[lattice.voxel[i]] = of_particle[i];
    return grid;
}

// --- VTK's XML files ----------------------------------------------------------------------------------

/// An attribute as XML: ` name="1"`.
std::string attribute(const std::string& name, std::size_t value) {
    return fmt::format(" {}=\"{}\"", name, value);
}
/// An attribute of several numbers as XML: ` name="1 0 0.5"`.
std::string attribute(const std::string& name, const std::vector<double>& numbers) {
    return fmt::format(" {}=\"{:.17g}\"", name, fmt::join(numbers, " "));
}

/// A VTK XML file whose arrays follow the XML as raw bytes ("appended raw").
class VtkFile {
public:
    /// `type` is VTK's name of the dataset.
    explicit VtkFile(const std::string& type)
        : xml_("<?xml version=\"1.0\"?>\n<VTKFile type=\"" + type +
               "\" version=\"1.0\" byte_order=\"LittleEndian\" header_type=\"UInt64\">\n") {}

    /// Opens a tag, such as `Piece NumberOfPoints="3"`, which end() closes.
    void begin(const std::string& tag) {
        xml_ += "<" + tag + ">\n";
        open_.push_back(tag.substr(0, tag.find(' ')));
    }
    void end() {
        xml_ += "</" + open_.back() + ">\n";
        open_.pop_back();
    }

    template <class Value>
    void array(const std::string& name, const std::vector<Value>& values) {
        const ArrayBytes array = bytes_of(values);
        xml_ += fmt::format(
            R"(<DataArray type="{}{}" Name="{}" NumberOfComponents="{}"{} format="appended" offset="{}"/>)",
            array.kind == 'f'   ? "Float"
            : array.kind == 'i' ? "Int"
                                : "UInt",
            8 * array.width, name, array.components,
            // An array of field data states its length here, since nothing else in the file does.
            open_.back() == "FieldData" ? attribute("NumberOfTuples", array.count) : "", offset_);
        xml_ += '\n';
        offset_ += sizeof(std::uint64_t) + array.bytes.size();
        blocks_.emplace_back(array.bytes);
    }

    /// Closes all open tags and returns the whole file. Frees each array once it is copied.
    std::string bytes() {
        while (!open_.empty()) end();
        std::string file = std::move(xml_);
        file += "<AppendedData encoding=\"raw\">\n_";
        const std::string tail = "\n</AppendedData>\n</VTKFile>\n";
        file.reserve(file.size() + offset_ + tail.size());
        for (std::string& block : blocks_) {
            const std::uint64_t size = block.size();
            file.append(reinterpret_cast<const char*>(&size), sizeof size);
            file += block;
            std::string().swap(block);
        }
        file += tail;
        return file;
    }

private:
    std::string xml_;
    std::vector<std::string> open_, blocks_;
    std::uint64_t offset_ = 0;
};

/// Adds the state's time and step. ParaView recognises TimeValue by its name.
void add_time(VtkFile& file, const Snapshot& snapshot) {
    file.begin("FieldData");
    file.array("TimeValue", std::vector<double>{snapshot.time});
    file.array("step", std::vector<std::int64_t>{snapshot.step});
    file.end();
}

/// Adds the cells of lines with two points each. `Index` must be wide enough for the last offset and for
/// every particle.
template <class Index>
void add_lines(VtkFile& file, const std::vector<std::uint32_t>& ends) {
    file.array("connectivity", std::vector<Index>(ends.begin(), ends.end()));
    std::vector<Index> offsets(ends.size() / 2);
    for (std::size_t cell = 0; cell < offsets.size(); ++cell) offsets[cell] = Index(2 * (cell + 1));
    file.array("offsets", offsets);
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

// --- numpy's files ------------------------------------------------------------------------------------

/// A zip file in memory, for minizip.
struct ZipMemory {
    std::string bytes;
    std::size_t position = 0;

    static ZipMemory& of(voidpf stream) { return *static_cast<ZipMemory*>(stream); }
    static voidpf open(voidpf memory, const void*, int) { return memory; }
    static uLong read(voidpf, voidpf, void*, uLong) { return 0; }  // the file is only written
    static uLong write(voidpf, voidpf stream, const void* from, uLong size) {
        ZipMemory& memory = of(stream);
        try {
            memory.bytes.resize(std::max(memory.bytes.size(), memory.position + size));
        } catch (const std::bad_alloc&) {
            return 0;  // an exception must not cross minizip
        }
        std::copy_n(static_cast<const char*>(from), size,
                    memory.bytes.begin() + std::ptrdiff_t(memory.position));
        memory.position += size;
        return size;
    }
    static ZPOS64_T tell(voidpf, voidpf stream) { return of(stream).position; }
    static long seek(voidpf, voidpf stream, ZPOS64_T offset, int origin) {
        ZipMemory& memory = of(stream);
        if (origin == ZLIB_FILEFUNC_SEEK_CUR) offset += memory.position;
        if (origin == ZLIB_FILEFUNC_SEEK_END) offset += memory.bytes.size();
        if (offset > memory.bytes.size()) return -1;
        memory.position = offset;
        return 0;
    }
    static int close(voidpf, voidpf) { return 0; }
    static int error(voidpf, voidpf) { return 0; }
};

/// A zip of arrays as numpy.savez() writes it.
class NpzFile {
public:
    NpzFile() {
        zlib_filefunc64_def functions{ZipMemory::open, ZipMemory::read,  ZipMemory::write, ZipMemory::tell,
                                      ZipMemory::seek, ZipMemory::close, ZipMemory::error, &memory_};
        file_.reset(zipOpen2_64("", APPEND_STATUS_CREATE, nullptr, &functions));
        check(file_ ? ZIP_OK : ZIP_ERRNO);
    }

    /// Adds an array of this shape, as numpy writes it: "(3,)".
    void array(const std::string& name, const std::string& shape, const ArrayBytes& array) {
        std::string header =
            fmt::format("{{'descr': '{}', 'fortran_order': False, 'shape': {}, }}", numpy_type(array), shape);
        // The header is padded so that the data begins at a multiple of 64 bytes. Ten bytes come before it:
        // the magic string, the version and the header's size.
        constexpr std::size_t before = 10, alignment = 64;
        header.append(alignment - 1 - (before + header.size()) % alignment, ' ');
        header += '\n';
        std::string begin = "\x93NUMPY";
        begin += {'\x01', '\x00', char(header.size() % 256), char(header.size() / 256)};
        begin += header;

        // A fixed date, the first that a zip can store, so that the same state gives the same file.
        zip_fileinfo info{};
        info.tmz_date.tm_year = 1980;
        info.tmz_date.tm_mday = 1;
        const int zip64 = array.bytes.size() > std::numeric_limits<std::int32_t>::max() ? 1 : 0;
        check(zipOpenNewFileInZip64(file_.get(), (name + ".npy").c_str(), &info, nullptr, 0, nullptr, 0,
                                    nullptr, 0, 0, zip64));
        append(begin);
        append(array.bytes);
        check(zipCloseFileInZip(file_.get()));
    }
    template <class Value>
    void array(const std::string& name, const std::vector<Value>& values) {
        const ArrayBytes bytes = bytes_of(values);
        array(name, numpy_shape(bytes.count, bytes.components), bytes);
    }
    template <class Number>
    void scalar(const std::string& name, Number value) {
        array(name, "()", bytes_of(std::vector<Number>{value}));
    }

    /// Closes the file and returns its bytes.
    std::string bytes() {
        check(zipClose(file_.release(), nullptr));
        return std::move(memory_.bytes);
    }

private:
    struct Close {
        void operator()(zipFile file) const { zipClose(file, nullptr); }
    };
    static void check(int status) {
        if (status != ZIP_OK) throw std::runtime_error("cannot make a .npz file: not enough memory");
    }
    void append(std::string_view bytes) {
        // Limit of one call: zipWriteInFileInZip() takes an unsigned length.
        constexpr std::size_t max_bytes = 1u << 30;
        for (; !bytes.empty(); bytes.remove_prefix(std::min(max_bytes, bytes.size()))) {
            check(
                zipWriteInFileInZip(file_.get(), bytes.data(), unsigned(std::min(max_bytes, bytes.size()))));
        }
    }

    ZipMemory memory_;  // declared before the file, which writes to it until it is closed
    std::unique_ptr<std::remove_pointer_t<zipFile>, Close> file_;
};

// --- The surface of a body -----------------------------------------------------------------------------

/// The surface of the voxels, deformed: positions at rest and displacements. They are in the coordinates of
/// the volume's file if the file places its grid.
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

}  // namespace

std::vector<glm::dvec3> velocities(const Snapshot& snapshot) {
    const Problem& problem = snapshot.problem;
    const auto backend = make_perturbed_reference({});  // float64, without perturbation
    backend->upload(problem, snapshot.state);
    if (problem.has_tool())
        backend->tool()->move_tool(snapshot.scene.tool_motion.at_step(snapshot.step, problem.time_step));
    backend->step(1);
    std::vector<glm::dvec3> velocity = backend->download().increment;  // x(t + dt) - x(t)
    for (std::size_t i = 0; i < velocity.size(); ++i)
        velocity[i] = (snapshot.state.increment_of(i) + velocity[i]) / (2 * problem.time_step);
    return velocity;
}

std::string csv(const Snapshot& snapshot) {
    const Problem& problem = snapshot.problem;
    const std::vector<glm::dvec3> position = positions(snapshot);
    const std::vector<glm::dvec3> velocity = velocities(snapshot);
    const std::vector<glm::ivec3> voxel = voxels(problem.lattice);  // empty for a body without a lattice
    std::string text = voxel.empty() ? "" : "voxel_x,voxel_y,voxel_z,";
    text += "x,y,z,displacement_x,displacement_y,displacement_z,velocity_x,velocity_y,velocity_z\n";
    const auto end = std::back_inserter(text);
    for (std::size_t i = 0; i < problem.particle_count(); ++i) {
        if (!voxel.empty()) fmt::format_to(end, "{},{},{},", voxel[i].x, voxel[i].y, voxel[i].z);
        for (const glm::dvec3& v : {position[i], snapshot.state.displacement[i], velocity[i]})
            fmt::format_to(end, "{},{},{},", v.x, v.y, v.z);
        text.back() = '\n';
    }
    return text;
}

std::string vti(const Snapshot& snapshot) {
    const Problem& problem = snapshot.problem;
    const Lattice& lattice = problem.lattice;
    if (lattice.voxel_count() == 0) throw std::invalid_argument("a problem without a lattice has no grid");
    const auto extent = [&](const char* name) {
        const glm::ivec3 last = lattice.dims - 1;
        return fmt::format("{}=\"0 {} 0 {} 0 {}\"", name, last.x, last.y, last.z);
    };
    std::string placed = attribute("Origin", std::vector<double>{0, 0, 0});
    if (const Placement* placement = placement_of(snapshot)) {
        const auto& [x, y, z] = placement->direction;
        const glm::dvec3& origin = placement->origin;
        placed = attribute("Origin", {origin.x, origin.y, origin.z}) +
                 // VTK reads the matrix, whose columns are the axes, row by row.
                 attribute("Direction", {x.x, y.x, z.x, x.y, y.y, z.y, x.z, y.z, z.z});
    }
    std::vector<std::uint8_t> label = or_zeros(problem.material, problem);
    for (std::uint8_t& material : label) ++material;
    std::vector<std::uint8_t> springs;
    springs.reserve(lattice.mask.size());
    for (const std::uint32_t mask : lattice.mask)
        springs.push_back(std::uint8_t(std::popcount(mask & NEIGHBOUR_BITS)));

    VtkFile file("ImageData");
    file.begin("ImageData " + extent("WholeExtent") + placed +
               attribute("Spacing", {lattice.spacing.x, lattice.spacing.y, lattice.spacing.z}));
    add_time(file, snapshot);
    file.begin("Piece " + extent("Extent"));
    file.begin("PointData");
    file.array("active", on_grid(lattice, std::vector<std::uint8_t>(problem.particle_count(), 1)));
    file.array("label", on_grid(lattice, label));
    file.array("pinned", on_grid(lattice, or_zeros(problem.pinned, problem)));
    file.array("springs", on_grid(lattice, springs));
    file.array("mass", on_grid(lattice, masses(problem)));
    file.array("displacement", on_grid(lattice, in_file(snapshot, snapshot.state.displacement)));
    file.array("velocity", on_grid(lattice, in_file(snapshot, velocities(snapshot))));
    return file.bytes();
}

std::string vtu(const Snapshot& snapshot) {
    const Problem& problem = snapshot.problem;
    SpringArrays springs = spring_arrays(snapshot);
    const std::size_t count = springs.rest_length.size();

    VtkFile file("UnstructuredGrid");
    file.begin("UnstructuredGrid");
    add_time(file, snapshot);
    file.begin("Piece" + attribute("NumberOfPoints", problem.particle_count()) +
               attribute("NumberOfCells", count));
    file.begin("PointData");
    file.array("displacement", in_file(snapshot, snapshot.state.displacement));
    file.array("velocity", in_file(snapshot, velocities(snapshot)));
    file.array("mass", masses(problem));
    file.array("pinned", or_zeros(problem.pinned, problem));
    file.array("material", or_zeros(problem.material, problem));
    if (problem.lattice.voxel_count() > 0) file.array("voxel", voxels(problem.lattice));
    file.end();
    file.begin("CellData");
    file.array("rest_length", springs.rest_length);
    file.array("stiffness", springs.stiffness);
    file.array("tension", springs.tension);
    file.end();
    file.begin("Points");
    std::vector<glm::dvec3> points = in_file(snapshot, positions(snapshot));
    if (const Placement* placement = placement_of(snapshot)) {
        for (glm::dvec3& point : points) point += placement->origin;
    }
    file.array("Points", points);
    file.end();
    file.begin("Cells");
    if (std::max(2 * count, problem.particle_count()) <= std::numeric_limits<std::int32_t>::max()) {
        add_lines<std::int32_t>(file, springs.ends);
    } else {
        add_lines<std::int64_t>(file, springs.ends);
    }
    springs.ends = {};
    constexpr std::uint8_t line = 3;  // VTK_LINE
    file.array("types", std::vector<std::uint8_t>(count, line));
    return file.bytes();
}

std::string npz(const Snapshot& snapshot) {
    const Problem& problem = snapshot.problem;
    const Lattice& lattice = problem.lattice;
    NpzFile file;
    file.array("position", positions(snapshot));
    file.array("displacement", snapshot.state.displacement);
    file.array("increment", snapshot.state.increment);
    file.array("velocity", velocities(snapshot));
    file.array("mass", masses(problem));
    file.array("pinned", or_zeros(problem.pinned, problem));
    file.array("material", or_zeros(problem.material, problem));
    file.array("voxel", voxels(lattice));
    const SpringArrays springs = spring_arrays(snapshot);
    file.array("springs", numpy_shape(springs.rest_length.size(), 2), bytes_of(springs.ends));
    file.array("rest_length", springs.rest_length);
    file.array("stiffness", springs.stiffness);
    file.array("tension", springs.tension);
    file.scalar("lattice_springs", std::int64_t(springs.rest_length.size() - problem.springs.size()));
    file.array("dims", std::vector<int>{lattice.dims.x, lattice.dims.y, lattice.dims.z});
    file.array("spacing", std::vector<double>{lattice.spacing.x, lattice.spacing.y, lattice.spacing.z});
    file.scalar("step", snapshot.step);
    file.scalar("time", snapshot.time);
    file.scalar("time_step", problem.time_step);
    return file.bytes();
}

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
    return file.bytes();
}

}  // namespace voxspring
