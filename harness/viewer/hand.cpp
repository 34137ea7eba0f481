#include "harness/viewer/hand.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <glm/geometric.hpp>

namespace voxspring {
namespace {

/// The blade's stroke (from pressing to releasing the button) cuts in pieces of at least this number of
/// pixels.
constexpr double stretch = 4;
/// Each further piece of a stroke begins this number of pixels before the end of the previous one, because
/// the body moves between frames.
constexpr double overlap = 10;

}  // namespace

glm::dvec3 Hand::place_through(glm::dvec2 pixel, double distance, glm::ivec2 size) const {
    const Ray ray = orbit_.through(pixel, size);
    return ray.origin - ray.direction * (distance / glm::dot(ray.direction, orbit_.backward()));
}

void Hand::look(const Pointer& pointer, bool turns, glm::ivec2 size) {
    const glm::dvec2 went = pointer.pixel - before_.pixel;
    if (pointer.wheel != 0) orbit_.zoom(pointer.wheel);
    if (turns) orbit_.turn(went, size);
    if (pointer.middle && before_.middle) orbit_.shift(went, size);
}

std::string Hand::press(const Controls& controls, glm::ivec2 size) {
    const auto place = painter_.place_at(before_.pixel);
    switch (controls.tool) {
        case HandTool::turn:
            return {};
        case HandTool::grab: {
            if (!place) return {};
            std::string refused =
                simulation_.take_hold(*place, double(controls.radius), double(controls.stiffness));
            if (!refused.empty()) return refused;
            const double distance = orbit_.distance_to(*place);
            grip_ = Grip{.place = place_through(before_.pixel, distance, size), .distance = distance};
            return {};
        }
        case HandTool::blade:
            cut_from_ = before_.pixel;
            cut_distance_ = 0;
            cut_springs_ = 0;
            return cut(controls, size);
        case HandTool::needle:
            stitch_from_ = place;
            return {};
    }
    return {};
}

std::string Hand::cut(const Controls& controls, glm::ivec2 size) {
    const glm::dvec2 to = before_.pixel;
    // If the pointer is not over the body, the blade keeps its previous distance from the eye.
    const auto place = painter_.place_at(to);
    const double distance = place ? orbit_.distance_to(*place) : cut_distance_;
    if (distance <= 0 || glm::distance(*cut_from_, to) < stretch) return {};
    // The blade sweeps a quadrilateral. It begins in front of the surface, which may rise towards the eye. It
    // covers the surface's distances from the eye at the pointer's present and previous positions, so that no
    // gap remains where the surface has just fallen or risen.
    const double before = cut_distance_ > 0 ? cut_distance_ : distance;
    const double depth = double(controls.depth);
    const double nearest = std::min(before, distance) - depth / 2,
                 farthest = std::max(before, distance) + depth;
    const glm::dvec2 back = cut_distance_ > 0 ? overlap * glm::normalize(*cut_from_ - to) : glm::dvec2(0);
    std::array<glm::dvec3, 4> swept;
    for (std::size_t n = 0; n < 4; ++n)
        swept[n] = place_through(n < 2 ? *cut_from_ + back : to, n % 2 == 0 ? nearest : farthest, size);
    const Simulation::Change change = simulation_.cut(swept);
    if (!change.refused.empty()) return change.refused;
    cut_from_ = to;
    cut_distance_ = distance;
    cut_springs_ += change.springs;
    return {};
}

std::string Hand::release(const Controls& controls) {
    std::string said;
    if (grip_) simulation_.let_go();
    if (cut_from_) said = fmt::format("cut {} springs", cut_springs_);
    if (stitch_from_) {
        if (const auto to = painter_.place_at(before_.pixel)) {
            const Simulation::Change change = simulation_.suture(*stitch_from_, *to, double(controls.radius));
            said = change.refused.empty() ? fmt::format("joined {} springs", change.springs) : change.refused;
        }
    }
    grip_.reset();
    cut_from_.reset();
    stitch_from_.reset();
    return said;
}

std::string Hand::follow(const Pointer& pointer, const Controls& controls, glm::ivec2 size) {
    const bool pressed = pointer.left && !before_.left;
    const bool released = !pointer.left && before_.left;
    look(
        pointer,
        (pointer.right && before_.right) || (pointer.left && before_.left && controls.tool == HandTool::turn),
        size);
    before_ = pointer;
    if (pressed) return press(controls, size);
    if (released) return release(controls);
    if (grip_) grip_->moved = place_through(pointer.pixel, grip_->distance, size) - grip_->place;
    if (cut_from_) return cut(controls, size);
    return {};
}

std::optional<glm::dvec3> Hand::moved() const {
    if (!grip_) return std::nullopt;
    return grip_->moved;
}

std::optional<Hand::Line> Hand::line(glm::ivec2 size) const {
    if (grip_) return Line{orbit_.pixel_of(grip_->place, size), before_.pixel};
    if (stitch_from_) return Line{orbit_.pixel_of(*stitch_from_, size), before_.pixel};
    if (cut_from_) return Line{*cut_from_, before_.pixel};
    return std::nullopt;
}

}  // namespace voxspring
