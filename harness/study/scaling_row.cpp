#include "harness/study/scaling_row.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <set>
#include <utility>

#include "harness/base/json.h"
#include "harness/base/text.h"
#include "harness/study/study_kind.h"

namespace voxspring {
namespace {

/// Whether ranks that exchange borders in this `way` step and send the borders of their parts first, so that
/// the borders travel while the rest of the part is stepped.
bool overlaps(const std::string& way) { return way.ends_with("_overlap"); }

/// "2600" for 2612.3: a figure of the model is given with no more than two significant digits.
std::string two_digits(double count) {
    const double unit = std::pow(10, std::max(0.0, std::floor(std::log10(count)) - 1));
    return fixed_text(unit * std::round(count / unit), 0);
}

/// The model that a row is compared with (compare()). Times are in seconds per step.
struct ScalingModel {
    double particle;         ///< time per particle, with one rank
    double own, ghosts;      ///< particles of the largest part: those it steps, and those it only reads
    double particles;        ///< particles of the body
    double latency, border;  ///< time of an exchange: fixed, and for its bytes
    bool overlaps;

    /// Seconds per step for a body of the same shape, `scale` times as long along each axis.
    double seconds(double scale) const {
        const double area = scale * scale;
        const double compute = particle * (own * area * scale + ghosts * area);
        const double exchange = latency + border * area;
        return overlaps ? std::max(compute, exchange) : compute + exchange;
    }
    double seconds_of_one(double scale) const { return particle * particles * scale * scale * scale; }
};

}  // namespace

void compare(ScalingRow& row, const ScalingRow& one) {
    const double particle = one.seconds_per_step / double(one.workpiece->particles);
    const auto particles = double(row.workpiece->particles);
    row.efficiency = particle * particles / (row.ranks * row.seconds_per_step);
    const double own = std::min(double(row.largest_part), std::ceil(particles / row.ranks));
    const ScalingModel model{.particle = particle,
                             .own = own,
                             .ghosts = double(row.largest_part) - own,
                             .particles = particles,
                             .latency = row.latency_seconds.value_or(0),
                             .border = row.seconds_per_byte.value_or(0) * double(row.border_bytes),
                             .overlaps = overlaps(row.way)};
    row.predicted_seconds = model.seconds(1);
    if (row.ranks == 1 || model.latency <= 0) return;
    // The search needs a small body for which one rank is faster, and a large one for which several ranks
    // are.
    double small = 1e-3, large = 1e3;
    const auto pays = [&](double scale) { return model.seconds(scale) < model.seconds_of_one(scale); };
    if (pays(small) || !pays(large)) return;
    constexpr int halvings = 60;
    for (int i = 0; i < halvings; ++i) {
        const double middle = std::sqrt(small * large);
        (pays(middle) ? large : small) = middle;
    }
    row.pays_from_particles = particles * large * large * large;
}

std::vector<ScalingRow> scaling_rows_of(JsonObject result, const std::string& scene) {
    Result read = read_result_of("scaling", std::move(result), scene, {"ranks", "seconds_per_step"});
    std::vector<ScalingRow> rows = std::move(read.rows<ScalingRow>("scaling"));
    std::erase_if(rows, [&](const ScalingRow& row) { return row.identity.scene != scene; });
    return rows;
}

void print_samples(const std::vector<ScalingRow>& rows, std::ostream& out) {
    std::set<std::string> printed;
    for (const ScalingRow& row : rows) {
        const std::string& scene = row.identity.scene;
        if (!row.judged_particles || !printed.insert(scene).second) continue;
        out << scene << ": errors, and equality of bits with one rank, are measured on a sample of "
            << *row.judged_particles << " of " << row.workpiece->particles
            << " particles, at either end and in the middle\n";
    }
}

void print_what_pays(const std::vector<ScalingRow>& rows, std::ostream& out) {
    for (const ScalingRow& one : rows) {
        if (one.ranks != 1 || one.scaling != "strong") continue;
        const ScalingRow* best = nullptr;
        for (const ScalingRow& row : rows) {
            const bool alike = row.family == one.family && row.label() == one.label();
            if (alike && row.ranks > 1 && (best == nullptr || row.seconds_per_step < best->seconds_per_step))
                best = &row;
        }
        if (best == nullptr) continue;
        const double times = one.seconds_per_step / best->seconds_per_step;
        out << one.identity.scene << " " << one.label() << ": "
            << (times > 1 ? "several ranks pay: " : "several ranks do not pay: ") << best->ranks
            << " ranks (parts " << best->cut << ", messages by " << best->way << ") are "
            << fmt::format("{:.2f}", times) << " times as fast as one";
        if (best->pays_from_particles) {
            const std::string from = two_digits(*best->pays_from_particles) + " particles of this shape on";
            const bool by_model = double(one.workpiece->particles) >= *best->pays_from_particles;
            if (by_model != (times > 1)) {
                out << "; the model contradicts this: by it they are faster from " << from;
            } else {
                out << (times > 1 ? ", and by the model they are faster from "
                                  : "; by the model they are faster from ")
                    << from;
            }
        }
        for (const std::string& reason : best->noisy) out << " (" << reason << ")";
        out << "\n";
    }
}

}  // namespace voxspring
