// Draws the pictures that a run was asked for.
#pragma once

#include <cstdint>
#include <glm/vec2.hpp>
#include <glm/vec3.hpp>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "backends/gl/context.h"
#include "harness/drawing/body_painter.h"
#include "harness/drawing/legend.h"
#include "harness/drawing/orbit.h"
#include "harness/export/export_formats.h"
#include "harness/scene/scene_runner.h"

namespace voxspring {

/// Sides of a picture, in pixels.
inline constexpr int min_picture_side = 64;
inline constexpr int max_picture_side = 4096;
inline constexpr glm::ivec2 default_size{1280, 960};

/// Draws snapshots of a run, whose states must be finite. It draws the deformed mesh if the body was made of
/// a mesh, otherwise the surface of the voxels. The pictures share a camera that shows all snapshots passed
/// to look_at(), and a colour scale up to the largest value in them. The legend of a picture states the
/// largest value in that picture. A single picture needs no look_at().
///
/// If something holds a part of the body, particles of parts that nothing holds at the run's start (parts.h)
/// are drawn, but their motion affects neither the camera nor the scale. They may drift so far that the held
/// part would shrink to a dot of one colour.
class Pictures {
public:
    /// The sides of `size` are from min_picture_side to max_picture_side. Throws Unavailable if there is no
    /// OpenGL, and DeviceError.
    Pictures(Colouring colouring, glm::ivec2 size);

    /// Extends the camera and the scale to a snapshot. All snapshots must be of one scene, which outlives
    /// them, and come in the order of their steps: if errors are shown, an earlier step starts the float64
    /// run anew. Throws DeviceError, and std::runtime_error if the body has no surface.
    void look_at(const Snapshot& snapshot);
    /// A PNG file of a snapshot. Its text chunk "voxspring" has JSON with the scene, particles, steps,
    /// backend, coloured_by, the snapshot's largest value of that quantity, and the device that drew it.
    /// Throws as look_at() does.
    std::string png(const Snapshot& snapshot);

    Colouring colouring() const { return colouring_; }
    /// The colouring's largest value in the latest snapshot, without the particles that BodyParts::loose()
    /// lists.
    double largest() const { return largest_; }

private:
    /// The float64 run from which the errors of the drawn run are computed.
    struct Reference {
        Reference(const Scene& scene, int steps);
        std::unique_ptr<Backend> backend;
        SceneRunner runner;
        std::int64_t step = 0;
    };
    /// The colouring's values, one per particle.
    std::vector<double> values_of(const Snapshot& snapshot);
    const std::vector<std::uint32_t>& loose_of(const Scene& scene);
    /// Gives the painter the surface and, unless `values` is empty, the values of particles.
    void show(const Snapshot& snapshot, const std::vector<glm::dvec3>& displacement,
              const std::vector<double>& values);

    Colouring colouring_;
    glm::ivec2 size_;
    gl::Context context_;
    BodyPainter painter_{context_, for_files};
    std::optional<Reference> reference_;
    const Scene* scene_ = nullptr;  ///< the scene of `loose_`
    std::vector<std::uint32_t> loose_;
    SlantedCamera camera_;
    double largest_ = 0;
    double largest_of_all_ = 0;
};

}  // namespace voxspring
