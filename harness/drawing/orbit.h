// Cameras: one that moves around a body, and the fixed one of pictures.
#pragma once

#include <glm/mat4x4.hpp>
#include <glm/vec2.hpp>
#include <glm/vec3.hpp>
#include <glm/vec4.hpp>
#include <span>

namespace voxspring {

/// What a camera sees, for a picture of `size` pixels. Pixels count from the top, y down.
struct View {
    glm::ivec2 size{1};
    glm::dmat4 to_eye{1};   ///< x to the right, y up, z towards the viewer
    glm::dmat4 to_clip{1};  ///< OpenGL's clip space

    /// The pixel at which a place appears. The result is meaningless for a place behind the eye.
    glm::dvec2 pixel_of(const glm::dvec3& place) const;
    /// The place at a pixel whose value in the depth buffer is `depth`, from 0 (near) to 1.
    glm::dvec3 place_at(glm::dvec2 pixel, double depth) const;
};

/// A line of sight from the eye through a pixel.
struct Ray {
    glm::dvec3 origin{0};
    glm::dvec3 direction{0};  ///< of length 1
};

/// A camera that looks at a point from a distance, z up. Angles are in radians.
class Orbit {
public:
    /// Moves the camera so that the box from `low` to `high` is visible.
    void show(const glm::dvec3& low, const glm::dvec3& high);

    /// Turns around the body: half a turn for a movement by the picture's height.
    void turn(glm::dvec2 pixels, glm::ivec2 size);
    /// Pans: the body follows the pointer on the screen.
    void shift(glm::dvec2 pixels, glm::ivec2 size);
    /// Moves nearer if `notches` is positive.
    void zoom(double notches);

    View view(glm::ivec2 size) const;
    glm::dvec2 pixel_of(const glm::dvec3& place, glm::ivec2 size) const { return view(size).pixel_of(place); }
    Ray through(glm::dvec2 pixel, glm::ivec2 size) const;
    /// The distance of a place from the eye along the viewing direction.
    double distance_to(const glm::dvec3& place) const;
    /// The unit vector from the point that the camera looks at towards the eye.
    glm::dvec3 backward() const;

private:
    glm::dvec3 eye() const { return middle_ + distance_ * backward(); }
    glm::dmat4 to_eye() const;

    glm::dvec3 middle_{0};
    double radius_ = 1;  ///< radius of the box that show() made visible
    double distance_ = 3;
    double azimuth_ = 0.5, elevation_ = 0.4;
};

/// The camera of pictures: along a fixed slanted direction, z up, without perspective so that lengths can be
/// compared, and as near as the included places allow.
class SlantedCamera {
public:
    /// Extends the view to these places, of which it takes x, y and z.
    void include(std::span<const glm::vec4> places);
    bool empty() const { return empty_; }
    /// The view in which all that is included lies in the upper `share` of the picture.
    View view(glm::ivec2 size, double share) const;

private:
    glm::dvec3 low_{0}, high_{0};  ///< bounding box in the camera's axes
    bool empty_ = true;
};

}  // namespace voxspring
