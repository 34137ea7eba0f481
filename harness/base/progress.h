// Reports on standard error what the program does and how far it is. On a terminal one line is overwritten.
// In a pipe or a file one line is added every ten seconds (or every VOXSPRING_PROGRESS_SECONDS seconds).
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

/// The time between two lines if standard error is not a terminal. Throws BadInput if
/// VOXSPRING_PROGRESS_SECONDS is set and is not a time.
Seconds time_between_lines();

/// A duration as text: "3 h 20 min", "12 min", "45 s".
std::string duration_text(double seconds);

/// Calls the function `tick` periodically from a separate thread. That thread blocks all signals.
class Ticker {
public:
    explicit Ticker(std::function<void()> tick) : tick_(std::move(tick)) {}

    /// Starts the thread. It makes the first call after `first`, and each further call `between` after the
    /// previous one. Does nothing if the thread already runs.
    void start(Seconds first, Seconds between);
    void stop() { thread_ = {}; }
    /// Postpones the next call until `between` from now. The caller must hold mutex().
    void postpone() { next_ = Clock::now() + between_; }
    /// The mutex that the thread holds while it calls the function.
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

/// Reports tasks that are done one after the other, even tasks that cannot say how far they are. On a
/// terminal the first report comes a second after the first begin().
class Activity {
public:
    ~Activity() { end(); }

    /// Reports from now on that the task `what` is in progress.
    void begin(const std::string& what);
    /// Reports that `fraction` of the current task is done, from 0 to 1. `detail` is shown after the name of
    /// the task. The time left is estimated from the time taken so far.
    void done(double fraction, const std::string& detail);
    /// Reports no task any more. Removes the line from a terminal.
    void end();

private:
    void write();

    std::string what_, detail_;
    double fraction_ = 0;
    Clock::time_point begin_;
    bool drawn_ = false;
    Ticker ticker_{[this] { write(); }};  ///< declared last, so destroyed first: it uses all other members
};

/// Reports the progress of a study. If standard error is not a terminal, a line is also written for each
/// finished scene. The time left is a guess: it assumes that the remaining work goes as fast as the finished
/// work, although backends differ in speed.
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
    ~Progress();

    void begin(const std::string& scene);
    /// Reports that the current scene is at the task `what`, with `done` of `total` units of work finished.
    /// The units that the first call reports as finished count as work of an earlier run, not of this one.
    void show(const std::string& what, int done, int total);
    /// Corrects the number of cases of scene number `scene`, counted from 0, to `cases`.
    void expect(std::size_t scene, int cases);
    /// Reports that the current scene is finished and has given `rows` rows of the result.
    void end(int rows);

private:
    void tick();
    double work_done() const;
    std::string left() const;
    std::string line() const;

    std::vector<Scene> scenes_;
    std::size_t number_ = 0;  ///< number of the current scene, from 1
    std::string heading_, what_;
    int done_ = 0, total_ = 0;  ///< the arguments of the latest show()
    Clock::time_point scene_begin_, begin_, what_begin_;
    double work_at_begin_ = -1;  ///< work_done() at the first show(); negative before that
    bool terminal_;
    Ticker ticker_{[this] { tick(); }};  ///< declared last, so destroyed first: it uses all other members
};

}  // namespace voxspring
