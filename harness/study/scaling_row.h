// A row of a study `scaling`, the model that it is compared with, and advice on the use of several devices.
#pragma once

#include <cstdint>
#include <optional>
#include <ostream>
#include <string>
#include <vector>

#include "harness/base/json.h"
#include "harness/results/row.h"

namespace voxspring {

/// The times of one or several ranks.
struct ScalingRow : Row {
    /// Rows of one family are compared: those of one scene, or of scenes that grow with the ranks.
    std::string family = {};
    std::string scaling = {};  ///< "strong": one scene; "weak": scenes that grow with the ranks
    int ranks = 1;
    std::string cut = {};  ///< how many parts along x, y and z: "1x1x2"
    std::string way = {};  ///< how borders are exchanged: "none", or one of known_ways
    double seconds_per_step = 0;
    /// Times of one step, in the rank with the most work.
    double compute_seconds = 0, exchange_seconds = 0, waiting_seconds = 0;
    std::uint64_t largest_part = 0;  ///< particles of the largest part, ghosts included
    std::uint64_t ghosts = 0;        ///< number of ghosts of all parts together
    std::uint64_t border_bytes = 0;  ///< the most bytes that a rank sends per step
    std::optional<double> latency_seconds = {}, seconds_per_byte = {};
    std::optional<bool> same_bits = {};
    std::optional<double> efficiency = {}, predicted_seconds = {};
    std::optional<std::uint64_t> judged_particles = {};  ///< size of the sample; empty: all are judged
    /// Number of particles from which on `ranks` ranks are faster than one in the model of compare().
    std::optional<double> pays_from_particles = {};

    static void fields(auto& row, auto& of) {
        of.required("family", row.family);
        of.required("scaling", row.scaling);
        of.required("ranks", row.ranks);
        of.required("cut", row.cut);
        of.required("way", row.way);
        of.required("seconds_per_step", row.seconds_per_step);
        of.required("compute_seconds", row.compute_seconds);
        of.required("exchange_seconds", row.exchange_seconds);
        of.required("waiting_seconds", row.waiting_seconds);
        of.required("largest_part", row.largest_part);
        of.required("ghosts", row.ghosts);
        of.required("border_bytes", row.border_bytes);
        of.nullable("latency_seconds", row.latency_seconds);
        of.nullable("seconds_per_byte", row.seconds_per_byte);
        of.nullable("same_bits", row.same_bits);
        of.nullable("efficiency", row.efficiency);
        of.nullable("predicted_seconds", row.predicted_seconds);
        of.nullable("pays_from_particles", row.pays_from_particles);
        of.nullable("judged_particles", row.judged_particles);
    }
};

/// Compares `row` with `one`, the row of the same family with one rank, and sets efficiency, prediction and
/// `pays_from_particles`. In the model each particle of the largest part takes as long as in `one`, and the
/// largest number of bytes is exchanged. The time of a step is the sum of computing and exchanging, or the
/// longer of the two if they overlap. Borders grow with the square of a body's length. In the model
/// `row.ranks` ranks are as fast as one if the body has `pays_from_particles` particles. That is empty if the
/// time of an exchange was not measured, or if there is no such size.
void compare(ScalingRow& row, const ScalingRow& one);

/// The rows of `scene` in the result of a scaling study. Throws BadInput as read_result_of().
std::vector<ScalingRow> scaling_rows_of(JsonObject result, const std::string& scene);

/// Prints which scenes were verified by a sample only.
void print_samples(const std::vector<ScalingRow>& rows, std::ostream& out);

/// Prints, for each backend and each scene of fixed size, which number of several ranks, cut and way of
/// exchange is the fastest, and whether it is faster than one rank.
void print_what_pays(const std::vector<ScalingRow>& rows, std::ostream& out);

}  // namespace voxspring
