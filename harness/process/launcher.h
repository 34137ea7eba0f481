// Where worker processes come from.
//
// A bare fork() of a program that has threads copies their locks, held, without the threads that would
// release them. So the study starts this executable anew, as a launcher: a process of one thread, which is
// sent the scene and forks the workers of all its cases, so that they have the scene in memory without a copy
// of their own.
#pragma once

#include <sys/types.h>

#include <chrono>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>

#include "harness/scene/scene.h"

namespace voxspring {

class Worker;

/// The study's side of one launcher. Whatever ends this process ends the launcher, and that its workers.
class Launcher {
public:
    /// Starts `program`. It may take `own_patience` for an answer beyond what it was asked to wait for: it
    /// computes nothing, but the machine may be busy. Throws BadInput unless that is a worker of this build,
    /// std::system_error if there can be no further process, and std::runtime_error with the reason if it
    /// does not take the scene.
    Launcher(const std::filesystem::path& program, const Scene* scene,
             std::chrono::duration<double> own_patience = std::chrono::minutes(1));
    Launcher(const Launcher&) = delete;
    Launcher& operator=(const Launcher&) = delete;
    ~Launcher();

    struct Child {
        pid_t process;
        int socket;  ///< its end of the connection, to be closed by the caller
    };
    /// Starts a worker. Throws as the constructor does, and std::runtime_error if the launcher is lost.
    Child start(const nlohmann::json& description);
    /// Waits for a worker, `patience` long until it ends by itself, then by force. How it ended, in words.
    std::string end(pid_t process, std::chrono::duration<double> patience);

    /// It has ended, and all its workers with it.
    bool is_lost() const { return !lost_.empty(); }

private:
    void check_build(const std::filesystem::path& program);
    nlohmann::json call(const nlohmann::json& request, std::chrono::duration<double> patience);
    /// Waits for its end, `patience` long before it is made to.
    void lose(std::chrono::duration<double> patience);

    const std::chrono::duration<double> own_patience_;
    int socket_ = -1;
    pid_t process_ = -1;
    std::string lost_;  ///< how it ended, if it has
};

/// Workers of one scene after the other. New ones come from one launcher a scene, which is started with the
/// first of them; if it is lost, the next worker has another one. A worker that has nothing left to do can be
/// kept, and take up the next work of its kind: to open and to close a GPU takes a driver a fifth of a second
/// each, one process after the other.
class Workers {
public:
    /// `program` is empty for this executable (worker_main.h). `scene`, null if the workers need none, must
    /// outlive this or the next turn_to(). Throws std::logic_error where this executable cannot be started as
    /// a worker.
    explicit Workers(std::filesystem::path program = {}, const Scene* scene = nullptr);
    Workers(const Workers&) = delete;
    Workers& operator=(const Workers&) = delete;
    ~Workers();

    /// Turns to another scene, which must outlive this or the next call.
    void turn_to(const Scene* scene);

    /// Throws as its constructor does.
    std::shared_ptr<Launcher> launcher();

    /// A worker for `description`: one that was kept for `kind`, if any, else a new one. Throws as Worker's
    /// constructor does.
    std::unique_ptr<Worker> take(const std::string& kind, const nlohmann::json& description,
                                 std::chrono::duration<double> timeout);
    /// Has `worker` give back what it has, and keeps it for the next work of `kind`. One that cannot be used
    /// again is dismissed and left where it is, and so are those of a large scene: they would hold on to
    /// memory.
    void keep_or_dismiss(const std::string& kind, std::unique_ptr<Worker>& worker);
    /// Ends those that are kept. They are strangers to what is timed on their device.
    void end_kept();

private:
    friend class Worker;

    std::filesystem::path program_;
    const Scene* scene_;
    int scene_number_ = 0;
    std::shared_ptr<Launcher> launcher_;
    Worker* last_asked_ = nullptr;
    std::multimap<std::string, std::unique_ptr<Worker>> kept_;  ///< by kind
};

/// What answers in the other process.
class Answerer;
/// Makes what answers in a worker that was started with `description`, on the launcher's scene, null if it
/// has none.
using MakeAnswerer =
    std::function<std::unique_ptr<Answerer>(const nlohmann::json& description, const Scene* scene)>;

/// The life of a launcher, on `socket`; it ends with the study.
[[noreturn]] void serve_as_launcher(int socket, const MakeAnswerer& make);

/// The life of a worker, on `socket`; its parent is `launcher`. It begins with `description` on `scene`.
[[noreturn]] void serve_as_worker(int socket, pid_t launcher, nlohmann::json description, const Scene* scene,
                                  const MakeAnswerer& make);

}  // namespace voxspring
