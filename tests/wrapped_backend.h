// cpu_reference in other clothes: backends of tests that differ from it in one thing.
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

/// cpu_reference behind the interface `Base`.
template <class Base>
class Wrapping : public Base, public BorderFacet {
public:
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
    std::unique_ptr<Backend> inner_ = BackendSpec::parse("cpu_reference").make();
};

/// Does what cpu_reference does. A test overrides what is to differ.
class WrappedBackend : public Wrapping<CpuBackend> {
public:
    void upload(const Problem& problem, const State& state) override { inner().upload(problem, state); }
    void step(int count) override { inner().step(count); }
};

/// WrappedBackend with monitors, to which its particles are always within bounds.
class MonitoredBackend : public Wrapping<MonitoredCpuBackend> {
protected:
    void begin(const Problem& problem, const State& state) override { inner().upload(problem, state); }
    void integrate(int count) override { inner().step(count); }
    bool within(double) override { return true; }
};

/// Registers a backend of a test, in float64.
inline Registered registered_for_test(const std::string& name, std::function<std::unique_ptr<Backend>()> make,
                                      Formulation formulation = Formulation::increment,
                                      std::map<std::string, TuningValues> tuning = {}) {
    return Registered({.name = name,
                       .api = name.substr(0, name.find('_')),
                       .summary = "A backend for this test.",
                       .precisions = {Precision::float64},
                       .formulations = {formulation},
                       .tuning = std::move(tuning),
                       .make = [make = std::move(make)](const Options&) { return make(); },
                       .bytes = [](const Problem&, const Options&) { return std::uint64_t(0); }});
}

}  // namespace voxspring::testing
