// Bodies that layouts and kernel bodies are tried on, and what every kernel body must do with them.
#pragma once

#include <gtest/gtest.h>

#include <cstddef>
#include <map>
#include <string>
#include <vector>

#include "backends/layout/march_cost.h"
#include "backends/registry.h"
#include "harness/verification/verify.h"
#include "tests/support.h"

namespace voxspring::testing {

/// An H200 with that many multiprocessors, as far as plans depend on it.
inline layout::MarchDevice march_device_of(int multiprocessors) {
    return {.multiprocessors = multiprocessors,
            .threads = 2048,
            .shared_bytes = 228 << 10U,
            .reserved_bytes = 1 << 10U,
            .block_shared_bytes = 227 << 10U,
            .hertz = 2e9,
            .bytes_per_second = 5e12,
            .cache_bytes = 6e7};
}

/// A card as far as plans and kernels depend on it. Figures are those of its maker.
struct CardProfile {
    const char* name;
    int architecture;
    layout::MarchDevice device;
};
/// From 16 to 170 multiprocessors, 48 to 227 KiB of shared memory, compute capability 7.5 to 12.0.
inline std::vector<CardProfile> card_profiles() {
    const auto device = [](int multiprocessors, int threads, std::size_t kibibytes, double gigahertz,
                           double gigabytes_per_second, double cache_megabytes) {
        layout::MarchDevice of = march_device_of(multiprocessors);
        of.threads = threads;
        of.block_shared_bytes = kibibytes << 10U;
        of.shared_bytes = of.block_shared_bytes + of.reserved_bytes;
        of.hertz = 1e9 * gigahertz;
        of.bytes_per_second = 1e9 * gigabytes_per_second;
        of.cache_bytes = 1e6 * cache_megabytes;
        return of;
    };
    return {{"16 multiprocessors of 7.5", 75, device(16, 1024, 48, 1.7, 130, 1)},
            {"A100", 80, device(108, 2048, 163, 1.41, 1555, 40)},
            {"RTX 4060", 89, device(24, 1536, 99, 2.46, 272, 24)},
            {"H200", 90, device(132, 2048, 227, 1.98, 4800, 50)},
            {"RTX 5090", 120, device(170, 1536, 99, 2.41, 1792, 96)}};
}

inline Problem with_dynamics(Problem problem) {
    problem.gravity = {8e-4, 0, -2e-3};
    problem.damping = 0.01;
    problem.time_step = 0.2;
    return problem;
}
inline Problem lattice(const VoxelGrid& grid, std::uint32_t groups = FACE_BITS | EDGE_BITS) {
    return with_dynamics(make_lattice_problem(grid, groups));
}
inline Problem pinned(Problem problem) {
    pin_base(problem);
    return problem;
}
inline Problem sutured(Problem problem) {
    const auto last = std::uint32_t(problem.particle_count() - 1);
    problem.springs = {{0, last, 0.5, 3.0}, {1, last - 1, 0.25, 2.0}, {1, last, 0.125, 0}};
    return problem;
}

/// Small bodies of one material, with face or edge springs.
inline std::map<std::string, Problem> small_bodies() {
    std::map<std::string, Problem> problems;
    problems["one_particle"] = lattice(solid({1, 1, 1}));
    problems["row_x"] = lattice(solid({37, 1, 1}));
    problems["row_y"] = lattice(solid({1, 19, 1}));
    problems["row_z"] = lattice(solid({1, 1, 23}));
    problems["prime_box"] = lattice(solid({13, 7, 11}));
    problems["without_springs"] =
        lattice(make_grid({8, 7, 6}, [](int x, int y, int z) { return (x + y + z) % 2; }), FACE_BITS);
    problems["sparse"] = lattice(random_grid({41, 17, 9}, 0.2, 1));
    problems["dense"] = lattice(random_grid({41, 17, 9}, 0.8, 2));
    problems["faces"] = lattice(solid({9, 8, 7}), FACE_BITS);
    problems["edges"] = lattice(solid({9, 8, 7}), EDGE_BITS);
    return problems;
}
/// These and others, for kernels that step springs by class.
inline std::map<std::string, Problem> bodies_by_class() {
    std::map<std::string, Problem> problems = small_bodies();
    problems["corner"] =
        lattice(make_grid({30, 21, 9}, [](int x, int y, int z) { return x > 20 && y > 14 && z > 5; }));
    problems["stiffness_per_group"] = lattice(random_grid({21, 9, 10}, 0.8, 3));
    problems["stiffness_per_group"].group_stiffness = {1.0, 0.5, 0.25};
    problems["anisotropic"] = lattice(solid({9, 10, 11}, {0.7, 1.0, 1.9}));
    problems["pinned"] = pinned(lattice(random_grid({12, 11, 10}, 0.9, 5)));
    problems["free"] = lattice(solid({6, 5, 4}));
    problems["free"].damping = 0;
    problems["free"].gravity = glm::dvec3(0);
    return problems;
}

/// Bodies to cut into subdomains, longest along z, x and y: solid and with holes; with a tool; with
/// materials, loads and pins.
inline std::vector<Problem> bodies_to_cut() {
    std::vector<Problem> all;
    all.push_back(lattice(solid({6, 5, 13}), FACE_BITS | EDGE_BITS));
    all.push_back(lattice(random_grid({37, 9, 8}, 0.37, 1), NEIGHBOUR_BITS));
    take_hold(all.back(), {.particles = {3, 200, 201, 700}, .held = {}, .stiffness = 0.05});
    all.push_back(pinned(lattice(random_grid({9, 23, 8}, 0.37, 2, 3), NEIGHBOUR_BITS)));
    all.back().materials = {{1, 1}, {2, 0.25}, {0.75, 0.5}};
    all.back().load.assign(all.back().particle_count(), {0.001, -0.002, 0.003});
    return all;
}

/// Five steps of `simulation`, which is at `start`, agree with the reference.
template <class Simulation>
void expect_reference(const Problem& problem, const State& start, Simulation& simulation,
                      Precision precision) {
    constexpr int steps = 5;
    const auto oracle = BackendSpec::parse("cpu_reference").make();
    oracle->upload(problem, start);
    oracle->step(steps);
    simulation.step(steps);
    const Comparison comparison =
        compare(problem, simulation.download(), oracle->download(), precision, steps);
    EXPECT_TRUE(comparison.passed()) << comparison.reason;
}

/// Two simulations have the same bits after each of these launches.
template <class One, class Other>
void expect_same_steps(One&& one, Other&& other, const std::vector<int>& launches = {5}) {
    for (const int count : launches) {
        one.step(count);
        other.step(count);
        expect_same_bits(one.download(), other.download());
    }
}

/// Edits `now`, which the simulation steps, several times. After each edit the simulation's layout is that of
/// one that is made for the edited body: its masks, and what `expect_same` compares. The edit names exactly
/// the words of masks that it changed; `word_of(masks, n)` is word n. The following steps have the same bits.
/// Returns how many words were changed.
template <class Simulation, class WordOf, class ExpectSame>
std::size_t expect_edits(Simulation& simulation, Problem& now, WordOf word_of, ExpectSame expect_same) {
    std::size_t changed = 0;
    Problem edited = now;
    for (const SpringEdit& edit : random_edits(edited, 5, 9)) {
        apply(now, edit);
        auto patched = simulation.layout().masks();
        for (const auto& word : simulation.edit(edit)) {
            std::uint32_t& mask = word_of(patched, word.word);
            EXPECT_NE(mask, word.bits);
            mask = word.bits;
            ++changed;
        }
        Simulation anew(now, simulation.download());
        EXPECT_EQ(patched, anew.layout().masks());
        EXPECT_EQ(simulation.layout().masks(), anew.layout().masks());
        expect_same(simulation.layout(), anew.layout());
        expect_same_steps(simulation, anew, {2});
    }
    return changed;
}

/// Each body steps as the reference does in a Simulation(problem, start). Without gravity it stays at rest to
/// the bit.
template <class Simulation>
void expect_agreement(const std::map<std::string, Problem>& bodies, Precision precision,
                      Formulation formulation) {
    for (const auto& [name, problem] : bodies) {
        SCOPED_TRACE(name);
        const State start = random_state(problem, 0.05, 7);
        Simulation simulation(problem, start);
        expect_reference(problem, start, simulation, precision);
        if (name == "anisotropic" && on_positions(formulation)) continue;  // x are rounded
        Problem unladen = problem;
        unladen.gravity = glm::dvec3(0);
        const State rest = state_at_rest(unladen);
        Simulation resting(unladen, rest);
        resting.step(3);
        expect_same_bits(resting.download(), rest);
    }
}

}  // namespace voxspring::testing
