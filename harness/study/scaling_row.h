// A row of a study `scaling`, the model that it is compared with, and what follows for who has more devices.
#pragma once

#include <cstdint>
#include <nlohmann/json.hpp>
#include <optional>
#include <ostream>
#include <string>
#include <vector>

#include "harness/base/json.h"
#include "harness/results/row.h"

namespace voxspring {

/// What several ranks took, or one.
struct ScalingRow {
    Row row;
    std::string family = {};   ///< of rows that are compared: a scene, or scenes that grow with the ranks
    std::string scaling = {};  ///< "strong", "weak"
    int ranks = 1;
    std::string cut = {};  ///< how many parts along x, y and z: "1x1x2"
    std::string way = {};  ///< how borders are exchanged: "none", or one of known_ways
    double seconds_per_step = 0;
    double compute_seconds = 0, exchange_seconds = 0, waiting_seconds = 0;  ///< of a step
    std::uint64_t largest_part = 0;                                         ///< particles, ghosts included
    std::uint64_t ghosts = 0;                                               ///< of all parts
    std::uint64_t border_bytes = 0;  ///< that the rank sends in a step which sends most
    std::optional<double> latency_seconds = {}, seconds_per_byte = {};
    std::optional<bool> same_bits = {};
    std::optional<double> efficiency = {}, predicted_seconds = {};
    std::optional<std::uint64_t> judged_particles = {};  ///< of a sample; nothing: all of them
    std::optional<double> pays_from_particles = {};      ///< by the model, of bodies of this shape
};

nlohmann::json to_json(const ScalingRow& row);
ScalingRow scaling_row_from_json(const nlohmann::json& json);

/// What follows from a row and from `one`, of the same family by one rank. The model: each particle of the
/// largest part takes the time that it takes there; then comes an exchange of the most bytes. Where they
/// overlap a step is as long as the longer of both. A body of the same shape has borders that grow with the
/// square of its length: `pays_from_particles` is where the model has as many ranks as fast as one, and
/// nothing where an exchange takes no time of its own.
void compare(ScalingRow& row, const ScalingRow& one);

/// Those of `scene` in the result of a scaling study. Throws BadInput if it has no list `scaling`, or none of
/// the scene.
std::vector<ScalingRow> scaling_rows_of(JsonObject result, const std::string& scene);

/// Which scenes were verified by a sample of them.
void print_samples(const std::vector<ScalingRow>& rows, std::ostream& out);

/// Of each scene of one size and each backend: which number of ranks, and which way, is the fastest, and
/// whether that is more than one.
void print_what_pays(const std::vector<ScalingRow>& rows, std::ostream& out);

}  // namespace voxspring
