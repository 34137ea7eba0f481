// The backends of this program by name. Every backend registers itself with a static initialiser.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "backends/backend.h"

namespace voxspring {

/// The accepted values of a tuning parameter, the default first. An empty list accepts a positive integer or
/// "auto", which is the default.
using TuningValues = std::vector<std::string>;

/// BackendEntry::formulations of a backend that has all of them.
inline const std::vector<Formulation> every_formulation = {Formulation::increment, Formulation::position,
                                                           Formulation::displacement,
                                                           Formulation::compensated, Formulation::paper};

/// Two values of a tuning parameter that give the same bits: with `skipping` the backend leaves out work that
/// a problem does not need, with `stepping` it does all of it.
struct Skip {
    std::string parameter, skipping, stepping;
};

/// How a backend finds the neighbours of a particle: by their place in the grid (implicit addressing), or in
/// lists (explicit addressing).
enum class Addressing : std::uint8_t { by_grid, by_lists };
std::string to_string(Addressing addressing);

/// What the harness knows of a backend before any device is touched.
struct BackendEntry {
    /// The backend's name, which is also that of its file and of its test (cpu_reference has none), and the
    /// `backend` field of a result.
    std::string name;
    /// The API that it is written in (Api::name). Backends of one API share a driver.
    std::string api = host_api;
    Addressing addressing = Addressing::by_lists;
    std::string summary;        ///< one sentence
    std::string strength = {};  ///< why it is fast, as text for users; empty: because of its addressing
    std::vector<Precision> precisions{Precision::float32};         ///< the default first
    std::vector<Formulation> formulations{Formulation::position};  ///< the default first
    std::map<std::string, TuningValues> tuning;
    std::function<std::unique_ptr<Backend>(const Options&)> make;
    /// About how many bytes of memory upload() would take. It is the device's memory if the device has its
    /// own.
    std::function<std::uint64_t(const Problem&, const Options&)> bytes;
    /// The most by which a particle's movement per step may fall short, in lattice spacings, because of an
    /// option such as a sleep threshold. Empty function: 0.
    std::function<double(const Options&)> admitted_spacings_per_step = {};
    /// The relative error of the backend's roots and divisions, if options ask for approximations. Empty
    /// function: about the rounding error of its precision.
    std::function<double(const Options&)> root_error = {};
    /// Returns an empty string, or why these values do not go together ("rest=flush requires
    /// formulation=increment or formulation=compensated"). Empty function: all values go together.
    std::function<std::string(const Options&)> refused_options = {};

    /// This backend's tuning parameters that only decide whether needless work is left out.
    std::vector<Skip> skips() const;
};

/// `static const Registered entry({...});` in a backend's file adds the backend to registry().
struct Registered {
    explicit Registered(BackendEntry entry);
};

/// Every backend of this build, by name.
const std::map<std::string, BackendEntry>& registry();

/// The backends that this build leaves out (CMakeLists.txt): the reason by the backend's name.
const std::map<std::string, std::string>& left_out();

/// A backend specification was refused. The message names what is accepted.
class BadSpecification : public std::invalid_argument {
    using std::invalid_argument::invalid_argument;
};

/// The options of a backend specification: {"rest=skip", "threads=2"} of "cpu_parallel:rest=skip,threads=2".
/// Throws BadSpecification if there is none after the colon or after a comma.
std::vector<std::string> listed_options(const std::string& specification);

/// A backend and its options, as a user writes them: `NAME[:key=value[,key=value]...]`. A key is `precision`,
/// `formulation` or a tuning parameter of that backend, and is named at most once.
struct BackendSpec {
    const BackendEntry* entry = nullptr;
    Options options;

    /// Throws BadSpecification if `text` is not valid. `auto` is not valid here, because its backend depends
    /// on the scene.
    static BackendSpec parse(const std::string& text);
    std::unique_ptr<Backend> make() const { return entry->make(options); }
    double admitted_spacings_per_step() const {
        return entry->admitted_spacings_per_step ? entry->admitted_spacings_per_step(options) : 0;
    }
    double root_error() const { return entry->root_error ? entry->root_error(options) : 0; }
    /// "mask=stencil,threads=2": all tuning parameters, empty if there are none.
    std::string tuning() const;
    /// The whole specification, which parse() accepts: "NAME:formulation=...,precision=...[,key=value...]".
    std::string text() const;
    /// NAME/formulation/precision[/tuning], with the tuning parameters that are not at their default. The
    /// name of a result row is its scene followed by this label. Two backends with the same formulation,
    /// precision and tuning parameters at their defaults differ only in NAME, so Google Benchmark's
    /// compare.py pairs them.
    std::string label() const;
};

}  // namespace voxspring
