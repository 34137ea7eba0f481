// A box to hold, cut and sew, and functions that compare its simulations.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>
#include <utility>

#include "harness/scene/scene.h"
#include "tests/support.h"

namespace voxspring::testing {

inline const glm::ivec3 dims(8, 6, 5);
inline const glm::dvec3 top(4, 3, 4);  // a particle in the uppermost slice

/// A box on its base, which gravity shears.
inline Scene box() {
    Problem problem = make_lattice_problem(solid(dims), FACE_BITS | EDGE_BITS);
    pin_base(problem);
    problem.damping = 0.01;
    problem.gravity = {8e-4, 0, -2e-3};
    return scene_of("box", std::move(problem));
}

/// The quad in the plane x = `at` across the whole box.
inline std::array<glm::dvec3, 4> across(double at) {
    return {{{at, -2, -2}, {at, -2, 9}, {at, 9, -2}, {at, 9, 9}}};
}

inline bool parts_box(const Problem& problem, double at) {
    const auto springs = list_springs(problem);
    return std::none_of(springs.begin(), springs.end(), [&](const Spring& spring) {
        return (problem.rest_position[spring.first].x < at) != (problem.rest_position[spring.second].x < at);
    });
}

inline std::string contents_of(const std::filesystem::path& file) {
    std::ifstream in(file, std::ios::binary);
    return {std::istreambuf_iterator<char>(in), {}};
}

inline std::filesystem::path file_called(const std::string& name) {
    return std::filesystem::path(::testing::TempDir()) / name;
}

}  // namespace voxspring::testing
