// The pictures that a run was asked for.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "harness/export/painter.h"
#include "harness/export/snapshot.h"
#include "harness/scene/scene_runner.h"

namespace voxspring {

/// Draws a run's snapshots. Those that it has looked at before fix what all pictures have in common: a camera
/// that has every one of them in view, and a scale to the largest value of any. What a legend calls the
/// largest is that of its own picture. A lone picture needs no look before.
///
/// Particles of parts that nothing holds (parts.h) are drawn where they are, but count neither for the camera
/// nor for the scale: they fall for ever, and the body would be a dot of one colour.
class Pictures {
public:
    /// Throws Unavailable where there is no OpenGL.
    Pictures(Colouring colouring, glm::ivec2 size);

    /// Snapshots are of one scene, which is kept until the last, and come in the order of their steps; an
    /// earlier one starts anew. Throws std::runtime_error.
    void look_at(const Snapshot& snapshot);
    /// A PNG file of a snapshot. It carries, as the text "voxspring", JSON with scene, particles, steps,
    /// backend, coloured_by, the snapshot's largest value of it and the device that drew it. Throws as
    /// look_at() does.
    std::string png(const Snapshot& snapshot);

    Colouring colouring() const { return colouring_; }
    /// Of the colouring, in the snapshot that was seen last, of what something holds.
    double largest() const { return largest_; }

private:
    /// float64 beside the run.
    struct Reference {
        Reference(const Scene& scene, int steps);
        std::unique_ptr<Backend> backend;
        SceneRunner runner;
        std::int64_t step = 0;
    };
    /// One per particle.
    std::vector<double> values_of(const Snapshot& snapshot);
    const std::vector<std::uint32_t>& loose_of(const Scene& scene);

    Colouring colouring_;
    Painter painter_;
    std::optional<Reference> reference_;
    const Scene* scene_ = nullptr;  ///< whose `loose_` is known
    std::vector<std::uint32_t> loose_;
    Camera camera_;
    double largest_ = 0;
    double largest_of_all_ = 0;
};

}  // namespace voxspring
