#include "harness/process/worker.h"

#include <malloc.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <csignal>
#include <ctime>
#include <exception>
#include <fstream>
#include <new>
#include <nlohmann/json.hpp>
#include <sstream>
#include <thread>
#include <utility>

#include "backends/backend.h"
#include "harness/base/clock.h"
#include "harness/process/message.h"

namespace voxspring {
namespace {

/// Makes the system end this process first if memory runs out, and not the study's process, which has all
/// finished measurements.
void be_ended_first() { std::ofstream("/proc/self/oom_score_adj") << 1000; }  // the highest score

/// Waits until the threads of this process are idle: OpenMP's threads spin for some milliseconds after their
/// work. Waits about 50 ms at most, since the threads of some drivers are never idle.
void come_to_rest() {
    constexpr std::clock_t idle = CLOCKS_PER_SEC / 20'000;  // 50 us of processor time per millisecond
    std::clock_t before = std::clock();
    for (int checks = 0; checks < 50; ++checks) {
        std::this_thread::sleep_for(std::chrono::milliseconds(1));
        const std::clock_t now = std::clock();
        if (now - before < idle) break;
        before = now;
    }
    // Gives freed memory back to the system: with a large scene the machine does not have enough memory for
    // every worker to keep it.
    constexpr std::size_t much = std::size_t(1) << 28;
    if (mallinfo2().fordblks > much) malloc_trim(0);
}

/// How long to wait for a worker to end, since its driver takes a while to release a device.
constexpr Seconds driver_patience(10);

const nlohmann::json rest_question = {{"do", "rest"}};

nlohmann::json answer_of(const std::function<nlohmann::json()>& action) {
    const auto refusal = [](const char* kind, const std::string& message) {
        return nlohmann::json{{"threw", kind}, {"message", message}};
    };
    try {
        return {{"answer", action()}};
    } catch (const Closed&) {
        throw;
    } catch (const Unavailable& absent) {
        return refusal("unavailable", absent.what());
    } catch (const std::bad_alloc&) {
        return refusal("error", "out of memory on the host");
    } catch (const std::exception& error) {
        return refusal("error", error.what());
    }
}

}  // namespace

void serve_as_worker(int socket, pid_t launcher, const nlohmann::json& description, const Scene* scene,
                     const MakeAnswerer& make) {
    prctl(PR_SET_PDEATHSIG, SIGKILL);
    if (getppid() != launcher) _exit(1);  // the launcher died before the call above
    be_ended_first();
    Answerer answerer;
    const OnEvent on_event = [&](const nlohmann::json& event) { send_message(socket, {{"event", event}}); };
    // The worker ends by _exit(), since this process must not run the exit handlers that the launcher's
    // program registered.
    try {
        for (;;) {
            const nlohmann::json question = receive_message(socket);
            send_message(socket, answer_of([&]() -> nlohmann::json {
                             if (question == rest_question) {
                                 come_to_rest();
                                 return nullptr;
                             }
                             if (answerer == nullptr) answerer = make(description, scene);
                             return answerer(question, on_event);
                         }));
        }
    } catch (const Closed&) {
        _exit(0);
    } catch (...) {
        _exit(1);
    }
}

Worker::Worker(Workers& workers, const nlohmann::json& description, Seconds timeout)
    : workers_(workers),
      // The clock counts nanoseconds in 64 bits. Without this limit a deadline might overflow.
      timeout_(std::min(timeout, Seconds(1e8))) {
    if (!(timeout.count() > 0)) throw std::invalid_argument("a worker's time-out has to be positive");
    launcher_ = workers_.launcher();
    const Launcher::Child child = launcher_->start(description);
    process_ = child.process;
    socket_ = child.socket;
}

Worker::~Worker() {
    if (workers_.last_asked_ == this) workers_.last_asked_ = nullptr;
    if (process_ < 0) return;
    dismiss();
    (void)launcher_->end(process_, asked_ ? Seconds(0) : std::min(driver_patience, timeout_));
    close(socket_);
}

void Worker::dismiss() {
    // If this program has been forked, the child has a copy of the socket. close() would then not tell the
    // worker to end, but shutdown() does.
    if (process_ >= 0) shutdown(socket_, SHUT_RDWR);
}

void Worker::lose(const std::string& how, const std::string& doing) {
    if (workers_.last_asked_ == this) workers_.last_asked_ = nullptr;
    close(socket_);
    process_ = -1;
    lost_ = how + " while " + doing;
    throw WorkerLost(lost_);
}

nlohmann::json Worker::receive(const std::string& doing, Seconds patience) {
    const auto until = Clock::now() + std::chrono::duration_cast<Clock::duration>(patience);
    try {
        return receive_message(socket_, until);
    } catch (const Late&) {
        (void)launcher_->end(process_, Seconds(0));
        std::ostringstream how;
        how << "did not answer within " << patience.count() << " s";
        lose(how.str(), doing);
    } catch (const Closed&) {
        // The worker's end of the socket is closed, so the worker has ended or is about to end.
        lose(launcher_->end(process_, std::min(Seconds(10), timeout_)), doing);
    }
}

void Worker::rest() {
    try {
        send_message(socket_, rest_question);
        receive("coming to rest", timeout_);
    } catch (const std::exception&) {
        // The failure is reported by the next call of begin() or finish() for this worker.
    }
}

nlohmann::json Worker::ask(const nlohmann::json& question, const std::string& doing,
                           const OnEvent& on_event) {
    Worker*& last = workers_.last_asked_;
    if (last != nullptr && last != this) std::exchange(last, nullptr)->rest();
    begin(question);
    last = this;
    return finish(doing, on_event);
}

void Worker::begin(const nlohmann::json& question) {
    if (process_ < 0) throw WorkerLost(lost_);
    // Until finish() other workers may work at the same time. So no call of ask() for another worker waits
    // until this worker is idle.
    if (workers_.last_asked_ == this) workers_.last_asked_ = nullptr;
    asked_ = true;
    try {
        send_message(socket_, question);
    } catch (const Closed&) {
        // The worker has ended. receive(), called by finish(), finds out how.
    }
}

nlohmann::json Worker::finish(const std::string& doing, const OnEvent& on_event) {
    if (process_ < 0) throw WorkerLost(lost_);
    for (;;) {
        nlohmann::json message = receive(doing, timeout_);
        if (message.contains("event")) {
            if (on_event) on_event(message.at("event"));
            continue;
        }
        asked_ = false;
        if (message.contains("answer")) return message.at("answer");
        const std::string text = message.at("message");
        if (message.at("threw") == "unavailable") throw Unavailable(text);
        throw DeviceError(text);
    }
}

}  // namespace voxspring
