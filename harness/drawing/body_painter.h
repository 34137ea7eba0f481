// Draws a body's surface from displacements in a buffer on the card. Any source may have written them.
#pragma once

#include <array>
#include <cstdint>
#include <glm/vec2.hpp>
#include <glm/vec3.hpp>
#include <glm/vec4.hpp>
#include <optional>
#include <span>
#include <vector>

#include "backends/gl/context.h"
#include "backends/gl/program.h"
#include "backends/gl/storage_buffer.h"
#include "harness/drawing/body_mesh.h"
#include "harness/drawing/image.h"
#include "harness/drawing/legend.h"
#include "harness/drawing/orbit.h"

namespace voxspring {

/// The colour scale: `low` is the value at one end of the colours, `high` that at the other.
struct Shades {
    double low = 0, high = 1;
    Colouring colours = Colouring::displacement;
};

/// How pictures are made.
struct PictureStyle {
    /// Samples per pixel, whose mean is shown. Every renderer supports 4. 0: no multisampling.
    int samples = 0;
    int smoothing = 0;  ///< number of passes that smooth the surface's normals
    /// A dark grey, from which both ends of the colour maps viridis and plasma stand out.
    std::array<float, 4> background = {0.16F, 0.17F, 0.19F, 1};
};
/// Smooth edges and surfaces on a transparent background.
inline constexpr PictureStyle for_files{.samples = 4, .smoothing = 2, .background = {0, 0, 0, 0}};

/// Draws in an OpenGL context, which must outlive this object. Each call that uses OpenGL makes the context
/// current. Throws DeviceError. On one renderer the same input gives the same bits.
class BodyPainter {
public:
    explicit BodyPainter(const gl::Context& context, const PictureStyle& style = {});

    /// Replaces the body. It is at rest until displacements are set.
    void set_mesh(BodyMesh mesh);
    const BodyMesh& mesh() const { return mesh_; }

    /// The buffer to pass to FeedFacet::feed() with mesh().particles. Valid until the next set_mesh().
    GLuint displacements() const { return displacements_.get(); }
    /// Sets displacements from the host: one per particle of the problem, or one per vertex if mesh() is a
    /// mesh that the body carries. It is the same for values.
    void put_displacements(std::span<const glm::dvec3> displacement);
    /// Sets displacements of mesh().particles only, in their order: x, y, z and 0.
    void put_displacements(std::span<const glm::vec4> followed);
    /// Sets the values that colours show. If `value` is empty, colours show the length of the displacement.
    void put_values(std::span<const double> value);

    /// Draws the body into a picture, with the present contents of displacements().
    void draw(const View& view, const Shades& shades);
    /// Copies the picture to the window's framebuffer.
    void show() const;
    Image picture() const;
    /// The point of the deformed body that is visible at a pixel of the picture; nullopt if there is none.
    /// Requires that PictureStyle::samples is 0 (no multisampling).
    std::optional<glm::dvec3> place_at(glm::dvec2 pixel) const;
    /// Where the mesh's vertices are (x, y, z), with the present contents of displacements(), and their
    /// values (w). Waits for the card.
    std::vector<glm::vec4> places();
    /// The smallest and the largest value of the mesh's vertices in the latest draw() or places(), except
    /// those whose first followed particle is in `without`, which is sorted in ascending order. Waits for the
    /// card.
    std::array<double, 2> range(std::span<const std::uint32_t> without = {}) const;

private:
    void make_picture(glm::ivec2 size);
    void follow_particles();
    std::vector<glm::vec4> downloaded_places() const;

    const gl::Context& context_;
    PictureStyle style_;
    gl::Program vertices_program_, normals_program_, program_;
    gl::VertexArray array_;
    BodyMesh mesh_;
    gl::StorageBuffer vertices_, displacements_, values_, places_, faces_, first_face_, face_of_vertex_,
        normals_, other_normals_;
    gl::Buffer corners_;  ///< vertex indices of triangles
    bool has_values_ = false;
    View view_{.size = {0, 0}};  ///< the view of the picture
    gl::Texture colour_, depth_, resolved_colour_;
    gl::Framebuffer target_;
    gl::Framebuffer resolved_;  ///< has the mean of the samples of each pixel; unused without multisampling
};

}  // namespace voxspring
