// The oracle: float64, a plain loop over springs, one thread. Every other backend is compared with it.
#include <glm/geometric.hpp>
#include <glm/vec3.hpp>

#include "backends/cpu_backend.h"
#include "backends/physics/spring.h"
#include "backends/registry.h"

namespace voxspring {
namespace {

class CpuReference final : public CpuBackend {
public:
    Capabilities capabilities() const override { return cpu_capabilities("scalar", 1); }

    void upload(const Problem& problem, const State& state) override {
        problem_ = &problem;
        springs_ = list_springs(problem);
        position_ = problem.rest_position;
        previous_ = problem.rest_position;
        for (std::size_t i = 0; i < position_.size(); ++i) {
            position_[i] += state.displacement[i];
            previous_[i] = position_[i] - state.increment[i];
        }
    }

    // Anew, which is plainly right.
    void edit(const Problem& edited, const SpringEdit&) override {
        problem_ = &edited;
        springs_ = list_springs(edited);
    }

    void step(int count) override {
        for (int n = 0; n < count; ++n) step_once();
    }

    State download() override {
        State state = state_at_rest(*problem_);
        for (std::size_t i = 0; i < position_.size(); ++i) {
            state.displacement[i] = position_[i] - problem_->rest_position[i];
            state.increment[i] = position_[i] - previous_[i];
        }
        return state;
    }

    StepWork step_work(const Problem& problem) const override {
        const std::uint64_t particles = problem.particle_count();
        const std::uint64_t springs = count_springs(problem).total();
        const std::uint64_t load = problem.load.empty() ? 0 : 1;
        // Forces: zeroed, read and written with the springs, read with the particles. Positions: read with
        // the springs, read and written with the particles; previous ones the same there.
        return {.bytes = particles * (4 + 3 + 2 + load) * sizeof(glm::dvec3) + springs * sizeof(Spring),
                // A spring: offset 3, force density 5 + 1 + 1 + 3, force 3, and its addition to either end 6.
                // A particle: next_position() 21 and 1 / mass.
                .operations = springs * (3 + 10 + 3 + 6) + particles * (21 + 1 + 3 * load)};
    }

private:
    void step_once() {
        const double shortest_squared = problem_->shortest_squared();
        force_.assign(position_.size(), glm::dvec3(0));
        for (const Spring& spring : springs_) {
            const glm::dvec3 offset = position_[spring.first] - position_[spring.second];
            const glm::dvec3 force =
                spring_force(offset, spring.rest_length, spring.stiffness, shortest_squared);
            force_[spring.first] += force;
            force_[spring.second] -= force;
        }
        const double retained = 1 - problem_->damping;
        const double time_step_squared = problem_->time_step * problem_->time_step;
        for (std::size_t i = 0; i < position_.size(); ++i) {
            if (problem_->is_pinned(i)) {
                previous_[i] = position_[i];
                continue;
            }
            if (!problem_->load.empty()) force_[i] += problem_->load[i];
            const glm::dvec3 next =
                next_position(position_[i], previous_[i], force_[i], 1 / problem_->material_of(i).mass,
                              problem_->gravity, retained, time_step_squared);
            previous_[i] = position_[i];
            position_[i] = next;
        }
    }

    const Problem* problem_ = nullptr;
    std::vector<Spring> springs_;
    std::vector<glm::dvec3> position_, previous_, force_;
};

const Registered entry({
    .name = "cpu_reference",
    .summary = "The oracle: float64, one thread, a plain loop over springs.",
    .precisions = {Precision::float64},
    .formulations = {Formulation::position},
    .tuning = {},
    .make = [](const Options&) { return std::make_unique<CpuReference>(); },
    .bytes =
        [](const Problem& problem, const Options&) {
            return problem.particle_count() * 3 * sizeof(glm::dvec3) +
                   count_springs(problem).total() * sizeof(Spring);
        },
});

}  // namespace
}  // namespace voxspring
