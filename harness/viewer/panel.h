// The panel beside the body: controls, and plots over time of the simulation's speed and force.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace voxspring {

/// The action of the left button on the body.
enum class HandTool : std::uint8_t { turn, grab, blade, needle };
/// The quantity that colours show.
enum class Shown : std::uint8_t { displacement, tension, error };

/// The latest values of a quantity, the oldest first.
class History {
public:
    void add(double value);
    const std::vector<float>& values() const { return values_; }
    /// The last value; 0 if there is none yet.
    double latest() const { return values_.empty() ? 0 : values_.back(); }
    double largest() const;

private:
    static constexpr std::size_t length_ = 180;
    std::vector<float> values_;
};

/// The settings, which the panel shows and changes.
struct Controls {
    bool paused = false;
    bool as_many_as_fit = true;
    int steps_per_frame = 1;
    HandTool tool = HandTool::grab;
    Shown shown = Shown::displacement;
    /// Radius and stiffness of the hand, depth of the blade, in the scene's units.
    float radius = 2, stiffness = 1, depth = 8;
    std::array<float, 3> largest{};  ///< largest values of the sliders of radius, stiffness and depth
};

/// The user's requests in one frame.
struct Requests {
    bool step = false, reset = false, save = false, close = false;
    std::optional<std::string> backend;
    bool shown_changed = false;
};

/// The figures and texts that the panel shows.
struct Figures {
    std::string scene, backend, device, message;
    bool is_bad = false;  ///< whether the message tells of a failure
    std::int64_t steps = 0;
    double time = 0;                ///< in the scene's unit
    std::array<double, 2> range{};  ///< values at the two ends of the colour bar
    bool from_device = false;       ///< whether the picture is drawn from data on the device
    History steps_per_second, frame_milliseconds, tick_microseconds, force;
};

/// Draws the panel in the window's frame, handles the typed characters, and returns the user's requests.
Requests draw_panel(const Figures& figures, const std::vector<std::string>& backends,
                    const std::u32string& typed, Controls& controls);

}  // namespace voxspring
