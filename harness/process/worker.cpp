#include "harness/process/worker.h"

#include <malloc.h>
#include <omp.h>
#include <poll.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <csignal>
#include <cstdint>
#include <cstring>
#include <ctime>
#include <exception>
#include <new>
#include <optional>
#include <sstream>
#include <system_error>
#include <thread>
#include <utility>
#include <vector>

#include "backends/backend.h"

namespace voxspring {
namespace {

using Seconds = std::chrono::duration<double>;
using Clock = std::chrono::steady_clock;

/// The other end of a socket is closed.
class Closed : public std::runtime_error {
public:
    Closed() : std::runtime_error("the other process is gone") {}
};
/// Nothing came until the deadline.
class Late : public std::runtime_error {
public:
    Late() : std::runtime_error("no answer") {}
};

void send_all(int socket, const void* bytes, std::size_t count) {
    const auto* from = static_cast<const char*>(bytes);
    while (count > 0) {
        const ssize_t sent = ::send(socket, from, count, MSG_NOSIGNAL);
        if (sent < 0 && errno == EINTR) continue;
        if (sent <= 0) throw Closed();
        from += sent;
        count -= std::size_t(sent);
    }
}

/// CBOR holds every double, NaN and infinity included; its length goes first.
void send(int socket, const nlohmann::json& message) {
    const std::vector<std::uint8_t> bytes = nlohmann::json::to_cbor(message);
    const std::uint64_t size = bytes.size();
    send_all(socket, &size, sizeof size);
    send_all(socket, bytes.data(), bytes.size());
}

void receive_all(int socket, void* bytes, std::size_t count, const std::optional<Clock::time_point>& until) {
    auto* to = static_cast<char*>(bytes);
    while (count > 0) {
        int milliseconds = -1;
        if (until) {
            const auto left = std::chrono::ceil<std::chrono::milliseconds>(*until - Clock::now()).count();
            if (left <= 0) throw Late();
            // poll() takes no more than an int; the loop goes on after that.
            milliseconds = int(std::min<std::int64_t>(left, 1000000));
        }
        pollfd waiting{socket, POLLIN, 0};
        if (poll(&waiting, 1, milliseconds) <= 0) continue;
        const ssize_t received = recv(socket, to, count, 0);
        if (received < 0 && errno == EINTR) continue;
        if (received <= 0) throw Closed();
        to += received;
        count -= std::size_t(received);
    }
}

nlohmann::json receive(int socket, const std::optional<Clock::time_point>& until = std::nullopt) {
    std::uint64_t size = 0;
    receive_all(socket, &size, sizeof size, until);
    std::vector<std::uint8_t> bytes(size);
    receive_all(socket, bytes.data(), bytes.size(), until);
    return nlohmann::json::from_cbor(bytes);
}

double cpu_seconds_of_process() {
    timespec time{};
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &time);
    return double(time.tv_sec) + 1e-9 * double(time.tv_nsec);
}

/// Returns once the threads of this process are idle. Those of OpenMP spin for some milliseconds after their
/// work; a driver whose threads never rest is not waited for.
void come_to_rest() {
    constexpr double interval = 1e-3, idle = 5e-5;  // seconds, and CPU seconds within them
    constexpr int max_checks = 50;
    double before = cpu_seconds_of_process();
    for (int i = 0; i < max_checks; ++i) {
        std::this_thread::sleep_for(Seconds(interval));
        const double now = cpu_seconds_of_process();
        if (now - before < idle) break;
        before = now;
    }
    // Beside the other workers of a large scene, each that keeps what it no longer needs is too much.
    constexpr std::size_t much = std::size_t(1) << 28;
    if (mallinfo2().fordblks > much) malloc_trim(0);
}

const nlohmann::json rest_question = {{"do", "rest"}};

nlohmann::json answer_of(Answerer& answerer, const nlohmann::json& question, const OnEvent& on_event) {
    const auto refusal = [](const char* kind, const std::string& message) {
        return nlohmann::json{{"threw", kind}, {"message", message}};
    };
    try {
        if (question != rest_question) return {{"answer", answerer.answer(question, on_event)}};
        come_to_rest();
        return {{"answer", nullptr}};
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

/// The life of the new process. It leaves without running what the parent registered for its own end.
[[noreturn]] void serve(int socket, pid_t parent, const std::function<std::unique_ptr<Answerer>()>& make) {
    prctl(PR_SET_PDEATHSIG, SIGKILL);
    if (getppid() != parent) _exit(1);  // it died before that
    // Ctrl-C is for all processes of a terminal: the parent lets this one finish what it is at.
    std::signal(SIGINT, SIG_IGN);
    std::signal(SIGTERM, SIG_IGN);
    // A driver's own cache may meet a limit on the size of files.
    std::signal(SIGXFSZ, SIG_IGN);
    try {
        const auto answerer = make();
        const OnEvent on_event = [&](const nlohmann::json& event) { send(socket, {{"event", event}}); };
        for (;;) send(socket, answer_of(*answerer, receive(socket), on_event));
    } catch (const Closed&) {
        _exit(0);
    } catch (...) {
        _exit(1);
    }
}

std::string describe_end(int status) {
    if (WIFSIGNALED(status)) {
        const int signal = WTERMSIG(status);
        return "was killed by signal " + std::to_string(signal) + " (" + strsignal(signal) + ")" +
               (signal == SIGKILL ? ", as the system does where memory runs out" : "");
    }
    return "ended with exit code " + std::to_string(WEXITSTATUS(status));
}

/// Waits for a child; ``patience` long until it ends by itself, then by force.
int reap(pid_t process, Seconds patience) {
    int status = 0;
    const auto until = Clock::now() + patience;
    while (waitpid(process, &status, WNOHANG) == 0) {
        if (Clock::now() > until) {
            kill(process, SIGKILL);
            waitpid(process, &status, 0);
            break;
        }
        std::this_thread::sleep_for(Seconds(1e-3));
    }
    return status;
}

}  // namespace

Worker* Worker::last_asked_ = nullptr;

Worker::Worker(const std::function<std::unique_ptr<Answerer>()>& make, Seconds timeout)
    // What a clock of nanoseconds in 64 bits has room for.
    : timeout_(std::min(timeout, Seconds(1e8))) {
    if (!(timeout.count() > 0)) throw std::invalid_argument("a worker's time-out has to be positive");
    int ends[2];
    if (socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends) != 0)
        throw std::system_error(errno, std::generic_category(), "cannot start another process");
    // No other thread is alive in a forked copy. GCC's OpenMP ends its own for that, to start them again
    // where they are needed; LLVM's knows that it has been forked, and takes no more than note of this.
    omp_pause_resource_all(omp_pause_soft);
    // What is free need not be copied.
    malloc_trim(0);
    const pid_t parent = getpid();
    process_ = fork();
    if (process_ == 0) {
        close(ends[0]);
        serve(ends[1], parent, make);
    }
    const int error = errno;
    close(ends[1]);
    socket_ = ends[0];
    if (process_ < 0) {
        close(socket_);
        throw std::system_error(error, std::generic_category(), "cannot start another process");
    }
}

Worker::~Worker() {
    if (last_asked_ == this) last_asked_ = nullptr;
    if (process_ < 0) return;
    // Other workers have a copy of this end: closing it would not tell.
    shutdown(socket_, SHUT_RDWR);
    constexpr Seconds patience(10);  // of a driver that gives back a device
    reap(process_, asked_ ? Seconds(0) : std::min(patience, timeout_));
    close(socket_);
}

void Worker::lose(const std::string& how, const std::string& doing) {
    if (last_asked_ == this) last_asked_ = nullptr;
    close(socket_);
    process_ = -1;
    lost_ = how + " while " + doing;
    throw WorkerLost(lost_);
}

nlohmann::json Worker::receive(const std::string& doing) {
    const auto until = Clock::now() + std::chrono::duration_cast<Clock::duration>(timeout_);
    try {
        return voxspring::receive(socket_, until);
    } catch (const Late&) {
        kill(process_, SIGKILL);
        waitpid(process_, nullptr, 0);
        std::ostringstream how;
        how << "did not answer within " << timeout_.count() << " s";
        lose(how.str(), doing);
    } catch (const Closed&) {
        // It has closed its end by ending, or is about to.
        lose(describe_end(reap(process_, std::min(Seconds(10), timeout_))), doing);
    }
}

void Worker::rest() {
    try {
        send(socket_, rest_question);
        receive("coming to rest");
    } catch (const std::exception&) {
        // Whoever asks it next is told.
    }
}

nlohmann::json Worker::ask(const nlohmann::json& question, const std::string& doing,
                           const OnEvent& on_event) {
    if (last_asked_ != nullptr && last_asked_ != this) std::exchange(last_asked_, nullptr)->rest();
    if (process_ < 0) throw WorkerLost(lost_);
    last_asked_ = this;
    asked_ = true;
    try {
        send(socket_, question);
    } catch (const Closed&) {
        // receive() finds out how it ended.
    }
    for (;;) {
        nlohmann::json message = receive(doing);
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
