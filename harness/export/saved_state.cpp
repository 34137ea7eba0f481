#include "harness/export/saved_state.h"

#include <fmt/format.h>
#include <minizip/unzip.h>

#include <algorithm>
#include <bit>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <glm/vec3.hpp>
#include <iterator>
#include <limits>
#include <memory>
#include <string>
#include <string_view>
#include <tuple>
#include <type_traits>
#include <utility>
#include <vector>

#include "backends/physics/edit.h"
#include "backends/physics/neighbours.h"
#include "harness/base/bad_input.h"
#include "harness/export/arrays.h"
#include "harness/scene/scene_runner.h"
#include "harness/scene/stability.h"

namespace voxspring {
namespace {

/// Reads the arrays of a .npz file.
class NpzReader {
public:
    explicit NpzReader(const std::filesystem::path& file) : name_(file.string()) {
        const std::string accepted = "a .npz file that `voxspring run --out` wrote";
        require_regular_file(file, accepted);  // opening a pipe would wait for its writer
        file_.reset(unzOpen64(file.c_str()));
        if (!file_) refuse("", name_, accepted);
    }

    /// The array `name`, whose rows are Values, or groups of `columns` of them. The file gives the number of
    /// rows.
    template <class Value>
    std::vector<Value> rows(const std::string& name, std::size_t columns = 1) {
        constexpr std::size_t most = std::size_t(1) << 40, at_once = std::size_t(1) << 20;
        std::vector<Value> values;
        const ArrayBytes type = bytes_of(values);
        const std::string header = open(name, type);
        const std::string_view key = "'shape': (";
        const std::size_t at = header.find(key);
        std::size_t count = 0;
        if (at != std::string::npos)
            std::from_chars(header.data() + at + key.size(), header.data() + header.size(), count);
        if (count > most) refuse(name, "its shape", "an array that fits into memory");
        check(name, header, "'shape': " + numpy_shape(count, columns * type.components));
        // Memory grows with the data that is really there, whatever the header says.
        for (std::size_t left = count * columns; left > 0;) {
            const std::size_t piece = std::min(left, at_once), before = values.size();
            values.resize(before + piece);
            take(name, reinterpret_cast<char*>(values.data() + before), piece * sizeof(Value));
            left -= piece;
        }
        close(name);
        return values;
    }
    /// Like rows(), but refuses the file unless there are `count` rows.
    template <class Value>
    std::vector<Value> rows_of(std::size_t count, const std::string& name) {
        std::vector<Value> values = rows<Value>(name);
        if (values.size() != count)
            refuse(name, std::to_string(values.size()) + " rows",
                   std::to_string(count) + ", as the scene has it");
        return values;
    }
    template <class Number>
    Number scalar(const std::string& name) {
        Number value{};
        check(name, open(name, bytes_of(std::vector<Number>{})), "'shape': ()");
        take(name, reinterpret_cast<char*>(&value), sizeof value);
        close(name);
        return value;
    }

    [[noreturn]] void refuse(const std::string& key, const std::string& value,
                             const std::string& accepted) const {
        throw BadInput(name_, key, value, accepted);
    }

private:
    struct Close {
        void operator()(unzFile file) const { unzClose(file); }
    };

    /// Seeks the data of the array `name`, whose elements must have the type of `wanted`. Returns the array's
    /// header.
    std::string open(const std::string& name, const ArrayBytes& wanted) {
        if (unzLocateFile(file_.get(), (name + ".npy").c_str(), 1) != UNZ_OK ||
            unzOpenCurrentFile(file_.get()) != UNZ_OK)
            throw BadInput(name_, name, missing, "the array " + name + " that `voxspring run --out` writes");
        constexpr std::size_t before = 10;  // magic string, version, the header's size
        std::string begin(before, '\0');
        take(name, begin.data(), begin.size());
        if (begin.substr(0, 8) != std::string("\x93NUMPY\x01\x00", 8))
            refuse(name, "its header", "a numpy array");
        std::string header(std::uint8_t(begin[8]) + 256u * std::uint8_t(begin[9]), '\0');
        take(name, header.data(), header.size());
        check(name, header, "'descr': '" + numpy_type(wanted) + "'");
        check(name, header, "'fortran_order': False");
        return header;
    }
    void check(const std::string& name, const std::string& header, const std::string& part) const {
        if (header.find(part) == std::string::npos)
            refuse(name, header.substr(0, header.find('\n')), "an array whose header has " + part);
    }
    /// Closes the array and checks that all of it has been read.
    void close(const std::string& name) {
        char more = 0;
        // Closing checks the data against the checksum in the file.
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
    const auto refuse = [&](const std::string& key, const auto& found, const auto& expected) {
        const auto text = [](const auto& v) { return fmt::format("{}, {}, {}", v.x, v.y, v.z); };
        file.refuse(key, text(found), text(expected) + ", as the scene " + scene.name + " has it");
    };
    const auto dims = file.rows_of<int>(3, "dims");
    const auto spacing = file.rows_of<double>(3, "spacing");
    if (const glm::ivec3 found(dims[0], dims[1], dims[2]); found != lattice.dims)
        refuse("dims", found, lattice.dims);
    if (const glm::dvec3 found(spacing[0], spacing[1], spacing[2]); found != lattice.spacing)
        refuse("spacing", found, lattice.spacing);
    const auto voxel = file.rows_of<glm::ivec3>(lattice.voxel.size(), "voxel");
    for (std::size_t i = 0; i < voxel.size(); ++i) {
        const glm::ivec3 expected = lattice.coordinates(lattice.voxel[i]);
        if (voxel[i] != expected) refuse(fmt::format("voxel {}", i), voxel[i], expected);
    }
    const auto time_step = file.scalar<double>("time_step");
    if (time_step != problem.time_step)
        file.refuse("time_step", fmt::format("{}", time_step),
                    fmt::format("{}, as the scene {} has it", problem.time_step, scene.name));
}

/// The lattice direction from `first` to `second`; null if no lattice spring can lead from `first` to
/// `second`.
const Direction* direction_between(const Problem& problem, std::uint32_t first, std::uint32_t second) {
    const Lattice& lattice = problem.lattice;
    if (first >= second || second >= lattice.voxel.size()) return nullptr;
    const glm::ivec3 offset =
        lattice.coordinates(lattice.voxel[second]) - lattice.coordinates(lattice.voxel[first]);
    const auto& all = directions();
    const auto found = std::find_if(all.begin(), all.end(), [&](const Direction& direction) {
        return direction.offset == offset && (problem.group_bits >> direction.bit & 1U) != 0;
    });
    return found == all.end() ? nullptr : &*found;
}

void read_springs(NpzReader& file, const Scene& scene, SavedState& saved) {
    const Problem& problem = scene.problem;
    const auto ends = file.rows<std::uint32_t>("springs", 2);
    const auto rest_length = file.rows<double>("rest_length");
    const auto stiffness = file.rows<double>("stiffness");
    const auto of_lattice = file.scalar<std::int64_t>("lattice_springs");
    const std::size_t count = ends.size() / 2;
    if (rest_length.size() != count || stiffness.size() != count)
        file.refuse("springs", std::to_string(count) + " pairs",
                    "as many pairs as rest_length and stiffness have rows");
    if (of_lattice < 0 || std::size_t(of_lattice) > count)
        file.refuse("lattice_springs", std::to_string(of_lattice), "a number from 0 to that of all springs");

    saved.mask = problem.lattice.mask;
    for (std::uint32_t& mask : saved.mask) mask &= ~std::uint32_t(NEIGHBOUR_BITS);
    std::size_t other = 0;
    for (std::size_t s = 0; s < std::size_t(of_lattice); ++s) {
        const std::uint32_t first = ends[2 * s], second = ends[2 * s + 1];
        const Direction* direction = direction_between(problem, first, second);
        if (direction == nullptr || rest_length[s] != rest_spring(problem, *direction).length ||
            stiffness[s] != problem.spring_stiffness(first, second, *direction)) {
            ++other;
            continue;
        }
        saved.mask[first] |= 1U << direction->bit;
        saved.mask[second] |= 1U << (direction->bit ^ 1);
    }
    if (other > 0)
        file.refuse("springs", fmt::format("{} of {}", other, of_lattice),
                    "springs of the stiffness, the rest length and the neighbours that the scene " +
                        scene.name + " has");
    for (std::size_t s = std::size_t(of_lattice); s < count; ++s) {
        const Spring spring{ends[2 * s], ends[2 * s + 1], stiffness[s], rest_length[s]};
        if (spring.first >= spring.second || spring.second >= problem.particle_count() ||
            !std::isfinite(spring.stiffness) || !(spring.stiffness > 0) ||
            !std::isfinite(spring.rest_length) || !(spring.rest_length > 0))
            file.refuse("springs", fmt::format("the one between {} and {}", spring.first, spring.second),
                        "springs between two particles, of a stiffness and a rest length above 0");
        saved.springs.push_back(spring);
    }
}

/// Records in `saved.differs` how the file's particles differ from the scene's.
void compare_particles(NpzReader& file, const Scene& scene, SavedState& saved) {
    const Problem& problem = scene.problem;
    const auto mass = file.rows_of<double>(problem.particle_count(), "mass");
    const auto pinned = file.rows_of<std::uint8_t>(problem.particle_count(), "pinned");
    std::size_t other_mass = 0, other_pins = 0;
    for (std::size_t i = 0; i < mass.size(); ++i) {
        other_mass += mass[i] != problem.material_of(i).mass ? 1 : 0;
        other_pins += (pinned[i] != 0) != problem.is_pinned(i) ? 1 : 0;
    }
    if (other_mass == 0 && other_pins == 0) return;
    saved.differs = fmt::format(
        "{} particles have a different mass in the file, and {} differ in whether they are pinned; "
        "the run uses the masses and pins of the scene {}",
        other_mass, other_pins, scene.name);
}

bool before(const Spring& a, const Spring& b) {
    return std::tie(a.first, a.second, a.stiffness, a.rest_length) <
           std::tie(b.first, b.second, b.stiffness, b.rest_length);
}

/// The part of each edit that still applies to `problem` after the edits before it have been made.
std::vector<ScheduledEdit> still_applying(Problem problem, const std::vector<ScheduledEdit>& edits) {
    SpringEditor editor(problem);
    std::vector<ScheduledEdit> made;
    const auto add = [&](int step, const SpringEdit& edit) {
        if (!edit.empty()) made.push_back({step, edit});
    };
    for (const ScheduledEdit& scheduled : edits) {
        std::vector<std::pair<std::uint32_t, std::uint32_t>> removed;
        for (const ChangedSpring& changed : changed_springs(problem, scheduled.edit.removed))
            removed.emplace_back(changed.spring.first, changed.spring.second);
        add(scheduled.step, editor.cut(removed));
        add(scheduled.step, editor.join(changed_springs(problem, scheduled.edit.added)));
    }
    return made;
}

}  // namespace

SavedState read_saved_state(const std::filesystem::path& path, const Scene& scene) {
    NpzReader file(path);
    check_scene(file, scene);
    SavedState saved;
    const auto step = file.scalar<std::int64_t>("step");
    if (step < 0 || step > std::numeric_limits<int>::max())
        file.refuse("step", std::to_string(step), "a number of steps from 0 to 2147483647");
    saved.step = int(step);
    for (auto [name, values] : {std::pair{"displacement", &saved.state.displacement},
                                std::pair{"increment", &saved.state.increment}}) {
        *values = file.rows_of<glm::dvec3>(scene.problem.particle_count(), name);
        for (const glm::dvec3& v : *values) {
            if (!std::isfinite(v.x + v.y + v.z))
                file.refuse(name, "a number that is not finite", "finite numbers");
        }
    }
    read_springs(file, scene, saved);
    compare_particles(file, scene, saved);
    return saved;
}

std::size_t springs_that_differ(const Scene& scene, const SavedState& saved) {
    const Problem own = problem_after(scene, saved.step);
    std::size_t ends = 0;  // ends of lattice springs, of which each spring has two
    for (std::size_t i = 0; i < saved.mask.size(); ++i)
        ends += std::size_t(std::popcount(saved.mask[i] ^ own.lattice.mask[i]));
    if (saved.springs == own.springs) return ends / 2;
    const auto sorted = [](std::vector<Spring> springs) {
        std::sort(springs.begin(), springs.end(), before);
        return springs;
    };
    const std::vector<Spring> these = sorted(saved.springs), those = sorted(own.springs);
    std::vector<Spring> other;
    std::set_symmetric_difference(these.begin(), these.end(), those.begin(), those.end(),
                                  std::back_inserter(other), before);
    // If these lists differ in their order alone, forces are summed in another order, and the bits of a step
    // differ. That counts as one difference.
    return ends / 2 + std::max<std::size_t>(other.size(), 1);
}

void take_springs(Scene& scene, const SavedState& saved) {
    scene.problem.lattice.mask = saved.mask;
    scene.problem.springs = saved.springs;
    std::erase_if(scene.edits, [&](const ScheduledEdit& edit) { return edit.step < saved.step; });
    if (!scene.edits.empty()) scene.edits = still_applying(scene.problem, scene.edits);
    scene.stable_time_step = stable_time_step(with_all_springs(scene));
}

}  // namespace voxspring
