// A backend outside of Voxspring's tree: it consists of this file and its line in CMakeLists.txt. It keeps
// displacements and increments in float32 and sums the force of every spring, particle by particle.
#include <glm/geometric.hpp>
#include <glm/vec3.hpp>
#include <memory>
#include <vector>

#include "backends/cpu/cpu_backend.h"
#include "backends/physics/spring.h"
#include "backends/registry.h"

namespace {

using namespace voxspring;

class MyBackend final : public CpuBackend {
public:
    Capabilities capabilities() const override { return cpu_capabilities("scalar", 1); }

    void upload(const Problem& problem, const State& state) override {
        problem_ = &problem;
        springs_ = list_springs(problem);
        rests_ = list_rest_springs(problem);
        const State start = state.in_full(problem.particle_count());  // at rest its lists are empty
        displacement_.assign(start.displacement.begin(), start.displacement.end());
        increment_.assign(start.increment.begin(), start.increment.end());
        force_.resize(displacement_.size());
    }

    // An edit rebuilds what the backend keeps of springs.
    void edit(const Problem& edited, const SpringEdit&) override {
        problem_ = &edited;
        springs_ = list_springs(edited);
        rests_ = list_rest_springs(edited);
    }

    void step(int count) override {
        for (int n = 0; n < count; ++n) {
            sum_forces();
            move();
        }
    }

    State download() override {
        return {{displacement_.begin(), displacement_.end()}, {increment_.begin(), increment_.end()}};
    }

    // The minimum work of a step, with which its time is compared: every array once, and every operation of
    // the two functions of spring.h that it calls.
    StepWork step_work(const Problem& problem) const override {
        const std::uint64_t particles = problem.particle_count();
        const std::uint64_t springs = count_springs(problem).total();
        const std::uint64_t lists = springs * (sizeof(Spring) + sizeof(RestSpring));
        return {.bytes = particles * 6 * sizeof(glm::vec3) + lists,
                .written_bytes = particles * 3 * sizeof(glm::vec3),
                .footprint_bytes = particles * 3 * sizeof(glm::vec3) + lists,
                .operations = springs * 35 + particles * 22};
    }

private:
    void sum_forces() {
        force_.assign(force_.size(), glm::vec3(0));
        const auto shortest_squared = float(problem_->shortest_squared());
        for (std::size_t s = 0; s < springs_.size(); ++s) {
            const Spring& spring = springs_[s];
            const RestSpring& rest = rests_[s];
            const glm::vec3 relative = displacement_[spring.first] - displacement_[spring.second];
            const glm::vec3 force =
                strain_force(relative, glm::vec3(rest.offset), float(rest.length), float(rest.deficit),
                             float(spring.stiffness), shortest_squared);
            force_[spring.first] += force;
            force_[spring.second] -= force;
        }
        for (std::size_t i = 0; i < problem_->load.size(); ++i) force_[i] += glm::vec3(problem_->load[i]);
    }

    void move() {
        const auto damping = float(problem_->damping);
        const auto time_step_squared = float(problem_->time_step * problem_->time_step);
        for (std::size_t i = 0; i < displacement_.size(); ++i) {
            if (problem_->is_pinned(i)) {
                increment_[i] = glm::vec3(0);
                continue;
            }
            const auto inverse_mass = float(1 / problem_->material_of(i).mass);
            increment_[i] += increment_change(increment_[i], force_[i], inverse_mass,
                                              glm::vec3(problem_->gravity), damping, time_step_squared);
            displacement_[i] += increment_[i];
        }
    }

    const Problem* problem_ = nullptr;
    std::vector<Spring> springs_;
    std::vector<RestSpring> rests_;
    std::vector<glm::vec3> displacement_, increment_, force_;
};

// The name is all that a study needs to find it.
const Registered entry({
    .name = "my_backend",
    .summary = "float32, one thread, a plain loop over springs.",
    .precisions = {Precision::float32},
    .formulations = {Formulation::increment},
    .tuning = {},
    .make = [](const Options&) { return std::make_unique<MyBackend>(); },
    .bytes =
        [](const Problem& problem, const Options&) {
            return problem.particle_count() * 3 * sizeof(glm::vec3) +
                   count_springs(problem).total() * (sizeof(Spring) + sizeof(RestSpring));
        },
});

}  // namespace
