// Pictures of a deformed body, drawn by an OpenGL context of its own without a window system.
#pragma once

#include <glm/vec2.hpp>
#include <glm/vec3.hpp>
#include <span>
#include <string>
#include <vector>

#include "backends/gl/context.h"
#include "backends/gl/program.h"
#include "harness/export/image.h"
#include "harness/export/legend.h"
#include "harness/export/surface.h"

namespace voxspring {

/// How a picture looks at a scene: along a fixed slanted direction, z up, without perspective, so that
/// lengths can be compared; as near as the bodies that it is to show allow.
class Camera {
public:
    /// Everything included is in the picture. Vertices are finite.
    void include(std::span<const SurfaceVertex> surface);

    /// x to the right, y up and z towards the viewer; (0, 0, 0) is the middle of what is included.
    glm::dvec3 seen(glm::dvec3 position) const { return turned(position) - (low_ + high_) / 2.0; }
    glm::dvec3 turned(glm::dvec3 direction) const;
    bool empty() const { return empty_; }
    /// Half the extent of what is included; above 0.
    glm::dvec3 reach() const;

private:
    glm::dvec3 low_{0};
    glm::dvec3 high_{0};
    bool empty_ = true;
};

/// Sides of a picture, in pixels.
inline constexpr int min_picture_side = 64;
inline constexpr int max_picture_side = 4096;
inline constexpr glm::ivec2 default_size{1280, 960};

/// Draws pictures of one size. They have no background, and the same bits for the same input on one renderer.
class Painter {
public:
    /// Sides from min_picture_side to max_picture_side. Throws Unavailable where there is no OpenGL,
    /// DeviceError.
    explicit Painter(glm::ivec2 size);

    const std::string& device() const { return context_.capabilities().device; }
    /// Where a seen position is in the picture: pixels from its upper left corner.
    glm::dvec2 pixel_of(const Camera& camera, glm::dvec3 position) const;

    /// The surface, whose values are places on the scale (0 to 1), above the scale's legend. Throws
    /// DeviceError.
    Image paint(std::span<const SurfaceVertex> surface, const Camera& camera, const Scale& scale);

private:
    /// Pixels of a unit of length, and the row of the camera's middle.
    glm::dvec2 fit(const Camera& camera) const;
    /// Empties the picture and sets what its shaders need.
    void begin(const Camera& camera, const Scale& scale);
    void draw(std::span<const SurfaceVertex> surface, const Camera& camera);
    /// What was drawn, the body's edges averaged.
    Image read_back();

    gl::Context context_;
    glm::ivec2 size_;
    gl::Program program_;
    gl::Texture samples_, depth_, resolved_;
    gl::Framebuffer target_, result_;
};

}  // namespace voxspring
