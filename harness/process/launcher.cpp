#include "harness/process/launcher.h"

#include <fmt/format.h>
#include <spawn.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <csignal>
#include <cstring>
#include <exception>
#include <new>
#include <nlohmann/json.hpp>
#include <optional>
#include <stdexcept>
#include <system_error>
#include <thread>
#include <utility>

#include "harness/base/bad_input.h"
#include "harness/base/clock.h"
#include "harness/base/json.h"
#include "harness/process/message.h"
#include "harness/process/signal_process.h"
#include "harness/process/worker.h"
#include "harness/process/worker_main.h"

namespace voxspring {
namespace {

Deadline after(Seconds patience) {
    return Clock::now() + std::chrono::duration_cast<Clock::duration>(patience);
}

[[noreturn]] void refuse_to_start(int error) {
    throw std::system_error(error, std::generic_category(), "cannot start another process");
}

[[noreturn]] void refuse_program(const std::filesystem::path& program, const std::string& accepted) {
    throw BadInput("run_study()", "worker", program.string(), accepted);
}

// --- In the study's process -----------------------------------------------------------------------------

/// Starts a launcher. The launcher has only the descriptors 0, 1, 2 and, as launcher_socket, `socket`. Closes
/// `socket` in this process.
pid_t spawn(const std::filesystem::path& program, int socket) {
    std::string name = program_invocation_name, word = worker_word, mark = worker_mark;
    std::array arguments = {name.data(), word.data(), mark.data(), static_cast<char*>(nullptr)};
    posix_spawn_file_actions_t actions;
    posix_spawn_file_actions_init(&actions);
    posix_spawn_file_actions_adddup2(&actions, socket, launcher_socket);
    posix_spawn_file_actions_addclosefrom_np(&actions, launcher_socket + 1);
    // The launcher inherits that signals are blocked, until it ignores them. So Ctrl-C never ends it.
    sigset_t all, before;
    sigfillset(&all);
    pthread_sigmask(SIG_SETMASK, &all, &before);
    // /proc/self/exe is the file that this process runs, even if another file has its name by now.
    const std::string file = program.empty() ? "/proc/self/exe" : program.string();
    pid_t process = -1;
    const int error = posix_spawn(&process, file.c_str(), &actions, nullptr, arguments.data(), environ);
    pthread_sigmask(SIG_SETMASK, &before, nullptr);
    posix_spawn_file_actions_destroy(&actions);
    close(socket);
    if (error != 0 && !program.empty())
        refuse_program(program, std::string("a program that can be started: ") + std::strerror(error));
    if (error != 0) refuse_to_start(error);
    return process;
}

std::string no_answer_within(Seconds patience) {
    return fmt::format("did not answer within {:g} s", patience.count());
}

std::string describe_end(int status) {
    if (WIFSIGNALED(status)) {
        const int signal = WTERMSIG(status);
        return "was killed by signal " + std::to_string(signal) + " (" + strsignal(signal) + ")" +
               (signal == SIGKILL ? ", as the system does when memory runs out" : "");
    }
    return "ended with exit code " + std::to_string(WEXITSTATUS(status));
}

/// Waits up to `patience` for a child to end by itself, then kills it. Returns how it ended.
std::string reap(pid_t process, Seconds patience) {
    int status = 0;
    const auto until = Clock::now() + patience;
    while (waitpid(process, &status, WNOHANG) == 0) {
        if (Clock::now() > until) {
            signal_process(process, SIGKILL);
            waitpid(process, &status, 0);
            // Without patience the child may have been about to end when its status was first asked for.
            if (patience.count() > 0)
                return fmt::format("closed its connection and did not end within {:g} s", patience.count());
            break;
        }
        std::this_thread::sleep_for(Seconds(1e-3));
    }
    return describe_end(status);
}

}  // namespace

Launcher::Launcher(const std::filesystem::path& program, const Scene* scene, Seconds own_patience)
    : own_patience_(own_patience) {
    int ends[2];
    if (socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends) != 0) refuse_to_start(errno);
    socket_ = ends[0];
    try {
        process_ = spawn(program, ends[1]);
    } catch (...) {
        close(socket_);
        throw;
    }
    try {
        check_build(program);
        send_scene(socket_, scene, process_);
        const nlohmann::json ready = receive_message(socket_, after(own_patience_));
        if (ready.contains("error")) throw std::runtime_error(ready.at("error").get<std::string>());
    } catch (const Closed&) {
        lose(own_patience_);
        throw std::runtime_error("before it had received the scene, the launcher " + lost_);
    } catch (const Late&) {
        lose(Seconds(0));
        throw std::runtime_error("before it had received the scene, the launcher " +
                                 no_answer_within(own_patience_));
    } catch (...) {
        lose(Seconds(0));
        throw;
    }
}

/// Receives the first message of the launcher, which describes its build. Throws BadInput if that is not this
/// program's build.
void Launcher::check_build(const std::filesystem::path& program) {
    nlohmann::json theirs;
    try {
        theirs = receive_message(socket_, after(own_patience_));
    } catch (const std::exception&) {
        if (program.empty()) throw;
        refuse_program(program, "a program that calls voxspring::worker_main() first in its main()");
    }
    if (theirs != build_of_workers())
        refuse_program(program.string() + ", built from " + json_text(theirs),
                       "a program of the same build as this one, " + json_text(build_of_workers()));
}

Launcher::~Launcher() {
    if (!is_lost()) lose(own_patience_);
}

void Launcher::lose(Seconds patience) {
    // If another thread has forked this program, the child has a copy of the socket. close() would then not
    // tell the launcher that the study is done with it, but shutdown() does.
    shutdown(socket_, SHUT_RDWR);
    lost_ = reap(process_, patience);
    close(socket_);
}

nlohmann::json Launcher::call(const nlohmann::json& request, Seconds patience) {
    if (is_lost()) throw Closed();
    try {
        send_message(socket_, request);
        return receive_message(socket_, after(patience + own_patience_));
    } catch (const Closed&) {
        lose(own_patience_);
        throw;
    } catch (const Late&) {
        lose(Seconds(0));
        lost_ = no_answer_within(patience + own_patience_);
        throw Closed();
    }
}

Launcher::Child Launcher::start() {
    try {
        const nlohmann::json started = call({{"do", "start"}}, Seconds(0));
        if (started.contains("errno")) refuse_to_start(started.at("errno"));
        const pid_t process = started.at("process");
        return {process, receive_descriptor(socket_, after(own_patience_))};
    } catch (const Late&) {
        // If the worker's socket comes late, it would be taken for the next answer. So the launcher is given
        // up.
        lose(Seconds(0));
        lost_ = no_answer_within(own_patience_);
    } catch (const Closed&) {
        if (!is_lost()) lose(Seconds(0));
    }
    throw std::runtime_error("the launcher " + lost_);
}

std::string Launcher::end(pid_t process, Seconds patience) {
    try {
        return call({{"do", "end"}, {"process", process}, {"patience", patience.count()}}, patience)
            .at("ended");
    } catch (const Closed&) {
        return "was terminated because its launcher " + lost_ + ",";
    }
}

Workers::Workers(std::filesystem::path program, const Scene* scene)
    : program_(std::move(program)), scene_(scene) {
    if (program_.empty() && !has_worker_main())
        throw std::logic_error(
            "a study measures in processes that it starts, and this program cannot be started as one: call "
            "voxspring::worker_main(argc, argv) first in main(), or name a program in StudyOptions::worker");
}

void Workers::turn_to(const Scene* scene) {
    launcher_.reset();  // the launcher has a copy of the previous scene
    scene_ = scene;
}

std::shared_ptr<Launcher> Workers::launcher() {
    if (launcher_ == nullptr || launcher_->is_lost())
        launcher_ = std::make_shared<Launcher>(program_, scene_);
    return launcher_;
}

// --- In the launcher's process ---------------------------------------------------------------------------

namespace {

void start_worker(int socket, const Scene* scene, const MakeAnswerer& make) {
    int ends[2];
    if (socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends) != 0) {
        send_message(socket, {{"errno", errno}});
        return;
    }
    const pid_t launcher = getpid();
    const pid_t process = fork();
    if (process == 0) {
        close(socket);
        close(ends[0]);
        serve_workers(ends[1], launcher, scene, make);
    }
    const int error = errno;
    close(ends[1]);
    if (process < 0) {
        send_message(socket, {{"errno", error}});
    } else {
        send_message(socket, {{"process", process}});
        send_descriptor(socket, ends[0]);
    }
    close(ends[0]);
}

/// Receives the scene, and reports to the study whether there was enough memory for it.
std::optional<Scene> take_scene(int socket) {
    try {
        std::optional<Scene> scene = receive_scene(socket);
        send_message(socket, {{"ready", true}});
        return scene;
    } catch (const std::bad_alloc&) {
        send_message(socket, {{"error", "out of memory on the host for a second copy of the scene"}});
        throw;
    }
}

}  // namespace

void serve_as_launcher(int socket, const MakeAnswerer& make) {
    // Makes the system kill this process when the study's process ends. If the study has ended before this
    // call, its end of the socket is closed, and send_message() below throws Closed.
    prctl(PR_SET_PDEATHSIG, SIGKILL);
    // A launcher that was started as /proc/self/exe would otherwise be shown as `exe` in lists of processes.
    prctl(PR_SET_NAME, program_invocation_short_name);
    // Ctrl-C sends SIGINT to all processes in the foreground of a terminal. The launcher and its workers
    // ignore the signal, so that the study can let them finish their current work.
    std::signal(SIGINT, SIG_IGN);
    std::signal(SIGTERM, SIG_IGN);
    // The launcher may have inherited that SIGCHLD is ignored. waitpid() would then not report how workers
    // end.
    std::signal(SIGCHLD, SIG_DFL);
    // A driver's cache file may reach the limit on the size of files. With SIGXFSZ ignored, write() then
    // fails instead of ending the process.
    std::signal(SIGXFSZ, SIG_IGN);
    sigset_t none;
    sigemptyset(&none);
    sigprocmask(SIG_SETMASK, &none, nullptr);
    try {
        send_message(socket, build_of_workers());
        const std::optional<Scene> scene = take_scene(socket);
        for (;;) {
            const nlohmann::json request = receive_message(socket);
            if (request.at("do") == "start") {
                start_worker(socket, scene ? &*scene : nullptr, make);
            } else {
                const Seconds patience(request.at("patience").get<double>());
                send_message(socket, {{"ended", reap(request.at("process"), patience)}});
            }
        }
    } catch (const Closed&) {
        _exit(0);
    } catch (...) {
        _exit(1);
    }
}

}  // namespace voxspring
