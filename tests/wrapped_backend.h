// Backends of tests that differ in one thing from a backend that they wrap.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "backends/cpu/cpu_backend.h"
#include "backends/registry.h"

namespace voxspring::testing {

/// Another backend, cpu_reference unless specified, behind the interface `Base`.
template <class Base>
class Wrapping : public Base, public BorderFacet {
public:
    explicit Wrapping(const std::string& inner = "cpu_reference")
        : inner_(BackendSpec::parse(inner).make()) {}

    Capabilities capabilities() const override { return inner_->capabilities(); }
    void edit(const Problem& edited, const SpringEdit& edit) override { inner_->edit(edited, edit); }
    State download() override { return inner_->download(); }
    StepWork step_work(const Problem& problem) const override { return inner_->limits()->step_work(problem); }
    BorderFacet* borders() override { return this; }
    std::unique_ptr<Border> border(const std::vector<std::uint32_t>& particles) override {
        return inner_->borders()->border(particles);
    }

protected:
    Backend& inner() { return *inner_; }

private:
    std::unique_ptr<Backend> inner_;
};

/// Does what the inner backend does. A test overrides what is to differ.
class WrappedBackend : public Wrapping<CpuBackend> {
public:
    using Wrapping::Wrapping;
    void upload(const Problem& problem, const State& state) override { inner().upload(problem, state); }
    void step(int count) override { inner().step(count); }
};

/// WrappedBackend with the tool of the inner backend.
class WrappedToolBackend : public WrappedBackend, public ToolFacet {
public:
    using WrappedBackend::WrappedBackend;
    ToolFacet* tool() override { return this; }
    void move_tool(const glm::dvec3& displacement) override { inner().tool()->move_tool(displacement); }
    glm::dvec3 tool_force() override { return inner().tool()->tool_force(); }
};

/// WrappedBackend with monitors, to which its particles are always within bounds.
class MonitoredBackend : public Wrapping<MonitoredCpuBackend> {
protected:
    void begin(const Problem& problem, const State& state) override { inner().upload(problem, state); }
    void integrate(int count) override { inner().step(count); }
    bool within(double) override { return true; }
};

/// Registers a backend of a test.
inline Registered registered_for_test(const std::string& name, std::function<std::unique_ptr<Backend>()> make,
                                      Formulation formulation = Formulation::increment,
                                      std::map<std::string, TuningValues> tuning = {},
                                      Precision precision = Precision::float64) {
    return Registered({.name = name,
                       .api = name.substr(0, name.find('_')),
                       .summary = "A backend for this test.",
                       .precisions = {precision},
                       .formulations = {formulation},
                       .tuning = std::move(tuning),
                       .make = [make = std::move(make)](const Options&) { return make(); },
                       .bytes = [](const Problem&, const Options&) { return std::uint64_t(0); }});
}
/// Registers a backend that is a Made(with...).
template <class Made, class... With>
Registered registered_as(const std::string& name, With... with) {
    return registered_for_test(name, [=] { return std::make_unique<Made>(with...); });
}

// --- Backends that no study may show as verified ---------------------------------------------------------

/// What is wrong with a backend.
struct Fault {
    std::function<void(Problem&)> change = {};  ///< of the problem that it steps
    bool edits = true;                          ///< whether it makes edits
    double force = 1;                           ///< factor of the tool's force
    bool forgets = false;                       ///< its gravity is another after each start
};

/// cpu_parallel in `position` and float32, whose threshold is the widest, with a fault.
class WrongBackend : public WrappedToolBackend {
public:
    explicit WrongBackend(Fault fault)
        : WrappedToolBackend("cpu_parallel:formulation=position,precision=float32"),
          fault_(std::move(fault)) {}

    void upload(const Problem& problem, const State& state) override {
        problem_ = problem;
        if (fault_.change) fault_.change(problem_);
        if (fault_.forgets) problem_.gravity *= 1 + 0.1 * uploads_++;
        inner().upload(problem_, state);
    }
    void edit(const Problem& edited, const SpringEdit& edit) override {
        if (!fault_.edits) return;
        problem_ = edited;
        if (fault_.change) fault_.change(problem_);
        inner().edit(problem_, edit);
    }
    glm::dvec3 tool_force() override { return fault_.force * WrappedToolBackend::tool_force(); }

private:
    const Fault fault_;
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
    for (const auto& named : faults()) {
        registered.push_back(registered_for_test(
            named.first, [fault = named.second] { return std::make_unique<WrongBackend>(fault); },
            Formulation::position, {}, Precision::float32));
    }
    return registered;
}

}  // namespace voxspring::testing
