#include "harness/view/orbit.h"

#include <algorithm>
#include <cmath>
#include <glm/ext/matrix_clip_space.hpp>
#include <glm/ext/matrix_transform.hpp>
#include <glm/geometric.hpp>
#include <glm/matrix.hpp>
#include <glm/vec4.hpp>
#include <numbers>

namespace voxspring {
namespace {

/// The angle in radians that the picture's height covers.
constexpr double field_of_view = 0.6;
/// The largest elevation: beyond straight above the view would turn over.
constexpr double highest = 1.5;

}  // namespace

void Orbit::show(const glm::dvec3& low, const glm::dvec3& high) {
    middle_ = (low + high) / 2.0;
    const double radius = glm::length(high - low) / 2;
    radius_ = radius > 0 ? radius : 1;
    distance_ = 1.15 * radius_ / std::sin(field_of_view / 2);
}

void Orbit::turn(glm::dvec2 pixels, glm::ivec2 size) {
    const double a_pixel = std::numbers::pi / size.y;
    azimuth_ -= pixels.x * a_pixel;
    elevation_ = std::clamp(elevation_ + pixels.y * a_pixel, -highest, highest);
}

void Orbit::shift(glm::dvec2 pixels, glm::ivec2 size) {
    const glm::dmat4 eye = glm::transpose(to_eye());
    const double a_pixel = 2 * distance_ * std::tan(field_of_view / 2) / size.y;
    middle_ += (glm::dvec3(eye[1]) * pixels.y - glm::dvec3(eye[0]) * pixels.x) * a_pixel;
}

void Orbit::zoom(double notches) {
    distance_ = std::clamp(distance_ * std::pow(0.9, notches), 0.05 * radius_, 100 * radius_);
}

glm::dvec3 Orbit::backward() const {
    return {std::sin(azimuth_) * std::cos(elevation_), -std::cos(azimuth_) * std::cos(elevation_),
            std::sin(elevation_)};
}

glm::dvec3 Orbit::eye() const { return middle_ + distance_ * backward(); }

glm::dmat4 Orbit::to_eye() const { return glm::lookAt(eye(), middle_, glm::dvec3(0, 0, 1)); }

glm::dmat4 Orbit::to_clip(glm::ivec2 size) const {
    const double nearest = std::max(distance_ - 4 * radius_, 0.01 * distance_);
    return glm::perspective(field_of_view, double(size.x) / size.y, nearest, distance_ + 4 * radius_) *
           to_eye();
}

glm::dvec3 Orbit::place_at(glm::dvec2 pixel, double depth, glm::ivec2 size) const {
    const glm::dvec3 seen(2 * pixel.x / size.x - 1, 1 - 2 * pixel.y / size.y, 2 * depth - 1);
    const glm::dvec4 place = glm::inverse(to_clip(size)) * glm::dvec4(seen, 1);
    return glm::dvec3(place) / place.w;
}

Ray Orbit::through(glm::dvec2 pixel, glm::ivec2 size) const {
    return {eye(), glm::normalize(place_at(pixel, 1, size) - eye())};
}

glm::dvec2 Orbit::pixel_of(const glm::dvec3& place, glm::ivec2 size) const {
    const glm::dvec4 seen = to_clip(size) * glm::dvec4(place, 1);
    const glm::dvec2 scaled = glm::dvec2(seen) / seen.w;
    return {(scaled.x + 1) / 2 * size.x, (1 - scaled.y) / 2 * size.y};
}

double Orbit::distance_to(const glm::dvec3& place) const { return glm::dot(eye() - place, backward()); }

}  // namespace voxspring
