// A camera that goes around a body.
#pragma once

#include <glm/mat4x4.hpp>
#include <glm/vec2.hpp>
#include <glm/vec3.hpp>

namespace voxspring {

/// From an eye through a pixel.
struct Ray {
    glm::dvec3 origin{0};
    glm::dvec3 direction{0};  ///< of length 1
};

/// Looks at a point from a distance, z up. Angles in radians, sizes in pixels, y down.
class Orbit {
public:
    /// All between `low` and `high` is to be seen.
    void show(const glm::dvec3& low, const glm::dvec3& high);

    /// Half a turn for as many pixels as the picture is high.
    void turn(glm::dvec2 pixels, glm::ivec2 size);
    /// The point that it looks at goes along with the pointer.
    void shift(glm::dvec2 pixels, glm::ivec2 size);
    /// Nearer for `notches` above 0.
    void zoom(double notches);

    glm::dvec3 eye() const;
    glm::dmat4 to_eye() const;
    glm::dmat4 to_clip(glm::ivec2 size) const;
    Ray through(glm::dvec2 pixel, glm::ivec2 size) const;
    /// The pixel at which a place is seen. Of a place behind the eye it says nothing.
    glm::dvec2 pixel_of(const glm::dvec3& place, glm::ivec2 size) const;
    /// The place that is seen at a pixel with a value of the depth buffer, 0 (near) to 1.
    glm::dvec3 place_at(glm::dvec2 pixel, double depth, glm::ivec2 size) const;
    /// How far along the line of sight a place lies.
    double distance_to(const glm::dvec3& place) const;
    /// Towards the eye.
    glm::dvec3 backward() const;

private:
    glm::dvec3 middle_{0};
    double radius_ = 1;  ///< of what is to be seen
    double distance_ = 3;
    double azimuth_ = 0.5, elevation_ = 0.4;
};

}  // namespace voxspring
