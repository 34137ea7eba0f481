// Ranks that are processes, on one host or on several, as mpirun starts them.
//
// Each of mpirun's processes keeps MPI to itself and has a worker step its subdomain: a worker that crashes
// or hangs takes no rank of MPI along, which would end them all. A worker and its keeper share a mailroom;
// the keeper carries messages between that and its neighbours. Rank 0 runs the study, and tells the others
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
#include "harness/process/shared_memory.h"
#include "harness/process/shared_state.h"
#include "harness/process/worker.h"
#include "harness/ranks/mailboxes.h"
#include "harness/ranks/open_mpi.h"
#include "harness/ranks/rank_run.h"
#include "harness/scene/scene.h"

namespace voxspring {

/// What ranks run together. All know it.
struct RankTask {
    std::string scene;        ///< what each of them takes to load_scene()
    std::string fingerprint;  ///< of the scene that it is to be
    std::string backend;      ///< what BackendSpec::parse() takes
    RankPlan plan = {};       ///< the first plan.ranks() take part
    Routes routes{1};         ///< between them
    int number = 0;           ///< of the task among all of the study
};

/// What a worker runs that is one rank of a task, on the rank's device. `shared`: room for its part of the
/// state.
CaseProgram rank_program(const RankTask& task, int rank, const SharedMemory& mailroom, SharedState* shared);

/// A process of mpirun.
class MpiRanks {
public:
    /// Null where mpirun has not started this process. Every rank has to be of this build: throws BadInput on
    /// rank 0 where one is not, and so what OpenMpi::join() throws.
    static std::unique_ptr<MpiRanks> join();
    /// On rank 0: the others leave.
    ~MpiRanks();
    MpiRanks(const MpiRanks&) = delete;
    MpiRanks& operator=(const MpiRanks&) = delete;

    int rank() const { return mpi_->rank(); }
    int ranks() const { return mpi_->ranks(); }
    int ranks_here() const;  ///< of them those on this host

    /// How ranks other than 0 come by scenes and processes.
    struct Means {
        std::function<Scene(const std::string& argument)> load;
        std::filesystem::path worker;  ///< StudyOptions::worker
        std::chrono::duration<double> timeout{0};
    };
    /// Of a rank other than 0: runs what rank 0 asks for until it leaves.
    void serve(const Means& means);

    /// Of rank 0: has all ranks of the task run it. `worker` is rank 0's own, in `mailroom`, and `ask` asks
    /// it: returns its report, once it has put its part of the state where the caller finds it. The parts of
    /// the others go into `left`. Throws std::runtime_error with the reason where any of them failed.
    std::vector<RankReport> run(RankTask task, const Scene& scene, const SharedMemory& mailroom, pid_t worker,
                                const std::function<nlohmann::json()>& ask, State& left);

private:
    explicit MpiRanks(std::unique_ptr<OpenMpi> mpi) : mpi_(std::move(mpi)) {}
    void compare_builds() const;
    nlohmann::json next_order() const;
    void take_part(const RankTask& task, const Means& means);

    std::unique_ptr<OpenMpi> mpi_;
    int tasks_ = 0;
    /// Of ranks other than 0: the scene that was asked for last, and its workers.
    std::string argument_;
    std::unique_ptr<Scene> scene_;
    std::unique_ptr<Workers> workers_;
};

}  // namespace voxspring
