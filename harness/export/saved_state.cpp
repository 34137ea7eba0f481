#include "harness/export/saved_state.h"

#include <minizip/unzip.h>

#include <cmath>
#include <cstdint>
#include <cstring>
#include <glm/vec3.hpp>
#include <limits>
#include <memory>
#include <string>
#include <type_traits>
#include <vector>

#include "harness/base/bad_input.h"
#include "harness/export/arrays.h"

namespace voxspring {
namespace {

/// The arrays of a .npz file.
class NpzReader {
public:
    explicit NpzReader(const std::filesystem::path& file)
        : name_(file.string()), file_(unzOpen64(file.c_str())) {
        if (!file_) refuse("", name_, "a .npz file that `voxspring run --out` wrote");
    }

    /// Fills `values` with the array `name`, which must have as many elements, of the same type.
    template <class Value>
    void read(const std::string& name, std::vector<Value>& values) {
        const ArrayBytes wanted = bytes_of(values);
        std::string shape = "(" + std::to_string(wanted.count) + ",";
        if (wanted.components > 1) shape += " " + std::to_string(wanted.components);
        read(name, wanted, shape + ")", reinterpret_cast<char*>(values.data()));
    }
    template <class Number>
    Number scalar(const std::string& name) {
        std::vector<Number> value(1);
        read(name, bytes_of(value), "()", reinterpret_cast<char*>(value.data()));
        return value[0];
    }

    [[noreturn]] void refuse(const std::string& key, const std::string& value,
                             const std::string& accepted) const {
        throw BadInput(name_, key, value, accepted);
    }

private:
    struct Close {
        void operator()(unzFile file) const { unzClose(file); }
    };

    void read(const std::string& name, const ArrayBytes& wanted, const std::string& shape, char* to) {
        if (unzLocateFile(file_.get(), (name + ".npy").c_str(), 1) != UNZ_OK ||
            unzOpenCurrentFile(file_.get()) != UNZ_OK)
            refuse(name, "nothing", "the array " + name + " that `voxspring run --out` writes");
        constexpr std::size_t before = 10;  // magic string, version, the header's size
        std::string begin(before, '\0');
        take(name, begin.data(), begin.size());
        if (begin.substr(0, 8) != std::string("\x93NUMPY\x01\x00", 8))
            refuse(name, "its header", "a numpy array");
        std::string header(std::uint8_t(begin[8]) + 256u * std::uint8_t(begin[9]), '\0');
        take(name, header.data(), header.size());
        const std::string type = std::string("'descr': '") + (wanted.width == 1 ? '|' : '<') + wanted.kind +
                                 std::to_string(wanted.width) + "'";
        for (const std::string& part : {type, std::string("'fortran_order': False"), "'shape': " + shape}) {
            if (header.find(part) == std::string::npos)
                refuse(name, header.substr(0, header.find('\n')), part + ", as the scene has it");
        }
        take(name, to, wanted.bytes.size());
        char more = 0;
        // Closing it checks what was read against the file's sum.
        if (unzReadCurrentFile(file_.get(), &more, 1) != 0 || unzCloseCurrentFile(file_.get()) != UNZ_OK)
            refuse(name, "its data", "as many bytes as its header says, undamaged");
    }

    void take(const std::string& name, char* to, std::size_t bytes) {
        while (bytes > 0) {
            const auto max_bytes = unsigned(std::min<std::size_t>(bytes, 1u << 30));
            const int got = unzReadCurrentFile(file_.get(), to, max_bytes);
            if (got <= 0) refuse(name, "its data", "as many bytes as its header says, undamaged");
            to += got;
            bytes -= std::size_t(got);
        }
    }

    std::string name_;
    std::unique_ptr<std::remove_pointer_t<unzFile>, Close> file_;
};

void check_scene(NpzReader& file, const Scene& scene) {
    const Problem& problem = scene.problem;
    const Lattice& lattice = problem.lattice;
    const auto refuse = [&](const std::string& key, const std::string& what) {
        file.refuse(key, "what it holds", "the " + what + " of the scene " + scene.name);
    };
    std::vector<int> dims(3);
    std::vector<double> spacing(3);
    std::vector<glm::ivec3> voxel(lattice.voxel.size());
    file.read("dims", dims);
    file.read("spacing", spacing);
    if (glm::ivec3(dims[0], dims[1], dims[2]) != lattice.dims) refuse("dims", "dims");
    if (glm::dvec3(spacing[0], spacing[1], spacing[2]) != lattice.spacing) refuse("spacing", "spacing");
    file.read("voxel", voxel);
    for (std::size_t i = 0; i < voxel.size(); ++i) {
        if (voxel[i] != lattice.coordinates(lattice.voxel[i])) refuse("voxel", "active voxels");
    }
    const auto time_step = file.scalar<double>("time_step");
    if (time_step != problem.time_step)
        file.refuse("time_step", std::to_string(time_step),
                    "the time step of the scene " + scene.name + ", " + std::to_string(problem.time_step));
}

}  // namespace

SavedState read_saved_state(const std::filesystem::path& path, const Scene& scene) {
    NpzReader file(path);
    check_scene(file, scene);
    SavedState saved;
    const auto step = file.scalar<std::int64_t>("step");
    if (step < 0 || step > std::numeric_limits<int>::max())
        file.refuse("step", std::to_string(step), "a number of steps");
    saved.step = int(step);
    for (auto [name, values] : {std::pair{"displacement", &saved.state.displacement},
                                std::pair{"increment", &saved.state.increment}}) {
        values->resize(scene.problem.particle_count());
        file.read(name, *values);
        for (const glm::dvec3& v : *values) {
            if (!std::isfinite(v.x + v.y + v.z))
                file.refuse(name, "a number that is not finite", "finite numbers");
        }
    }
    return saved;
}

}  // namespace voxspring
