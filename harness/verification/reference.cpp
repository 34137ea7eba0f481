#include "harness/verification/reference.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <glm/geometric.hpp>
#include <limits>
#include <stdexcept>
#include <type_traits>
#include <utility>

#include "backends/cpu/perturbed_reference.h"
#include "backends/registry.h"
#include "harness/base/files.h"
#include "harness/scene/scene_runner.h"
#include "harness/verification/divergence.h"
#include "harness/verification/error_threshold.h"
#include "harness/verification/random_starts.h"
#include "harness/verification/verify.h"

namespace voxspring {
namespace {

const std::string reference = reference_backend + ":formulation=increment";

/// References of scenes with more particles are neither cached nor checked against cpu_reference.
constexpr std::size_t max_listed_particles = std::size_t(1) << 22;
/// Particles times steps that cpu_reference computes in about a second.
constexpr double max_plain_updates = 1e7;
/// Particles times steps of a check against cpu_reference: a wrong force shows in the first step, a wrong
/// velocity in the second.
constexpr double max_checked_updates = 2e6;
constexpr int min_checked_steps = 2;
/// Limit of particles times steps of all refined runs together: about a minute on two cores. Beyond it no
/// total error is computed.
constexpr double max_refined_updates = 5e9;
/// How many of the first steps of a run on all cores are checked against cpu_reference. Later steps may
/// differ widely, because the two backends sum in different orders.
constexpr int max_checked_steps = 100;

/// Whether the scene is too large for the cache and for the check against cpu_reference.
bool is_large(const Scene& scene) { return scene.problem.particle_count() > max_listed_particles; }
bool is_plain(const Scene& scene, int steps) {
    return double(scene.problem.particle_count()) * std::max(steps, 1) <= max_plain_updates;
}

static_assert(sizeof(glm::dvec3) == 3 * sizeof(double));

/// The bytes of a state in the cache: displacements, then increments.
std::string packed(const State& state) {
    std::string bytes;
    for (const auto* vectors : {&state.displacement, &state.increment})
        bytes.append(reinterpret_cast<const char*>(vectors->data()), vectors->size() * sizeof(glm::dvec3));
    return bytes;
}

/// The state in these bytes, or nullopt if they are no state of `particles` particles.
std::optional<State> unpacked(const std::optional<std::string>& bytes, std::size_t particles) {
    const std::size_t size = particles * sizeof(glm::dvec3);
    if (!bytes || bytes->size() != 2 * size) return std::nullopt;
    State state;
    const char* from = bytes->data();
    for (auto* vectors : {&state.displacement, &state.increment}) {
        vectors->resize(particles);
        if (particles > 0) std::memcpy(vectors->data(), from, size);
        from += size;
    }
    return state;
}

/// Adds one list of the state at the start. An empty list gives the same hash as a list of zeros.
void add_start(Hash& hash, const std::vector<glm::dvec3>& list, std::size_t particles) {
    if (!list.empty()) return hash.add_numbers(list);
    hash.add_number(particles);
    constexpr std::size_t at_once = 1024;
    const std::vector<glm::dvec3> zeros(std::min(particles, at_once), glm::dvec3(0));
    for (std::size_t done = 0; done < particles; done += at_once)
        hash.add(zeros.data(), std::min(at_once, particles - done) * sizeof(glm::dvec3));
}

void add(Hash& hash, const Spring& spring) {
    hash.add_number(spring.first);
    hash.add_number(spring.second);
    hash.add_number(spring.stiffness);
    hash.add_number(spring.rest_length);
}

/// Adds everything on which a run of `steps` steps depends.
void add(Hash& hash, const Scene& scene, int steps) {
    hash.add_number(steps);
    // The structured binding names all members, so that a new member does not compile until it is added here.
    const auto& [rest_position, materials, material, pinned, ghosts, load, tool, lattice, rest_length,
                 group_stiffness, group_bits, springs, gravity, damping, time_step] = scene.problem;
    hash.add_numbers(rest_position);
    for (const Material& one : materials) {
        hash.add_number(one.mass);
        hash.add_number(one.stiffness);
    }
    hash.add_numbers(material);
    hash.add_numbers(pinned);
    hash.add_numbers(load);
    hash.add_number(lattice.dims);
    hash.add_number(lattice.spacing);
    hash.add_numbers(lattice.voxel);
    hash.add_numbers(lattice.mask);
    hash.add_number(rest_length);
    hash.add_number(group_stiffness);
    hash.add_number(group_bits);
    hash.add_number(springs.size());
    for (const Spring& spring : springs) add(hash, spring);
    hash.add_number(gravity);
    hash.add_number(damping);
    hash.add_number(time_step);
    add_start(hash, scene.state.displacement, scene.problem.particle_count());
    add_start(hash, scene.state.increment, scene.problem.particle_count());
    // Ghosts, the tool and edits are added only if present, so that they change no hash, and thus no seed, of
    // scenes without them.
    if (!ghosts.empty()) hash.add_numbers(ghosts);
    if (scene.problem.has_tool()) {
        hash.add_numbers(tool.particles);
        hash.add_numbers(tool.held);
        hash.add_number(tool.stiffness);
        hash.add_number(scene.tool_motion.every);
        hash.add_numbers(scene.tool_motion.time);
        hash.add_numbers(scene.tool_motion.displacement);
    }
    for (const ScheduledEdit& scheduled : scene.edits) {
        if (scheduled.step >= steps) break;
        hash.add_number(scheduled.step);
        for (const auto* changes : {&scheduled.edit.removed, &scheduled.edit.added}) {
            const std::vector<ChangedSpring> list = changed_springs(scene.problem, *changes);
            hash.add_number(list.size());
            for (const ChangedSpring& changed : list) {
                add(hash, changed.spring);
                hash.add_number(changed.bit);
            }
        }
    }
}

/// Name of a cached result: a hash of the scene, the program and the kind of result.
std::string name_of(const Scene& scene, int steps, const std::string& what) {
    Hash hash;
    hash.add(fingerprint_of_code());
    hash.add(what);
    add(hash, scene, steps);
    return hash.text();
}

/// A hash that is equal on every machine and for every build.
std::string hash_for_seed(const Scene& scene, int steps, const RoundingModel& model) {
    Hash hash;
    hash.add(to_string(model));
    add(hash, scene, steps);
    return hash.text();
}
std::uint64_t seed_of(const std::string& hash) { return std::stoull(hash.substr(0, 16), nullptr, 16); }

/// Calls hash_of_model() for all models in parallel, since hashing a large scene takes long.
std::vector<std::string> hashes_of(const std::vector<RoundingModel>& models,
                                   const std::function<std::string(const RoundingModel&)>& hash_of_model) {
    (void)fingerprint_of_code();  // called here first because it may throw
    std::vector<std::string> hashes(models.size());
#pragma omp parallel for schedule(dynamic) if (models.size() > 1)
    for (std::ptrdiff_t n = 0; n < std::ptrdiff_t(models.size()); ++n)
        hashes[std::size_t(n)] = hash_of_model(models[std::size_t(n)]);
    return hashes;
}

/// How many of the runs of a scene, of counts[0], counts[1]... steps, fit into max_refined_updates together.
std::size_t affordable_runs(const Scene& scene, const std::vector<int>& counts) {
    double updates = 0;
    for (std::size_t k = 0; k < counts.size(); ++k) {
        updates += double(scene.problem.particle_count()) * counts[k];
        if (updates > max_refined_updates) return k;
    }
    return counts.size();
}

/// One step of Neville's scheme: extrapolates to dt = 0 from two results, whose time steps have the ratio
/// `ratio`.
std::vector<glm::dvec3> extrapolate(const std::vector<glm::dvec3>& coarse,
                                    const std::vector<glm::dvec3>& fine, double ratio) {
    std::vector<glm::dvec3> result(fine.size());
    const double weight = 1 / (ratio * ratio - 1);
    for (std::size_t i = 0; i < fine.size(); ++i) result[i] = fine[i] + weight * (fine[i] - coarse[i]);
    return result;
}

}  // namespace

/// Memory that perturbed runs use one after the other.
struct References::PerturbedRuns {
    std::unique_ptr<PerturbedReference> backend;
    State state;  ///< the final state of the latest run
};

const State* LatestStates::find(const std::string& name) const {
    const auto found = states_.find(name);
    return found != states_.end() ? &found->second : nullptr;
}

const State& LatestStates::keep(const std::string& name, State state) {
    const std::size_t more = (state.displacement.size() + state.increment.size()) * sizeof(glm::dvec3);
    if (bytes_ + more > max_bytes_) {
        states_.clear();
        bytes_ = 0;
    }
    bytes_ += more;
    return states_[name] = std::move(state);
}

std::string fingerprint_of(const Scene& scene) {
    return name_of(scene, std::numeric_limits<int>::max(), "any backend");
}

double relative_difference(const std::vector<glm::dvec3>& a, const std::vector<glm::dvec3>& b) {
    double difference = 0, size = 0;
    for (std::size_t i = 0; i < b.size(); ++i) {
        difference += glm::dot(a[i] - b[i], a[i] - b[i]);
        size += glm::dot(b[i], b[i]);
    }
    if (difference == 0) return 0;
    return size > 0 ? std::sqrt(difference / size) : std::numeric_limits<double>::infinity();
}

Scene at_time_step(const Scene& scene, double time_step) {
    Scene refined = scene;
    Problem& problem = refined.problem;
    if (time_step == problem.time_step) return refined;
    const double ratio = time_step / problem.time_step;
    const double scale = 1 - problem.damping / 2;
    const double g = problem.damping / (2 - problem.damping) * ratio;
    const double refined_scale = 1 / (1 + g);

    const auto backend = References::backend_of(scene, 1);
    backend->upload(scene.problem, scene.state);
    backend->step(1);
    const State next = backend->download();
    refined.state = scene.state.in_full(problem.particle_count());
    for (std::size_t i = 0; i < problem.particle_count(); ++i) {
        glm::dvec3& increment = refined.state.increment[i];
        if (problem.is_pinned(i)) {
            increment = glm::dvec3(0);
            continue;
        }
        // The acceleration times dt^2, where dt is the scene's time step, not the refined one.
        const glm::dvec3 accelerated = next.increment[i] - (1 - problem.damping) * increment;
        const glm::dvec3 velocity = scale * increment + accelerated / 2.0;
        increment = ratio * ((1 + g) * velocity - ratio / 2 / scale * accelerated);
    }
    problem.time_step = time_step;
    problem.damping = 2 * g * refined_scale;
    for (Material& material : problem.materials) material.mass *= scale / refined_scale;
    problem.gravity *= refined_scale / scale;
    return refined;
}

Scene in_steps(const Scene& scene, const Span& span, int steps) {
    return at_time_step(scene, span.time_step * (double(span.steps) / steps));
}

std::unique_ptr<Backend> References::backend_of(const Scene& scene, int steps) {
    return is_plain(scene, steps) ? BackendSpec::parse(reference).make() : make_perturbed_reference({});
}

std::string References::name_of_backend(const Scene& scene, int steps) {
    return is_plain(scene, steps) ? reference_backend : parallel_reference_name;
}

/// Runs the scene from its start. `runner` holds the edited problem, which `backend` reads until the next
/// upload.
void References::play(SceneRunner& runner, int steps, Backend& backend) const {
    runner.rewind(backend);
    if (!on_progress_) {
        runner.run(backend, steps);
        return;
    }
    using Clock = std::chrono::steady_clock;
    constexpr std::chrono::duration<double> often(0.1);
    const auto begin = Clock::now();
    // The run is cut into pieces that take about `often` each. The state does not depend on how it is cut.
    for (int done = 0, piece = 1; done < steps;) {
        piece = std::min(piece, steps - done);
        const auto piece_begin = Clock::now();
        runner.run(backend, piece);
        backend.synchronize();
        done += piece;
        const auto now = Clock::now();
        if (now - begin >= quiet_) on_progress_(done, steps);
        if (now - piece_begin < often / 2) piece *= 2;
    }
}

State References::computed(const Scene& scene, int steps, Backend& backend) const {
    SceneRunner runner(scene);
    play(runner, steps, backend);
    return backend.download();
}

void References::check_first_steps(const Scene& scene, int steps) const {
    if (is_large(scene)) return;
    const double affordable = max_checked_updates / double(scene.problem.particle_count());
    const int first = std::min(std::clamp(int(affordable), min_checked_steps, max_checked_steps), steps);
    const auto plain = BackendSpec::parse(reference).make();
    const auto parallel = make_perturbed_reference({});
    const State one = computed(scene, first, *plain), other = computed(scene, first, *parallel);
    // A run that diverges leaves nothing to compare. Its rows say that it has diverged.
    if (farthest(one) > largest_increment(scene, first)) return;
    // Both backends compute in float64, and sum forces in different orders. In so few steps their relative
    // difference is at most this.
    constexpr double agreement = 1e-9;
    const double apart = relative_difference(other.displacement, one.displacement);
    if (apart <= agreement) return;
    throw std::logic_error(fmt::format(
        "after {} steps {} differs from {} by {:g} (relative L2): neither can serve as the reference", first,
        parallel_reference_name, reference_backend, apart));
}

State References::after(const Scene& scene, int steps) {
    const std::string backend = name_of_backend(scene, steps);
    const bool keeps = !is_large(scene);
    const std::string name = keeps ? name_of(scene, steps, backend) : std::string();
    if (const State* const known = latest_.find(name); keeps && known != nullptr) return *known;
    std::optional<State> state;
    if (keeps) state = unpacked(cache_.find(name), scene.problem.particle_count());
    if (state) return latest_.keep(name, *std::move(state));
    if (!is_plain(scene, steps)) check_first_steps(scene, steps);
    state = computed(scene, steps, *backend_of(scene, steps));
    ++computed_;
    if (!keeps) return *std::move(state);
    cache_.keep(name, packed(*state));
    return latest_.keep(name, *std::move(state));
}

std::vector<Spread> References::spreads(const Scene& scene, int steps, const State& expected,
                                        const std::vector<RoundingModel>& models) {
    static_assert(std::is_trivially_copyable_v<Spread>);
    const auto names = hashes_of(models, [&](const RoundingModel& model) {
        return name_of(scene, steps, "spread of " + to_string(model));
    });
    std::vector<Spread> spreads(models.size());
    std::vector<std::size_t> missing;
    std::vector<RoundingModel> missing_models;
    for (std::size_t n = 0; n < models.size(); ++n) {
        const auto known = cache_.find(names[n]);
        if (known && known->size() == sizeof(Spread)) {
            std::memcpy(&spreads[n], known->data(), sizeof(Spread));
        } else {
            missing.push_back(n);
            missing_models.push_back(models[n]);
        }
    }
    if (missing.empty()) return spreads;
    const auto seeds = hashes_of(
        missing_models, [&](const RoundingModel& model) { return hash_for_seed(scene, steps, model); });
    PerturbedRuns runs{make_perturbed_reference({}), {}};
    for (std::size_t m = 0; m < missing.size(); ++m) {
        Spread& spread = spreads[missing[m]];
        spread = measured_spread(scene, steps, expected, models[missing[m]], seed_of(seeds[m]), runs);
        cache_.keep(names[missing[m]], {reinterpret_cast<const char*>(&spread), sizeof spread});
    }
    return spreads;
}

Spread References::measured_spread(const Scene& scene, int steps, const State& expected,
                                   const RoundingModel& model, std::uint64_t seed,
                                   PerturbedRuns& runs) const {
    Spread spread;
    const Comparison motion = differences(expected, scene.state);
    spread.motion_max = motion.max;
    spread.motion_rms = motion.rms;
    spread.motion_mean = motion.mean;
    const int random = random_runs(scene.problem.particle_count());
    const auto rounded = [&](int run) -> const State& {
        runs.backend->perturb({run == 0 ? Perturbation::Kind::nearest : Perturbation::Kind::random,
                               model.formulation, model.precision, model.root_error,
                               seed + std::uint64_t(run)});
        SceneRunner runner(scene);
        play(runner, steps, *runs.backend);
        runs.backend->read(runs.state);
        return runs.state;
    };
    // Only chaotic scenes are judged by statistics. Usually the first run shows that a scene is chaotic. Any
    // runs before the one that shows it are repeated in the end, to take their statistics.
    std::optional<Problem> edited;
    std::optional<StateSummary> reference_summary;
    const auto take_statistics = [&](const State& state) {
        if (!scene.edits.empty() && !edited) edited = problem_after(scene, steps);
        const Problem& last = edited ? *edited : scene.problem;
        if (!reference_summary) reference_summary = summary_of(last, scene.state, expected);
        const Statistics found = statistics(summary_of(last, scene.state, state), *reference_summary);
        for (std::size_t kind = 0; kind < found.size(); ++kind)
            spread.statistic[kind] = std::max(spread.statistic[kind], found[kind].difference);
    };
    int without_statistics = 0;
    for (int run = 0; run <= random; ++run) {
        const State& state = rounded(run);
        const Comparison apart = differences(state, expected);
        // If a state is not finite the differences are infinite, and the scene counts as chaotic.
        spread.max = std::max(spread.max, apart.max);
        spread.rms = std::max(spread.rms, apart.rms);
        spread.mean = std::max(spread.mean, apart.mean);
        ++spread.runs;
        if (!is_chaotic(spread)) {
            ++without_statistics;
        } else if (apart.finite) {
            take_statistics(state);
        }
    }
    if (!is_chaotic(spread)) return spread;
    for (int run = 0; run < without_statistics; ++run) take_statistics(rounded(run));
    return spread;
}

Refined References::refined(const Scene& scene, const Span& span, std::vector<int> counts) {
    constexpr int doublings = 4;
    constexpr std::size_t max_columns = 5;  // removes errors up to dt^10; beyond, rounding dominates
    constexpr double smallest = 1e-11;
    Refined result;
    if (!scene.edits.empty()) {
        result.reason = "its springs change during the run, so that convergence in time is of first order";
        return result;
    }
    if (scene.problem.has_tool()) {
        result.reason = "its tool moves in jumps, so that convergence in time is of first order";
        return result;
    }
    const std::size_t asked = counts.size();
    while (counts.size() < asked + doublings && counts.back() <= std::numeric_limits<int>::max() / 2)
        counts.push_back(2 * counts.back());

    // An estimate needs all runs that were asked for, and at least three runs. If these are not affordable,
    // no run is made.
    std::size_t affordable = affordable_runs(scene, counts);
    if (affordable < std::min(counts.size(), std::max<std::size_t>(asked, 3))) affordable = 0;
    std::vector<std::vector<glm::dvec3>> row;  // of Neville's tableau: the run, then its extrapolations
    std::vector<glm::dvec3> finest_asked;
    for (std::size_t k = 0; k < counts.size(); ++k) {
        if (k == affordable) {
            result.reason = fmt::format(
                "smaller time steps in float64 would take too many particle updates: more than {:.0f}",
                max_refined_updates);
            return result;
        }
        std::vector<std::vector<glm::dvec3>> next;
        next.push_back(after(in_steps(scene, span, counts[k]), counts[k]).displacement);
        if (k + 1 == asked) finest_asked = next.front();
        for (std::size_t column = 1; column <= std::min(row.size(), max_columns); ++column) {
            const double ratio = double(counts[k]) / counts[k - column];
            next.push_back(extrapolate(row[column - 1], next[column - 1], ratio));
        }
        std::swap(row, next);
        if (k + 1 < asked || row.size() < 3) continue;
        // The best extrapolation is compared with that of the row before. Neighbours within a row are close
        // even without convergence, since their difference is the difference from the row before divided by
        // up to 4^5 - 1.
        const std::vector<glm::dvec3>& best = row.back();
        result.uncertainty = relative_difference(next.back(), best);
        result.finest = counts[k];
        const double wanted =
            std::max(smallest, 0.01 * std::min(1.0, relative_difference(finest_asked, best)));
        if (result.uncertainty <= wanted) {
            result.displacement = best;
            return result;
        }
    }
    result.reason = fmt::format(
        "float64 does not converge as the time step shrinks: extrapolations with and without the run of {} "
        "steps differ by {:g}",
        result.finest, result.uncertainty);
    return result;
}

}  // namespace voxspring
