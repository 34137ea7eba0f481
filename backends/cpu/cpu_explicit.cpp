// cpu_explicit: all cores, with neighbour lists. Accepts any network of springs, and so also sutures between
// particles that are not lattice neighbours.
//
// Each particle has a list of its springs: first those of the lattice in the order of neighbours.h, then
// those of Problem::springs in their order. Their forces are summed in that order. Each spring is evaluated
// from both of its ends, so no bit depends on the number of threads.
#include <omp.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <glm/geometric.hpp>
#include <glm/vec3.hpp>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "backends/by_precision.h"
#include "backends/cpu/barrier.h"
#include "backends/cpu/cpu_backend.h"
#include "backends/cpu/parallel_options.h"
#include "backends/cpu/subnormals.h"
#include "backends/layout/springs.h"
#include "backends/physics/spring.h"
#include "backends/physics/stored.h"
#include "backends/registry.h"

namespace voxspring {
namespace {

constexpr auto name = "cpu_explicit";

/// A spring from a particle to a neighbour.
template <class Real>
struct Link {
    std::uint32_t neighbour;
    std::uint32_t rest;  ///< index of the spring's RestState
    Real stiffness;
};

/// A RestSpring (problem.h) in the backend's precision.
template <class Real>
struct RestState {
    glm::vec<3, Real> offset;
    Real length, deficit;
};

/// Where a particle's links are, and for how many links there is room.
struct ListRange {
    std::size_t begin = 0;
    std::uint32_t count = 0, room = 0;
};

/// The springs of every particle.
template <class Real>
class Links {
public:
    Links() = default;
    explicit Links(const Problem& problem) {
        for (const Direction& direction : directions())
            rest_.push_back(
                rest_of(problem.lattice.mask.empty() ? RestSpring{} : rest_spring(problem, direction)));
        const std::size_t particles = problem.particle_count();
        const std::vector<std::uint32_t> degree = layout::degrees(problem);
        ranges_.resize(particles);
        std::size_t size = 0;
        for (std::size_t i = 0; i < particles; ++i) {
            ranges_[i] = {size, 0, degree[i]};
            size += degree[i];
        }
        links_.resize(size);
        const LatticeSprings lattice(problem);
#pragma omp parallel for schedule(static)
        for (std::ptrdiff_t n = 0; n < std::ptrdiff_t(particles); ++n) {
            const auto i = std::size_t(n);
            lattice.all_of(i, [&](std::uint32_t j, const Direction& direction) {
                add(i, {j, std::uint32_t(direction.bit), Real(problem.spring_stiffness(i, j, direction))});
            });
        }
        for (const Spring& spring : problem.springs) {
            add(spring.first,
                beyond(problem, spring.first, spring.second, spring.stiffness, spring.rest_length));
            add(spring.second,
                beyond(problem, spring.second, spring.first, spring.stiffness, spring.rest_length));
        }
    }

    /// Makes new lists for the particles that `edit` touched. A list that has too little room moves to the
    /// end of links_.
    void follow(const Problem& edited, const SpringEdit& edit) {
        for (const SpringEdit::Touched& touched : edit.touched) {
            ListRange& range = ranges_[touched.particle];
            const auto springs = edit.springs_of(touched);
            if (springs.size() > range.room) {
                range = {links_.size(), 0, std::uint32_t(springs.size())};
                links_.resize(links_.size() + springs.size());
            }
            range.count = 0;
            for (const ListedSpring& s : springs) {
                add(touched.particle,
                    s.bit < 0 ? beyond(edited, touched.particle, s.neighbour, s.stiffness, s.rest_length)
                              : Link<Real>{s.neighbour, std::uint32_t(s.bit), Real(s.stiffness)});
            }
        }
    }

    /// Number of links and rest states, including those that edits have left unused.
    std::size_t size() const { return links_.size() + rest_.size(); }

    /// Calls visit(neighbour, rest state, stiffness) for each spring of particle i in the order of its list.
    template <class Visit>
    void visit(std::size_t i, Visit visit) const {
        const ListRange& range = ranges_[i];
        for (std::size_t n = range.begin; n < range.begin + range.count; ++n)
            visit(links_[n].neighbour, rest_[links_[n].rest], links_[n].stiffness);
    }

private:
    static RestState<Real> rest_of(const RestSpring& rest) {
        return {glm::vec<3, Real>(rest.offset), Real(rest.length), Real(rest.deficit)};
    }
    void add(std::size_t particle, const Link<Real>& link) {
        ListRange& range = ranges_[particle];
        links_[range.begin + range.count++] = link;
    }
    /// Makes the link from `particle` for a spring that is not of the lattice, and adds its RestState.
    Link<Real> beyond(const Problem& problem, std::uint32_t particle, std::uint32_t neighbour,
                      double stiffness, double rest_length) {
        rest_.push_back(rest_of(rest_spring(problem, Spring{particle, neighbour, stiffness, rest_length})));
        return {neighbour, std::uint32_t(rest_.size() - 1), Real(stiffness)};
    }

    std::vector<ListRange> ranges_;
    std::vector<Link<Real>> links_;
    /// First one per direction of the lattice (26), then two per spring of Problem::springs: one for either
    /// end. An edit adds new ones for the particles that it touches.
    std::vector<RestState<Real>> rest_;
};

template <class Real>
class CpuExplicit final : public MonitoredCpuBackend, public BorderFacet, public ToolFacet {
    using Vec3 = glm::vec<3, Real>;
    using Vectors = std::vector<Vec3>;

public:
    explicit CpuExplicit(const Options& options)
        : options_(options),
          formulation_(options.formulation),
          threads_(cpu_parallel::thread_count(options, name)),
          chosen_(options.tuning.at("threads") != "auto") {}

    Capabilities capabilities() const override {
        Capabilities all = cpu_capabilities("scalar", threads_);
        all.has_borders = true;
        return all;
    }

    void edit(const Problem& edited, const SpringEdit& edit) override {
        take(edited);
        links_.follow(edited, edit);
        // Edits leave unused list entries behind. Once the lists have more than doubled, they are made anew.
        if (links_.size() > 2 * uploaded_size_ + 4096) list_springs_anew();
    }

    ToolFacet* tool() override { return this; }
    void move_tool(const glm::dvec3& displacement) override { tool_moved_ = Vec3(displacement); }
    glm::dvec3 tool_force() override {
        glm::dvec3 sum(0);
        for (const Vec3& force : tool_forces_) sum -= glm::dvec3(force);
        return sum;
    }

    State download() override {
        State state = state_at_rest(*problem_);
        const Vectors &at = at_[current_], &previous = at_[1 - current_];
        each_particle([&](std::size_t i) {
            const glm::dvec3 rest = on_positions(formulation_) ? problem_->rest_position[i] : glm::dvec3(0);
            const glm::dvec3 here(at[i]);
            state.displacement[i] = here - rest;
            state.increment[i] =
                by_increments(formulation_) ? glm::dvec3(increment_[i]) : here - glm::dvec3(previous[i]);
            if (formulation_ != Formulation::compensated) return;
            state.displacement[i] += glm::dvec3(at_low_[current_][i]);
            state.increment[i] += glm::dvec3(increment_low_[i]);
        });
        return state;
    }

    BorderFacet* borders() override { return this; }
    std::unique_ptr<Border> border(const std::vector<std::uint32_t>& particles) override {
        const auto arrays = [this] {
            std::vector<Vectors*> all = {&at_[current_]};
            if (formulation_ == Formulation::compensated) all.push_back(&at_low_[current_]);
            return all;
        };
        return std::make_unique<VectorBorder<Vec3>>(arrays, particles);
    }

    std::optional<Choice> choice() const override {
        return choice_of_auto(options_, {{"threads", std::to_string(team())}});
    }

    StepWork step_work(const Problem& problem) const override {
        const std::uint64_t particles = problem.particle_count(), ends = 2 * count_springs(problem).total();
        const std::uint64_t load = problem.load.empty() ? 0 : 1;
        const bool increments = by_increments(formulation_);
        const std::uint64_t split = formulation_ == Formulation::compensated ? 1 : 0;
        // Formulations by increments read displacements from one array, write them to another, and change
        // increments in place. The others read one of two arrays of positions or displacements, and read and
        // overwrite the other. Low parts are read and written in the same way.
        const std::uint64_t parts = 1 + split, vector = sizeof(Vec3);
        const std::uint64_t others = load * vector + sizeof(Real) + sizeof(ListRange);
        const std::uint64_t written = (increments ? 2 : 1) * parts * vector;
        const std::uint64_t lists =
            ends * sizeof(Link<Real>) + 2 * problem.springs.size() * sizeof(RestState<Real>);
        // Operations at each end of a spring: 3 for the difference of its ends, and 6 more with low parts; 3
        // for the offset, if it is made from displacements; 20 or 10 for the force density; 3 for the force;
        // 3 to add it.
        const std::uint64_t spring =
            3 + split * 6 + (on_positions(formulation_) ? 0 : 3) + (increments ? 20 : 10) + 3 + 3;
        return {.bytes = particles * (2 * parts * vector + written + others) + lists,
                .written_bytes = particles * written,
                .footprint_bytes = particles * ((increments ? 3 : 2) * parts * vector + others) + lists,
                .operations = ends * spring + particles * (21 + split * 60 + 3 * load)};
    }

private:
    /// If the user does not choose the number of threads, each of several gets at least this many particles.
    static constexpr std::size_t min_particles = 1024;

    template <class Do>
    void each_particle(const Do& act) const {
        const auto particles = std::ptrdiff_t(problem_->particle_count());
#pragma omp parallel for schedule(static) num_threads(team())
        for (std::ptrdiff_t i = 0; i < particles; ++i) act(std::size_t(i));
    }
    int team() const {
        const std::size_t particles = problem_->particle_count();
        const std::size_t most = std::max<std::size_t>(1, chosen_ ? particles : particles / min_particles);
        return int(std::min(std::size_t(threads_), most));
    }

    void take(const Problem& problem) {
        problem_ = &problem;
        shortest_squared_ = Real(problem.shortest_squared());  // for a network, this visits all springs
    }

    void list_springs_anew() {
        links_ = {};  // frees the old lists before the new ones are made
        links_ = Links<Real>(*problem_);
        uploaded_size_ = links_.size();
    }

    void begin(const Problem& problem, const State& state) override {
        take(problem);
        current_ = 0;
        list_springs_anew();
        const std::size_t particles = problem.particle_count();
        const bool split = formulation_ == Formulation::compensated;
        for (std::size_t parity : {0, 1}) {
            at_[parity].assign(particles, Vec3(0));
            at_low_[parity].assign(split ? particles : 0, Vec3(0));
        }
        increment_.assign(by_increments(formulation_) ? particles : 0, Vec3(0));
        increment_low_.assign(split ? particles : 0, Vec3(0));
        inverse_mass_.assign(particles, Real(0));
        load_.assign(problem.load.empty() ? 0 : particles, Vec3(0));
        each_particle([&](std::size_t i) { pack(state, i); });
        tool_moved_ = Vec3(0);
        tool_forces_.assign(problem.tool.particles.size(), Vec3(0));
    }

    void pack(const State& state, std::size_t i) {
        const Problem& problem = *problem_;
        const glm::dvec3 moved = state.increment_of(i);
        const glm::dvec3 rest = on_positions(formulation_) ? problem.rest_position[i] : glm::dvec3(0);
        const glm::dvec3 here = rest + state.displacement_of(i);
        at_[0][i] = Vec3(here);
        at_[1][i] = Vec3(here - moved);
        inverse_mass_[i] = Real(1 / problem.material_of(i).mass);
        if (!load_.empty()) load_[i] = Vec3(problem.load[i]);
        if (by_increments(formulation_)) increment_[i] = Vec3(moved);
        if (formulation_ != Formulation::compensated) return;
        at_low_[0][i] = Vec3(lost_by<Real>(here));
        increment_low_[i] = Vec3(lost_by<Real>(moved));
    }

    void integrate(int count) override {
        cpu_parallel::Barrier barrier;
        const std::size_t first = current_;
        const std::size_t particles = problem_->particle_count();
#pragma omp parallel num_threads(team())
        {
            const auto threads = std::size_t(omp_get_num_threads()),
                       thread = std::size_t(omp_get_thread_num());
            const FlushSubnormals flush(true);
#pragma omp single
            barrier.expect(int(threads));
            for (int n = 0; n < count; ++n) {
                const std::size_t now = (first + std::size_t(n)) % 2;
                if (problem_->has_tool()) {
                    if (thread == 0) use_tool(now);
                    barrier.wait();
                }
                for (std::size_t i = particles * thread / threads; i < particles * (thread + 1) / threads;
                     ++i)
                    step_particle(i, now);
                barrier.wait();
            }
        }
        current_ = (first + std::size_t(count)) % 2;
    }

    /// Adds the tool's forces to the loads of the particles that it holds.
    void use_tool(std::size_t now) {
        const Tool& tool = problem_->tool;
        for (std::size_t n = 0; n < tool.particles.size(); ++n) {
            const std::uint32_t i = tool.particles[n];
            const glm::dvec3 rest = on_positions(formulation_) ? problem_->rest_position[i] : glm::dvec3(0);
            const Vec3 low = formulation_ == Formulation::compensated ? at_low_[now][i] : Vec3(0);
            tool_forces_[n] =
                hold_force(Vec3(rest + tool.held_at(n)), at_[now][i], low, tool_moved_, Real(tool.stiffness));
            load_[i] = Vec3(problem_->load[i]) + tool_forces_[n];
        }
    }

    Vec3 force_on(std::size_t i, std::size_t now) const {
        const Vectors &at = at_[now], &at_low = at_low_[now];
        const bool split = formulation_ == Formulation::compensated;
        Vec3 sum(0);
        links_.visit(i, [&](std::uint32_t j, const RestState<Real>& rest, Real stiffness) {
            Vec3 relative = at[i] - at[j];
            if (split) relative = relative + (at_low[i] - at_low[j]);
            if (by_increments(formulation_)) {
                sum += strain_force(relative, rest.offset, rest.length, rest.deficit, stiffness,
                                    shortest_squared_);
            } else {
                const Vec3 offset = on_positions(formulation_) ? relative : rest.offset + relative;
                sum += spring_force(offset, rest.length, stiffness, shortest_squared_);
            }
        });
        return load_.empty() ? sum : sum + load_[i];
    }

    void step_particle(std::size_t i, std::size_t now) {
        const Problem& problem = *problem_;
        const Vec3 here = at_[now][i];
        Vec3& next = at_[1 - now][i];
        const bool split = formulation_ == Formulation::compensated;
        if (problem.is_pinned(i)) {
            next = here;
            if (by_increments(formulation_)) increment_[i] = Vec3(0);
            if (split) {
                at_low_[1 - now][i] = at_low_[now][i];
                increment_low_[i] = Vec3(0);
            }
            return;
        }
        const Vec3 force = force_on(i, now);
        const Vec3 gravity(problem.gravity);
        const auto time_step_squared = Real(problem.time_step * problem.time_step);
        const auto retained = Real(1 - problem.damping);
        if (formulation_ == Formulation::paper) {
            next = paper_position(here, next, force, inverse_mass_[i], gravity, Real(2 - problem.damping),
                                  retained, time_step_squared);
        } else if (!by_increments(formulation_)) {
            next = next_position(here, next, force, inverse_mass_[i], gravity, retained, time_step_squared);
        } else {
            Vec3& increment = increment_[i];
            const Vec3 change = increment_change(increment, force, inverse_mass_[i], gravity,
                                                 Real(problem.damping), time_step_squared);
            if (!split) {
                increment += change;
                next = here + increment;
                return;
            }
            const Vec3 before = increment, before_low = increment_low_[i], low = at_low_[now][i];
            increment = split_high(before, before_low, change, Vec3(0));
            increment_low_[i] = split_low(before, before_low, change, Vec3(0));
            next = split_high(here, low, increment, increment_low_[i]);
            at_low_[1 - now][i] = split_low(here, low, increment, increment_low_[i]);
        }
    }

    bool within(double largest_increment) override {
        bool all = true;
        const Vectors &at = at_[current_], &previous = at_[1 - current_];
        const auto particles = std::ptrdiff_t(at.size());
#pragma omp parallel for schedule(static) num_threads(team()) reduction(&& : all)
        for (std::ptrdiff_t n = 0; n < particles; ++n) {
            const auto i = std::size_t(n);
            const glm::dvec3 here(at[i]);
            const glm::dvec3 moved =
                by_increments(formulation_) ? glm::dvec3(increment_[i]) : here - glm::dvec3(previous[i]);
            all = all && glm::length(moved) <= largest_increment && std::isfinite(glm::dot(here, here));
        }
        return all;
    }

    const Options options_;
    const Formulation formulation_;
    const int threads_;
    const bool chosen_;  ///< whether the user chose the number of threads
    const Problem* problem_ = nullptr;
    Real shortest_squared_ = 0;
    std::size_t current_ = 0;  ///< index of the array that has the current state
    Links<Real> links_;
    std::size_t uploaded_size_ = 0;
    /// Positions or displacements after even steps and after odd steps. The array that the next step
    /// overwrites holds the previous state until then.
    std::array<Vectors, 2> at_, at_low_;
    Vectors increment_, increment_low_, load_;
    std::vector<Real> inverse_mass_;
    Vec3 tool_moved_{0};
    Vectors tool_forces_;  ///< the tool's forces in the latest step, in the order of Tool::particles
};

std::uint64_t bytes(const Problem& problem, const Options& options) {
    const std::uint64_t vectors = 2 + (by_increments(options.formulation) ? 1 : 0) +
                                  (options.formulation == Formulation::compensated ? 3 : 0) +
                                  (problem.load.empty() ? 0 : 1);
    return by_precision(options.precision, [&]<class Real>(Real) {
        return problem.particle_count() *
                   (vectors * sizeof(glm::vec<3, Real>) + sizeof(Real) + sizeof(ListRange)) +
               2 * count_springs(problem).total() * sizeof(Link<Real>) +
               (neighbour_count + 2 * problem.springs.size()) * sizeof(RestState<Real>);
    });
}

const Registered entry({
    .name = name,
    .summary = "All cores, with neighbour lists: accepts any network of springs, sutures included.",
    .precisions = {Precision::float32, Precision::float64},
    .formulations = every_formulation,
    .tuning = {{"threads", {}}},
    .make = [](const Options& options) { return make_by_precision<CpuExplicit>(options, options); },
    .bytes = bytes,
});

}  // namespace
}  // namespace voxspring
