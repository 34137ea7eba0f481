// Draws pictures of a deformed body in an OpenGL context without a window system.
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

/// The view of a picture: along a fixed slanted direction, z up, without perspective so that lengths can be
/// compared, and as near as the included bodies allow.
class Camera {
public:
    /// Extends the view so that `surface` is in the picture. Vertices must be finite.
    void include(std::span<const SurfaceVertex> surface);

    /// A position in the view: x to the right, y up and z towards the viewer. (0, 0, 0) is the middle of what
    /// is included.
    glm::dvec3 seen(glm::dvec3 position) const { return turned(position) - (low_ + high_) / 2.0; }
    glm::dvec3 turned(glm::dvec3 direction) const;
    bool empty() const { return empty_; }
    /// Half the extent of what is included. Always above 0.
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

/// Draws pictures of one size, on a transparent background. On one renderer the same input gives the same
/// bits.
class Painter {
public:
    /// The sides of `size` are from min_picture_side to max_picture_side. Throws Unavailable if there is no
    /// OpenGL, and DeviceError.
    explicit Painter(glm::ivec2 size);

    const std::string& device() const { return context_.capabilities().device; }
    /// Where a position appears in the picture, in pixels from the upper left corner.
    glm::dvec2 pixel_of(const Camera& camera, glm::dvec3 position) const;

    /// Draws the surface above the legend of `scale`. Values of vertices are places on the scale (0 to 1).
    /// Throws DeviceError.
    Image paint(std::span<const SurfaceVertex> surface, const Camera& camera, const Scale& scale);

private:
    /// Pixels per unit of length, and the pixel row of the camera's middle.
    glm::dvec2 fit(const Camera& camera) const;
    /// Clears the picture and sets the inputs of the shaders.
    void begin(const Camera& camera, const Scale& scale);
    void draw(std::span<const SurfaceVertex> surface, const Camera& camera);
    /// Reads the picture back, with the samples of each pixel averaged.
    Image read_back();

    gl::Context context_;
    glm::ivec2 size_;
    gl::Program program_;
    gl::Texture samples_, depth_, resolved_;
    gl::Framebuffer target_, result_;
};

}  // namespace voxspring
