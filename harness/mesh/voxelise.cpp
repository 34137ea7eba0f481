#include "harness/mesh/voxelise.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <exception>
#include <glm/common.hpp>
#include <numeric>
#include <tuple>
#include <utility>

#include "harness/base/bad_input.h"
#include "harness/mesh/winding.h"

namespace voxspring {
namespace {

/// The number of lines along x per voxel in each of y and z, which makes 16 lines per voxel. Near holes it is
/// also the number of sample points on each line within a voxel.
constexpr int per_axis = 4;

/// Limits on the number of crossings between triangles and lines. All crossings take some minutes at the
/// first limit. Those of the lines at one z take some hundred megabytes per thread at the second. A box
/// filled with a hundred layers of surface stays below both.
constexpr double max_crossings = 4e9, max_crossings_of_z = 1e7;

/// A triangle that some line along x may cross.
struct Crossed {
    Triangle corners;
    std::int32_t first, last;  ///< range of the z indices of these lines
};

/// Where a line along x crosses the surface.
struct Crossing {
    std::int32_t row;   ///< number of the line along y
    std::int32_t step;  ///< change of the winding number from lower to higher x
    double x;           ///< in voxels
};

/// Computes which part of each voxel has a winding number above 1/2, with respect to the surface without its
/// caps. Lines along x first give the winding number of the closed surface: it changes by 1 at each crossing
/// and is constant elsewhere. Then the winding number of the caps is subtracted, which matters only near
/// holes.
class Voxeliser {
public:
    Voxeliser(const Surface& surface, glm::ivec3 dims, const glm::dvec3& low, double pitch)
        : dims_(dims), caps_(caps_of(surface, low, pitch)) {
        points_.reserve(surface.points.size());
        for (const glm::dvec3& p : surface.points) points_.push_back((p - low) / pitch);
        std::vector<double> per_line(std::size_t(dims.z) * per_axis + 1);
        for (const auto* triangles : {&surface.triangles, &surface.caps}) {
            for (const Triangle& corners : *triangles) add(corners, per_line);
        }
        std::partial_sum(per_line.begin(), per_line.end(), per_line.begin());
        is_too_folded_ = *std::max_element(per_line.begin(), per_line.end()) > max_crossings_of_z ||
                         std::accumulate(per_line.begin(), per_line.end(), 0.0) > max_crossings;
    }

    /// Whether shares() would take too much time or memory.
    bool is_too_folded() const { return is_too_folded_; }

    /// The share of each voxel of slice z that lies inside the surface, x fastest.
    std::vector<float> shares(int z) const {
        std::vector<float> share(std::size_t(dims_.x) * std::size_t(dims_.y));
        std::vector<const Crossed*> near;
        const int first_line = z * per_axis;
        for (const Crossed& triangle : crossed_) {
            if (triangle.first < first_line + per_axis && triangle.last >= first_line)
                near.push_back(&triangle);
        }
        const std::vector<float> caps = of_caps(z);
        std::vector<Crossing> crossings;
        for (int line = first_line; line < first_line + per_axis; ++line) {
            crossings.clear();
            for (const Crossed* triangle : near) cross(*triangle, line, crossings);
            std::sort(crossings.begin(), crossings.end(), [](const Crossing& a, const Crossing& b) {
                return std::tie(a.row, a.x, a.step) < std::tie(b.row, b.x, b.step);
            });
            auto next = crossings.begin();
            for (int row = 0; row < dims_.y * per_axis; ++row) {
                const auto begin = next;
                while (next != crossings.end() && next->row == row) ++next;
                const std::size_t first_voxel = std::size_t(row / per_axis) * std::size_t(dims_.x);
                follow({begin, next}, row, line, caps, first_voxel, share);
            }
        }
        return share;
    }

private:
    using Range = std::pair<std::vector<Crossing>::const_iterator, std::vector<Crossing>::const_iterator>;

    static double place(int line) { return (line + 0.5) / per_axis; }

    static WindingTree caps_of(const Surface& surface, const glm::dvec3& low, double pitch) {
        std::vector<Corners> caps;
        caps.reserve(surface.caps.size());
        for (const auto& [a, b, c] : surface.caps)
            caps.push_back({(surface.points[a] - low) / pitch, (surface.points[b] - low) / pitch,
                            (surface.points[c] - low) / pitch});
        return WindingTree(std::move(caps));
    }

    /// Keeps a triangle if lines may cross it. Adds an upper bound of its number of crossings to `per_line`,
    /// which has for each z of lines the difference from the z before: the caller sums these up.
    void add(const Triangle& corners, std::vector<double>& per_line) {
        glm::dvec3 least = points_[corners[0]], most = least;
        for (const std::uint32_t c : corners) {
            least = glm::min(least, points_[c]);
            most = glm::max(most, points_[c]);
        }
        const auto line = [](double z) { return std::int32_t(std::ceil(z * per_axis - 0.5)); };
        // The range has one line more at each end, in case rounding would lose one. cross() decides exactly.
        const std::int32_t first = std::max(0, line(least.z) - 1);
        const std::int32_t last = std::min(dims_.z * per_axis - 1, line(most.z) + 1);
        if (first > last) return;
        crossed_.push_back({corners, first, last});
        const double rows = (most.y - least.y) * per_axis + 1;
        per_line[std::size_t(first)] += rows;
        per_line[std::size_t(last) + 1] -= rows;
    }

    /// The caps' winding number at the centres of the voxels of slice z.
    std::vector<float> of_caps(int z) const {
        std::vector<float> winding(std::size_t(dims_.x) * std::size_t(dims_.y));
        for (std::size_t n = 0; n < winding.size(); ++n) {
            const std::size_t y = n / std::size_t(dims_.x), x = n % std::size_t(dims_.x);
            winding[n] = float(caps_.at({double(x) + 0.5, double(y) + 0.5, z + 0.5}));
        }
        return winding;
    }

    /// Adds the crossings of a triangle with the lines of one z.
    void cross(const Crossed& triangle, int line, std::vector<Crossing>& crossings) const {
        const double z = place(line);
        struct End {
            double y, x;
            int sign;
        };
        std::array<End, 3> ends{};
        std::size_t count = 0;
        for (std::size_t k = 0; k < 3; ++k) {
            std::uint32_t from = triangle.corners[k], to = triangle.corners[(k + 1) % 3];
            const bool is_upward = points_[to].z > z;
            if ((points_[from].z > z) == is_upward) continue;
            // With the ends in this order both triangles at an edge compute the same bits, so that no line
            // passes between the triangles.
            if (from > to) std::swap(from, to);
            const glm::dvec3 &a = points_[from], &b = points_[to];
            const double along = (z - a.z) / (b.z - a.z);
            ends[count++] = {a.y + along * (b.y - a.y), a.x + along * (b.x - a.x), is_upward ? 1 : -1};
        }
        if (count != 2) return;
        if (ends[0].y > ends[1].y) std::swap(ends[0], ends[1]);
        const auto& [left, right] = std::pair(ends[0], ends[1]);
        // Rows between the two ends; a row at `right` itself belongs to the next triangle.
        int row = std::max(0, int(std::floor(std::max(left.y * per_axis - 0.5, -1.0))));
        for (; row < dims_.y * per_axis && place(row) < left.y; ++row) {
        }
        for (; row < dims_.y * per_axis && place(row) < right.y; ++row) {
            const double along = (place(row) - left.y) / (right.y - left.y);
            // Seen from higher x, with y to the right and z up, a triangle whose edge at `right` runs upward
            // is counter-clockwise. So its normal points to higher x, and the line leaves the body.
            crossings.push_back({row, -right.sign, left.x + along * (right.x - left.x)});
        }
    }

    /// Follows one line along x, and adds its length inside the body to the fractions of the voxels on it.
    void follow(const Range& crossings, int row, int line, const std::vector<float>& caps,
                std::size_t first_voxel, std::vector<float>& share) const {
        constexpr float whole = 1.0F / (per_axis * per_axis);
        auto [next, end] = crossings;
        int winding = 0;
        for (int x = 0; x < dims_.x; ++x) {
            float& sum = share[first_voxel + std::size_t(x)];
            const double of_caps = double(caps[first_voxel + std::size_t(x)]);
            // A winding number of the caps up to this one cannot move the result across 1/2 when it is
            // subtracted.
            constexpr double noticeable = 0.4;
            // Within a voxel without a crossing the winding number varies by less than this, except at the
            // rim of a hole. So the value at the centre is enough unless it is this close to 1/2.
            constexpr double change = 0.4;
            double inside = 0, from = x;
            const auto pass = [&](double to) {
                const bool is_whole = to - from == 1;
                if (std::abs(of_caps) <= noticeable) {
                    if (winding > 0) inside += to - from;
                } else if (is_whole && std::abs(winding - of_caps - 0.5) > change) {
                    if (winding - of_caps > 0.5) inside += 1;
                } else {
                    for (int n = 0; n < per_axis; ++n) {
                        const double at = x + place(n);
                        if (at < from || at >= to) continue;
                        if (winding - caps_.at({at, place(row), place(line)}) > 0.5) inside += 1.0 / per_axis;
                    }
                }
                from = to;
            };
            for (; next != end && next->x < x + 1; ++next) {
                if (next->x > from) pass(next->x);
                winding += next->step;
            }
            pass(x + 1);
            sum += whole * float(inside);
        }
    }

    glm::ivec3 dims_;
    std::vector<glm::dvec3> points_;  ///< in voxels from the grid's corner
    std::vector<Crossed> crossed_;
    WindingTree caps_;
    bool is_too_folded_ = false;
};

std::string text_of(const glm::dvec3& v) { return fmt::format("{:.4g} x {:.4g} x {:.4g}", v.x, v.y, v.z); }

/// Notes on properties of a mesh that its user may not expect.
std::vector<std::string> notes_on(const MeshFacts& facts) {
    std::vector<std::string> notes;
    if (facts.holes > 0)
        notes.push_back(fmt::format(
            "the surface has {} open edges in {} {}; the body is closed there as if by a membrane",
            facts.open_edges, facts.holes, facts.holes == 1 ? "hole" : "holes"));
    if (facts.non_manifold_edges > 0)
        notes.push_back(
            fmt::format("{} edges of the surface have more than two triangles", facts.non_manifold_edges));
    if (facts.turned > 0)
        notes.push_back(fmt::format("{} of {} triangles face inwards, and are treated as if turned over",
                                    facts.turned, facts.triangles));
    if (facts.flat > 0) notes.push_back(fmt::format("{} triangles have no area", facts.flat));
    if (facts.parts > 1)
        notes.push_back(fmt::format("the surface has {} parts that share no vertex", facts.parts));
    return notes;
}

}  // namespace

double default_pitch(const MeshFacts& facts) {
    const glm::dvec3 extent = facts.high - facts.low;
    const double pitch = std::max({extent.x, extent.y, extent.z}) / default_voxels;
    if (!(pitch > 0)) return 1;
    const double unit = std::pow(10, std::floor(std::log10(pitch)) - 1);
    return std::round(pitch / unit) * unit;
}

Voxelised voxelise(Mesh mesh, std::optional<double> chosen_pitch, double fill,
                   const SceneSizeLimits& limits) {
    const Surface surface = surface_of(mesh);
    const MeshFacts& facts = surface.facts;
    const double pitch = chosen_pitch.value_or(default_pitch(facts));
    const glm::dvec3 extent = facts.high - facts.low;
    // Squares of much smaller lengths vanish in float32.
    if (pitch < min_quantity)
        throw BadInput(
            mesh.file, "", "a mesh of " + text_of(extent),
            fmt::format("a larger mesh, in a smaller unit of length: {} voxels along its longest side "
                        "are shorter than {:g}",
                        default_voxels, min_quantity));
    const auto sides_of = [&](double edge) {
        return glm::max(glm::ceil(extent / edge - 1e-9), glm::dvec3(1));
    };
    // Four voxels fit across the thinnest side with this pitch. It is 0 if the mesh is flat. The grid is too
    // large if the mesh is very long.
    const double thinnest = std::min({extent.x, extent.y, extent.z}) / 4;
    const bool is_useful = thinnest > 0 && exceeded_limit(sides_of(thinnest), limits).empty();
    const std::string suggestion = fmt::format(
        "about {:.2g}: the mesh is {} in its file's unit of length",
        is_useful ? std::min(default_pitch(facts), thinnest) : default_pitch(facts), text_of(extent));
    const glm::dvec3 sides = sides_of(pitch);
    const double voxels = sides.x * sides.y * sides.z;
    if (const std::string limit = exceeded_limit(sides, limits); !limit.empty())
        throw TooLarge(mesh.file, "--pitch", fmt::format("{:g}, a grid of {}", pitch, text_of(sides)),
                       fmt::format("{}, and {}", suggestion, limit));
    const glm::ivec3 dims(sides);
    // The grid's middle is that of the mesh.
    const glm::dvec3 low = (facts.low + facts.high) / 2.0 - sides * pitch / 2.0;
    const Voxeliser voxeliser(surface, dims, low, pitch);
    if (voxeliser.is_too_folded())
        throw TooLarge(
            mesh.file, "--pitch", fmt::format("{:g}", pitch),
            "a larger one: at this pitch, the lines that find active voxels cross the mesh too often");

    Voxelised result;
    result.grid = {dims, glm::dvec3(pitch), std::vector<std::uint8_t>(std::size_t(voxels))};
    const std::size_t slice = std::size_t(dims.x) * std::size_t(dims.y);
    std::vector<double> inside(std::size_t(dims.z)), active(std::size_t(dims.z));
    std::exception_ptr failure;
#pragma omp parallel for schedule(dynamic)
    for (int z = 0; z < dims.z; ++z) {
        try {
            constexpr float rounding = 1e-6F;  // rounding error of a sum of 16 fractions
            const std::vector<float> share = voxeliser.shares(z);
            for (std::size_t n = 0; n < slice; ++n) {
                inside[std::size_t(z)] += double(share[n]);
                if (!(share[n] > rounding && share[n] >= float(fill) - rounding)) continue;
                result.grid.label[std::size_t(z) * slice + n] = 1;
                active[std::size_t(z)] += 1;
            }
        } catch (...) {
#pragma omp critical
            failure = std::current_exception();
        }
    }
    if (failure) std::rethrow_exception(failure);
    const double voxel = pitch * pitch * pitch;
    const double volume = voxel * std::accumulate(inside.begin(), inside.end(), 0.0);
    const double body_volume = voxel * std::accumulate(active.begin(), active.end(), 0.0);
    if (!(body_volume > 0)) {
        constexpr double flat = 1e-9;  // fraction of the volume of the box around the mesh
        if (!(facts.volume > flat * extent.x * extent.y * extent.z))
            throw BadInput(mesh.file, "",
                           fmt::format("a mesh of {} triangles that enclose nothing", facts.triangles),
                           "a surface that encloses a body, though it may have holes");
        throw BadInput(mesh.file, "--pitch", fmt::format("{:g} with --fill {:g}", pitch, fill),
                       suggestion + ", so that at least one voxel is that full");
    }
    result.notes = mesh.notes;
    if (!chosen_pitch)
        result.notes.push_back(fmt::format(
            "the pitch is {:g}: {} voxels along the longest side, which is {:g} long; to change it, "
            "give --pitch, or \"pitch\" in a scene's dataset",
            pitch, std::max({dims.x, dims.y, dims.z}), std::max({extent.x, extent.y, extent.z})));
    for (std::string& note : notes_on(facts)) result.notes.push_back(std::move(note));
    result.source = {std::move(mesh), facts, low + pitch / 2, pitch, fill, volume, body_volume};
    return result;
}

}  // namespace voxspring
