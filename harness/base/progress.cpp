#include "harness/base/progress.h"

#include <fmt/format.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <cmath>
#include <csignal>
#include <cstdlib>
#include <iostream>
#include <utility>

#include "harness/base/bad_input.h"
#include "harness/base/text.h"

namespace voxspring {
namespace {

bool is_terminal() { return isatty(STDERR_FILENO) != 0; }

void overwrite_line(const std::string& line) {
    winsize size{};
    const bool known = ioctl(STDERR_FILENO, TIOCGWINSZ, &size) == 0 && size.ws_col > 0;
    // The line is cut to the terminal's width, since a line that wraps could not be overwritten.
    const std::size_t fits = bytes_of_characters(line, (known ? size.ws_col : 80) - 1u);
    std::cerr << "\r\x1b[K" << line.substr(0, fits) << std::flush;
}

}  // namespace

Seconds time_between_lines() {
    constexpr const char* variable = "VOXSPRING_PROGRESS_SECONDS";
    constexpr double otherwise = 10, shortest = 0.01, longest = 1e6;
    const char* asked = std::getenv(variable);
    if (asked == nullptr || *asked == '\0') return Seconds(otherwise);
    char* end = nullptr;
    const double seconds = std::strtod(asked, &end);
    if (*end != '\0' || !(seconds >= shortest && seconds <= longest))
        throw BadInput("environment", variable, asked,
                       fmt::format("a number of seconds from {:g} to {:g}", shortest, longest));
    return Seconds(seconds);
}

std::string duration_text(double seconds) {
    const auto whole = std::llround(seconds);
    if (whole < 60) return std::to_string(whole) + " s";
    const auto minutes = (whole + 30) / 60;
    if (minutes < 60) return std::to_string(minutes) + " min";
    return std::to_string(minutes / 60) + " h " + std::to_string(minutes % 60) + " min";
}

void Ticker::start(Seconds first, Seconds between) {
    if (thread_.joinable()) return;
    between_ = between;
    next_ = Clock::now() + first;
    // The new thread inherits that all signals are blocked. Signals then go to the thread that does the work,
    // and interrupt its system calls.
    sigset_t all, before;
    sigfillset(&all);
    pthread_sigmask(SIG_SETMASK, &all, &before);
    thread_ = std::jthread([this](const std::stop_token& stopped) { run(stopped); });
    pthread_sigmask(SIG_SETMASK, &before, nullptr);
}

void Ticker::run(const std::stop_token& stopped) {
    std::unique_lock lock(mutex_);
    while (!stopped.stop_requested()) {
        const auto until = next_;  // a copy, since postpone() may change `next_` during the wait
        changed_.wait_until(lock, stopped, until, [] { return false; });
        if (stopped.stop_requested() || Clock::now() < next_) continue;
        postpone();
        tick_();
    }
}

void Activity::end() {
    ticker_.stop();
    if (std::exchange(drawn_, false)) overwrite_line("");
}

void Activity::begin(const std::string& what) {
    constexpr Seconds unseen{1}, redrawn{0.2};
    {
        const std::lock_guard lock(ticker_.mutex());
        what_ = what;
        detail_.clear();
        fraction_ = 0;
        begin_ = Clock::now();
    }
    if (is_terminal()) {
        ticker_.start(unseen, redrawn);
    } else {
        ticker_.start(time_between_lines(), time_between_lines());
    }
}

void Activity::done(double fraction, const std::string& detail) {
    const std::lock_guard lock(ticker_.mutex());
    fraction_ = fraction;
    detail_ = detail;
}

void Activity::write() {
    const double took = seconds_since(begin_);
    std::string text = what_ + (detail_.empty() ? "" : ": " + detail_) + ", " + duration_text(took);
    if (fraction_ > 0) text += ", " + duration_text(took * (1 - fraction_) / fraction_) + " left";
    if (is_terminal()) {
        overwrite_line(text);
        drawn_ = true;
    } else {
        std::cerr << "voxspring: " + text + "\n" << std::flush;
    }
}

Progress::Progress(std::vector<Scene> scenes) : scenes_(std::move(scenes)), terminal_(is_terminal()) {
    ticker_.start(time_between_lines(), time_between_lines());
}

Progress::~Progress() {
    ticker_.stop();
    if (terminal_) overwrite_line("");
}

void Progress::begin(const std::string& scene) {
    const std::lock_guard lock(ticker_.mutex());
    ++number_;
    heading_ = "[" + std::to_string(number_) + "/" + std::to_string(scenes_.size()) + "] " + scene;
    what_.clear();
    done_ = 0;
    total_ = 0;
    scene_begin_ = Clock::now();
}

void Progress::show(const std::string& what, int done, int total) {
    const std::lock_guard lock(ticker_.mutex());
    if (what != what_) what_begin_ = Clock::now();
    what_ = what;
    done_ = done;
    total_ = total;
    if (work_at_begin_ < 0) {
        work_at_begin_ = work_done();
        begin_ = Clock::now();
    }
    if (terminal_) overwrite_line(line());
}

void Progress::expect(std::size_t scene, int cases) {
    const std::lock_guard lock(ticker_.mutex());
    scenes_[scene].cases = cases;
}

void Progress::end(int rows) {
    const std::lock_guard lock(ticker_.mutex());
    what_.clear();
    done_ = total_ = 1;
    if (terminal_) return;
    const double took = seconds_since(scene_begin_);
    std::cerr << fmt::format("{}: {} in {:.3g} s{}\n", heading_, counted(std::uint64_t(rows), "row"), took,
                             number_ < scenes_.size() ? left() : "")
              << std::flush;
    ticker_.postpone();
}

/// Called periodically: shows the current task and, from a second on, for how long it has been running.
void Progress::tick() {
    if (what_.empty()) return;
    const double took = seconds_since(what_begin_);
    const std::string text = line() + (took >= 1 ? ", " + duration_text(took) : "");
    if (terminal_) {
        overwrite_line(text);
    } else {
        std::cerr << text + "\n" << std::flush;
    }
}

double Progress::work_done() const {
    double work = 0;
    for (std::size_t i = 0; i + 1 < number_; ++i) work += scenes_[i].work();
    const double within = total_ > 0 ? double(done_) / total_ : 0;
    return number_ > 0 ? work + within * scenes_[number_ - 1].work() : work;
}

std::string Progress::left() const {
    const double work = work_done(), of_this_run = work - work_at_begin_;
    if (work_at_begin_ < 0 || of_this_run <= 0) return "";
    double of_all = 0;
    for (const Scene& scene : scenes_) of_all += scene.work();
    const double took = seconds_since(begin_);
    return ", about " + duration_text(took * (of_all - work) / of_this_run) + " left";
}

std::string Progress::line() const {
    int rows_done = 0, rows = 0;
    for (std::size_t i = 0; i < scenes_.size(); ++i) {
        rows += scenes_[i].rows();
        if (i + 1 < number_) rows_done += scenes_[i].rows();
    }
    return fmt::format("{} {}/{}, {}/{}{}: {}", heading_, done_, total_, rows_done,
                       counted(std::uint64_t(rows), "row"), left(), what_);
}

}  // namespace voxspring
