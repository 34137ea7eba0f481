// Reports what the program does and how far it is, on standard error. On a terminal one line is overwritten;
// elsewhere a line is added every ten seconds (or every VOXSPRING_PROGRESS_SECONDS).
#pragma once

#include <condition_variable>
#include <functional>
#include <mutex>
#include <stop_token>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "harness/base/clock.h"

namespace voxspring {

/// A duration as text: "3 h 20 min", "12 min", "45 s".
std::string duration_text(double seconds);

/// Calls a function periodically from a separate thread, which receives no signals.
class Ticker {
public:
    explicit Ticker(std::function<void()> tick) : tick_(std::move(tick)) {}
    Ticker(const Ticker&) = delete;
    Ticker& operator=(const Ticker&) = delete;
    ~Ticker() = default;

    /// The first call is made after `first`, each further one `between` later. Does nothing if the thread
    /// already runs.
    void start(Seconds first, Seconds between);
    void stop() { thread_ = {}; }
    /// Postpones the next call as if a call had been made now. The caller holds mutex().
    void postpone() { next_ = Clock::now() + between_; }
    /// The mutex, which is held while the function is called.
    std::mutex& mutex() { return mutex_; }

private:
    void run(const std::stop_token& stopped);

    const std::function<void()> tick_;
    std::mutex mutex_;
    std::condition_variable_any changed_;
    std::chrono::time_point<Clock, Seconds> next_;
    Seconds between_{0};
    std::jthread thread_;  ///< declared last, so destroyed first: it uses all other members
};

/// Progress of tasks done one after the other, some of which cannot say how far they are. A task that takes
/// less than a second is not reported.
class Activity {
public:
    Activity() = default;
    Activity(const Activity&) = delete;
    Activity& operator=(const Activity&) = delete;
    ~Activity() { end(); }

    /// Task `what` begins now; how long it takes is unknown.
    void begin(const std::string& what);
    /// `fraction` of the current task is done, from 0 to 1; `detail` is shown behind its name. The time left
    /// is estimated from the time taken so far.
    void done(double fraction, const std::string& detail);
    /// No task is under way any more: removes the line from a terminal.
    void end();

private:
    void write();

    std::string what_, detail_;
    double fraction_ = 0;
    Clock::time_point begin_;
    bool drawn_ = false;
    Ticker ticker_{[this] { write(); }};  ///< declared last, so destroyed first: it uses all other members
};

/// Progress of a study. If standard error is no terminal, a line is also written for each finished scene. The
/// time left is a guess: it assumes that the remaining work is as fast as the finished work, although
/// backends differ.
class Progress {
public:
    struct Scene {
        int cases = 0;
        int rows_per_case = 0;
        double work_per_case = 0;  ///< in any unit that all scenes share

        int rows() const { return cases * rows_per_case; }
        double work() const { return cases * work_per_case; }
    };
    explicit Progress(std::vector<Scene> scenes);
    Progress(const Progress&) = delete;
    Progress& operator=(const Progress&) = delete;
    ~Progress();

    void begin(const std::string& scene);
    /// The current scene is at task `what`, and `done` of `total` is finished. What the first call reports as
    /// finished was done by an earlier run, and does not count for the speed of this run.
    void show(const std::string& what, int done, int total);
    /// Corrects the number of cases of scene number `scene`, counted from 0: only `cases` cases can run.
    void expect(std::size_t scene, int cases);
    /// The scene is finished and has given `rows` rows.
    void end(int rows);

private:
    void tick();
    double work_of_all() const;
    double work_done() const;
    std::string left() const;
    std::string line() const;

    std::vector<Scene> scenes_;
    std::size_t number_ = 0;  ///< number of the current scene, from 1
    std::string heading_, what_;
    int done_ = 0, total_ = 0;  ///< as in show()
    Clock::time_point scene_begin_, begin_, what_begin_;
    double work_at_begin_ = -1;  ///< negative: nothing has been shown yet
    bool terminal_;
    Ticker ticker_{[this] { tick(); }};  ///< declared last, so destroyed first: it uses all other members
};

}  // namespace voxspring
