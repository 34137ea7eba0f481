// The pointer on the body: it turns it, takes hold of it, cuts and sews.
#pragma once

#include <glm/vec2.hpp>
#include <glm/vec3.hpp>
#include <optional>
#include <string>

#include "harness/view/body_painter.h"
#include "harness/view/orbit.h"
#include "harness/view/simulation.h"
#include "harness/window/panel.h"

namespace voxspring {

/// Where the pointer is and which buttons are down, in pixels of the picture.
struct Pointer {
    glm::dvec2 pixel{0};
    bool left = false, right = false, middle = false;
    double wheel = 0;
};

class Hand {
public:
    Hand(Simulation& simulation, const BodyPainter& painter, Orbit& orbit)
        : simulation_(simulation), painter_(painter), orbit_(orbit) {}

    /// One frame's input on a picture of `size`. Returns what there is to say of it; empty: nothing.
    std::string follow(const Pointer& pointer, const Controls& controls, glm::ivec2 size);
    /// The simulation has let go by itself.
    void forget() { grip_.reset(); }

    /// How far the hand has moved since it took hold; nothing where it holds nothing.
    std::optional<glm::dvec3> moved() const;
    /// What to draw over the picture, from one pixel to the other: to the hand, or along a stroke.
    struct Line {
        glm::dvec2 from{0}, to{0};
    };
    std::optional<Line> line(glm::ivec2 size) const;

private:
    void look(const Pointer& pointer, bool turns, glm::ivec2 size);
    std::string press(const Controls& controls, glm::ivec2 size);
    std::string cut(const Controls& controls, glm::ivec2 size);
    std::string release(const Controls& controls);
    /// The place at a distance along the line of sight.
    glm::dvec3 place_through(glm::dvec2 pixel, double distance, glm::ivec2 size) const;

    struct Grip {
        glm::dvec3 place{0};  ///< where it took hold
        glm::dvec3 moved{0};
        double distance = 0;  ///< of that place along the line of sight
    };

    Simulation& simulation_;
    const BodyPainter& painter_;
    Orbit& orbit_;
    Pointer before_;
    std::optional<Grip> grip_;
    std::optional<glm::dvec2> cut_from_;  ///< the end of what the stroke has cut so far
    double cut_distance_ = 0;             ///< of the surface there; 0: the stroke has not met it yet
    std::size_t cut_springs_ = 0;         ///< by the stroke
    std::optional<glm::dvec3> stitch_from_;
};

}  // namespace voxspring
