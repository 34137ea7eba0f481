#include "harness/export/painter.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <glm/geometric.hpp>
#include <string>

#include "backends/gl/texture.h"
#include "harness/export/pixels.h"

namespace voxspring {
namespace {

/// The share of the picture's width, and of its height above the legend, that the body may take.
constexpr double margin = 0.94;
/// Samples per pixel at edges. Every renderer supports four.
constexpr int samples_a_pixel = 4;
/// Faces are sent to the card in batches of this number, which take 28 MiB.
constexpr std::size_t batch = std::size_t(1) << 18;

/// A vertex in the layout that the shader reads.
struct Vertex {
    glm::vec3 position;
    glm::vec3 normal;
    float value;
};
static_assert(sizeof(Vertex) == 7 * sizeof(float));

gl::Texture multisampled(const gl::Context& context, GLenum format, glm::ivec2 size) {
    GLuint name = 0;
    glCreateTextures(GL_TEXTURE_2D_MULTISAMPLE, 1, &name);
    gl::Texture texture(context, name);
    glTextureStorage2DMultisample(name, samples_a_pixel, format, size.x, size.y, GL_TRUE);
    return texture;
}

gl::Framebuffer framebuffer(const gl::Context& context, const gl::Texture& colour, const gl::Texture* depth) {
    gl::Framebuffer made = gl::make_framebuffer(context);
    glNamedFramebufferTexture(made.get(), GL_COLOR_ATTACHMENT0, colour.get(), 0);
    if (depth != nullptr) glNamedFramebufferTexture(made.get(), GL_DEPTH_ATTACHMENT, depth->get(), 0);
    const GLenum status = glCheckNamedFramebufferStatus(made.get(), GL_FRAMEBUFFER);
    if (status != GL_FRAMEBUFFER_COMPLETE) {
        throw DeviceError("the framebuffer of a picture is incomplete: status " + std::to_string(status));
    }
    return made;
}

void attribute(GLuint array, GLuint location, int components, std::size_t offset) {
    glEnableVertexArrayAttrib(array, location);
    glVertexArrayAttribFormat(array, location, components, GL_FLOAT, GL_FALSE, GLuint(offset));
    glVertexArrayAttribBinding(array, location, 0);
}

/// Indices of two triangles for each of `faces` faces with four vertices.
std::vector<std::uint32_t> corners_of(std::size_t faces) {
    std::vector<std::uint32_t> corners;
    for (std::size_t n = 0; n < faces; ++n) {
        for (const std::uint32_t corner : {0, 1, 2, 0, 2, 3})
            corners.push_back(std::uint32_t(4 * n) + corner);
    }
    return corners;
}

/// Undoes the multiplication by opacity: a pixel that is half body and half background came out half as
/// bright.
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

}  // namespace

void Camera::include(std::span<const SurfaceVertex> surface) {
    for (const SurfaceVertex& vertex : surface) {
        const glm::dvec3 place = turned(vertex.position);
        low_ = empty_ ? place : glm::min(low_, place);
        high_ = empty_ ? place : glm::max(high_, place);
        empty_ = false;
    }
}

glm::dvec3 Camera::turned(glm::dvec3 direction) const {
    static const glm::dvec3 towards_viewer = glm::normalize(glm::dvec3(0.62, -1, 0.5));
    static const glm::dvec3 right = glm::normalize(glm::cross(glm::dvec3(0, 0, 1), towards_viewer));
    static const glm::dvec3 up = glm::cross(towards_viewer, right);
    return {glm::dot(direction, right), glm::dot(direction, up), glm::dot(direction, towards_viewer)};
}

glm::dvec3 Camera::reach() const {
    const glm::dvec3 half = (high_ - low_) / 2.0;
    // A body that has collapsed onto a line or a point still needs an extent above 0.
    const double largest = std::max({half.x, half.y, half.z});
    return glm::max(half, glm::dvec3(largest > 0 ? 1e-6 * largest : 1));
}

Painter::Painter(glm::ivec2 size) : size_(size) {
    program_ = gl::Program(context_, gl::load_source("body.vert", {}),
                           gl::load_source("body.frag", {{"KNOTS", std::to_string(colour_knots)}}));
    samples_ = multisampled(context_, GL_RGBA8, size);
    depth_ = multisampled(context_, GL_DEPTH_COMPONENT32F, size);
    GLuint name = 0;
    glCreateTextures(GL_TEXTURE_2D, 1, &name);
    resolved_ = gl::Texture(context_, name);
    glTextureStorage2D(name, 1, GL_RGBA8, size.x, size.y);
    context_.check("making room for a picture");
    target_ = framebuffer(context_, samples_, &depth_);
    result_ = framebuffer(context_, resolved_, nullptr);
}

glm::dvec2 Painter::fit(const Camera& camera) const {
    const double free = size_.y * (1 - legend_share);
    const glm::dvec3 reach = camera.reach();
    return {margin * std::min(size_.x / 2.0 / reach.x, free / 2 / reach.y), free / 2};
}

glm::dvec2 Painter::pixel_of(const Camera& camera, glm::dvec3 position) const {
    const glm::dvec2 fitted = fit(camera);
    const glm::dvec3 place = camera.seen(position);
    return {size_.x / 2.0 + fitted.x * place.x, fitted.y - fitted.x * place.y};
}

void Painter::begin(const Camera& camera, const Scale& scale) {
    glBindFramebuffer(GL_FRAMEBUFFER, target_.get());
    glViewport(0, 0, size_.x, size_.y);
    glEnable(GL_DEPTH_TEST);
    glClearColor(0, 0, 0, 0);
    glClearDepth(1);
    glClear(GL_COLOR_BUFFER_BIT | GL_DEPTH_BUFFER_BIT);

    // Vertices are sent as multiples of the reach, so that float32 suits large and small bodies alike.
    const glm::dvec3 reach = camera.reach();
    const glm::dvec2 fitted = fit(camera);
    const glm::dvec2 half = glm::dvec2(size_) / 2.0;
    program_.set("scale", glm::vec3(fitted.x * reach.x / half.x, fitted.x * reach.y / half.y, -1 / 1.01));
    program_.set("offset", glm::vec3(0, float(1 - fitted.y / half.y), 0));
    std::vector<glm::vec4> knots;
    for (const Colour& knot : colours_of(scale.colouring()))
        knots.emplace_back(knot[0], knot[1], knot[2], knot[3]);
    program_.set("colours", knots);
    glUseProgram(program_.get());
}

void Painter::draw(std::span<const SurfaceVertex> surface, const Camera& camera) {
    const gl::Buffer vertices = gl::make_buffer(context_);
    const gl::Buffer order = gl::make_buffer(context_);
    const gl::VertexArray array = gl::make_vertex_array(context_);
    const std::size_t faces = surface.size() / 4;
    const std::size_t faces_in_batch = std::min(batch, faces);
    const std::vector<std::uint32_t> corners = corners_of(faces_in_batch);
    glNamedBufferData(order.get(), GLsizeiptr(corners.size() * sizeof corners[0]), corners.data(),
                      GL_STATIC_DRAW);
    glVertexArrayVertexBuffer(array.get(), 0, vertices.get(), 0, sizeof(Vertex));
    glVertexArrayElementBuffer(array.get(), order.get());
    attribute(array.get(), 0, 3, offsetof(Vertex, position));
    attribute(array.get(), 1, 3, offsetof(Vertex, normal));
    attribute(array.get(), 2, 1, offsetof(Vertex, value));
    glBindVertexArray(array.get());
    const glm::dvec3 reach = camera.reach();
    std::vector<Vertex> seen;
    for (std::size_t begin = 0; begin < faces; begin += faces_in_batch) {
        seen.clear();
        for (const SurfaceVertex& vertex :
             surface.subspan(4 * begin, 4 * std::min(faces_in_batch, faces - begin))) {
            seen.push_back({glm::vec3(camera.seen(vertex.position) / reach),
                            glm::vec3(camera.turned(vertex.normal)), float(vertex.value)});
        }
        glNamedBufferData(vertices.get(), GLsizeiptr(seen.size() * sizeof seen[0]), seen.data(),
                          GL_STREAM_DRAW);
        glDrawElements(GL_TRIANGLES, GLsizei(seen.size() / 4 * 6), GL_UNSIGNED_INT, nullptr);
    }
}

Image Painter::read_back() {
    glBlitNamedFramebuffer(target_.get(), result_.get(), 0, 0, size_.x, size_.y, 0, 0, size_.x, size_.y,
                           GL_COLOR_BUFFER_BIT, GL_NEAREST);
    glBindFramebuffer(GL_READ_FRAMEBUFFER, result_.get());
    Image image = read_pixels(size_);
    glDisable(GL_DEPTH_TEST);
    context_.check("drawing a picture");
    return image;
}

Image Painter::paint(std::span<const SurfaceVertex> surface, const Camera& camera, const Scale& scale) {
    context_.make_current();
    begin(camera, scale);
    draw(surface, camera);
    Image image = read_back();
    divide_by_opacity(image);
    draw_legend(image, scale);
    return image;
}

}  // namespace voxspring
