#include "harness/process/worker.h"

#include <fmt/format.h>
#include <malloc.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <csignal>
#include <ctime>
#include <deque>
#include <exception>
#include <fstream>
#include <map>
#include <new>
#include <nlohmann/json.hpp>
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

/// How long to wait for a process to end, since its driver takes a while to release a device.
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

void serve_workers(int socket, pid_t launcher, const Scene* scene, const MakeAnswerer& make) {
    prctl(PR_SET_PDEATHSIG, SIGKILL);
    if (getppid() != launcher) _exit(1);  // the launcher died before the call above
    be_ended_first();
    struct Served {
        nlohmann::json description;
        Answerer answerer;
    };
    std::map<int, Served> workers;
    // The process ends by _exit(), since it must not run the exit handlers that the launcher's program
    // registered.
    try {
        for (;;) {
            const nlohmann::json message = receive_message(socket);
            const int number = message.at("worker");
            if (const auto description = message.find("description"); description != message.end()) {
                workers[number].description = *description;
                continue;
            }
            const nlohmann::json& question = message.at("question");
            const OnEvent on_event = [&](const nlohmann::json& event) {
                send_message(socket, {{"worker", number}, {"event", event}});
            };
            nlohmann::json answer = answer_of([&]() -> nlohmann::json {
                if (question == rest_question) {
                    come_to_rest();
                    return nullptr;
                }
                Served& worker = workers.at(number);
                if (worker.answerer == nullptr) worker.answerer = make(worker.description, scene);
                return worker.answerer(question, on_event);
            });
            answer["worker"] = number;
            send_message(socket, answer);
        }
    } catch (const Closed&) {
        _exit(0);
    } catch (...) {
        _exit(1);
    }
}

/// The process of one or more workers, as this process sees it.
class WorkerProcess {
public:
    explicit WorkerProcess(Workers& workers) : launcher_(workers.launcher()) {
        const Launcher::Child child = launcher_->start();
        id_ = child.process;
        socket_ = child.socket;
    }
    WorkerProcess(const WorkerProcess&) = delete;
    WorkerProcess& operator=(const WorkerProcess&) = delete;
    ~WorkerProcess() {
        if (is_lost()) return;
        hang_up();
        (void)launcher_->end(id_, unanswered_ > 0 ? Seconds(0) : patience_);
        close(socket_);
    }

    bool is_lost() const { return id_ < 0; }
    /// How the process ended; empty while it runs.
    const std::string& how_lost() const { return lost_; }
    std::optional<pid_t> id() const { return is_lost() ? std::nullopt : std::optional<pid_t>(id_); }

    /// Adds a worker and returns its number.
    int add(const nlohmann::json& description, Seconds timeout) {
        patience_ = std::min(driver_patience, timeout);
        ++undismissed_;
        try {
            send_message(socket_, {{"worker", workers_}, {"description", description}});
        } catch (const Closed&) {
            // The process has ended. receive() finds out how.
        }
        return workers_++;
    }
    void dismiss() {
        if (--undismissed_ == 0 && !is_lost()) hang_up();
    }

    void send(int worker, const nlohmann::json& question) {
        ++unanswered_;
        try {
            send_message(socket_, {{"worker", worker}, {"question", question}});
        } catch (const Closed&) {
            // The process has ended. receive() finds out how.
        }
    }
    /// Waits for the next message to `worker`. Throws WorkerLost if the process ends, or if it sends nothing
    /// to any of its workers for as long as `patience` and is killed.
    nlohmann::json receive(int worker, const std::string& doing, Seconds patience) {
        std::deque<nlohmann::json>& own = early_[worker];
        while (own.empty()) {
            nlohmann::json message = receive_any(doing, patience);
            early_[message.at("worker").get<int>()].push_back(std::move(message));
        }
        nlohmann::json message = std::move(own.front());
        own.pop_front();
        if (!message.contains("event")) --unanswered_;
        return message;
    }

private:
    nlohmann::json receive_any(const std::string& doing, Seconds patience) {
        const auto until = Clock::now() + std::chrono::duration_cast<Clock::duration>(patience);
        try {
            return receive_message(socket_, until);
        } catch (const Late&) {
            (void)launcher_->end(id_, Seconds(0));
            lose(fmt::format("did not answer within {:g} s", patience.count()), doing);
        } catch (const Closed&) {
            // The process's end of the socket is closed, so the process has ended or is about to end.
            lose(launcher_->end(id_, std::min(Seconds(10), patience)), doing);
        }
    }
    [[noreturn]] void lose(const std::string& how, const std::string& doing) {
        close(socket_);
        id_ = -1;
        lost_ = how + " while " + doing;
        throw WorkerLost(lost_);
    }
    void hang_up() const {
        // If this program has been forked, the child has a copy of the socket. close() would then not tell
        // the process to end, but shutdown() does.
        shutdown(socket_, SHUT_RDWR);
    }

    const std::shared_ptr<Launcher> launcher_;  ///< the launcher that forked the process
    int socket_ = -1;
    pid_t id_ = -1;
    int workers_ = 0, undismissed_ = 0, unanswered_ = 0;
    Seconds patience_{0};  ///< how long the process may take to end by itself
    /// Messages to each worker that came while another worker's message was awaited.
    std::map<int, std::deque<nlohmann::json>> early_;
    std::string lost_;
};

Worker::Worker(Workers& workers, const nlohmann::json& description, Seconds timeout,
               std::shared_ptr<WorkerProcess> process)
    : workers_(workers),
      process_(std::move(process)),
      // The clock counts nanoseconds in 64 bits. Without this limit a deadline might overflow.
      timeout_(std::min(timeout, Seconds(1e8))) {
    if (!(timeout.count() > 0)) throw std::invalid_argument("a worker's time-out has to be positive");
    if (process_ == nullptr) process_ = std::make_shared<WorkerProcess>(workers);
    number_ = process_->add(description, timeout_);
}

Worker::~Worker() {
    if (workers_.last_asked_ == this) workers_.last_asked_ = nullptr;
    dismiss();
}

void Worker::dismiss() {
    if (!std::exchange(dismissed_, true)) process_->dismiss();
}

std::optional<pid_t> Worker::process() const { return process_->id(); }

void Worker::rest() {
    if (process_->is_lost()) return;
    try {
        process_->send(number_, rest_question);
        (void)process_->receive(number_, "coming to rest", timeout_);
    } catch (const std::exception&) {
        // The failure is reported by the next call of begin() or finish() for this worker.
    }
}

nlohmann::json Worker::ask(const nlohmann::json& question, const std::string& doing,
                           const OnEvent& on_event) {
    Worker*& last = workers_.last_asked_;
    if (last != nullptr && last->process_ != process_) std::exchange(last, nullptr)->rest();
    begin(question);
    last = this;
    return finish(doing, on_event);
}

void Worker::begin(const nlohmann::json& question) {
    if (process_->is_lost()) throw WorkerLost(process_->how_lost());
    // Until finish() other workers may work at the same time. So no call of ask() for another worker waits
    // until this worker is idle.
    if (workers_.last_asked_ == this) workers_.last_asked_ = nullptr;
    process_->send(number_, question);
}

nlohmann::json Worker::finish(const std::string& doing, const OnEvent& on_event) {
    if (process_->is_lost()) throw WorkerLost(process_->how_lost());
    for (;;) {
        nlohmann::json message = process_->receive(number_, doing, timeout_);
        if (message.contains("event")) {
            if (on_event) on_event(message.at("event"));
            continue;
        }
        if (message.contains("answer")) return message.at("answer");
        const std::string text = message.at("message");
        if (message.at("threw") == "unavailable") throw Unavailable(text);
        throw DeviceError(text);
    }
}

}  // namespace voxspring
