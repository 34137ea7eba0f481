// The Python module voxspring._core: the library's public headers for Python. What users see is in
// voxspring/__init__.py.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/array.h>
#include <nanobind/stl/function.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <memory>
#include <nlohmann/json.hpp>
#include <numeric>
#include <sstream>
#include <stdexcept>
#include <string>
#include <system_error>
#include <utility>
#include <vector>

#include "backends/physics/neighbours.h"
#include "harness/base/bad_input.h"
#include "harness/base/json.h"
#include "harness/choice/auto_choice.h"
#include "harness/results/print.h"
#include "harness/scene/scene.h"
#include "harness/scene/scene_runner.h"
#include "harness/simulation/simulation.h"
#include "harness/study/kernel_trial.h"
#include "harness/study/study.h"
#include "harness/study/study_kind.h"

namespace nb = nanobind;
using namespace nb::literals;
using namespace voxspring;

namespace {

/// Thrown if the simulation refuses an edit, a hold, a change of the backend, or to save a state that is not
/// finite. The simulation has not changed then.
class Refused : public std::runtime_error {
    using std::runtime_error::runtime_error;
};

void require_done(const std::string& refusal) {
    if (!refusal.empty()) throw Refused(refusal);
}

// --- Arrays -----------------------------------------------------------------------------------------------

/// A new numpy array of `rows` x `columns`, one-dimensional if `columns` is 0. fill(row, pointer to its first
/// element) fills each row.
template <class T, class Fill>
nb::object array_of(std::size_t rows, std::size_t columns, Fill fill) {
    const std::size_t width = std::max<std::size_t>(columns, 1);
    auto values = std::make_unique<T[]>(std::max<std::size_t>(rows * width, 1));
    for (std::size_t i = 0; i < rows; ++i) fill(i, &values[i * width]);
    T* const data = values.get();
    const nb::capsule owner(values.release(), [](void* old) noexcept { delete[] static_cast<T*>(old); });
    const std::size_t shape[2] = {rows, columns};
    return nb::cast(nb::ndarray<nb::numpy, T>(data, columns == 0 ? 1 : 2, shape, owner));
}

nb::object vectors(std::size_t count, const std::function<glm::dvec3(std::size_t)>& of) {
    return array_of<double>(count, 3, [&](std::size_t i, double* to) {
        const glm::dvec3 vector = of(i);
        for (int axis = 0; axis < 3; ++axis) to[axis] = vector[axis];
    });
}

using Vectors = nb::ndarray<const double, nb::shape<-1, 3>, nb::c_contig, nb::device::cpu>;
using Flags = nb::ndarray<const bool, nb::ndim<1>, nb::c_contig, nb::device::cpu>;

std::vector<glm::dvec3> list_of(const Vectors& array, std::size_t count, const char* name) {
    if (array.shape(0) != count)
        throw BadInput("array", name, std::to_string(array.shape(0)) + " rows",
                       "one row for each of the " + std::to_string(count) + " particles");
    std::vector<glm::dvec3> list(count);
    for (std::size_t i = 0; i < count; ++i) list[i] = {array(i, 0), array(i, 1), array(i, 2)};
    return list;
}

/// Throws BadInput unless the numbers are finite.
glm::dvec3 vec3(const std::array<double, 3>& from) {
    for (const double number : from) {
        if (!std::isfinite(number))
            throw BadInput("voxspring", "a vector", std::to_string(number), "three finite numbers");
    }
    return {from[0], from[1], from[2]};
}

// --- Interruption -----------------------------------------------------------------------------------------

/// Lets Python handle pending signals. Throws KeyboardInterrupt after Ctrl-C. Takes the GIL meanwhile.
void check_signals() {
    const nb::gil_scoped_acquire gil;
    if (PyErr_CheckSignals() != 0) throw nb::python_error();
}

// --- A body -----------------------------------------------------------------------------------------------

struct Body {
    std::shared_ptr<const Scene> scene;
    const Problem& problem() const { return scene->problem; }
    std::size_t count() const { return scene->problem.particle_count(); }
};

using Labels = nb::ndarray<const std::uint8_t, nb::ndim<3>, nb::f_contig, nb::device::cpu>;
using Mask = nb::ndarray<const bool, nb::ndim<3>, nb::f_contig, nb::device::cpu>;

nb::object as_array(nb::handle given, const char* type) {
    return nb::module_::import_("numpy").attr("asarray")(given, type, "F");
}

std::string text_of(const nb::object& value) { return nb::cast<std::string>(nb::str(value)); }

/// Converts `given`, anything that numpy.asarray() takes, to labels. Throws BadInput.
Labels labels_of(nb::handle given) {
    const nb::object array = nb::module_::import_("numpy").attr("asarray")(given);
    const auto refuse = [](const std::string& value) {
        throw BadInput("Body()", "labels", value,
                       "three axes x, y, z of whole numbers 0 (inactive) to 255, or of bool");
    };
    if (const nb::object axes = array.attr("ndim"); nb::cast<int>(axes) != 3)
        refuse("an array of " + text_of(axes) + " axes");
    const nb::object type = array.attr("dtype");
    if (const std::string kind = text_of(nb::object(type.attr("kind")));
        kind != "b" && kind != "i" && kind != "u")
        refuse("an array of " + text_of(type));
    if (nb::cast<std::size_t>(array.attr("size")) == 0) refuse("an array without elements");
    for (const char* bound : {"min", "max"}) {
        const nb::object value = nb::int_(array.attr(bound)());
        if (value < nb::int_(0) || value > nb::int_(255)) refuse(text_of(value));
    }
    return nb::cast<Labels>(as_array(array, "uint8"));
}

/// Takes `array`, of numpy, as an Array. Throws BadInput if it has another shape.
template <class Array>
Array of_shape(const nb::object& array, const char* key, const char* accepted) {
    try {
        return nb::cast<Array>(array);
    } catch (const nb::cast_error&) {
        throw BadInput("Body()", key, "an array of shape " + text_of(array.attr("shape")), accepted);
    }
}

/// Converts `given`, a number or a list of numbers, to a list.
std::vector<double> numbers_of(nb::handle given, const char* key) {
    try {
        return nb::cast<std::vector<double>>(
            nb::module_::import_("numpy").attr("atleast_1d")(given).attr("tolist")());
    } catch (const nb::cast_error&) {
        throw BadInput("Body()", key, text_of(nb::borrow(given)), "a number, or a list of numbers");
    }
}

/// Expands `given`, either `count` numbers or one number for all, to `count` numbers.
std::vector<double> one_or_each(const std::vector<double>& given, std::size_t count, const char* key,
                                const std::string& accepted) {
    if (given.size() == count) return given;
    if (given.size() != 1) throw BadInput("Body()", key, std::to_string(given.size()) + " numbers", accepted);
    return std::vector<double>(count, given.front());
}

std::uint32_t groups_of(const std::vector<std::string>& names) {
    std::uint32_t bits = 0;
    for (const std::string& name : names) {
        if (name == "face") {
            bits |= FACE_BITS;
        } else if (name == "edge") {
            bits |= EDGE_BITS;
        } else if (name == "corner") {
            bits |= CORNER_BITS;
        } else {
            throw BadInput("Body()", "springs", name, "\"face\", \"edge\" or \"corner\"");
        }
    }
    return bits;
}

Body body_of(const Labels& labels, const std::vector<double>& spacing, const std::vector<double>& stiffness,
             const std::vector<double>& mass, const std::vector<std::string>& springs,
             const std::optional<Mask>& pinned, const std::array<double, 3>& gravity,
             const std::optional<Vectors>& load, double damping, double time_step, const std::string& name) {
    VoxelGrid grid;
    const auto axis = [&](std::size_t n) { return int(labels.shape(n)); };
    grid.dims = {axis(0), axis(1), axis(2)};
    const auto along = one_or_each(spacing, 3, "spacing", "one number, or one for each of x, y and z");
    grid.spacing = {along[0], along[1], along[2]};
    grid.label.assign(labels.data(), labels.data() + labels.size());
    const auto last = std::max_element(grid.label.begin(), grid.label.end());
    if (last == grid.label.end() || *last == 0)
        throw BadInput("Body()", "labels", "an array without a label above 0", "at least one active voxel");
    const std::size_t materials = *last;
    Problem problem;
    if (materials == 1) {
        problem = make_lattice_problem(grid, groups_of(springs));
        problem.materials[0].mass = one_or_each(mass, 1, "mass", "one number").front();
        const auto groups =
            one_or_each(stiffness, 3, "stiffness", "one number, or one for each of face, edge and corner");
        std::copy(groups.begin(), groups.end(), problem.group_stiffness.begin());
    } else {
        problem = make_lattice_problem(grid, groups_of(springs));
        const std::string accepted =
            "one number, or one for each of the " + std::to_string(materials) + " labels";
        const auto masses = one_or_each(mass, materials, "mass", accepted);
        const auto each = one_or_each(stiffness, materials, "stiffness", accepted);
        problem.materials.resize(materials);
        for (std::size_t m = 0; m < materials; ++m) problem.materials[m] = {masses[m], each[m]};
    }
    problem.gravity = vec3(gravity);
    problem.damping = damping;
    problem.time_step = time_step;
    if (load) problem.load = list_of(*load, problem.particle_count(), "load");
    if (pinned) {
        for (std::size_t n = 0; n < 3; ++n) {
            if (pinned->shape(n) != labels.shape(n))
                throw BadInput("Body()", "pinned", "an array of another shape", "the shape of labels");
        }
        std::vector<std::uint8_t> of_particles;
        for (const std::uint32_t voxel : problem.lattice.voxel)
            of_particles.push_back(pinned->data()[voxel] ? 1 : 0);
        pin(problem, std::move(of_particles));
    }
    try {
        return {std::make_shared<const Scene>(scene_of(name, std::move(problem)))};
    } catch (const std::invalid_argument& error) {
        throw std::invalid_argument(std::string("Body(): ") + error.what());
    }
}

nb::object neighbours_of(const Body& body) {
    const LatticeSprings springs(body.problem());
    return array_of<std::int32_t>(body.count(), neighbour_count, [&](std::size_t i, std::int32_t* to) {
        std::fill(to, to + neighbour_count, -1);
        springs.all_of(i, [&](std::uint32_t j, const Direction& direction) {
            to[std::size_t(direction.bit)] = std::int32_t(j);
        });
    });
}

nb::object neighbour_stiffness_of(const Body& body) {
    const LatticeSprings springs(body.problem());
    return array_of<double>(body.count(), neighbour_count, [&](std::size_t i, double* to) {
        std::fill(to, to + neighbour_count, 0.0);
        springs.all_of(i, [&](std::uint32_t j, const Direction& direction) {
            to[std::size_t(direction.bit)] = body.problem().spring_stiffness(i, j, direction);
        });
    });
}

/// A new numpy array with a row of `columns` elements per spring, one-dimensional if `columns` is 0.
/// fill(spring, pointer to its first element) fills each row.
template <class T, class Fill>
nb::object of_springs(const Body& body, std::size_t columns, Fill fill) {
    const std::vector<Spring> springs = list_springs(body.problem());
    return array_of<T>(springs.size(), columns, [&](std::size_t n, T* to) { fill(springs[n], to); });
}

// --- A simulation -----------------------------------------------------------------------------------------

/// The Python class Simulation: a C++ Simulation, and the array of displacements on the card.
class Running {
public:
    Running(const Body& body, const std::string& backend) : body_(body) {
        const nb::gil_scoped_release free;
        if (!asks_for_auto(backend)) {
            made_.emplace(*body.scene, BackendSpec::parse(backend));
            return;
        }
        AutoChoice choice = choose_backend(backend, *body.scene, [&](Backend& candidate) {
            return SceneRunner(*body.scene).unsupported(candidate).empty();
        });
        made_.emplace(*body.scene, choice.spec, std::move(choice.backend));
    }

    Simulation& simulation() { return *made_; }
    const Body& body() const { return body_; }

    /// Makes `count` steps. Makes many steps in several calls, and lets Python handle signals between them.
    void step(int count) {
        if (count < 0) throw BadInput("step()", "count", std::to_string(count), "0 or more");
        const nb::gil_scoped_release free;
        while (count > piece_) {
            using Clock = std::chrono::steady_clock;
            const auto begin = Clock::now();
            simulation().step(piece_);
            simulation().backend().synchronize();
            count -= piece_;
            if (Clock::now() - begin < std::chrono::milliseconds(50))
                piece_ = piece_ > (1 << 29) ? piece_ : 2 * piece_;
            check_signals();
        }
        if (count > 0) simulation().step(count);
    }

    nb::object displacement() {
        const State& state = latest();
        return vectors(state.displacement.size(), [&](std::size_t i) { return state.displacement[i]; });
    }
    nb::object velocity() {
        const State& state = latest();
        const double time_step = body_.problem().time_step;
        return vectors(state.increment.size(), [&](std::size_t i) { return state.increment[i] / time_step; });
    }
    nb::object position() {
        const State& state = latest();
        return vectors(state.displacement.size(), [&](std::size_t i) {
            return body_.problem().rest_position[i] + state.displacement[i];
        });
    }

    /// Computes the displacements on the card. Returns their address there (x, y, z and 0 per particle,
    /// float32) and the card's number. Throws Unavailable if the backend's state is not in CUDA's memory.
    std::pair<std::uintptr_t, int> on_card() {
        const nb::gil_scoped_release free;
        if (feed_ == nullptr || uploads_ != simulation().uploads()) {
            feed_.reset();
            std::vector<std::uint32_t> all(body_.count());
            std::iota(all.begin(), all.end(), 0U);
            if (FeedFacet* const feeds = simulation().backend().feeds()) feed_ = feeds->device_feed(all);
            uploads_ = simulation().uploads();
        }
        if (feed_ == nullptr)
            throw Unavailable(
                simulation().backend_label() +
                " has no displacements in CUDA's memory; `displacement` copies them to the host");
        return {reinterpret_cast<std::uintptr_t>(feed_->read()), feed_->device()};
    }

    /// Frees the array of displacements on the card, which must not outlive the backend that fills it.
    void forget_feed() { feed_.reset(); }

private:
    const State& latest() {
        const nb::gil_scoped_release free;
        return simulation().state();
    }

    /// The initial number of steps between two checks for signals. These steps take a fraction of a second on
    /// the slowest backend.
    int first_piece() const { return int(std::clamp(2'000'000 / double(body_.count() + 1), 1.0, 1e6)); }

    const Body body_;
    std::optional<Simulation> made_;
    std::unique_ptr<DeviceFeed> feed_;  ///< destroyed before the simulation
    std::uint64_t uploads_ = 0;
    int piece_ = first_piece();
};

/// Describes displacements in a card's memory to other libraries. Shape (n, 3), strides (16, 4) bytes.
struct CardArray {
    nb::object keeps;  ///< the object that owns the memory, usually the Simulation
    std::uintptr_t address;
    int device;
    std::size_t count;

    nb::dict interface() const {
        nb::dict all;
        all["shape"] = nb::make_tuple(count, 3);
        all["typestr"] = "<f4";
        all["data"] = nb::make_tuple(address, true);
        all["strides"] = nb::make_tuple(16, 4);
        all["version"] = 3;
        return all;
    }
    nb::object dlpack_array() const {
        const std::size_t shape[2] = {count, 3};
        const std::int64_t strides[2] = {4, 1};
        // With nb::array_api the result has a method __dlpack__, which takes a version and a stream. Without
        // it nanobind returns a bare capsule.
        return nb::cast(nb::ndarray<nb::array_api, float, nb::device::cuda>(
            reinterpret_cast<void*>(address), 2, shape, keeps, strides, nb::dtype<float>(),
            nb::device::cuda::value, device));
    }
};

// --- Studies and results ----------------------------------------------------------------------------------

/// A result read from its JSON, as far as a table needs it.
Result result_of(const nlohmann::json& json) {
    Result result;
    result.context = json.at("context");
    for (const char* list : {"benchmarks", "verification", "skipped", "failed"}) {
        for (Row& row : rows_from_json(json.at(list))) result.rows(list).push_back(std::move(row));
    }
    return result;
}

std::string study_json(const std::string& name, const std::optional<Body>& body, int steps,
                       const std::vector<std::string>& backends, const std::vector<std::string>& scenes,
                       const std::optional<int>& repetitions, const std::optional<std::string>& out,
                       const std::string& worker) {
    const nb::gil_scoped_release free;
    Study study = load_study(name);
    if (body) {
        StudyScene only{.scene = body->scene->name, .steps = steps, .backends = {}, .built = body->scene};
        if (!study.scenes.empty()) only.settings = study.scenes.front().settings;
        study.scenes = {std::move(only)};
    }
    StudyOptions options;
    options.backends = backends;
    options.scenes = scenes;
    options.repetitions = repetitions;
    if (out) options.out = *out;
    options.worker = worker;
    const Result result = run_study(std::move(study), options);
    const std::string text = json_text(nlohmann::json(result), 2);
    if (is_unfinished(result)) {
        const nb::gil_scoped_acquire gil;
        PyErr_SetString(PyExc_KeyboardInterrupt, out ? ("what was finished is in " + *out).c_str() : "");
        throw nb::python_error();
    }
    return text;
}

std::string table_of(const std::string& text, int width) {
    const nlohmann::json json = nlohmann::json::parse(text);
    const nlohmann::json study = json.at("context").at("voxspring").value("study", nlohmann::json::object());
    const std::vector<std::string> kinds = study_kind_names();
    std::ostringstream table;
    if (std::count(kinds.begin(), kinds.end(), study.value("kind", "")) > 0) {
        print_result(read_result(json), table, TableWidth(width));
    } else {
        print_table(result_of(json), table, TableWidth(width));  // of kind judge, or of an older file
    }
    return table.str();
}

// --- A trial of a kernel ----------------------------------------------------------------------------------

class Trial {
public:
    Trial(const Body& body, int steps, int repetitions, Kernel kernel) : body_(body) {
        const nb::gil_scoped_release free;
        trial_ = std::make_unique<KernelTrial>(body.scene, steps, repetitions, std::move(kernel),
                                               [](int, int) { check_signals(); });
    }
    void repeat(const std::function<std::optional<double>()>& run) { trial_->repeat(run); }
    void judge_state(const Vectors& displacement, const Vectors& increment) {
        trial_->judge_state(state_of(displacement, increment));
    }
    nb::object strained_start() {
        const State* start = nullptr;
        {
            const nb::gil_scoped_release free;
            start = trial_->strained_start();
        }
        if (start == nullptr) return nb::none();
        return vectors(body_.count(), [&](std::size_t i) { return start->displacement_of(i); });
    }
    void judge_strained(const Vectors& displacement, const Vectors& increment) {
        trial_->judge_strained(state_of(displacement, increment));
    }
    std::string json() const { return json_text(nlohmann::json(trial_->result()), 2); }

private:
    State state_of(const Vectors& displacement, const Vectors& increment) const {
        return {list_of(displacement, body_.count(), "x"), list_of(increment, body_.count(), "v")};
    }

    const Body body_;
    std::unique_ptr<KernelTrial> trial_;
};

Formulation formulation_named(const std::string& name) {
    std::vector<std::string> names;
    for (const Formulation one : every_formulation) {
        if (to_string(one) == name) return one;
        names.push_back(to_string(one));
    }
    throw BadInput("judge()", "formulation", name,
                   "one of position, paper, displacement, increment, compensated");
}

Precision precision_named(const std::string& name) {
    for (const Precision one : {Precision::float32, Precision::float64}) {
        if (to_string(one) == name) return one;
    }
    throw BadInput("judge()", "precision", name, "float32 or float64");
}

}  // namespace

NB_MODULE(_core, m) {
    m.doc() = "The C++ half of voxspring; use the package, which documents it.";

    // Translators of exceptions are tried in the reverse order of registration.
    nb::exception<Unavailable>(m, "Unavailable", PyExc_RuntimeError).doc() =
        "There is no such device, driver or library here.";
    nb::exception<DeviceError>(m, "DeviceError", PyExc_RuntimeError).doc() =
        "The device or its driver failed. The simulation can only go on by switch_to().";
    nb::exception<Refused>(m, "Refused", PyExc_RuntimeError).doc() =
        "The simulation refused an edit, a hold or a backend; nothing has changed.";
    static PyObject* bad_input = nb::exception<BadInput>(m, "BadInput", PyExc_ValueError).ptr();
    m.attr("BadInput").doc() = "A value is not accepted; the message names it and says what is accepted.";
    nb::register_exception_translator([](const std::exception_ptr& error, void*) {
        try {
            std::rethrow_exception(error);
        } catch (const std::invalid_argument& bad) {  // BadSpecification derives from it
            PyErr_SetString(bad_input, bad.what());
        } catch (const std::system_error& failed) {
            PyErr_SetString(PyExc_OSError, failed.what());
        }
    });

    nb::class_<Body>(m, "Body",
                     "A body: particles at the centres of active voxels, or at the corners if its scene says "
                     "so, and springs between neighbours.\n\n"
                     "Lengths, times and masses are in one consistent set of units, the body's own. Unless "
                     "they say otherwise, arrays have one row per particle, in the order of voxels with x "
                     "fastest; each is a new copy.")
        .def(
            "__init__",
            [](Body* self, nb::handle labels, nb::handle spacing, nb::handle stiffness, nb::handle mass,
               const std::vector<std::string>& springs, nb::handle pinned,
               const std::array<double, 3>& gravity, nb::handle load, double damping, double time_step,
               const std::string& name) {
                std::optional<Mask> fixed;
                if (!pinned.is_none())
                    fixed = of_shape<Mask>(as_array(pinned, "bool"), "pinned", "the shape of labels");
                std::optional<Vectors> forces;
                if (!load.is_none())
                    forces = of_shape<Vectors>(
                        nb::module_::import_("numpy").attr("ascontiguousarray")(load, "float64"), "load",
                        "three numbers per particle: (n, 3)");
                new (self) Body(body_of(labels_of(labels), numbers_of(spacing, "spacing"),
                                        numbers_of(stiffness, "stiffness"), numbers_of(mass, "mass"), springs,
                                        fixed, gravity, forces, damping, time_step, name));
            },
            "labels"_a, nb::kw_only(), "spacing"_a = 1.0, "stiffness"_a = 1.0, "mass"_a = 1.0,
            "springs"_a = std::vector<std::string>{"face", "edge"}, "pinned"_a = nb::none(),
            "gravity"_a = std::array<double, 3>{}, "load"_a = nb::none(), "damping"_a = 0.0,
            "time_step"_a = 0.0, "name"_a = "body",
            nb::sig("def __init__(self, labels: ArrayLike, *, spacing: float | Sequence[float] = 1.0, "
                    "stiffness: float | Sequence[float] = 1.0, mass: float | Sequence[float] = 1.0, "
                    "springs: Sequence[str] = ('face', 'edge'), pinned: ArrayLike | None = None, "
                    "gravity: Sequence[float] = (0.0, 0.0, 0.0), load: ArrayLike | None = None, "
                    "damping: float = 0.0, time_step: float = 0.0, name: str = 'body') -> None"),
            "labels[x, y, z] is 0 for an inactive voxel and m for one of material m, 1 to 255.\n\n"
            "spacing: distance between voxel centres, one number or one for each axis. stiffness: force per "
            "length, one number; with one material also one for each of face, edge and corner springs, "
            "otherwise "
            "one for each material. mass: of a particle, one number or one for each material. springs: the "
            "groups "
            "of neighbours that are joined. pinned[x, y, z]: voxels that do not move. gravity: acceleration. "
            "load: "
            "forces, (n, 3). damping: the share of its velocity that a particle loses in a step, 0 to 2. "
            "time_step: 0 is half of the stable one. name: in rows of results. Raises BadInput.")
        .def_prop_ro("name", [](const Body& body) { return body.scene->name; })
        .def_prop_ro("description", [](const Body& body) { return body.scene->description; })
        .def_prop_ro(
            "notes", [](const Body& body) { return body.scene->notes; },
            "What the loader guessed, rounded or left out, as sentences.")
        .def("__len__", &Body::count, "The number of particles.")
        .def_prop_ro(
            "dims",
            [](const Body& body) {
                const glm::ivec3 dims = body.problem().lattice.dims;
                return std::array<int, 3>{dims.x, dims.y, dims.z};
            },
            "Voxels along x, y, z; (0, 0, 0) for a network without a grid.")
        .def_prop_ro(
            "spacing",
            [](const Body& body) {
                const glm::dvec3 spacing = body.problem().lattice.spacing;
                return std::array<double, 3>{spacing.x, spacing.y, spacing.z};
            },
            "Distance between voxel centres along x, y, z.")
        .def_prop_ro(
            "gravity",
            [](const Body& body) {
                const glm::dvec3 gravity = body.problem().gravity;
                return std::array<double, 3>{gravity.x, gravity.y, gravity.z};
            },
            "Acceleration of every particle.")
        .def_prop_ro(
            "damping", [](const Body& body) { return body.problem().damping; },
            "The share of its velocity that a particle loses in a step (lambda).")
        .def_prop_ro("time_step", [](const Body& body) { return body.problem().time_step; })
        .def_prop_ro(
            "stable_time_step", [](const Body& body) { return body.scene->stable_time_step; },
            "A time step that is stable for small displacements: a lower bound of the largest.")
        .def_prop_ro(
            "rest_position",
            [](const Body& body) {
                return vectors(body.count(), [&](std::size_t i) { return body.problem().rest_position[i]; });
            },
            "Positions at rest, float64 (n, 3).")
        .def_prop_ro(
            "start",
            [](const Body& body) {
                return vectors(body.count(), [&](std::size_t i) {
                    return body.problem().rest_position[i] + body.scene->state.displacement_of(i);
                });
            },
            "Positions at the start, float64 (n, 3).")
        .def_prop_ro(
            "start_velocity",
            [](const Body& body) {
                return vectors(body.count(), [&](std::size_t i) {
                    return body.scene->state.increment_of(i) / body.problem().time_step;
                });
            },
            "Velocities at the start, float64 (n, 3).")
        .def_prop_ro(
            "load",
            [](const Body& body) {
                return vectors(body.count(), [&](std::size_t i) {
                    return body.problem().load.empty() ? glm::dvec3(0) : body.problem().load[i];
                });
            },
            "Constant forces, float64 (n, 3).")
        .def_prop_ro(
            "mass",
            [](const Body& body) {
                return array_of<double>(body.count(), 0, [&](std::size_t i, double* to) {
                    *to = body.problem().material_of(i).mass;
                });
            },
            "Masses, float64 (n,).")
        .def_prop_ro(
            "pinned",
            [](const Body& body) {
                return array_of<bool>(body.count(), 0,
                                      [&](std::size_t i, bool* to) { *to = body.problem().is_pinned(i); });
            },
            "Which particles do not move, bool (n,).")
        .def_prop_ro(
            "voxel",
            [](const Body& body) {
                const Lattice& lattice = body.problem().lattice;
                return array_of<std::int32_t>(lattice.voxel.size(), 3, [&](std::size_t i, std::int32_t* to) {
                    const glm::ivec3 at = lattice.coordinates(lattice.voxel[i]);
                    for (int axis = 0; axis < 3; ++axis) to[axis] = at[axis];
                });
            },
            "Voxel of each particle by x, y, z, int32 (n, 3); empty for a network without a grid.")
        .def_prop_ro(
            "springs",
            [](const Body& body) {
                return of_springs<std::int32_t>(body, 2, [](const Spring& spring, std::int32_t* to) {
                    to[0] = std::int32_t(spring.first);
                    to[1] = std::int32_t(spring.second);
                });
            },
            "The two particles of each spring, int32 (m, 2); the first number is the smaller one.")
        .def_prop_ro(
            "rest_length",
            [](const Body& body) {
                return of_springs<double>(body, 0,
                                          [](const Spring& spring, double* to) { *to = spring.rest_length; });
            },
            "Rest length of each spring, float64 (m,).")
        .def_prop_ro(
            "stiffness",
            [](const Body& body) {
                return of_springs<double>(body, 0,
                                          [](const Spring& spring, double* to) { *to = spring.stiffness; });
            },
            "Stiffness of each spring, force per length, float64 (m,).")
        .def_prop_ro(
            "neighbours", &neighbours_of,
            "The particle at the other end of each spring of the grid, int32 (n, 26); -1: no spring. "
            "Column b is direction b of `directions`.")
        .def_prop_ro("neighbour_stiffness", &neighbour_stiffness_of,
                     "Stiffness of the springs of `neighbours`, float64 (n, 26); 0: no spring.")
        .def_prop_ro(
            "direction_length",
            [](const Body& body) {
                return array_of<double>(neighbour_count, 0, [&](std::size_t b, double* to) {
                    *to = body.problem().rest_length[b];
                });
            },
            "Rest length of the springs in each column of `neighbours`, float64 (26,).")
        .def_prop_ro_static(
            "directions",
            [](nb::handle) {
                return array_of<std::int32_t>(neighbour_count, 3, [](std::size_t b, std::int32_t* to) {
                    for (int axis = 0; axis < 3; ++axis) to[axis] = directions()[b].offset[axis];
                });
            },
            "Voxel offsets of the 26 neighbours, int32 (26, 3): 6 faces, 12 edges, 8 corners.");

    m.def(
        "load_scene",
        [](const std::string& argument) {
            const nb::gil_scoped_release free;
            return Body{std::make_shared<const Scene>(load_scene(argument))};
        },
        "argument"_a);

    nb::class_<CardArray>(
        m, "CardArray",
        "Displacements in the card's memory, float32, shape (n, 3), strides (16, 4) bytes. For "
        "torch.from_dlpack(), cupy.asarray() and the like. JAX takes compact arrays alone: give it a copy. "
        "Do not write to it. Reading Simulation.displacement_on_card again overwrites this memory; after "
        "take_hold(), let_go() or reset() it frees this memory, and switch_to() frees it at once. Copy what "
        "you keep.")
        .def(
            "__init__",
            [](CardArray* self, nb::object owner, std::uintptr_t address, std::size_t count, int device) {
                new (self) CardArray{std::move(owner), address, device, count};
            },
            "owner"_a, "address"_a, "count"_a, "device"_a = 0,
            "Describes `count` displacements at `address` in the memory of card `device`. The array keeps "
            "a reference to `owner`, the object that owns the memory.")
        .def_prop_ro("__cuda_array_interface__", &CardArray::interface)
        .def("__dlpack__",
             [](const CardArray& array, const nb::kwargs& options) {
                 return array.dlpack_array().attr("__dlpack__")(**options);
             })
        .def("__dlpack_device__", [](const CardArray& array) { return nb::make_tuple(2, array.device); });

    nb::class_<Running>(
        m, "Simulation",
        "A body that steps on one backend, and that a user holds, cuts and sews meanwhile.\n\n"
        "Places are in the body's unit of length. Not thread-safe; other threads of Python run "
        "while it steps. After a DeviceError every call that needs the device raises the same error; "
        "switch_to() goes on from the state that was read last.")
        .def(nb::init<const Body&, const std::string&>(), "body"_a, "backend"_a = "auto",
             "`backend` is what the program's --backend takes: NAME[:key=value,...], or auto. Raises "
             "BadInput for "
             "a wrong one, Unavailable if its device is missing, and RuntimeError if the backend refuses the "
             "body.")
        .def("step", &Running::step, "count"_a = 1,
             "Takes `count` steps. May return before the steps have run. Ctrl-C ends a long call between two "
             "steps.")
        .def(
            "synchronize",
            [](Running& self) {
                const nb::gil_scoped_release free;
                self.simulation().backend().synchronize();
            },
            "Waits for the steps so far.")
        .def_prop_ro(
            "steps", [](Running& self) { return self.simulation().steps(); },
            "Number of steps since the start.")
        .def_prop_ro(
            "backend", [](Running& self) { return self.simulation().backend_label(); },
            "The backend with its formulation, precision and tuning.")
        .def_prop_ro("body", &Running::body)
        .def_prop_ro("displacement", &Running::displacement,
                     "Positions less positions at rest, float64 (n, 3), copied from the device.")
        .def_prop_ro("velocity", &Running::velocity,
                     "Movement in the last step over the time step, float64 (n, 3), copied from the device.")
        .def_prop_ro("position", &Running::position, "Positions, float64 (n, 3), copied from the device.")
        .def_prop_ro(
            "displacement_on_card",
            [](nb::handle_t<Running> self) {
                Running& running = nb::cast<Running&>(self);
                const auto [address, device] = running.on_card();
                return CardArray{nb::borrow(self), address, device, running.body().count()};
            },
            "Displacements in CUDA's memory, a CardArray. Backends keep positions or displacements, in an "
            "order and in buffers that suit their threads: the card computes this array from them, in the "
            "order of particles. "
            "Nothing passes through the host. Raises Unavailable if the backend's state is not in CUDA's "
            "memory.")
        .def(
            "take_hold",
            [](Running& self, const std::array<double, 3>& place, double radius, double stiffness) {
                const nb::gil_scoped_release free;
                require_done(self.simulation().take_hold(vec3(place), radius, stiffness));
            },
            "place"_a, "radius"_a, "stiffness"_a,
            "Takes hold of the particles within `radius` of `place`, at least of the nearest one and at most "
            "of the nearest 4096. "
            "`stiffness`, a "
            "force per length, is the sum over all springs of the hand, reduced if the time step would "
            "become "
            "unstable. Raises Refused.")
        .def(
            "drag",
            [](Running& self, const std::array<double, 3>& moved) { self.simulation().drag(vec3(moved)); },
            "moved"_a,
            "Moves the hand to `moved`, a displacement from where it took hold. Does nothing without a hold.")
        .def_prop_ro(
            "force",
            [](Running& self) {
                const nb::gil_scoped_release free;
                const glm::dvec3 force = self.simulation().force();
                return std::array<double, 3>{force.x, force.y, force.z};
            },
            "The force on the hand in the latest step; 0 if the hand holds nothing.")
        .def(
            "let_go",
            [](Running& self) {
                const nb::gil_scoped_release free;
                self.simulation().let_go();
            },
            "Lets go of what the hand holds.")
        .def(
            "cut",
            [](Running& self, const std::array<std::array<double, 3>, 4>& swept) {
                const nb::gil_scoped_release free;
                const auto change =
                    self.simulation().cut({vec3(swept[0]), vec3(swept[1]), vec3(swept[2]), vec3(swept[3])});
                require_done(change.refused);
                return change.springs;
            },
            "swept"_a,
            "Cuts every spring that passes through a quad and returns how many. The blade's edge lies from "
            "swept[0] to swept[1] at the beginning of the stroke, and from swept[2] to swept[3] at its end. "
            "Raises Refused.")
        .def(
            "suture",
            [](Running& self, const std::array<double, 3>& a, const std::array<double, 3>& b, double radius) {
                const nb::gil_scoped_release free;
                const auto change = self.simulation().suture(vec3(a), vec3(b), radius);
                require_done(change.refused);
                return change.springs;
            },
            "a"_a, "b"_a, "radius"_a,
            "Restores the cut springs within `radius` of the line from `a` to `b`. If there are none, a new "
            "spring joins the particle nearest to `a` with the one nearest to `b`. Returns the number of "
            "springs restored or joined. Raises Refused.")
        .def(
            "reset",
            [](Running& self) {
                const nb::gil_scoped_release free;
                self.simulation().reset();
            },
            "Goes back to the start and undoes all cuts, sutures and holds.")
        .def(
            "switch_to",
            [](Running& self, const std::string& backend) {
                const nb::gil_scoped_release free;
                require_done(self.simulation().switch_to(BackendSpec::parse(backend),
                                                         [&self] { self.forget_feed(); }));
            },
            "backend"_a, "Goes on with another backend from the present state. Raises BadInput and Refused.")
        .def(
            "save",
            [](Running& self, const std::string& file) {
                const nb::gil_scoped_release free;
                Simulation& simulation = self.simulation();
                simulation.keep_state();
                if (simulation.kept_steps() != simulation.steps())
                    throw Refused("the state is no longer finite");
                simulation.save(file);
            },
            "file"_a,
            "Writes the state as `voxspring run --out FILE.npz` does. "
            "Raises OSError, and Refused if the state is not finite.");

    nb::class_<Trial>(m, "Trial")
        .def(
            "__init__",
            [](Trial* self, const Body& body, int steps, int repetitions, const std::string& name,
               const std::string& formulation, const std::string& precision, const std::string& api,
               const std::string& device, const std::string& clock, const std::string& family,
               std::optional<int> lines) {
                Kernel kernel{.name = name,
                              .formulation = formulation_named(formulation),
                              .precision = precision_named(precision)};
                kernel.capabilities.api = api;
                kernel.capabilities.device = device;
                kernel.capabilities.clock = clock;
                kernel.capabilities.family = family;
                kernel.capabilities.deterministic = false;  // its bits may differ from run to run
                if (lines) kernel.counters.add("lines_of_code", double(*lines), Unit::number, Better::less);
                new (self) Trial(body, steps, repetitions, std::move(kernel));
            },
            "body"_a, "steps"_a, "repetitions"_a, "name"_a, "formulation"_a, "precision"_a, "api"_a,
            "device"_a, "clock"_a, "family"_a, "lines"_a.none())
        .def("repeat", &Trial::repeat, "run"_a)
        .def("judge_state", &Trial::judge_state, "displacement"_a, "increment"_a)
        .def("strained_start", &Trial::strained_start)
        .def("judge_strained", &Trial::judge_strained, "displacement"_a, "increment"_a)
        .def("json", &Trial::json);

    m.def("study", &study_json, "name"_a, "body"_a.none(), "steps"_a, "backends"_a, "scenes"_a,
          "repetitions"_a.none(), "out"_a.none(), "worker"_a);
    m.def("table", &table_of, "json"_a, "width"_a = 0);
    m.def("cpu", [] { return build_context().at("cpu").get<std::string>(); });
    m.def("version", [] { return build_context().at("commit").get<std::string>(); });
}
