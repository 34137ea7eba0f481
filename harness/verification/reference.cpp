#include "harness/verification/reference.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstring>
#include <glm/geometric.hpp>
#include <limits>
#include <sstream>
#include <utility>

#include "backends/registry.h"
#include "harness/base/executable.h"
#include "harness/scene/scene_runner.h"

namespace voxspring {
namespace {

const std::string reference = reference_backend + ":formulation=increment";
const std::string reference_without_lists = "cpu_parallel:precision=float64,formulation=increment";

static_assert(sizeof(glm::dvec3) == 3 * sizeof(double));

/// A state as the cache keeps it: displacements, then increments.
std::string packed(const State& state) {
    std::string bytes;
    for (const auto* vectors : {&state.displacement, &state.increment})
        bytes.append(reinterpret_cast<const char*>(vectors->data()), vectors->size() * sizeof(glm::dvec3));
    return bytes;
}

/// Nothing if that is no state of `particles`.
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

void add(Hash& hash, const Spring& spring) {
    hash.add_number(spring.first);
    hash.add_number(spring.second);
    hash.add_number(spring.stiffness);
    hash.add_number(spring.rest_length);
}

/// All that determines a trajectory: the program that computes it, and what it is given.
std::string name_of(const Scene& scene, int steps, const std::string& specification) {
    Hash hash;
    hash.add(fingerprint_of_executable());
    hash.add(specification);
    hash.add_number(steps);
    const Problem& problem = scene.problem;
    hash.add_numbers(problem.rest_position);
    for (const Material& material : problem.materials) {
        hash.add_number(material.mass);
        hash.add_number(material.stiffness);
    }
    hash.add_numbers(problem.material);
    hash.add_numbers(problem.pinned);
    hash.add_numbers(problem.load);
    hash.add_number(problem.lattice.dims);
    hash.add_number(problem.lattice.spacing);
    hash.add_numbers(problem.lattice.voxel);
    hash.add_numbers(problem.lattice.mask);
    hash.add_number(problem.rest_length);
    hash.add_number(problem.group_stiffness);
    hash.add_number(problem.group_bits);
    hash.add_number(problem.springs.size());
    for (const Spring& spring : problem.springs) add(hash, spring);
    hash.add_number(problem.gravity);
    hash.add_number(problem.damping);
    hash.add_number(problem.time_step);
    hash.add_numbers(scene.state.displacement);
    hash.add_numbers(scene.state.increment);
    for (const ScheduledEdit& scheduled : scene.edits) {
        if (scheduled.step >= steps) break;
        hash.add_number(scheduled.step);
        for (const auto* list : {&scheduled.edit.removed, &scheduled.edit.added}) {
            hash.add_number(list->size());
            for (const ChangedSpring& changed : *list) {
                add(hash, changed.spring);
                hash.add_number(changed.bit);
            }
        }
    }
    return hash.text();
}

/// One step of Neville's scheme: to dt = 0 from two values whose squared steps have the given ratio of roots.
std::vector<glm::dvec3> extrapolate(const std::vector<glm::dvec3>& coarse,
                                    const std::vector<glm::dvec3>& fine, double ratio) {
    std::vector<glm::dvec3> result(fine.size());
    const double weight = 1 / (ratio * ratio - 1);
    for (std::size_t i = 0; i < fine.size(); ++i) result[i] = fine[i] + weight * (fine[i] - coarse[i]);
    return result;
}

}  // namespace

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

    const auto backend = BackendSpec::parse(reference).make();
    backend->upload(scene.problem, scene.state);
    backend->step(1);
    const State next = backend->download();
    for (std::size_t i = 0; i < problem.particle_count(); ++i) {
        glm::dvec3& increment = refined.state.increment[i];
        if (problem.is_pinned(i)) {
            increment = glm::dvec3(0);
            continue;
        }
        // a dt^2, all of it at the scene's own step.
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

bool References::is_large(const Scene& scene) {
    constexpr std::size_t most_particles = std::size_t(1) << 22;
    return scene.problem.particle_count() > most_particles &&
           SceneRunner(scene).unsupported(*BackendSpec::parse(reference_without_lists).make()).empty();
}

void References::play(SceneRunner& runner, Backend& backend, int steps) const {
    using Clock = std::chrono::steady_clock;
    constexpr std::chrono::duration<double> often(0.1);
    const auto begin = Clock::now();
    // Pieces that take about that long: the state is the same however a run is cut into calls.
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

State References::computed(const Scene& scene, int steps, const std::string& specification) {
    const auto backend = BackendSpec::parse(specification).make();
    SceneRunner runner(scene);
    runner.rewind(*backend);
    if (on_progress_) {
        play(runner, *backend, steps);
    } else {
        runner.run(*backend, steps);
    }
    ++computed_;
    return backend->download();
}

const State& References::run(const Scene& scene, int steps, const std::string& specification) {
    const std::string name = name_of(scene, steps, specification);
    if (const auto known = latest_.find(name); known != latest_.end()) return known->second;
    std::optional<State> state = unpacked(cache_.find(name), scene.problem.particle_count());
    if (!state) {
        state = computed(scene, steps, specification);
        cache_.keep(name, packed(*state));
    }
    constexpr std::size_t most_bytes = std::size_t(1) << 30;
    if ((latest_.size() + 1) * sizeof(glm::dvec3) * 2 * state->displacement.size() > most_bytes)
        latest_.clear();
    return latest_[name] = *std::move(state);
}

State References::after(const Scene& scene, int steps) {
    const std::string of = specification(scene);
    return is_large(scene) ? computed(scene, steps, of) : run(scene, steps, of);
}

std::string References::specification(const Scene& scene) {
    return is_large(scene) ? reference_without_lists : reference;
}

Refined References::refined(const Scene& scene, const Span& span, std::vector<int> counts) {
    constexpr int doublings = 4;
    constexpr std::size_t most_columns = 5;  // beyond the tenth order rounding decides
    constexpr double smallest = 1e-11;
    Refined result;
    if (!scene.edits.empty()) {
        result.reason = "its springs change on the way, which makes the order in time one";
        return result;
    }
    const std::size_t asked = counts.size();
    while (counts.size() < asked + doublings && counts.back() <= std::numeric_limits<int>::max() / 2)
        counts.push_back(2 * counts.back());

    std::vector<std::vector<glm::dvec3>> row;  // of Neville's tableau, the run itself first
    std::vector<glm::dvec3> finest_asked;
    for (std::size_t k = 0; k < counts.size(); ++k) {
        std::vector<std::vector<glm::dvec3>> next;
        next.push_back(after(in_steps(scene, span, counts[k]), counts[k]).displacement);
        if (k + 1 == asked) finest_asked = next.front();
        for (std::size_t column = 1; column <= std::min(row.size(), most_columns); ++column) {
            const double ratio = double(counts[k]) / counts[k - column];
            next.push_back(extrapolate(row[column - 1], next[column - 1], ratio));
        }
        std::swap(row, next);
        if (k + 1 < asked || row.size() < 3) continue;
        // Within a row neighbours are close whether or not it converges: their difference is that to the row
        // before, divided by up to 4^5 - 1.
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
    std::ostringstream reason;
    reason << "float64 does not converge: its extrapolations in " << result.finest << " steps differ by "
           << result.uncertainty;
    result.reason = reason.str();
    return result;
}

Chaos References::chaos(const Scene& scene, int steps) {
    if (is_large(scene)) return {};
    const std::string other = "cpu_parallel:precision=float64";
    const Formulation formulation = BackendSpec::parse(other).options.formulation;
    if (!SceneRunner(scene).unsupported(*BackendSpec::parse(other).make()).empty()) return {};
    const State one = run(scene, steps, "cpu_reference:formulation=" + to_string(formulation));
    return {relative_difference(run(scene, steps, other).displacement, one.displacement)};
}

}  // namespace voxspring
