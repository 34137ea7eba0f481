// cpu_reference: float64, a plain loop over springs, one thread. All other backends are compared with it.
#include <cmath>
#include <glm/geometric.hpp>
#include <glm/vec3.hpp>
#include <memory>
#include <stdexcept>
#include <utility>
#include <vector>

#include "backends/cpu/cpu_backend.h"
#include "backends/physics/spring.h"
#include "backends/registry.h"

namespace voxspring {
namespace {

class CpuReference final : public MonitoredCpuBackend, public BorderFacet, public ToolFacet {
public:
    explicit CpuReference(Formulation formulation) : formulation_(formulation) {}

    Capabilities capabilities() const override {
        Capabilities all = cpu_capabilities("scalar", 1);
        all.has_borders = true;
        return all;
    }

    ToolFacet* tool() override { return this; }
    void move_tool(const glm::dvec3& displacement) override { tool_moved_ = displacement; }
    glm::dvec3 tool_force() override { return tool_force_; }

    // Lists all springs anew, which is slow but obviously correct. A caller that changes the uploaded problem
    // breaks the contract (backend.h), which only some backends would notice, by wrong springs.
    void edit(const Problem& edited, const SpringEdit&) override {
        if (&edited == uploaded_)
            throw std::logic_error("the uploaded problem must not change; edit a copy of it");
        problem_ = &edited;
        springs_ = list_springs(edited);
        rest_springs_ = list_rest_springs(edited);
    }

    State download() override {
        State state = state_at_rest(*problem_);
        for (std::size_t i = 0; i < at_.size(); ++i) {
            const glm::dvec3 rest = on_positions(formulation_) ? problem_->rest_position[i] : glm::dvec3(0);
            state.displacement[i] = at_[i] - rest + at_low_[i];
            state.increment[i] = by_increments(formulation_) ? increment_[i] + increment_low_[i]  //
                                                             : at_[i] - previous_[i];
        }
        return state;
    }

    BorderFacet* borders() override { return this; }
    std::unique_ptr<Border> border(const std::vector<std::uint32_t>& particles) override {
        return std::make_unique<VectorBorder<glm::dvec3>>(
            [this] {
                return std::vector{&at_, &at_low_};
            },
            particles);
    }

    StepWork step_work(const Problem& problem) const override {
        const std::uint64_t particles = problem.particle_count();
        const std::uint64_t springs = count_springs(problem).total();
        const std::uint64_t load = problem.load.empty() ? 0 : 1;
        const std::uint64_t lows = formulation_ == Formulation::compensated ? 1 : 0;
        const std::uint64_t rests = on_positions(formulation_) ? 0 : 1;
        // Operations of a spring: 3 for the difference of its ends, and 6 more with low parts; 3 for the
        // offset, if that is not the difference; 5 + 1 + 1 + 3 for force_density(), or 3 + 5 + 1 + 5 + 1 + 1
        // + 4 for strain_density(); 3 for the force; 6 to add it at both ends. Operations of a particle: 21
        // for next_position(), or for increment_change() and two sums, where each sum that is split takes 33
        // instead of 3; 1 for 1 / mass; 3 to add a load.
        const std::uint64_t spring =
            3 + lows * 6 + rests * 3 + (by_increments(formulation_) ? 20 : 10) + 3 + 6;
        const std::uint64_t particle = 21 + lows * 60 + 1 + 3 * load;
        // A step first zeroes the forces. The loop over springs reads and writes forces and reads positions.
        // The loop over particles reads forces, and reads and writes positions and previous positions or
        // increments.
        const std::uint64_t lists = springs * (sizeof(Spring) + rests * sizeof(RestSpring));
        return {.bytes = particles * (4 + 3 + 2 + load + lows * 5) * sizeof(glm::dvec3) + lists,
                .written_bytes = particles * (2 + 1 + 1 + lows * 2) * sizeof(glm::dvec3),
                .footprint_bytes = particles * (1 + 1 + 1 + load + lows * 2) * sizeof(glm::dvec3) + lists,
                .operations = springs * spring + particles * particle};
    }

private:
    void begin(const Problem& problem, const State& state) override {
        problem_ = uploaded_ = &problem;
        springs_ = list_springs(problem);
        rest_springs_ = list_rest_springs(problem);
        State start = state.in_full(problem.particle_count());
        at_ = std::move(start.displacement);
        if (on_positions(formulation_)) {
            for (std::size_t i = 0; i < at_.size(); ++i) at_[i] += problem.rest_position[i];
        }
        increment_ = std::move(start.increment);
        previous_ = at_;
        for (std::size_t i = 0; i < at_.size(); ++i) previous_[i] -= increment_[i];
        at_low_.assign(at_.size(), glm::dvec3(0));
        increment_low_ = at_low_;
        tool_moved_ = tool_force_ = glm::dvec3(0);
    }

    void integrate(int count) override {
        for (int n = 0; n < count; ++n) {
            sum_forces();
            for (std::size_t i = 0; i < at_.size(); ++i) {
                if (problem_->is_pinned(i)) {
                    hold(i);
                } else {
                    move(i);
                }
            }
        }
    }

    bool within(double largest_increment) override {
        for (std::size_t i = 0; i < at_.size(); ++i) {
            const glm::dvec3 moved = by_increments(formulation_) ? increment_[i] : at_[i] - previous_[i];
            if (!(glm::length(moved) <= largest_increment) || !std::isfinite(glm::dot(at_[i], at_[i])))
                return false;
        }
        return true;
    }

    glm::dvec3 force_of(const Spring& spring, const RestSpring& rest, double shortest_squared) const {
        const glm::dvec3 relative =
            (at_[spring.first] - at_[spring.second]) + (at_low_[spring.first] - at_low_[spring.second]);
        if (by_increments(formulation_)) {
            return strain_force(relative, rest.offset, rest.length, rest.deficit, spring.stiffness,
                                shortest_squared);
        }
        const glm::dvec3 offset = on_positions(formulation_) ? relative : rest.offset + relative;
        return spring_force(offset, rest.length, spring.stiffness, shortest_squared);
    }

    void sum_forces() {
        const double shortest_squared = problem_->shortest_squared();
        force_.assign(at_.size(), glm::dvec3(0));
        for (std::size_t s = 0; s < springs_.size(); ++s) {
            const glm::dvec3 force = force_of(springs_[s], rest_springs_[s], shortest_squared);
            force_[springs_[s].first] += force;
            force_[springs_[s].second] -= force;
        }
        for (std::size_t i = 0; i < problem_->load.size(); ++i) force_[i] += problem_->load[i];
        use_tool();
    }

    void use_tool() {
        const Tool& tool = problem_->tool;
        tool_force_ = glm::dvec3(0);
        for (std::size_t n = 0; n < tool.particles.size(); ++n) {
            const std::uint32_t i = tool.particles[n];
            const glm::dvec3 rest = on_positions(formulation_) ? problem_->rest_position[i] : glm::dvec3(0);
            const glm::dvec3 force =
                hold_force(rest + tool.held_at(n), at_[i], at_low_[i], tool_moved_, tool.stiffness);
            force_[i] += force;
            tool_force_ -= force;
        }
    }

    void hold(std::size_t i) {
        previous_[i] = at_[i];
        increment_[i] = increment_low_[i] = glm::dvec3(0);
    }

    void move(std::size_t i) {
        const double inverse_mass = 1 / problem_->material_of(i).mass;
        const double damping = problem_->damping;
        const double time_step_squared = problem_->time_step * problem_->time_step;
        if (by_increments(formulation_)) {
            const glm::dvec3 change = increment_change(increment_[i], force_[i], inverse_mass,
                                                       problem_->gravity, damping, time_step_squared);
            if (formulation_ == Formulation::increment) {
                increment_[i] += change;
                at_[i] += increment_[i];
            } else {
                add(increment_[i], increment_low_[i], change, glm::dvec3(0));
                add(at_[i], at_low_[i], increment_[i], increment_low_[i]);
            }
            return;
        }
        const glm::dvec3 next =
            formulation_ == Formulation::paper
                ? paper_position(at_[i], previous_[i], force_[i], inverse_mass, problem_->gravity,
                                 2 - damping, 1 - damping, time_step_squared)
                : next_position(at_[i], previous_[i], force_[i], inverse_mass, problem_->gravity, 1 - damping,
                                time_step_squared);
        previous_[i] = at_[i];
        at_[i] = next;
    }

    static void add(glm::dvec3& high, glm::dvec3& low, const glm::dvec3& added, const glm::dvec3& added_low) {
        const glm::dvec3 left = split_low(high, low, added, added_low);
        high = split_high(high, low, added, added_low);
        low = left;
    }

    const Formulation formulation_;
    const Problem* problem_ = nullptr;
    const Problem* uploaded_ = nullptr;  ///< must not change
    std::vector<Spring> springs_;
    std::vector<RestSpring> rest_springs_;
    /// The state. `at_` has positions or displacements. Formulations by increments use `increment_`, the
    /// others `previous_`. The low parts are zero except in `compensated`.
    std::vector<glm::dvec3> at_, previous_, increment_, at_low_, increment_low_;
    std::vector<glm::dvec3> force_;
    glm::dvec3 tool_moved_{0}, tool_force_{0};
};

const Registered entry({
    .name = "cpu_reference",
    .summary = "The reference for errors: float64, one thread, a plain loop over springs.",
    .precisions = {Precision::float64},
    .formulations = every_formulation,
    .tuning = {},
    .make = [](const Options& options) { return std::make_unique<CpuReference>(options.formulation); },
    .bytes =
        [](const Problem& problem, const Options&) {
            return problem.particle_count() * 6 * sizeof(glm::dvec3) +
                   count_springs(problem).total() * (sizeof(Spring) + sizeof(RestSpring));
        },
});

}  // namespace
}  // namespace voxspring
