#include "harness/drawing/body_painter.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <glm/common.hpp>
#include <glm/mat4x4.hpp>
#include <glm/matrix.hpp>
#include <glm/vec4.hpp>
#include <string>
#include <utility>

#include "backends/glsl/compute.h"

namespace voxspring {
namespace {

// The layout that shaders/mesh_vertices.comp reads.
static_assert(sizeof(BodyMesh::Vertex) == 12 * sizeof(float));

/// An empty texture with `samples` samples per pixel. If that is 0, the texture is not a multisample one.
gl::Texture picture_texture(const gl::Context& context, GLenum format, glm::ivec2 size, int samples) {
    GLuint name = 0;
    glCreateTextures(samples > 0 ? GL_TEXTURE_2D_MULTISAMPLE : GL_TEXTURE_2D, 1, &name);
    gl::Texture texture(context, name);
    if (samples > 0) {
        glTextureStorage2DMultisample(name, samples, format, size.x, size.y, GL_TRUE);
    } else {
        glTextureStorage2D(name, 1, format, size.x, size.y);
    }
    return texture;
}

/// A framebuffer that draws to the textures; `depth` may be null.
gl::Framebuffer framebuffer_of(const gl::Context& context, const gl::Texture& colour,
                               const gl::Texture* depth) {
    gl::Framebuffer made = gl::make_framebuffer(context);
    glNamedFramebufferTexture(made.get(), GL_COLOR_ATTACHMENT0, colour.get(), 0);
    if (depth != nullptr) glNamedFramebufferTexture(made.get(), GL_DEPTH_ATTACHMENT, depth->get(), 0);
    const GLenum status = glCheckNamedFramebufferStatus(made.get(), GL_FRAMEBUFFER);
    if (status != GL_FRAMEBUFFER_COMPLETE)
        throw DeviceError("the framebuffer of a picture is incomplete: status " + std::to_string(status));
    return made;
}

/// Copies the colours of a rectangle at the origin. A pixel with several samples becomes their mean.
void copy_colours(const gl::Framebuffer& from, GLuint to, glm::ivec2 size) {
    glBlitNamedFramebuffer(from.get(), to, 0, 0, size.x, size.y, 0, 0, size.x, size.y, GL_COLOR_BUFFER_BIT,
                           GL_NEAREST);
}

/// Reads the framebuffer that is bound for reading.
Image read_pixels(glm::ivec2 size) {
    Image image(size.x, size.y);
    glPixelStorei(GL_PACK_ALIGNMENT, 4);
    glReadPixels(0, 0, size.x, size.y, GL_RGBA, GL_UNSIGNED_BYTE, image.pixels.data());
    // OpenGL's first row is the lowest.
    for (int y = 0; y < size.y / 2; ++y)
        std::swap_ranges(image.at(0, y), image.at(0, y) + std::ptrdiff_t(4) * size.x,
                         image.at(0, size.y - 1 - y));
    return image;
}

/// Divides colours by their opacity. Drawing has multiplied them: a pixel that is half body and half
/// transparent background is half as bright.
void divide_by_opacity(Image& image) {
    for (std::size_t n = 0; n < image.pixels.size(); n += 4) {
        const int opacity = image.pixels[n + 3];
        if (opacity == 0 || opacity == 255) continue;
        for (std::size_t c = 0; c < 3; ++c) {
            image.pixels[n + c] =
                std::uint8_t(std::min(255, (image.pixels[n + c] * 255 + opacity / 2) / opacity));
        }
    }
}

void dispatch(const gl::Program& program, std::size_t count) {
    glUseProgram(program.get());
    glDispatchCompute(glsl::striding_groups(count), 1, 1);
    glMemoryBarrier(GL_SHADER_STORAGE_BARRIER_BIT | GL_BUFFER_UPDATE_BARRIER_BIT);
}

}  // namespace

BodyPainter::BodyPainter(const gl::Context& context, const PictureStyle& style)
    : context_(context), style_(style) {
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
    if (style_.smoothing > 0) other_normals_.replace(context_, std::vector<glm::vec4>(mesh_.vertices.size()));
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
    // Squares of areas must stay within the range of float32, whatever the unit of length is.
    const glm::dvec3 extent = mesh_.high - mesh_.low;
    const double largest = std::max({extent.x, extent.y, extent.z});
    normals_program_.set("unit", float(largest > 0 ? 1 / largest : 1));
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
    if (size == view_.size) return;
    colour_ = picture_texture(context_, GL_RGBA8, size, style_.samples);
    depth_ = picture_texture(context_, GL_DEPTH_COMPONENT32F, size, style_.samples);
    target_ = framebuffer_of(context_, colour_, &depth_);
    if (style_.samples == 0) return;
    resolved_colour_ = picture_texture(context_, GL_RGBA8, size, 0);
    resolved_ = framebuffer_of(context_, resolved_colour_, nullptr);
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
    normals_program_.set("smoothing", 0);
    dispatch(normals_program_, mesh_.vertices.size());
    normals_program_.set("smoothing", 1);
    for (int pass = 0; pass < style_.smoothing; ++pass) {
        std::swap(normals_, other_normals_);
        other_normals_.bind(0);
        normals_.bind(4);
        dispatch(normals_program_, mesh_.vertices.size());
    }
}

void BodyPainter::draw(const View& view, const Shades& shades) {
    context_.make_current();
    make_picture(view.size);
    view_ = view;
    follow_particles();

    glBindFramebuffer(GL_FRAMEBUFFER, target_.get());
    glViewport(0, 0, view.size.x, view.size.y);
    glEnable(GL_DEPTH_TEST);
    glClearNamedFramebufferfv(target_.get(), GL_COLOR, 0, style_.background.data());
    const float farthest = 1;
    glClearNamedFramebufferfv(target_.get(), GL_DEPTH, 0, &farthest);
    std::vector<glm::vec4> knots;
    for (const Colour& knot : colours_of(shades.colours))
        knots.emplace_back(knot[0], knot[1], knot[2], knot[3]);
    program_.set("colours", knots);
    const double extent = shades.high > shades.low ? shades.high - shades.low : 1;
    program_.set("colour_scale", glm::vec3(1 / extent, -shades.low / extent, 0));
    const auto row = [](const glm::dmat4& matrix, int n) { return glm::vec4(glm::transpose(matrix)[n]); };
    program_.set("to_eye", std::vector{row(view.to_eye, 0), row(view.to_eye, 1), row(view.to_eye, 2)});
    program_.set("to_clip", std::vector{row(view.to_clip, 0), row(view.to_clip, 1), row(view.to_clip, 2),
                                        row(view.to_clip, 3)});
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
    copy_colours(target_, 0, view_.size);
}

Image BodyPainter::picture() const {
    context_.make_current();
    if (style_.samples > 0) copy_colours(target_, resolved_.get(), view_.size);
    glBindFramebuffer(GL_READ_FRAMEBUFFER, style_.samples > 0 ? resolved_.get() : target_.get());
    Image image = read_pixels(view_.size);
    glBindFramebuffer(GL_READ_FRAMEBUFFER, 0);
    context_.check("reading a picture");
    divide_by_opacity(image);
    return image;
}

std::optional<glm::dvec3> BodyPainter::place_at(glm::dvec2 pixel) const {
    const glm::ivec2 at(glm::floor(pixel));
    if (at.x < 0 || at.y < 0 || at.x >= view_.size.x || at.y >= view_.size.y) return std::nullopt;
    context_.make_current();
    float depth = 1;
    glBindFramebuffer(GL_READ_FRAMEBUFFER, target_.get());
    glReadPixels(at.x, view_.size.y - 1 - at.y, 1, 1, GL_DEPTH_COMPONENT, GL_FLOAT, &depth);
    glBindFramebuffer(GL_READ_FRAMEBUFFER, 0);
    context_.check("reading a depth");
    if (depth >= 1) return std::nullopt;
    return view_.place_at(glm::dvec2(at) + 0.5, depth);
}

std::vector<glm::vec4> BodyPainter::downloaded_places() const {
    std::vector<glm::vec4> places(mesh_.vertices.size());
    places_.download(places);
    context_.check("reading a body's surface");
    return places;
}

std::vector<glm::vec4> BodyPainter::places() {
    context_.make_current();
    follow_particles();
    return downloaded_places();
}

std::array<double, 2> BodyPainter::range(std::span<const std::uint32_t> without) const {
    context_.make_current();
    const std::vector<glm::vec4> places = downloaded_places();
    std::array<double, 2> range{0, 0};
    bool is_first = true;
    for (std::size_t v = 0; v < places.size(); ++v) {
        const std::uint32_t particle = mesh_.particles[mesh_.vertices[v].follows[0]];
        if (std::binary_search(without.begin(), without.end(), particle)) continue;
        const double value = places[v].w;
        range = is_first ? std::array{value, value}
                         : std::array{std::min(range[0], value), std::max(range[1], value)};
        is_first = false;
    }
    return range;
}

}  // namespace voxspring
