// Runs a scene by ranks: the work of one rank, and all ranks as threads of this process.
#pragma once

#include <chrono>
#include <glm/glm.hpp>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "backends/device_choice.h"
#include "backends/layout/decomposition.h"
#include "backends/registry.h"
#include "harness/ranks/exchange.h"
#include "harness/ranks/rank_backend.h"
#include "harness/scene/scene.h"

namespace nlohmann {

template <>
struct adl_serializer<glm::ivec3> {
    static void to_json(json& list, const glm::ivec3& v) { list = {v.x, v.y, v.z}; }
    static void from_json(const json& list, glm::ivec3& v) {
        for (int axis = 0; axis < 3; ++axis) v[axis] = list.at(std::size_t(axis));
    }
};
template <>
struct adl_serializer<std::chrono::duration<double>> {
    static void to_json(json& number, std::chrono::duration<double> seconds) { number = seconds.count(); }
    static void from_json(const json& number, std::chrono::duration<double>& seconds) {
        seconds = std::chrono::duration<double>(number.get<double>());
    }
};

}  // namespace nlohmann

namespace voxspring {

/// What each rank runs: a warm-up batch and `repetitions` timed batches, each of `steps` steps from the
/// start. If borders go from device to device, one more batch measures the parts of a step.
struct RankPlan {
    int steps = 0;
    int repetitions = 0;
    /// How long a rank may wait for another one: until all ranks are connected, and after that.
    std::chrono::duration<double> start_patience{1800}, patience{10};
    /// Rank r takes device number devices[r % size]. Empty: ranks take the available devices in turn.
    std::vector<int> devices = {};
    DeviceNumber device_of(int rank) const;
    /// The device of rank 0, as if no other rank used it.
    DeviceNumber first_device() const;
    /// How borders travel: "memory", which means by the Exchange, or one of Capabilities::border_ways, which
    /// require that all ranks are threads of one process.
    std::string way = "memory";
    /// How many subdomains the scene is cut into along each axis. Each rank has one.
    glm::ivec3 cut{1};
    int ranks() const { return cut.x * cut.y * cut.z; }
    /// If not empty, only the state of Sample::particles() of these bricks is kept at the end of the run.
    std::vector<Decomposition::Brick> sampled = {};
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Decomposition::Brick, begin, end)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(RankPlan, steps, repetitions, start_patience, patience, devices, way, cut,
                                   sampled)

/// One batch of one rank, in seconds. If borders go from device to device, all but `total` are those of the
/// batch that measures the parts of a step.
struct RankBatch {
    double total = 0, compute = 0, exchange = 0, waiting = 0;
};

/// The results of one rank.
struct RankReport {
    std::vector<RankBatch> batches = {};
    std::size_t own = 0, ghosts = 0;  ///< number of particles that the rank steps, and of its ghosts
    std::size_t border_bytes = 0;     ///< bytes that the rank sends per step
    /// The cost of an exchange with all neighbours, in seconds: the time with empty messages, and the time
    /// that each of border_bytes adds, reading and writing included. Both are zero for a single rank, and if
    /// borders travel within steps.
    double latency = 0, seconds_per_byte = 0;
    std::string device = {}, uuid = {};  ///< from the Capabilities of its backend
    /// The clock of the rank's card and the number of its other users (Observed::card_mhz, other_users),
    /// after each batch; empty if the device is no card or is not watched. With MPI the other users of a card
    /// may be other ranks.
    std::vector<unsigned> card_mhz = {}, other_users = {};
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(RankBatch, total, compute, exchange, waiting)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(RankReport, batches, own, ghosts, border_bytes, latency, seconds_per_byte,
                                   device, uuid, card_mhz, other_users)

/// Empty, or which ranks are on devices of different names. Such ranks are not measured together.
std::string different_devices(const std::vector<RankReport>& reports);

/// Empty, or why the scene cannot be cut into this many subdomains along each axis.
std::string cut_refusal(const Scene& scene, glm::ivec3 cut);
/// The routes between ranks, each of which has one of these subdomains.
Routes routes_of(const Decomposition& decomposition);

/// Room for the state that is kept at the end of a run: of all particles, or of RankPlan::sampled.
State room_for_state(const Problem& problem, const RankPlan& plan);
/// The indices in room_for_state() of the particles that a rank steps, ascending.
std::vector<std::uint32_t> places_of_rank(const Problem& problem, const RankPlan& plan, int rank);

/// Runs one rank, and copies the final state of the particles that it steps to `left`, which is
/// room_for_state(). Throws RankLost if another rank failed, Unavailable if there is no such device or the
/// backend cannot run its subdomain, std::runtime_error if the run diverges, and what the backend throws.
///
/// `parts` is shared by all ranks. It may be null if plan.way is "memory".
RankReport run_rank(const BackendSpec& spec, const Scene& scene, const RankPlan& plan, Exchange& exchange,
                    State& left, PartsOnDevices* parts = nullptr);

/// Runs all ranks of the plan, each as a thread of this process, and returns one report per rank. If a rank
/// fails, the other ranks end soon, and this function throws the first reason: as Unavailable if that rank
/// threw Unavailable, otherwise as std::runtime_error. A thread that hangs is left behind until the process
/// ends, with the data that it uses: `scene` must live until then.
std::vector<RankReport> run_ranks_as_threads(const BackendSpec& spec, const Scene& scene,
                                             const RankPlan& plan, State& left);

}  // namespace voxspring
