// What the program does and how far it is: on a terminal one line that is overwritten, elsewhere a line every
// ten seconds (VOXSPRING_PROGRESS_SECONDS: so many), all to standard error.
#pragma once

#include <chrono>
#include <condition_variable>
#include <functional>
#include <mutex>
#include <string>
#include <thread>
#include <utility>
#include <vector>

namespace voxspring {

/// "3 h 20 min", "12 min", "45 s".
std::string duration_text(double seconds);

/// Calls a function now and then from a thread of its own, which takes no signals.
class Ticker {
public:
    using Seconds = std::chrono::duration<double>;
    explicit Ticker(std::function<void()> tick) : tick_(std::move(tick)) {}
    Ticker(const Ticker&) = delete;
    Ticker& operator=(const Ticker&) = delete;
    ~Ticker() { stop(); }

    /// The first call is in `first`, each further one `between` later; nothing changes where it runs already.
    void start(Seconds first, Seconds between);
    void stop();
    /// The next call is as far away as if there had been one now. Under the mutex.
    void postpone() { next_ = std::chrono::steady_clock::now() + between_; }
    /// Held while the function is called.
    std::mutex& mutex() { return mutex_; }

private:
    using Clock = std::chrono::steady_clock;

    void run();

    const std::function<void()> tick_;
    std::mutex mutex_;
    std::condition_variable changed_;
    bool ends_ = false;
    std::chrono::time_point<Clock, Seconds> next_;
    Seconds between_{0};
    std::thread thread_;  ///< last: it uses all of the others
};

/// Work of one thing after the other, some of which cannot say how far it is. Nothing is written of what
/// takes less than a second.
class Activity {
public:
    Activity() = default;
    Activity(const Activity&) = delete;
    Activity& operator=(const Activity&) = delete;
    ~Activity() { end(); }

    /// `what` begins now, of unknown length.
    void begin(const std::string& what);
    /// So much of what began last is done, from 0 to 1: what is left is said to take as long as that did.
    void done(double fraction, const std::string& detail);
    /// Nothing is under way any more: removes the line from a terminal.
    void end();

private:
    using Clock = std::chrono::steady_clock;

    void write();

    std::string what_, detail_;
    double fraction_ = 0;
    Clock::time_point begin_;
    bool drawn_ = false;
    Ticker ticker_{[this] { write(); }};  ///< last: it uses all of the others
};

/// Of a study, which elsewhere than on a terminal has a line for each scene too. The time left is a guess: it
/// takes what is left for as fast as what was done, though backends differ.
class Progress {
public:
    struct Scene {
        int cases = 0;
        int rows_per_case = 0;
        double work_per_case = 0;  ///< in whatever unit, the same for all scenes

        int rows() const { return cases * rows_per_case; }
        double work() const { return cases * work_per_case; }
    };
    explicit Progress(std::vector<Scene> scenes);
    Progress(const Progress&) = delete;
    Progress& operator=(const Progress&) = delete;
    ~Progress();

    void begin(const std::string& scene);
    /// `what` is being done in the scene, of which `done` of `total` is done. Work that was done before the
    /// first call took no time of this run.
    void show(const std::string& what, int done, int total);
    /// Only that many cases of a scene, by its number from 0, can run.
    void expect(std::size_t scene, int cases);
    /// The scene has given that many rows.
    void end(int rows);

private:
    using Clock = std::chrono::steady_clock;

    void tick();
    double work_of_all() const;
    double work_done() const;
    std::string left() const;
    std::string line() const;

    std::vector<Scene> scenes_;
    std::size_t number_ = 0;  ///< of the scene, from 1
    std::string heading_, what_;
    int done_ = 0, total_ = 0;  ///< within the scene
    Clock::time_point scene_begin_, begin_, what_begin_;
    double work_at_begin_ = -1;  ///< negative: nothing has been shown
    bool terminal_;
    Ticker ticker_{[this] { tick(); }};  ///< last: it uses all of the others
};

}  // namespace voxspring
