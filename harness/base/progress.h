// What the program does and how far it is: on a terminal one line that is overwritten, elsewhere a line every
// ten seconds (VOXSPRING_PROGRESS_SECONDS: so many), all to standard error.
#pragma once

#include <chrono>
#include <condition_variable>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

namespace voxspring {

/// "3 h 20 min", "12 min", "45 s".
std::string duration_text(double seconds);

/// Work of one thing after the other, some of which cannot say how far it is. A thread of its own writes the
/// line, so that what takes long in one call is seen as well; nothing is written of what takes less than a
/// second.
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
    std::string line() const;

    std::mutex mutex_;
    std::condition_variable changed_;
    bool ends_ = false;
    std::string what_, detail_;
    double fraction_ = 0;
    Clock::time_point begin_;
    std::thread writer_;  ///< last: it uses all of the others
};

/// Of a study, which elsewhere than on a terminal has a line for each scene too. The time left is a guess: it
/// takes what is left for as fast as what was done, though backends differ.
class Progress {
public:
    struct Scene {
        int rows = 0;     ///< cases
        double work = 0;  ///< in whatever unit, the same for all scenes
    };
    explicit Progress(std::vector<Scene> scenes);
    Progress(const Progress&) = delete;
    Progress& operator=(const Progress&) = delete;
    ~Progress();

    void begin(const std::string& scene);
    /// `what` is being done in the scene, of which `done` of `total` is done. Work that was done before the
    /// first call took no time of this run.
    void show(const std::string& what, int done, int total);
    /// Of the scene's work only that share is left to do: the rest was skipped. So it is expected of later
    /// scenes until one says otherwise.
    void narrow(double share);
    /// The scene has given that many rows.
    void end(int rows);

private:
    using Clock = std::chrono::steady_clock;

    std::string left(double fraction) const;
    void write_now_and_then(const std::string& line);

    const std::vector<Scene> expected_;
    std::vector<Scene> scenes_;  ///< what is left of them
    double all_work_ = 0, work_done_ = 0;
    int all_rows_ = 0, rows_done_ = 0;
    std::size_t number_ = 0;  ///< of the scene, from 1
    std::string heading_;
    Clock::time_point scene_begin_, begin_ = Clock::now(), written_ = Clock::now();
    double fraction_at_begin_ = -1;  ///< negative: nothing has been shown
    bool terminal_;
};

}  // namespace voxspring
