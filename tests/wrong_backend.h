// Backends that are wrong in one respect, which no study may show as verified.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "backends/cpu/cpu_backend.h"
#include "backends/registry.h"

namespace voxspring::testing {

/// What is wrong with a backend.
struct Fault {
    std::function<void(Problem&)> change = {};  ///< of the problem that it steps
    bool edits = true;                          ///< whether it makes edits
    double force = 1;                           ///< factor of the tool's force
    bool forgets = false;                       ///< its gravity is another after each start
};

/// cpu_parallel in `position` and float32, whose threshold is the widest, with a fault.
class WrongBackend : public CpuBackend, public ToolFacet {
public:
    explicit WrongBackend(Fault fault) : fault_(std::move(fault)) {}

    Capabilities capabilities() const override { return inner_->capabilities(); }
    void upload(const Problem& problem, const State& state) override {
        problem_ = problem;
        if (fault_.change) fault_.change(problem_);
        if (fault_.forgets) problem_.gravity *= 1 + 0.1 * uploads_++;
        inner_->upload(problem_, state);
    }
    void edit(const Problem& edited, const SpringEdit& edit) override {
        if (!fault_.edits) return;
        problem_ = edited;
        if (fault_.change) fault_.change(problem_);
        inner_->edit(problem_, edit);
    }
    void step(int count) override { inner_->step(count); }
    State download() override { return inner_->download(); }
    StepWork step_work(const Problem& problem) const override { return inner_->limits()->step_work(problem); }
    ToolFacet* tool() override { return this; }
    void move_tool(const glm::dvec3& displacement) override { inner_->tool()->move_tool(displacement); }
    glm::dvec3 tool_force() override { return fault_.force * inner_->tool()->tool_force(); }

private:
    const Fault fault_;
    const std::unique_ptr<Backend> inner_ =
        BackendSpec::parse("cpu_parallel:formulation=position,precision=float32").make();
    Problem problem_;
    int uploads_ = 0;
};

/// Faults by the name of their backend. `wrong_in_nothing` has none.
inline const std::vector<std::pair<std::string, Fault>>& faults() {
    static const std::vector<std::pair<std::string, Fault>> all = {
        {"wrong_in_nothing", {}},
        {"wrong_without_springs",
         {.change =
              [](Problem& problem) {
                  problem.group_stiffness = {0, 0, 0};
              }}},
        {"wrong_direction",
         {.change =
              [](Problem& problem) {
                  for (std::uint32_t& mask : problem.lattice.mask) mask &= ~0x3u;
              }}},
        {"wrong_gravity", {.change = [](Problem& problem) { problem.gravity *= 1.05; }}},
        {"wrong_uncut", {.edits = false}},
        {"wrong_force", {.force = 0.99}},
        {"wrong_restart", {.forgets = true}}};
    return all;
}

/// Registers the backends of faults(). For a variable at namespace scope.
inline std::vector<Registered> register_wrong_backends() {
    std::vector<Registered> registered;
    for (const auto& named : faults())
        registered.push_back(
            Registered({.name = named.first,
                        .api = "wrong",
                        .summary = "A backend for this test.",
                        .precisions = {Precision::float32},
                        .formulations = {Formulation::position},
                        .tuning = {},
                        .make = [fault = named.second](const Options&) -> std::unique_ptr<Backend> {
                            return std::make_unique<WrongBackend>(fault);
                        },
                        .bytes = [](const Problem&, const Options&) { return std::uint64_t(0); }}));
    return registered;
}

}  // namespace voxspring::testing
