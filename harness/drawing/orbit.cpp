#include "harness/drawing/orbit.h"

#include <algorithm>
#include <cmath>
#include <glm/common.hpp>
#include <glm/ext/matrix_clip_space.hpp>
#include <glm/ext/matrix_transform.hpp>
#include <glm/geometric.hpp>
#include <glm/matrix.hpp>
#include <numbers>

namespace voxspring {
namespace {

/// The angle in radians that the picture's height covers.
constexpr double field_of_view = 0.6;
/// The largest elevation in radians. Beyond a right angle the picture would turn upside down.
constexpr double highest = 1.5;
/// The largest fraction of the picture that the body may fill.
constexpr double margin = 0.94;

constexpr glm::dvec3 up(0, 0, 1);

/// The fixed direction of pictures.
glm::dmat4 slanted() { return glm::lookAt(glm::dvec3(0.62, -1, 0.5), glm::dvec3(0), up); }

}  // namespace

glm::dvec2 View::pixel_of(const glm::dvec3& place) const {
    const glm::dvec4 seen = to_clip * glm::dvec4(place, 1);
    const glm::dvec2 scaled = glm::dvec2(seen) / seen.w;
    return {(scaled.x + 1) / 2 * size.x, (1 - scaled.y) / 2 * size.y};
}

glm::dvec3 View::place_at(glm::dvec2 pixel, double depth) const {
    const glm::dvec3 seen(2 * pixel.x / size.x - 1, 1 - 2 * pixel.y / size.y, 2 * depth - 1);
    const glm::dvec4 place = glm::inverse(to_clip) * glm::dvec4(seen, 1);
    return glm::dvec3(place) / place.w;
}

// --- Around a body ----------------------------------------------------------------------------------------

void Orbit::show(const glm::dvec3& low, const glm::dvec3& high) {
    middle_ = (low + high) / 2.0;
    const double radius = glm::length(high - low) / 2;
    radius_ = radius > 0 ? radius : 1;
    distance_ = 1.15 * radius_ / std::sin(field_of_view / 2);
}

void Orbit::turn(glm::dvec2 pixels, glm::ivec2 size) {
    const double radians_per_pixel = std::numbers::pi / size.y;
    azimuth_ -= pixels.x * radians_per_pixel;
    elevation_ = std::clamp(elevation_ + pixels.y * radians_per_pixel, -highest, highest);
}

void Orbit::shift(glm::dvec2 pixels, glm::ivec2 size) {
    const glm::dmat4 eye = glm::transpose(to_eye());
    const double pixel_length = 2 * distance_ * std::tan(field_of_view / 2) / size.y;
    middle_ += (glm::dvec3(eye[1]) * pixels.y - glm::dvec3(eye[0]) * pixels.x) * pixel_length;
}

void Orbit::zoom(double notches) {
    distance_ = std::clamp(distance_ * std::pow(0.9, notches), 0.05 * radius_, 100 * radius_);
}

glm::dvec3 Orbit::backward() const {
    return {std::sin(azimuth_) * std::cos(elevation_), -std::cos(azimuth_) * std::cos(elevation_),
            std::sin(elevation_)};
}

glm::dmat4 Orbit::to_eye() const { return glm::lookAt(eye(), middle_, up); }

View Orbit::view(glm::ivec2 size) const {
    const double nearest = std::max(distance_ - 4 * radius_, 0.01 * distance_);
    const glm::dmat4 seen = to_eye();
    return {
        size, seen,
        glm::perspective(field_of_view, double(size.x) / size.y, nearest, distance_ + 4 * radius_) * seen};
}

Ray Orbit::through(glm::dvec2 pixel, glm::ivec2 size) const {
    return {eye(), glm::normalize(view(size).place_at(pixel, 1) - eye())};
}

double Orbit::distance_to(const glm::dvec3& place) const { return glm::dot(eye() - place, backward()); }

// --- For pictures -----------------------------------------------------------------------------------------

void SlantedCamera::include(std::span<const glm::vec4> places) {
    const glm::dmat3 turn(slanted());
    for (const glm::vec4& place : places) {
        const glm::dvec3 turned = turn * glm::dvec3(place);
        low_ = empty_ ? turned : glm::min(low_, turned);
        high_ = empty_ ? turned : glm::max(high_, turned);
        empty_ = false;
    }
}

View SlantedCamera::view(glm::ivec2 size, double share) const {
    const glm::dvec3 middle = (low_ + high_) / 2.0;
    glm::dvec3 half = (high_ - low_) / 2.0;
    // A body that has collapsed onto a line or a point still needs an extent above 0.
    const double largest = std::max({half.x, half.y, half.z});
    half = glm::max(half, glm::dvec3(largest > 0 ? 1e-6 * largest : 1));
    const double pixel_length = std::max(half.x / size.x, half.y / (share * size.y)) * 2 / margin;
    const double left = middle.x - pixel_length * size.x / 2,
                 top = middle.y + pixel_length * share * size.y / 2;
    const glm::dmat4 turn(glm::dmat3{slanted()});
    return {size, turn,
            glm::ortho(left, left + pixel_length * size.x, top - pixel_length * size.y, top,
                       -(middle.z + 1.01 * half.z), -(middle.z - 1.01 * half.z)) *
                turn};
}

}  // namespace voxspring
