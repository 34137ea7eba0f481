// The launcher, which starts worker processes.
//
// If a program with several threads calls fork(), the child may have locks that are held by threads that the
// child does not have, so that nothing releases them. The study therefore starts its executable (or
// StudyOptions::worker) anew, as a launcher: a process with one thread, which receives the scene once and
// forks the workers of all cases. The workers share the scene in memory without copying it.
#pragma once

#include <sys/types.h>

#include <chrono>
#include <filesystem>
#include <functional>
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <string>

#include "harness/scene/scene.h"

namespace voxspring {

class Worker;

/// One launcher, as the study's process sees it. When the study's process ends, in whatever way, the launcher
/// and its workers end as well.
class Launcher {
public:
    /// Starts `program`, or this executable if `program` is empty, and sends it the scene. If the launcher
    /// takes longer for an answer than the request allows plus `own_patience`, it is killed and is_lost():
    /// launchers compute nothing, but the machine may be busy. Throws BadInput unless `program` can be
    /// started, calls worker_main() and is of this build, std::system_error if no further process can be
    /// started, and std::runtime_error with the reason if the launcher does not take the scene.
    Launcher(const std::filesystem::path& program, const Scene* scene,
             std::chrono::duration<double> own_patience = std::chrono::minutes(1));
    Launcher(const Launcher&) = delete;
    Launcher& operator=(const Launcher&) = delete;
    ~Launcher();

    struct Child {
        pid_t process;
        int socket;  ///< the connection to the worker, to be closed by the caller
    };
    /// Starts a process for workers. Throws std::system_error if no process can be started,
    /// std::runtime_error if the launcher is lost.
    Child start();
    /// Waits up to `patience` for a worker to end by itself, then kills it. Returns how it ended, in words.
    std::string end(pid_t process, std::chrono::duration<double> patience);

    /// Whether the launcher is known to have ended, and all its workers with it.
    bool is_lost() const { return !lost_.empty(); }

private:
    void check_build(const std::filesystem::path& program);
    nlohmann::json call(const nlohmann::json& request, std::chrono::duration<double> patience);
    /// Waits up to `patience` for the launcher to end, then kills it.
    void lose(std::chrono::duration<double> patience);

    const std::chrono::duration<double> own_patience_;
    int socket_ = -1;
    pid_t process_ = -1;
    std::string lost_;  ///< how the launcher ended; empty while it runs
};

/// Starts workers, for one scene at a time. Each scene has a launcher, which is started with its first
/// worker. If a launcher is lost, the next worker gets a new one.
class Workers {
public:
    /// If `program` is empty, workers are processes of this executable (worker_main.h). `scene` is null if
    /// the workers need no scene; otherwise it must live until the next turn_to() or the end of this object.
    /// Throws std::logic_error if `program` is empty and this executable has not called worker_main().
    explicit Workers(std::filesystem::path program = {}, const Scene* scene = nullptr);
    Workers(const Workers&) = delete;
    Workers& operator=(const Workers&) = delete;

    /// Starts workers with another scene from now on. It must live until the next turn_to() or the end of
    /// this object.
    void turn_to(const Scene* scene);

    /// The launcher for the present scene, started if necessary. Throws as Launcher's constructor does.
    std::shared_ptr<Launcher> launcher();

private:
    friend class Worker;

    std::filesystem::path program_;
    const Scene* scene_;
    std::shared_ptr<Launcher> launcher_;
    /// The worker that Worker::ask() has asked last; null if no worker has to come to rest.
    Worker* last_asked_ = nullptr;
};

/// A function that an Answerer calls to report something to the study before the answer.
using OnEvent = std::function<void(const nlohmann::json& event)>;
/// A function in the worker's process that answers the questions of the study.
using Answerer = std::function<nlohmann::json(const nlohmann::json& question, const OnEvent& on_event)>;
/// A function that makes the Answerer of a worker from the worker's `description`. `scene` is the scene of
/// the launcher; null if the launcher has none.
using MakeAnswerer = std::function<Answerer(const nlohmann::json& description, const Scene* scene)>;

/// Turns this process into a launcher that answers requests on `socket`. Exits when the other end is closed.
[[noreturn]] void serve_as_launcher(int socket, const MakeAnswerer& make);

/// Makes this process, a child of the process `launcher`, answer the questions of one or more workers on
/// `socket`.
[[noreturn]] void serve_workers(int socket, pid_t launcher, const Scene* scene, const MakeAnswerer& make);

}  // namespace voxspring
