// How far a study is: on a terminal one line that is overwritten, elsewhere a line a scene.
#pragma once

#include <chrono>
#include <string>
#include <vector>

namespace voxspring {

/// Writes to standard error. The time left is what the work that was done took, for the work that is left.
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
    /// The scene has given that many rows.
    void end(int rows);

    /// "3 h 20 min", "12 min", "45 s".
    static std::string duration_text(double seconds);

private:
    using Clock = std::chrono::steady_clock;

    std::string left(double fraction) const;
    void overwrite(const std::string& line) const;

    std::vector<Scene> scenes_;
    double all_work_ = 0, work_done_ = 0;
    int all_rows_ = 0, rows_done_ = 0;
    std::size_t number_ = 0;  ///< of the scene, from 1
    std::string heading_;
    Clock::time_point scene_begin_, begin_ = Clock::now();
    double fraction_at_begin_ = -1;  ///< negative: nothing has been shown
    bool terminal_;
};

}  // namespace voxspring
