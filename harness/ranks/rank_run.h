// The run of a scene by ranks: what each of them does, and all of them as threads of this process.
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
#include "harness/ranks/mailboxes.h"
#include "harness/ranks/rank_backend.h"
#include "harness/scene/scene.h"

namespace voxspring {

/// Timed batches of `steps` steps from the scene's start, after one that is not timed.
struct RankPlan {
    int steps = 0;
    int repetitions = 0;
    /// For which a rank may say nothing before the first batch, and after that.
    std::chrono::duration<double> start_patience{1800}, patience{10};
    /// Which device each rank takes, over and over. Empty: the next of those that there are.
    std::vector<int> devices = {};
    DeviceNumber device_of(int rank) const;
    /// That of rank 0, where nothing else is stepped on it.
    DeviceNumber first_device() const;
    /// How borders travel: "memory", which is what the Exchange does, or one of Capabilities::border_ways,
    /// where all ranks are threads of one process.
    std::string way = "memory";
    /// How many subdomains along each axis the scene is cut into, each for a rank.
    glm::ivec3 cut{1};
    int ranks() const { return cut.x * cut.y * cut.z; }
    /// The state that a run leaves is that of a Sample's particles in these bricks; without any of all.
    std::vector<Decomposition::Brick> sampled = {};
};
nlohmann::json to_json(const RankPlan& plan);
RankPlan rank_plan_of(const nlohmann::json& json);

/// One batch of one rank, in seconds.
struct RankBatch {
    double total = 0, compute = 0, exchange = 0, waiting = 0;
};

/// What one rank's run found.
struct RankReport {
    std::vector<RankBatch> batches = {};
    std::size_t own = 0, ghosts = 0;  ///< particles
    std::size_t border_bytes = 0;     ///< of all that it sends in a step
    /// Of an exchange in which each rank sends to and hears from each neighbour: without anything in the
    /// messages, and what each of border_bytes adds, with reading and writing it. Zero for a rank by itself,
    /// and where borders travel within steps.
    double latency = 0, seconds_per_byte = 0;
    std::string device = {}, uuid = {};  ///< Capabilities of its backend
    /// What its card said after each batch, as Observed has it; none where the device is no card or is not
    /// watched. Who else computed on the card may be other ranks, in processes of their own.
    std::vector<unsigned> card_mhz = {}, other_users = {};
};
nlohmann::json to_json(const RankReport& report);
RankReport rank_report_of(const nlohmann::json& json);
/// Empty, or which ranks are on devices of different names, whose times are not compared as of one kind.
std::string different_devices(const std::vector<RankReport>& reports);

/// Empty, or why the scene cannot be cut so.
std::string cut_refusal(const Scene& scene, glm::ivec3 cut);
/// Between ranks of which each has one of these subdomains.
Routes routes_of(const Decomposition& decomposition);

/// Room for the state that a run of the plan leaves.
State room_for_state(const Problem& problem, const RankPlan& plan);
/// Where in that the particles are that a rank steps, ascending.
std::vector<std::uint32_t> places_of_rank(const Problem& problem, const RankPlan& plan, int rank);

/// Runs a rank of the scene, and copies the state of its own particles into `left`, which is
/// room_for_state(). Throws RankLost, what the backend throws (Unavailable where there is no such device),
/// Unavailable where the backend cannot run its subdomain, and std::runtime_error where the run diverges.
///
/// `parts`: room for one of each rank, which they share; for ways from device to device alone.
RankReport run_rank(const BackendSpec& spec, const Scene& scene, const RankPlan& plan, Exchange& exchange,
                    State& left, PartsOnDevices* parts = nullptr);

/// All ranks of the plan, each a thread of this process; one report a rank. Where one fails the others end at
/// once, and this throws Unavailable, where that was what one threw, or std::runtime_error with its reason. A
/// thread that hangs is left behind for the end of the process, and so is what it works on: `scene` is to
/// live until then.
std::vector<RankReport> run_ranks_as_threads(const BackendSpec& spec, const Scene& scene,
                                             const RankPlan& plan, State& left);

}  // namespace voxspring
