// What mutation_test.py builds from mutated sources: cpu_parallel, and the bodies of CUDA's kernels on the
// host, against states that the unmutated program wrote.
//
//     mutants write FILE                writes states and spreads of the plain reference
//     mutants check FILE STRATEGY...    prints three numbers
//
// The numbers: how many runs exceed the bound of the conformance test after 20 steps; whether a run fails the
// gate after as many steps as `table1` and `figure7` take; and how many runs there were.
//
// STRATEGY: cpu_parallel, implicit, tile, groups, springs, delta or scatter. Of the last six only those are
// built in that the macro STRATEGIES names. Exit code 3: a strategy is not built in.
#include <algorithm>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <iostream>
#include <memory>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

#include "backends/cpu/perturbed_reference.h"
#include "backends/registry.h"
#include "harness/verification/error_threshold.h"
#include "harness/verification/verify.h"
#include "tests/host_kernels.h"
#include "tests/support.h"

namespace voxspring::testing {
namespace {

constexpr int brief = 20, full = 1000;

struct Body {
    std::string name;
    Problem problem;
    State start;
    std::vector<SpringEdit> edits;  ///< one every three steps
};

/// Wide enough for blocks of particles with a full stencil.
std::vector<Body> bodies() {
    std::vector<Body> all;
    const auto add = [&](const std::string& name, Problem problem) {
        problem.gravity = {8e-4, 0, -2e-3};
        problem.time_step = 0.25;
        Body body{name, std::move(problem), {}, {}};
        body.start = random_state(body.problem, 0.05, 7);
        all.push_back(std::move(body));
    };
    Problem pinned = make_lattice_problem(solid({37, 5, 6}), FACE_BITS | EDGE_BITS);
    pin_base(pinned);
    pinned.group_stiffness = {1, 0.7, 0.5};
    pinned.damping = 0.002;
    add("pinned", pinned);
    // Kernels of the paper's two groups have only these terms compiled in.
    Problem plain = pinned;
    plain.pinned.clear();
    for (std::uint32_t& mask : plain.lattice.mask) mask &= ~PINNED_BIT;
    add("plain", plain);
    Problem labels = make_lattice_problem(random_grid({9, 8, 7}, 0.9, 4, 3), NEIGHBOUR_BITS);
    pin_base(labels);
    labels.materials = {{1, 1}, {2, 0.25}, {0.75, 0.5}};
    labels.load.assign(labels.particle_count(), glm::dvec3(0.002, -0.001, 0));
    add("labels", labels);
    Problem cut = make_lattice_problem(solid({37, 6, 6}), FACE_BITS | EDGE_BITS);
    pin_base(cut);
    add("cut", cut);
    Problem edited = cut;
    SpringEditor editor(edited);
    const glm::dvec3 middle(20.1, 3.2, 3.3);  // where blocks are full
    all.back().edits.push_back(editor.cut(Plane{middle, {1, 0.2, -0.1}}));
    all.back().edits.push_back(editor.suture(Ball{middle, 2.5}, 1.5));
    return all;
}

State play(Backend& backend, const Body& body, int steps) {
    Problem now = body.problem;
    backend.upload(body.problem, body.start);
    int done = 0;
    for (const SpringEdit& edit : body.edits) {
        backend.step(3);
        done += 3;
        apply(now, edit);
        backend.edit(now, edit);
    }
    backend.step(steps - done);
    return backend.download();
}

/// Whether a strategy is built in. All of them take most of this file's compilation.
constexpr bool built(std::string_view strategy) {
    return strategy == "cpu_parallel" ||
           std::string_view(STRATEGIES).find(strategy) != std::string_view::npos;
}

/// `steps` steps of kernel bodies on the host.
template <Formulation formulation>
State play_kernel(const std::string& strategy, const Body& body, int steps) {
    using V = cuda::Variant<float, formulation>;
    const Problem& problem = body.problem;
    [[maybe_unused]] const auto played = [&](cuda::Simulation<V>&& simulation) {
        simulation.step(steps);
        return simulation.download();
    };
    [[maybe_unused]] constexpr cuda::ListLayout layout = cuda::ListLayout::vertical;
    if constexpr (built("implicit")) {
        if (strategy == "implicit")
            return played(cuda::ImplicitSimulation<V>(problem, body.start, cuda::BlockShape{32, 4, 2}));
    }
    if constexpr (built("tile")) {
        if (strategy == "tile") return played(cuda::TileSimulation<V, 32, 4>(problem, body.start));
    }
    if constexpr (built("groups")) {
        if (strategy == "groups")
            return played(cuda::ExplicitSimulation<V>(
                problem, body.start, cuda::list_by_groups<float>(problem, layout, formulation)));
    }
    if constexpr (built("springs")) {
        if (strategy == "springs")
            return played(cuda::ExplicitSimulation<V>(
                problem, body.start, cuda::list_by_springs<float>(problem, layout, formulation)));
    }
    if constexpr (built("delta")) {
        if (strategy == "delta") return played(cuda::DeltaSimulation<V>(problem, body.start, true));
    }
    if constexpr (built("scatter")) {
        if (strategy == "scatter") return played(cuda::ScatterSimulation<V>(problem, body.start));
    }
    throw std::invalid_argument("no strategy " + strategy);
}

/// Whether the strategy takes the body. Kernels are tried without edits.
bool takes(const std::string& strategy, const Body& body) {
    if (strategy == "cpu_parallel") return true;
    return body.edits.empty() && (strategy != "groups" || cuda::grouped_list_refusal(body.problem).empty());
}

State play(const std::string& strategy, Formulation formulation, const Body& body, int steps) {
    if (strategy != "cpu_parallel") {
        return formulation == Formulation::position
                   ? play_kernel<Formulation::position>(strategy, body, steps)
                   : play_kernel<Formulation::increment>(strategy, body, steps);
    }
    const auto backend = BackendSpec::parse("cpu_parallel:formulation=" + to_string(formulation)).make();
    return play(*backend, body, steps);
}

// --- What `mutants write` writes --------------------------------------------------------------------------

/// The expected states of a body, by increments in float64, and how far rounding to float32 moves runs of one
/// formulation away from them.
struct Expected {
    State after_brief, after_full;
    Spread spread;
};

Spread spread_of(const Body& body, const State& expected, Formulation formulation) {
    Spread spread;
    const Comparison motion = differences(expected, body.start);
    spread.motion_max = motion.max;
    spread.motion_rms = motion.rms;
    for (const std::uint64_t run : {0, 1, 2, 3}) {
        const auto backend =
            make_perturbed_reference({run == 0 ? Perturbation::Kind::nearest : Perturbation::Kind::random,
                                      formulation, Precision::float32, 0, run});
        const Comparison apart = differences(play(*backend, body, full), expected);
        spread.max = std::max(spread.max, apart.max);
        spread.rms = std::max(spread.rms, apart.rms);
    }
    return spread;
}

Expected expected_of(const Body& body, Formulation formulation) {
    const auto oracle = BackendSpec::parse("cpu_reference:formulation=increment").make();
    Expected expected{play(*oracle, body, brief), play(*oracle, body, full), {}};
    expected.spread = spread_of(body, expected.after_full, formulation);
    return expected;
}

void write(std::ostream& out, const State& state) {
    const std::uint64_t count = state.displacement.size();
    out.write(reinterpret_cast<const char*>(&count), sizeof count);
    for (const auto* vectors : {&state.displacement, &state.increment})
        out.write(reinterpret_cast<const char*>(vectors->data()),
                  std::streamsize(count * sizeof(glm::dvec3)));
}
State read_state(std::istream& in) {
    std::uint64_t count = 0;
    in.read(reinterpret_cast<char*>(&count), sizeof count);
    State state{std::vector<glm::dvec3>(count), std::vector<glm::dvec3>(count)};
    for (auto* vectors : {&state.displacement, &state.increment})
        in.read(reinterpret_cast<char*>(vectors->data()), std::streamsize(count * sizeof(glm::dvec3)));
    return state;
}

// --- What is checked -------------------------------------------------------------------------------------

/// One strategy on one body.
struct Run {
    std::string strategy;
    const Body* body;
    Formulation formulation;
    std::shared_ptr<const Expected> expected;
};

/// Whether the bound of the conformance test detects the mutant.
bool departs_early(const Run& run) {
    const Comparison early = compare(run.body->problem, play(run.strategy, run.formulation, *run.body, brief),
                                     run.expected->after_brief, Precision::float32, brief, run.formulation);
    if (!early.passed())
        std::cerr << run.strategy << " " << run.body->name << " " << to_string(run.formulation) << ": "
                  << early.reason << "\n";
    return !early.passed();
}

/// Whether the gate detects the mutant.
bool departs_late(const Run& run) {
    const Comparison late =
        differences(play(run.strategy, run.formulation, *run.body, full), run.expected->after_full);
    const Spread& spread = run.expected->spread;
    return !late.passed() || late.max > gate(spread.max, spread.motion_max, 0) ||
           late.rms > gate(spread.rms, spread.motion_rms, 0);
}

std::vector<Run> read_runs(std::istream& in, const std::vector<Body>& bodies,
                           const std::vector<Formulation>& formulations,
                           const std::vector<std::string>& strategies) {
    std::vector<Run> runs;
    for (const Body& body : bodies) {
        for (const Formulation formulation : formulations) {
            const auto expected = std::make_shared<Expected>();
            expected->after_brief = read_state(in);
            expected->after_full = read_state(in);
            in.read(reinterpret_cast<char*>(&expected->spread), sizeof expected->spread);
            for (const std::string& strategy : strategies) {
                if (takes(strategy, body)) runs.push_back({strategy, &body, formulation, expected});
            }
        }
    }
    return runs;
}

int run(const std::string& what, const char* path, const std::vector<std::string>& strategies) {
    for (const std::string& strategy : strategies) {
        if (!built(strategy)) return 3;
    }
    const std::vector<Formulation> formulations = {Formulation::increment, Formulation::position};
    if (what == "write") {
        std::ofstream out(path, std::ios::binary);
        for (const Body& body : bodies()) {
            for (const Formulation formulation : formulations) {
                const Expected expected = expected_of(body, formulation);
                write(out, expected.after_brief);
                write(out, expected.after_full);
                out.write(reinterpret_cast<const char*>(&expected.spread), sizeof expected.spread);
            }
        }
        return out ? 0 : 2;
    }
    std::ifstream in(path, std::ios::binary);
    const std::vector<Body> all = bodies();
    std::vector<Run> runs = read_runs(in, all, formulations, strategies);
    if (!in) throw std::runtime_error(std::string(path) + " is too short");
    // Long runs go one by one until one detects the mutant, beginning with those that differ already.
    const auto found = std::stable_partition(runs.begin(), runs.end(), departs_early);
    const auto late = std::find_if(runs.begin(), runs.end(), departs_late);
    std::cout << found - runs.begin() << " " << (late == runs.end() ? 0 : 1) << " " << runs.size() << "\n";
    return 0;
}

}  // namespace
}  // namespace voxspring::testing

int main(int argc, char** argv) {
    try {
        return argc >= 3 ? voxspring::testing::run(argv[1], argv[2], {argv + 3, argv + argc}) : 2;
    } catch (const std::exception& error) {
        std::cerr << error.what() << "\n";
        return 2;
    }
}
