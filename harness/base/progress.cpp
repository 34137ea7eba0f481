#include "harness/base/progress.h"

#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <iomanip>
#include <iostream>
#include <sstream>
#include <utility>

namespace voxspring {

Progress::Progress(std::vector<Scene> scenes)
    : scenes_(std::move(scenes)), terminal_(isatty(STDERR_FILENO) != 0) {
    for (const Scene& scene : scenes_) {
        all_work_ += scene.work;
        all_rows_ += scene.rows;
    }
}

Progress::~Progress() { overwrite(""); }

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
    overwrite(heading_ + " " + std::to_string(done) + "/" + std::to_string(total) + ", " +
              std::to_string(rows_done_) + "/" + std::to_string(all_rows_) + " rows" + left(fraction) + ": " +
              what);
}

void Progress::end(int rows) {
    work_done_ += scenes_[number_ - 1].work;
    rows_done_ += scenes_[number_ - 1].rows;
    if (terminal_) return;
    const std::chrono::duration<double> took = Clock::now() - scene_begin_;
    std::ostringstream line;
    line << heading_ << ": " << rows << (rows == 1 ? " row" : " rows") << " in " << std::setprecision(3)
         << took.count() << " s"
         << (number_ < scenes_.size() ? left(work_done_ / std::max(all_work_, 1.0)) : "") << "\n";
    std::cerr << line.str() << std::flush;
}

std::string Progress::duration_text(double seconds) {
    const auto whole = std::llround(seconds);
    if (whole < 60) return std::to_string(whole) + " s";
    const auto minutes = (whole + 30) / 60;
    if (minutes < 60) return std::to_string(minutes) + " min";
    return std::to_string(minutes / 60) + " h " + std::to_string(minutes % 60) + " min";
}

std::string Progress::left(double fraction) const {
    const double done = fraction - fraction_at_begin_;
    if (fraction_at_begin_ < 0 || done <= 0) return "";
    const std::chrono::duration<double> took = Clock::now() - begin_;
    return ", " + duration_text(took.count() * (1 - fraction) / done) + " left";
}

void Progress::overwrite(const std::string& line) const {
    if (!terminal_) return;
    winsize size{};
    const bool known = ioctl(STDERR_FILENO, TIOCGWINSZ, &size) == 0 && size.ws_col > 0;
    // A line that wraps could not be overwritten.
    std::cerr << "\r\x1b[K" << line.substr(0, (known ? size.ws_col : 80) - 1u) << std::flush;
}

}  // namespace voxspring
