// Builds a body in memory, times its own backend (my_backend.cpp) on it beside one of Voxspring's, checks
// both against float64, and writes the result.
#include <exception>
#include <iostream>
#include <memory>
#include <utility>
#include <vector>

#include "backends/physics/neighbours.h"
#include "harness/process/worker_main.h"
#include "harness/results/print.h"
#include "harness/scene/scene.h"
#include "harness/study/study.h"

using namespace voxspring;

namespace {

// A ball of 17 voxels across, pinned where it is lowest, under gravity.
Problem make_ball() {
    constexpr int side = 17;
    VoxelGrid grid;
    grid.dims = {side, side, side};
    grid.spacing = {1, 1, 1};
    for (int z = 0; z < side; ++z) {
        for (int y = 0; y < side; ++y) {
            for (int x = 0; x < side; ++x) {
                const glm::ivec3 from_centre = glm::ivec3(x, y, z) - side / 2;
                const glm::ivec3 squares = from_centre * from_centre;
                grid.label.push_back(squares.x + squares.y + squares.z <= side * side / 4 ? 1 : 0);
            }
        }
    }
    Problem ball = make_lattice_problem(grid, FACE_BITS | EDGE_BITS);
    ball.gravity = {0, 0, -1e-3};
    ball.damping = 1e-3;
    std::vector<std::uint8_t> pinned;
    for (const glm::dvec3& position : ball.rest_position) pinned.push_back(position.z < 2 ? 1 : 0);
    pin(ball, std::move(pinned));
    return ball;
}

}  // namespace

int main(int argc, char** argv) {
    // A study measures in processes of this same program, which begin and end here.
    worker_main(argc, argv);
    if (argc != 2) {
        std::cerr << "usage: example RESULT.json\n";
        return 2;
    }
    try {
        // A time step of 0, as the problem has it, is half of the stable one.
        const auto ball = std::make_shared<const Scene>(scene_of("ball", make_ball()));
        Study study;
        study.name = "example";
        study.repetitions = 5;
        study.backends = {"cpu_reference", "my_backend"};
        study.scenes = {{.scene = ball->name, .steps = 50, .backends = {}, .built = ball}};
        StudyOptions options;
        options.out = argv[1];
        const Result result = run_study(study, options);
        print_table(result, std::cout);
        return result.rows("failed").empty() ? 0 : 1;
    } catch (const std::exception& error) {
        std::cerr << "example: " << error.what() << "\n";
        return 2;
    }
}
