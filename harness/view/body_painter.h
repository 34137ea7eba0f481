// Draws a body's surface from displacements on the card, whatever their source.
#pragma once

#include <array>
#include <glm/vec2.hpp>
#include <glm/vec3.hpp>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "backends/gl/context.h"
#include "backends/gl/program.h"
#include "backends/gl/storage_buffer.h"
#include "harness/export/image.h"
#include "harness/export/legend.h"
#include "harness/view/body_mesh.h"
#include "harness/view/orbit.h"

namespace voxspring {

/// The colour scale: `low` is the value at one end of the colours, `high` that at the other.
struct Shades {
    double low = 0, high = 1;
    Colouring colours = Colouring::displacement;
};

/// Draws in an OpenGL context, which must outlive this and which each call makes current. Throws DeviceError.
class BodyPainter {
public:
    explicit BodyPainter(const gl::Context& context);

    /// Replaces the body. It is at rest until displacements are set.
    void set_mesh(BodyMesh mesh);
    const BodyMesh& mesh() const { return mesh_; }

    /// The buffer to pass to Backend::feed() with mesh().particles. Valid until the next set_mesh().
    GLuint displacements() const { return displacements_.get(); }
    /// Sets displacements from the host, one per particle of the problem.
    void put_displacements(std::span<const glm::dvec3> displacement);
    /// Sets displacements of mesh().particles only, in their order: x, y, z and 0.
    void put_displacements(std::span<const glm::vec4> followed);
    /// Sets the values that colours show, one per particle of the problem. If `value` is empty, colours show
    /// the length of the displacement.
    void put_values(std::span<const double> value);

    /// Draws the body into a picture of `size` pixels, with the present contents of displacements().
    void draw(const Orbit& orbit, glm::ivec2 size, const Shades& shades);
    /// Copies the picture to the window's framebuffer.
    void show() const;
    Image picture() const;
    /// The place on the body that is visible at a pixel of the picture; nullopt if no body is there.
    std::optional<glm::dvec3> place_at(glm::dvec2 pixel) const;
    /// The smallest and the largest value on the body in the picture. Waits for the card.
    std::array<double, 2> range() const;

private:
    void make_picture(glm::ivec2 size);
    void follow_particles();

    const gl::Context& context_;
    gl::Program vertices_program_, normals_program_, program_;
    gl::VertexArray array_;
    BodyMesh mesh_;
    gl::StorageBuffer vertices_, displacements_, values_, places_, faces_, first_face_, face_of_vertex_,
        normals_;
    gl::Buffer corners_;  ///< vertex indices of triangles
    bool has_values_ = false;
    glm::ivec2 size_{0};
    gl::Texture colour_, depth_;
    gl::Framebuffer target_;
    Orbit orbit_;  ///< view of the picture
};

}  // namespace voxspring
