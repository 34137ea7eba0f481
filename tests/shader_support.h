// Problems and questions for backends that step by shaders, whichever API runs them.
#pragma once

#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "backends/registry.h"
#include "harness/verification/verify.h"
#include "tests/support.h"

namespace voxspring::testing {

/// For its lifetime, calls of a driver's function go to another one.
template <class Function>
class Replaced {
public:
    Replaced(Function& function, std::type_identity_t<Function> other)
        : function_(function), before_(std::exchange(function, other)) {}
    Replaced(const Replaced&) = delete;
    Replaced& operator=(const Replaced&) = delete;
    ~Replaced() { function_ = before_; }

private:
    Function& function_;
    const Function before_;
};

/// Each of these backends in each of its formulations.
inline std::vector<std::string> formulations_of(const std::vector<std::string>& backends) {
    std::vector<std::string> specs;
    for (const std::string& name : backends) {
        for (const Formulation formulation : all_formulations)
            specs.push_back(name + ":formulation=" + to_string(formulation));
    }
    return specs;
}

/// A body that is two thirds full, with every term in use.
inline Problem problem_with_everything() {
    Problem problem = make_lattice_problem(random_grid({13, 11, 9}, 0.67, 11, 3), NEIGHBOUR_BITS);
    problem.materials = {{1, 1}, {2, 0.25}, {0.75, 0.5}};
    problem.gravity = {8e-4, 0, -2e-3};
    problem.damping = 0.01;
    problem.time_step = 0.2;
    problem.load.assign(problem.particle_count(), glm::dvec3(0));
    problem.load[7] = {0.01, -0.02, 0.03};
    pin_base(problem);
    return problem;
}

/// A body of the shape of problem_with_everything(), without any optional term, with face springs only.
inline Problem plain_problem() {
    Problem problem = make_lattice_problem(random_grid({13, 11, 9}, 0.67, 11), FACE_BITS);
    problem.time_step = 0.2;
    return problem;
}

inline State after(Backend& backend, const Problem& problem, int steps) {
    backend.upload(problem, random_state(problem, 0.05, 3));
    backend.step(steps);
    return backend.download();
}

/// `arms` particles around one, each joined to it by a spring; on no grid.
inline Problem star(std::uint32_t arms) {
    Problem problem;
    problem.rest_position.assign(arms + 1, glm::dvec3(0));
    for (std::uint32_t i = 1; i <= arms; ++i) {
        const double angle = 2 * 3.14159265358979 * i / arms;
        problem.rest_position[i] = {std::cos(angle), std::sin(angle), 0.1 * i / arms};
        problem.springs.push_back({0, i, 1.0 + 0.5 * i / arms, 0.9});
    }
    problem.time_step = 0.1;
    return problem;
}

/// Scenes that lack one term each, and some that lack most.
inline std::vector<std::pair<std::string, Problem>> scenes_to_skip_in() {
    std::vector<std::pair<std::string, Problem>> cases;
    const auto add = [&](const char* name, Problem problem) { cases.emplace_back(name, std::move(problem)); };
    add("nothing to skip", problem_with_everything());
    add("nothing but face springs", plain_problem());
    Problem problem = problem_with_everything();
    problem.damping = 0;
    add("no damping", problem);
    problem = problem_with_everything();
    problem.gravity = glm::dvec3(0);
    add("no gravity", problem);
    problem = problem_with_everything();
    problem.load.clear();
    add("no loads", problem);
    problem = problem_with_everything();
    pin(problem, std::vector<std::uint8_t>(problem.particle_count(), 0));
    add("no pins", problem);
    problem = problem_with_everything();
    problem.material.clear();
    problem.materials = {{1.3, 1}};
    problem.group_stiffness = {0.9, 0.7, 0.3};
    add("one material", problem);
    for (const std::uint32_t groups : {FACE_BITS, EDGE_BITS, CORNER_BITS, FACE_BITS | EDGE_BITS}) {
        problem = make_lattice_problem(random_grid({13, 11, 9}, 0.67, 11), groups);
        problem.time_step = 0.2;
        problem.gravity = {0, 0, -2e-3};
        add("some groups", problem);
    }
    problem = problem_with_everything();
    for (double& length : problem.rest_length) length *= 0.97;
    add("stressed at rest", problem);
    return cases;
}

/// Expects that what `terms=needed` leaves out changes no bit, and that the state follows the reference.
inline void expect_skipping_changes_no_bit(const std::string& specification) {
    const auto skipping = BackendSpec::parse(specification + ",terms=needed").make();
    const auto with_all = BackendSpec::parse(specification + ",terms=all").make();
    const auto oracle = BackendSpec::parse("cpu_reference").make();
    for (const auto& [name, scene] : scenes_to_skip_in()) {
        SCOPED_TRACE(name);
        const State needed = after(*skipping, scene, 20);
        expect_same_bits(needed, after(*with_all, scene, 20));
        const Comparison comparison =
            compare(scene, needed, after(*oracle, scene, 20), Precision::float32, 20);
        EXPECT_TRUE(comparison.passed()) << comparison.reason;
    }
}

/// Expects an edit to wait for the steps before it, and the steps after it to wait for the edit.
inline void expect_edits_in_order(const std::string& specification) {
    // There are enough steps and edits in flight that one out of order would show.
    Problem problem = make_lattice_problem(solid({24, 24, 24}), FACE_BITS | EDGE_BITS);
    problem.gravity = {8e-4, 0, -2e-3};
    problem.time_step = 0.2;
    pin_base(problem);
    Problem edited = problem;
    SpringEditor editor(edited);
    std::vector<SpringEdit> edits;
    for (int n = 0; n < 4; ++n) {
        const Plane plane{{11.5, 0, 6.0 * n}, {1, 0, 0.3}};
        edits.push_back(editor.cut(plane));
        edits.push_back(editor.suture(plane, 1.5));
    }
    const auto play = [&](bool waits) {
        const auto backend = BackendSpec::parse(specification).make();
        Problem now = problem;
        backend->upload(problem, random_state(problem, 0.05, 3));
        for (const SpringEdit& edit : edits) {
            backend->step(3);
            if (waits) backend->synchronize();
            apply(now, edit);
            backend->edit(now, edit);
            if (waits) backend->synchronize();
        }
        backend->step(3);
        return backend->download();
    };
    expect_same_bits(play(false), play(true));
}

}  // namespace voxspring::testing
