#include "harness/view/body_painter.h"

#include <algorithm>
#include <cstdint>
#include <glm/common.hpp>
#include <glm/mat4x4.hpp>
#include <glm/vec4.hpp>
#include <string>
#include <utility>

#include "backends/gl/texture.h"
#include "backends/glsl/compute.h"
#include "harness/export/pixels.h"

namespace voxspring {
namespace {

// The layout that shaders/mesh_vertices.comp reads.
static_assert(sizeof(BodyMesh::Vertex) == 12 * sizeof(float));

/// Neither light nor dark, so that both ends of viridis and plasma stand out from it.
constexpr std::array<float, 4> background = {0.16F, 0.17F, 0.19F, 1};

gl::Texture picture_texture(const gl::Context& context, GLenum format, glm::ivec2 size) {
    GLuint name = 0;
    glCreateTextures(GL_TEXTURE_2D, 1, &name);
    gl::Texture texture(context, name);
    glTextureStorage2D(name, 1, format, size.x, size.y);
    return texture;
}

glm::vec4 row(const glm::dmat4& matrix, int n) {
    return {matrix[0][n], matrix[1][n], matrix[2][n], matrix[3][n]};
}

void dispatch(const gl::Program& program, std::size_t count) {
    glUseProgram(program.get());
    glDispatchCompute(glsl::striding_groups(count), 1, 1);
    glMemoryBarrier(GL_SHADER_STORAGE_BARRIER_BIT | GL_BUFFER_UPDATE_BARRIER_BIT);
}

}  // namespace

BodyPainter::BodyPainter(const gl::Context& context) : context_(context) {
    context_.make_current();
    vertices_program_ = gl::Program(context_, gl::load_source("mesh_vertices.comp", {}));
    normals_program_ = gl::Program(context_, gl::load_source("mesh_normals.comp", {}));
    program_ = gl::Program(context_, gl::load_source("mesh.vert", {}),
                           gl::load_source("body.frag", {{"KNOTS", std::to_string(colour_knots)}}));
    array_ = gl::make_vertex_array(context_);
}

void BodyPainter::set_mesh(BodyMesh mesh) {
    context_.make_current();
    mesh_ = std::move(mesh);
    vertices_.replace(context_, mesh_.vertices);
    faces_.replace(context_, mesh_.faces);
    first_face_.replace(context_, mesh_.first_face);
    face_of_vertex_.replace(context_, mesh_.face_of_vertex);
    displacements_.replace(context_, std::vector<glm::vec4>(mesh_.particles.size()));
    places_.replace(context_, std::vector<glm::vec4>(mesh_.vertices.size()));
    normals_.replace(context_, std::vector<glm::vec4>(mesh_.vertices.size()));
    put_values({});
    std::vector<std::uint32_t> corners;
    corners.reserve(6 * mesh_.faces.size());
    for (const auto& face : mesh_.faces) {
        for (const std::size_t corner : {0, 1, 2, 0, 2, 3}) corners.push_back(face[corner]);
    }
    corners_ = gl::make_buffer(context_);
    glNamedBufferData(corners_.get(), GLsizeiptr(corners.size() * sizeof corners[0]), corners.data(),
                      GL_STATIC_DRAW);
    glVertexArrayElementBuffer(array_.get(), corners_.get());
    vertices_program_.set("count", int(mesh_.vertices.size()));
    normals_program_.set("count", int(mesh_.vertices.size()));
    context_.check("keeping a body's surface");
}

void BodyPainter::put_displacements(std::span<const glm::dvec3> displacement) {
    std::vector<glm::vec4> followed;
    followed.reserve(mesh_.particles.size());
    for (const std::uint32_t i : mesh_.particles) followed.emplace_back(glm::vec3(displacement[i]), 0);
    put_displacements(std::span<const glm::vec4>(followed));
}

void BodyPainter::put_displacements(std::span<const glm::vec4> followed) {
    context_.make_current();
    glNamedBufferSubData(displacements_.get(), 0, GLsizeiptr(followed.size_bytes()), followed.data());
}

void BodyPainter::put_values(std::span<const double> value) {
    if (value.empty() && !has_values_ && values_.bytes() > 0) return;
    context_.make_current();
    std::vector<float> followed(1);  // never empty, because an empty buffer cannot be bound
    if (!value.empty()) {
        followed.clear();
        for (const std::uint32_t i : mesh_.particles) followed.push_back(float(value[i]));
    }
    has_values_ = !value.empty();
    values_.replace(context_, followed);
}

void BodyPainter::make_picture(glm::ivec2 size) {
    if (size == size_) return;
    size_ = size;
    colour_ = picture_texture(context_, GL_RGBA8, size);
    depth_ = picture_texture(context_, GL_DEPTH_COMPONENT32F, size);
    target_ = gl::make_framebuffer(context_);
    glNamedFramebufferTexture(target_.get(), GL_COLOR_ATTACHMENT0, colour_.get(), 0);
    glNamedFramebufferTexture(target_.get(), GL_DEPTH_ATTACHMENT, depth_.get(), 0);
    const GLenum status = glCheckNamedFramebufferStatus(target_.get(), GL_FRAMEBUFFER);
    if (status != GL_FRAMEBUFFER_COMPLETE)
        throw DeviceError("the framebuffer of a picture is incomplete: status " + std::to_string(status));
}

void BodyPainter::follow_particles() {
    vertices_program_.set("by_values", has_values_ ? 1 : 0);
    vertices_.bind(0);
    displacements_.bind(1);
    values_.bind(2);
    places_.bind(3);
    dispatch(vertices_program_, mesh_.vertices.size());
    places_.bind(0);
    faces_.bind(1);
    first_face_.bind(2);
    face_of_vertex_.bind(3);
    normals_.bind(4);
    dispatch(normals_program_, mesh_.vertices.size());
}

void BodyPainter::draw(const Orbit& orbit, glm::ivec2 size, const Shades& shades) {
    context_.make_current();
    make_picture(size);
    orbit_ = orbit;
    follow_particles();

    glBindFramebuffer(GL_FRAMEBUFFER, target_.get());
    glViewport(0, 0, size.x, size.y);
    glEnable(GL_DEPTH_TEST);
    glClearNamedFramebufferfv(target_.get(), GL_COLOR, 0, background.data());
    const float farthest = 1;
    glClearNamedFramebufferfv(target_.get(), GL_DEPTH, 0, &farthest);
    std::vector<glm::vec4> knots;
    for (const Colour& knot : colours_of(shades.colours))
        knots.emplace_back(knot[0], knot[1], knot[2], knot[3]);
    program_.set("colours", knots);
    const double extent = shades.high > shades.low ? shades.high - shades.low : 1;
    program_.set("colour_scale", glm::vec3(1 / extent, -shades.low / extent, 0));
    const glm::dmat4 to_eye = orbit.to_eye();
    const glm::dmat4 to_clip = orbit.to_clip(size);
    program_.set("to_eye", std::vector{row(to_eye, 0), row(to_eye, 1), row(to_eye, 2)});
    program_.set("to_clip", std::vector{row(to_clip, 0), row(to_clip, 1), row(to_clip, 2), row(to_clip, 3)});
    places_.bind(0);
    normals_.bind(1);
    glUseProgram(program_.get());
    glBindVertexArray(array_.get());
    glDrawElements(GL_TRIANGLES, GLsizei(6 * mesh_.faces.size()), GL_UNSIGNED_INT, nullptr);
    glDisable(GL_DEPTH_TEST);
    glBindFramebuffer(GL_FRAMEBUFFER, 0);
    context_.check("drawing a body");
}

void BodyPainter::show() const {
    context_.make_current();
    glBlitNamedFramebuffer(target_.get(), 0, 0, 0, size_.x, size_.y, 0, 0, size_.x, size_.y,
                           GL_COLOR_BUFFER_BIT, GL_NEAREST);
}

Image BodyPainter::picture() const {
    context_.make_current();
    glBindFramebuffer(GL_READ_FRAMEBUFFER, target_.get());
    Image image = read_pixels(size_);
    glBindFramebuffer(GL_READ_FRAMEBUFFER, 0);
    context_.check("reading a picture");
    return image;
}

std::optional<glm::dvec3> BodyPainter::place_at(glm::dvec2 pixel) const {
    const glm::ivec2 at(glm::floor(pixel));
    if (at.x < 0 || at.y < 0 || at.x >= size_.x || at.y >= size_.y) return std::nullopt;
    context_.make_current();
    float depth = 1;
    glBindFramebuffer(GL_READ_FRAMEBUFFER, target_.get());
    glReadPixels(at.x, size_.y - 1 - at.y, 1, 1, GL_DEPTH_COMPONENT, GL_FLOAT, &depth);
    glBindFramebuffer(GL_READ_FRAMEBUFFER, 0);
    context_.check("reading a depth");
    if (depth >= 1) return std::nullopt;
    return orbit_.place_at(glm::dvec2(at) + 0.5, depth, size_);
}

std::array<double, 2> BodyPainter::range() const {
    context_.make_current();
    std::vector<glm::vec4> places(mesh_.vertices.size());
    places_.download(places);
    context_.check("reading values");
    if (places.empty()) return {0, 0};
    const auto [low, high] = std::minmax_element(
        places.begin(), places.end(), [](const glm::vec4& a, const glm::vec4& b) { return a.w < b.w; });
    return {low->w, high->w};
}

}  // namespace voxspring
