// Interprets a header's claims by the rules of docs/volumes.md, which are the same for all formats.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <glm/geometric.hpp>
#include <glm/vec3.hpp>
#include <numbers>
#include <string>
#include <utility>
#include <vector>

#include "harness/base/bad_input.h"
#include "harness/volume/claims.h"

namespace voxspring {
namespace {

constexpr const char* axis_names = "xyz";

/// Axes that deviate from a right angle by at most this number of degrees are taken for orthogonal. The rest
/// length of an edge spring is then wrong by less than 0.5%, which is the accuracy of a direction that a
/// header gives with two digits.
constexpr double right_angle_tolerance = 0.5;
/// A deviation from a right angle is reported if it exceeds this number of degrees. Smaller ones are within
/// the accuracy of directions with four digits.
constexpr double said_angle = 0.05;

/// The largest volume spanned by the directions of three axes that counts as none.
constexpr double flat = 1e-6;

constexpr const char* or_spacing = "; --spacing, or \"spacing\" in a scene, replaces what the file says";

double degrees(double cosine) { return std::acos(std::clamp(cosine, -1.0, 1.0)) * 180 / std::numbers::pi; }

bool is_spacing(double distance) { return distance >= min_quantity && distance <= max_quantity; }

/// Finds the axes that are the grid's x, y and z: those that the file marks as space and, if it marks fewer
/// than three, also those of unknown kind. If there are more than three, axes of size 1 are left out first,
/// from the end and then from the beginning; then axes of unknown kind, from the end.
class AxesOfSpace {
public:
    explicit AxesOfSpace(const VolumeClaims& claims) : claims_(claims) {
        for (std::size_t a = 0; a < claims.axes.size(); ++a) {
            if (kind(a) == AxisKind::space) axes_.push_back(a);
        }
        if (axes_.size() < 3) {
            axes_.clear();
            for (std::size_t a = 0; a < claims.axes.size(); ++a) {
                if (kind(a) != AxisKind::other) axes_.push_back(a);
            }
        }
        if (axes_.size() < 3) {
            throw BadInput(claims.file, claims.kinds_key, claims.kinds_text,
                           "three spatial axes: time, colours and lists are not spatial");
        }
        while (axes_.size() > 3 && claims.axes[axes_.back()].size == 1) axes_.pop_back();
        while (axes_.size() > 3 && claims.axes[axes_.front()].size == 1) {
            left_out_ = claims.axes[axes_.front()].name;
            axes_.erase(axes_.begin());
        }
        // Axes marked as space stay. Axes of unknown kind are dropped, the last ones first.
        for (std::size_t a = axes_.size(); a-- > 0 && axes_.size() > 3;) {
            if (kind(axes_[a]) == AxisKind::unknown) axes_.erase(axes_.begin() + std::ptrdiff_t(a));
        }
        if (axes_.size() > 3) {
            throw BadInput(claims.file, claims.kinds_key, claims.kinds_text,
                           "three spatial axes, and a size of 1 along any further spatial axis");
        }
    }

    const AxisClaim& operator[](int axis) const { return claims_.axes[axes_[std::size_t(axis)]]; }
    bool contains(std::size_t axis) const {
        return std::find(axes_.begin(), axes_.end(), axis) != axes_.end();
    }
    /// The name of the axis of size 1 that was left out right before x; empty if none was.
    const std::string& left_out() const { return left_out_; }

private:
    AxisKind kind(std::size_t axis) const { return claims_.axes[axis].kind; }

    const VolumeClaims& claims_;
    std::vector<std::size_t> axes_;
    std::string left_out_;
};

class Decision {
public:
    Decision(const VolumeClaims& claims, const VolumeChoice& choice, const SceneSizeLimits& limits)
        : claims_(claims), choice_(choice), limits_(limits), space_(claims) {}

    DecidedVolume make() {
        volume().file = claims_.file;
        volume().type = claims_.type;
        volume().slope = claims_.slope;
        volume().intercept = claims_.intercept;
        volume().segments = claims_.segments;
        volume().notes = claims_.notes;
        decide_dims();
        decide_values();
        decide_unit();
        decide_spacing();
        decide_placement();
        return std::move(decided_);
    }

private:
    Volume& volume() { return decided_.volume; }
    void say(std::string note) { volume().notes.push_back(std::move(note)); }

    void decide_dims() {
        const GridSides sides(space_[0].size, space_[1].size, space_[2].size);
        checked_voxel_count(sides, limits_, claims_.file, claims_.sizes_key);
        volume().dims = glm::ivec3(sides);
        if (!space_.left_out().empty())
            say(fmt::format("{} has size 1 and is left out: x is {}", space_.left_out(), space_[0].name));
        std::string thin;
        for (int axis = 0; axis < 3; ++axis) {
            if (sides[axis] == 1) thin += std::string(thin.empty() ? "" : " and ") + axis_names[axis];
        }
        if (!thin.empty()) say("the grid has 1 voxel along " + thin);
    }

    /// Decides which scalars are the values: one per voxel, or the layers of a segmentation.
    void decide_values() {
        const std::size_t none = claims_.axes.size();
        std::size_t several = none;
        std::uint64_t scalars = 1;
        for (std::size_t a = 0; a < none; ++a) {
            const std::int64_t size = claims_.axes[a].size;
            if (size < 1 || std::uint64_t(size) > max_scalars / scalars) {
                throw BadInput(claims_.file, claims_.sizes_key,
                               fmt::format("{} along {}", size, claims_.axes[a].name),
                               "a size from 1 on, and less than 2^48 scalars in all");
            }
            if (!space_.contains(a) && size > 1) {
                if (several != none) {
                    throw BadInput(
                        claims_.file, claims_.sizes_key,
                        fmt::format("{} values along {} and {} along {}", claims_.axes[several].size,
                                    claims_.axes[several].name, size, claims_.axes[a].name),
                        "one value per voxel, or several along one axis");
                }
                several = a;
            }
            scalars *= std::uint64_t(size);
        }
        decided_.scalars = decided_.kept.period = decided_.kept.length = scalars;
        const std::int64_t values = several == none ? 1 : claims_.axes[several].size;
        std::uint64_t inner = 1;
        for (std::size_t a = 0; a < std::min(several, none); ++a)
            inner *= std::uint64_t(claims_.axes[a].size);
        if (!claims_.segments.empty()) return decide_layers(std::size_t(values), std::size_t(inner));

        const std::string range =
            values == 1 ? "0: the file has one value per voxel"
                        : fmt::format("0 to {}: the file has {} values per voxel", values - 1, values);
        const std::int64_t frame = choice_.frame.value_or(0);
        if (frame < 0 || frame >= values) throw BadInput(claims_.file, "frame", std::to_string(frame), range);
        if (values == 1) return;
        if (!choice_.frame) {
            throw BadInput(
                claims_.file, claims_.sizes_key,
                fmt::format("{} along {}", values, claims_.axes[several].name),
                fmt::format(
                    "one value per voxel; --frame or \"frame\" of a scene's dataset chooses one, from 0 "
                    "to {}",
                    values - 1));
        }
        decided_.kept = {inner * std::uint64_t(values), inner * std::uint64_t(frame), inner};
        volume().facts.frame = frame;
        volume().facts.frames = values;
    }

    void decide_layers(std::size_t layers, std::size_t inner) {
        if (choice_.frame) {
            throw BadInput(claims_.file, "frame", std::to_string(*choice_.frame),
                           "no frame: the file is a segmentation, whose segments are chosen by name");
        }
        for (const Segment& segment : claims_.segments) {
            if (segment.layer >= layers) {
                throw BadInput(
                    claims_.file, "Layer of segment " + segment.name, std::to_string(segment.layer),
                    layers == 1 ? "0: the file has one layer"
                                : fmt::format("0 to {}: the file has {} layers", layers - 1, layers));
            }
        }
        const std::uint64_t values = decided_.scalars;
        if (values > limits_.voxels) {
            throw TooLarge(claims_.file, claims_.sizes_key,
                           fmt::format("{} values in {} layers", values, layers),
                           fmt::format("at most {} on this machine", limits_.voxels));
        }
        volume().layers = layers;
        volume().inner = layers == 1 ? 1 : inner;
    }

    void decide_unit() {
        std::string unit;
        bool differ = false;
        for (int axis = 0; axis < 3; ++axis) {
            const std::string& said = space_[axis].unit;
            if (said.empty()) continue;
            differ = differ || (!unit.empty() && said != unit);
            unit = said;
        }
        if (choice_.spacing) return;
        if (differ) {
            throw BadInput(claims_.file, "units",
                           fmt::format("{}, {}, {}", space_[0].unit, space_[1].unit, space_[2].unit),
                           std::string("one unit for the three axes") + or_spacing);
        }
        volume().facts.unit = unit;
        if (!unit.empty() && unit != "mm")
            say(fmt::format("lengths are in {}, as the file has them: nothing is converted", unit));
    }

    void decide_spacing() {
        volume().facts.spacing_chosen = choice_.spacing.has_value();
        if (choice_.spacing) {
            volume().spacing = *choice_.spacing;
            return;
        }
        if (!space_[0].distance && !space_[1].distance && !space_[2].distance) {
            say("the file gives no distance between voxels: 1 is taken");
            return;
        }
        for (int axis = 0; axis < 3; ++axis) {
            const AxisClaim& claim = space_[axis];
            const double distance = claim.distance.value_or(0);
            volume().spacing[axis] = std::abs(distance);
            if (!is_spacing(std::abs(distance))) {
                throw BadInput(
                    claims_.file, claim.distance_key, claim.distance_text,
                    std::string("a distance between voxels along each axis, other than 0") + or_spacing);
            }
            if (distance < 0)
                say(fmt::format("{} is {}: its absolute value is used for {}", claim.distance_key,
                                claim.distance_text, axis_names[axis]));
        }
    }

    void decide_placement() {
        Placement placement;
        placement.space = claims_.space;
        const bool have_directions = space_[0].direction && space_[1].direction && space_[2].direction;
        if (!have_directions && !claims_.origin) return;
        for (int axis = 0; axis < 3; ++axis) {
            glm::dvec3& direction = placement.direction[std::size_t(axis)];
            direction = glm::dvec3(axis == 0, axis == 1, axis == 2);
            if (have_directions) {
                const double length = glm::length(*space_[axis].direction);
                if (!(length > 0 && std::isfinite(length))) {
                    say(claims_.directions_key + " gives an axis no direction: the orientation is not known");
                    return;
                }
                direction = *space_[axis].direction / length;
                check_length(axis, length);
            }
        }
        // Only a grid that lies somewhere can run the other way. So the note comes from here.
        for (int axis = 0; axis < 3; ++axis) {
            if (claims_.directions_have_lengths || !(space_[axis].distance.value_or(1) < 0)) continue;
            placement.direction[std::size_t(axis)] *= -1;
            say(fmt::format("{} is negative: {} runs the other way", space_[axis].distance_key,
                            axis_names[axis]));
        }
        if (!have_directions) placement.space.clear();
        check_angles(placement);
        const auto& [x, y, z] = placement.direction;
        if (std::abs(glm::dot(glm::cross(x, y), z)) < flat) {
            say(claims_.directions_key + " puts the axes in one plane: the orientation is not known");
            return;
        }
        if (claims_.origin) placement.origin = checked(*claims_.origin);
        volume().facts.placement = placement;
    }

    /// The origin, or 0 with a note if a component is not finite or so large that voxels would coincide.
    glm::dvec3 checked(const glm::dvec3& origin) {
        for (int axis = 0; axis < 3; ++axis) {
            if (std::abs(origin[axis]) <= max_quantity) continue;
            say(fmt::format("the origin {:g}, {:g}, {:g} is not of numbers up to {:g}: 0 is taken", origin.x,
                            origin.y, origin.z, max_quantity));
            return glm::dvec3(0);
        }
        return origin;
    }

    /// Adds a note if the header's distance between voxels differs from `length`, the length of the axis's
    /// direction.
    void check_length(int axis, double length) {
        constexpr double said = 1e-3;  // the accuracy of a header with four digits
        const double distance = volume().spacing[axis];
        if (!claims_.directions_have_lengths || choice_.spacing || std::abs(length / distance - 1) < said)
            return;
        say(fmt::format("{} says {:g} and {} says {:g}: the first is taken", space_[axis].distance_key,
                        distance, claims_.directions_key, length));
    }

    void check_angles(const Placement& placement) {
        for (int axis = 0; axis < 3; ++axis) {
            const int other = (axis + 1) % 3;
            const double angle = degrees(
                glm::dot(placement.direction[std::size_t(axis)], placement.direction[std::size_t(other)]));
            const double off = std::abs(angle - 90);
            if (off <= said_angle) continue;
            const std::string said =
                fmt::format("{:.4g} degrees between {} and {}", angle, axis_names[axis], axis_names[other]);
            if (off > right_angle_tolerance && !choice_.spacing) {
                throw BadInput(
                    claims_.file, claims_.directions_key, said,
                    fmt::format("axes at right angles, to within {} degrees", right_angle_tolerance) +
                        or_spacing);
            }
            say(said + ", taken for a right angle");
        }
    }

    static constexpr std::uint64_t max_scalars = std::uint64_t{1} << 48;

    const VolumeClaims& claims_;
    const VolumeChoice& choice_;
    const SceneSizeLimits& limits_;
    const AxesOfSpace space_;
    DecidedVolume decided_;
};

/// The coordinate of `space` that runs between `side` and its opposite, and 1 if it grows towards `side`,
/// otherwise -1.
std::pair<int, double> coordinate_of(const std::string& space, AnatomicalSide side) {
    const auto first_letter = [](AnatomicalSide s) {
        return char(anatomical_sides[std::size_t(s)][0] - 'a' + 'A');
    };
    const auto opposite = AnatomicalSide(std::size_t(side) ^ 1);
    for (int c = 0; c < 3; ++c) {
        if (space[std::size_t(c)] == first_letter(side)) return {c, 1};
        if (space[std::size_t(c)] == first_letter(opposite)) return {c, -1};
    }
    return {0, 0};
}

}  // namespace

DecidedVolume decide(const VolumeClaims& claims, const VolumeChoice& choice, const SceneSizeLimits& limits) {
    return Decision(claims, choice, limits).make();
}

glm::dvec3 Placement::towards(AnatomicalSide side) const {
    const auto [coordinate, sign] = coordinate_of(space, side);
    glm::dvec3 along{0};
    for (int axis = 0; axis < 3; ++axis) along[axis] = sign * direction[std::size_t(axis)][coordinate];
    return glm::normalize(along);
}

glm::dvec3 Placement::to_file(const glm::dvec3& v) const {
    return v.x * direction[0] + v.y * direction[1] + v.z * direction[2];
}

GridSide nearest_grid_side(const Placement& placement, AnatomicalSide side) {
    const glm::dvec3 along = placement.towards(side);
    GridSide nearest;
    for (int axis = 1; axis < 3; ++axis) {
        if (std::abs(along[axis]) > std::abs(along[nearest.axis])) nearest.axis = axis;
    }
    nearest.upper = along[nearest.axis] > 0;
    nearest.degrees = degrees(std::abs(along[nearest.axis]));
    return nearest;
}

std::pair<AnatomicalSide, double> nearest_side(const Placement& placement, int axis) {
    const glm::dvec3& direction = placement.direction[std::size_t(axis)];
    AnatomicalSide nearest{};
    double most = -1;
    for (std::size_t s = 0; s < anatomical_sides.size(); ++s) {
        const auto [coordinate, sign] = coordinate_of(placement.space, AnatomicalSide(s));
        if (sign * direction[coordinate] <= most) continue;
        most = sign * direction[coordinate];
        nearest = AnatomicalSide(s);
    }
    return {nearest, degrees(most)};
}

}  // namespace voxspring
