// What tests of backends that step by shaders share, whichever API runs them.
#pragma once

#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "backends/registry.h"
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
    return stepped(backend, problem, random_state(problem, 0.05, 3), steps);
}

}  // namespace voxspring::testing
