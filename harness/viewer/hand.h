// The pointer as a hand, which turns the body, takes hold of it, cuts it and sews it.
#pragma once

#include <glm/vec2.hpp>
#include <glm/vec3.hpp>
#include <optional>
#include <string>

#include "harness/drawing/body_painter.h"
#include "harness/drawing/orbit.h"
#include "harness/simulation/simulation.h"
#include "harness/viewer/panel.h"

namespace voxspring {

/// The pointer's position in pixels of the picture, and which buttons are down.
struct Pointer {
    glm::dvec2 pixel{0};
    bool left = false, right = false, middle = false;
    double wheel = 0;
};

class Hand {
public:
    Hand(Simulation& simulation, const BodyPainter& painter, Orbit& orbit)
        : simulation_(simulation), painter_(painter), orbit_(orbit) {}

    /// Handles the input of one frame on a picture of `size`. Returns a message for the user; may be empty.
    std::string follow(const Pointer& pointer, const Controls& controls, glm::ivec2 size);
    /// Forgets the grip; to be called when the simulation has let go of the body by itself.
    void forget() { grip_.reset(); }

    /// How far the hand has moved since it took hold; nullopt if it holds nothing.
    std::optional<glm::dvec3> moved() const;
    /// A line to draw over the picture, in pixels: from the place held, the first stitch or the end of the
    /// cut to the pointer.
    struct Line {
        glm::dvec2 from{0}, to{0};
    };
    std::optional<Line> line(glm::ivec2 size) const;

private:
    void look(const Pointer& pointer, bool turns, glm::ivec2 size);
    std::string press(const Controls& controls, glm::ivec2 size);
    std::string cut(const Controls& controls, glm::ivec2 size);
    std::string release(const Controls& controls);
    /// The place at `distance` from the eye (along the viewing direction) that is visible at `pixel`.
    glm::dvec3 place_through(glm::dvec2 pixel, double distance, glm::ivec2 size) const;

    struct Grip {
        glm::dvec3 place{0};  ///< where the hand took hold
        glm::dvec3 moved{0};
        double distance = 0;  ///< distance of `place` from the eye, along the viewing direction
    };

    Simulation& simulation_;
    const BodyPainter& painter_;
    Orbit& orbit_;
    Pointer before_;
    std::optional<Grip> grip_;
    std::optional<glm::dvec2> cut_from_;  ///< pixel up to which the blade has cut; absent: no cut is made
    double cut_distance_ = 0;      ///< distance of the surface from the eye at cut_from_; 0: not known yet
    std::size_t cut_springs_ = 0;  ///< number of springs cut since the button went down
    std::optional<glm::dvec3> stitch_from_;
};

}  // namespace voxspring
