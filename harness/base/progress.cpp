#include "harness/base/progress.h"

#include <fmt/format.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <iostream>
#include <utility>

namespace voxspring {
namespace {

bool is_terminal() { return isatty(STDERR_FILENO) != 0; }

/// Between two lines, where it is no terminal.
std::chrono::duration<double> pause() {
    constexpr double otherwise = 10, shortest = 0.01, longest = 1e6;
    const char* asked = std::getenv("VOXSPRING_PROGRESS_SECONDS");
    const double seconds = asked != nullptr ? std::strtod(asked, nullptr) : otherwise;
    return std::chrono::duration<double>(seconds >= shortest ? std::min(seconds, longest) : otherwise);
}

void overwrite_line(const std::string& line) {
    winsize size{};
    const bool known = ioctl(STDERR_FILENO, TIOCGWINSZ, &size) == 0 && size.ws_col > 0;
    // A line that wraps could not be overwritten.
    std::cerr << "\r\x1b[K" << line.substr(0, (known ? size.ws_col : 80) - 1u) << std::flush;
}

}  // namespace

std::string duration_text(double seconds) {
    const auto whole = std::llround(seconds);
    if (whole < 60) return std::to_string(whole) + " s";
    const auto minutes = (whole + 30) / 60;
    if (minutes < 60) return std::to_string(minutes) + " min";
    return std::to_string(minutes / 60) + " h " + std::to_string(minutes % 60) + " min";
}

void Activity::end() {
    if (!writer_.joinable()) return;
    {
        const std::lock_guard lock(mutex_);
        ends_ = true;
    }
    changed_.notify_one();
    writer_.join();
    ends_ = false;
}

void Activity::begin(const std::string& what) {
    {
        const std::lock_guard lock(mutex_);
        what_ = what;
        detail_.clear();
        fraction_ = 0;
        begin_ = Clock::now();
    }
    if (!writer_.joinable()) writer_ = std::thread([this] { write(); });
}

void Activity::done(double fraction, const std::string& detail) {
    const std::lock_guard lock(mutex_);
    fraction_ = fraction;
    detail_ = detail;
}

std::string Activity::line() const {
    const std::chrono::duration<double> took = Clock::now() - begin_;
    std::string text = what_ + (detail_.empty() ? "" : ": " + detail_) + ", " + duration_text(took.count());
    if (fraction_ > 0) text += ", " + duration_text(took.count() * (1 - fraction_) / fraction_) + " left";
    return text;
}

void Activity::write() {
    constexpr std::chrono::duration<double> unseen{1}, redrawn{0.2};
    const bool terminal = is_terminal();
    const std::chrono::duration<double> between = terminal ? redrawn : pause();
    bool drawn = false;
    std::unique_lock lock(mutex_);
    auto next = Clock::now() + (terminal ? unseen : between);
    while (!changed_.wait_until(lock, next, [this] { return ends_; })) {
        if (terminal) {
            overwrite_line(line());
            drawn = true;
        } else {
            std::cerr << "voxspring: " + line() + "\n" << std::flush;
        }
        next = Clock::now() + between;
    }
    if (drawn) overwrite_line("");
}

Progress::Progress(std::vector<Scene> scenes)
    : expected_(std::move(scenes)), scenes_(expected_), terminal_(is_terminal()) {
    for (const Scene& scene : scenes_) {
        all_work_ += scene.work;
        all_rows_ += scene.rows;
    }
}

Progress::~Progress() {
    if (terminal_) overwrite_line("");
}

void Progress::begin(const std::string& scene) {
    ++number_;
    heading_ = "[" + std::to_string(number_) + "/" + std::to_string(scenes_.size()) + "] " + scene;
    scene_begin_ = Clock::now();
}

void Progress::show(const std::string& what, int done, int total) {
    const double within = total > 0 ? double(done) / total : 0;
    const double fraction = (work_done_ + within * scenes_[number_ - 1].work) / std::max(all_work_, 1.0);
    if (fraction_at_begin_ < 0) {
        fraction_at_begin_ = fraction;
        begin_ = Clock::now();
    }
    const std::string line = heading_ + " " + std::to_string(done) + "/" + std::to_string(total) + ", " +
                             std::to_string(rows_done_) + "/" + std::to_string(all_rows_) + " rows" +
                             left(fraction) + ": " + what;
    if (terminal_) {
        overwrite_line(line);
    } else {
        write_now_and_then(line);
    }
}

void Progress::narrow(double share) {
    for (std::size_t i = number_ - 1; i < scenes_.size(); ++i) {
        const Scene narrowed{int(std::lround(expected_[i].rows * share)), expected_[i].work * share};
        all_work_ += narrowed.work - scenes_[i].work;
        all_rows_ += narrowed.rows - scenes_[i].rows;
        scenes_[i] = narrowed;
    }
}

void Progress::end(int rows) {
    work_done_ += scenes_[number_ - 1].work;
    rows_done_ += scenes_[number_ - 1].rows;
    if (terminal_) return;
    const std::chrono::duration<double> took = Clock::now() - scene_begin_;
    std::cerr << fmt::format("{}: {} {} in {:.3g} s{}\n", heading_, rows, rows == 1 ? "row" : "rows",
                             took.count(),
                             number_ < scenes_.size() ? left(work_done_ / std::max(all_work_, 1.0)) : "")
              << std::flush;
    written_ = Clock::now();
}

std::string Progress::left(double fraction) const {
    const double done = fraction - fraction_at_begin_;
    if (fraction_at_begin_ < 0 || done <= 0) return "";
    const std::chrono::duration<double> took = Clock::now() - begin_;
    return ", about " + duration_text(took.count() * (1 - fraction) / done) + " left";
}

void Progress::write_now_and_then(const std::string& line) {
    if (Clock::now() - written_ < pause()) return;
    written_ = Clock::now();
    std::cerr << line + "\n" << std::flush;
}

}  // namespace voxspring
