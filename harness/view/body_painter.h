// Draws a body's surface from displacements that lie on the card, wherever they came from.
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

/// Of what is shown, by its value: from `low` at the one end of the colours to `high` at the other.
struct Shades {
    double low = 0, high = 1;
    Colouring colours = Colouring::displacement;
};

/// In a context, which must outlive it and which each call makes current. Throws DeviceError.
class BodyPainter {
public:
    explicit BodyPainter(const gl::Context& context);

    /// All that follows is of this body, at rest until the next displacements.
    void set_mesh(BodyMesh mesh);
    const BodyMesh& mesh() const { return mesh_; }

    /// A buffer for Backend::feed() of mesh().particles, until the next mesh.
    GLuint displacements() const { return displacements_.get(); }
    /// The same from the host: one displacement a particle of the problem.
    void put_displacements(std::span<const glm::dvec3> displacement);
    /// The same of mesh().particles alone, in their order: x, y, z and 0.
    void put_displacements(std::span<const glm::vec4> followed);
    /// One value a particle of the problem to be shown in colours; without any it is the displacement's
    /// length.
    void put_values(std::span<const double> value);

    /// Draws the body, with what lies in displacements() now, on a picture of `size` pixels.
    void draw(const Orbit& orbit, glm::ivec2 size, const Shades& shades);
    /// Copies the picture to the framebuffer that a window shows.
    void show() const;
    Image picture() const;
    /// The place on the body that is seen at a pixel of the picture; nothing beside the body.
    std::optional<glm::dvec3> place_at(glm::dvec2 pixel) const;
    /// The least and the largest value on the picture's body. Waits for the card.
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
    gl::Buffer corners_;  ///< of triangles
    bool has_values_ = false;
    glm::ivec2 size_{0};
    gl::Texture colour_, depth_;
    gl::Framebuffer target_;
    Orbit orbit_;  ///< of the picture
};

}  // namespace voxspring
