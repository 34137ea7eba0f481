// Ranks as processes on one or several hosts, started by mpirun.
//
// Each process of mpirun is one rank. It uses MPI itself, and lets another process, its worker, step the
// rank's subdomain. So a worker that crashes or hangs does not end its rank, which would make MPI end all
// ranks. A worker and its rank share a mailroom (mailboxes in memory, exchange.h), and the rank carries
// messages between that mailroom and the neighbouring ranks. Rank 0 runs the study, and tells the other ranks
// what to run.
#pragma once

#include <sys/types.h>

#include <chrono>
#include <filesystem>
#include <functional>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "harness/process/case_runner.h"
#include "harness/process/shared_state.h"
#include "harness/process/worker.h"
#include "harness/ranks/exchange.h"
#include "harness/ranks/open_mpi.h"
#include "harness/ranks/rank_run.h"
#include "harness/scene/scene.h"

namespace voxspring {

/// A run of one scene by several ranks. Each rank that takes part gets a copy of this task.
struct RankTask {
    std::string scene;        ///< the argument of load_scene(), for each of these ranks
    bool strained = false;    ///< whether steps begin at strained_start() instead of the scene's start
    std::string fingerprint;  ///< fingerprint_of(scene), to check that all have the same
    std::string backend;      ///< the argument of BackendSpec::parse()
    RankPlan plan = {};       ///< the first plan.ranks() ranks take part
    Routes routes{1};         ///< routes between the ranks
    int number = 0;           ///< number of the task within the study
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(RankTask, scene, strained, fingerprint, backend, plan, routes, number)

/// The program of a worker that is one rank of a task, on the rank's device. `shared` is room for the rank's
/// part of the state.
CaseProgram rank_program(const RankTask& task, int rank, const SharedMemory& mailroom, SharedState* shared);

/// One of the processes that mpirun started.
class MpiRanks {
public:
    /// The result is null if mpirun did not start this process. All ranks must be of the same build: if one
    /// is not, rank 0 throws BadInput. Also throws what OpenMpi::join() throws.
    static std::unique_ptr<MpiRanks> join();
    /// On rank 0: tells the other ranks to leave.
    ~MpiRanks();
    MpiRanks(const MpiRanks&) = delete;
    MpiRanks& operator=(const MpiRanks&) = delete;

    int rank() const { return mpi_->rank(); }
    int ranks() const { return mpi_->ranks(); }
    int ranks_here() const;  ///< how many of the ranks are on this host

    /// How ranks other than 0 get scenes and worker processes.
    struct Means {
        std::function<Scene(const std::string& argument)> load;
        std::filesystem::path worker;  ///< StudyOptions::worker
        std::chrono::duration<double> timeout{0};
    };
    /// For ranks other than 0: takes part in what rank 0 runs, until rank 0 tells this rank to leave.
    void serve(const Means& means);

    /// For rank 0: makes all ranks of the task run it. `worker` is the process of rank 0's worker, which uses
    /// `mailroom`. `ask` asks that worker to run its part, and returns the worker's report. The caller
    /// fetches the state of rank 0's part; the states of the other parts are copied to `left`. Throws
    /// std::runtime_error with the reason if any rank failed.
    std::vector<RankReport> run(RankTask task, const Scene& scene, const SharedMemory& mailroom, pid_t worker,
                                const std::function<nlohmann::json()>& ask, State& left);

private:
    explicit MpiRanks(std::unique_ptr<OpenMpi> mpi) : mpi_(std::move(mpi)) {}
    void compare_builds() const;
    nlohmann::json next_order() const;
    void take_part(const RankTask& task, const Means& means);

    std::unique_ptr<OpenMpi> mpi_;
    int tasks_ = 0;
    /// On ranks other than 0: the scene of the latest task, its argument (RankTask::scene) and its workers.
    std::string argument_;
    bool strained_ = false;  ///< RankTask::strained of the latest task
    std::unique_ptr<Scene> scene_;
    std::unique_ptr<Workers> workers_;
};

}  // namespace voxspring
