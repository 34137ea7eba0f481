// The panel beside the body: what is asked for by hand, and what it costs, as running plots.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace voxspring {

/// What the left button does on the body.
enum class HandTool : std::uint8_t { turn, grab, blade, needle };
/// What colours mean.
enum class Shown : std::uint8_t { displacement, tension, error };

/// The latest values of something, the oldest first.
class History {
public:
    void add(double value);
    const std::vector<float>& values() const { return values_; }
    /// The last one; 0 before any.
    double latest() const { return values_.empty() ? 0 : values_.back(); }
    double largest() const;

private:
    static constexpr std::size_t length_ = 180;
    std::vector<float> values_;
};

/// What somebody has set; the panel shows it and changes it.
struct Controls {
    bool paused = false;
    bool as_many_as_fit = true;
    int steps_a_frame = 1;
    HandTool tool = HandTool::grab;
    Shown shown = Shown::displacement;
    float radius = 2, stiffness = 1, depth = 8;  ///< of the hand, in the scene's units; of the blade
    std::array<float, 3> largest{};              ///< that the sliders of these three go to
};

/// What was asked for in one frame.
struct Requests {
    bool step = false, reset = false, save = false, close = false;
    std::optional<std::string> backend;
    bool shown_changed = false;
};

/// What the panel tells.
struct Figures {
    std::string scene, backend, device, message;
    bool is_bad = false;  ///< the message: something failed
    std::int64_t steps = 0;
    double time = 0;                ///< in the scene's unit
    std::array<double, 2> range{};  ///< of the colours
    bool from_device = false;       ///< the picture is drawn from what lies on the device
    History steps_a_second, frame_milliseconds, tick_microseconds, force;
};

/// Draws the panel in the window's frame, takes what was typed, and returns what was asked for.
Requests draw_panel(const Figures& figures, const std::vector<std::string>& backends,
                    const std::u32string& typed, Controls& controls);

}  // namespace voxspring
