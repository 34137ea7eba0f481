// Resamples a grid of labels to another distance between voxels.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cstddef>
#include <glm/common.hpp>
#include <utility>
#include <vector>

#include "harness/base/bad_input.h"
#include "harness/volume/volume.h"

namespace voxspring {
namespace {

/// The old voxels that a new voxel overlaps along one axis. Old voxel first + i covers share[i] of the new
/// one.
struct Overlap {
    int first = 0;
    std::vector<double> share;
};

/// The overlaps of `count` new voxels along one axis. A new voxel is `ratio` old voxels long. Both grids have
/// the same middle, and the old one reaches from 0 to `old_count`.
std::vector<Overlap> overlaps(int count, int old_count, double ratio) {
    std::vector<Overlap> all(static_cast<std::size_t>(count));
    const double begin = (old_count - count * ratio) / 2;
    for (int n = 0; n < count; ++n) {
        Overlap& overlap = all[std::size_t(n)];
        const double low = std::max(0.0, begin + n * ratio);
        const double high = std::min(double(old_count), begin + (n + 1) * ratio);
        overlap.first = int(low);
        for (int old = overlap.first; old < high; ++old)
            overlap.share.push_back((std::min(old + 1.0, high) - std::max(double(old), low)) / ratio);
    }
    return all;
}

constexpr double rounding = 1e-9;  // rounding error of a sum of shares

}  // namespace

glm::dvec3 resample(LabelledGrid& labelled, double pitch, double fill, const std::string& file,
                    const SceneSizeLimits& limits) {
    const VoxelGrid old = std::move(labelled.grid);
    const glm::dvec3 extent = glm::dvec3(old.dims) * old.spacing;
    const glm::dvec3 sides = glm::max(glm::ceil(extent / pitch - rounding), glm::dvec3(1));
    const std::string size = fmt::format("{:g} x {:g} x {:g}", extent.x, extent.y, extent.z);
    if (const std::string limit = exceeded_limit(sides, limits); !limit.empty())
        throw TooLarge(
            file, "--pitch",
            fmt::format("{:g}, a grid of {:.4g} x {:.4g} x {:.4g}", pitch, sides.x, sides.y, sides.z),
            fmt::format("a larger one: the volume is {} in its unit of length, and {}", size, limit));
    VoxelGrid grid{glm::ivec3(sides), glm::dvec3(pitch), {}};
    grid.label.resize(std::size_t(sides.x) * std::size_t(sides.y) * std::size_t(sides.z));
    std::array<std::vector<Overlap>, 3> axes;
    for (int a = 0; a < 3; ++a)
        axes[std::size_t(a)] = overlaps(grid.dims[a], old.dims[a], pitch / old.spacing[a]);
#pragma omp parallel for schedule(dynamic)
    for (int z = 0; z < grid.dims.z; ++z) {
        std::array<double, 256> share{};  // share of the new voxel, by label
        std::size_t voxel = std::size_t(z) * std::size_t(grid.dims.y) * std::size_t(grid.dims.x);
        const Overlap& in_z = axes[2][std::size_t(z)];
        for (const Overlap& in_y : axes[1]) {
            for (const Overlap& in_x : axes[0]) {
                double full = 0;
                std::uint8_t most = 0;
                const auto visit = [&](const auto& take) {
                    for (std::size_t k = 0; k < in_z.share.size(); ++k) {
                        for (std::size_t j = 0; j < in_y.share.size(); ++j) {
                            const std::size_t row = ((std::size_t(in_z.first) + k) * std::size_t(old.dims.y) +
                                                     std::size_t(in_y.first) + j) *
                                                        std::size_t(old.dims.x) +
                                                    std::size_t(in_x.first);
                            const double of_row = in_z.share[k] * in_y.share[j];
                            for (std::size_t i = 0; i < in_x.share.size(); ++i) {
                                if (const std::uint8_t label = old.label[row + i]; label != 0)
                                    take(label, of_row * in_x.share[i]);
                            }
                        }
                    }
                };
                visit([&](std::uint8_t label, double part) {
                    full += part;
                    share[label] += part;
                });
                double best = 0;
                visit([&](std::uint8_t label, double) {
                    const double of_label = std::exchange(share[label], 0);
                    if (of_label > best + rounding || (of_label > best - rounding && label < most)) {
                        most = label;
                        best = of_label;
                    }
                });
                grid.label[voxel++] = full > rounding && full >= fill - rounding ? most : std::uint8_t{0};
            }
        }
    }
    const auto volume_of = [](const VoxelGrid& of) {
        const auto inactive = std::count(of.label.begin(), of.label.end(), std::uint8_t{0});
        return double(of.label.size() - std::size_t(inactive)) * of.spacing.x * of.spacing.y * of.spacing.z;
    };
    if (!(volume_of(grid) > 0))
        throw BadInput(file, "--pitch", fmt::format("{:g} with --fill {:g}", pitch, fill),
                       "a smaller one, so that at least one voxel is that full: the volume is " + size +
                           " in its unit of length");
    labelled.notes.push_back(fmt::format(
        "{} x {} x {} voxels become {} x {} x {} of {:g}, which changes the body's volume by {:.2g}%",
        old.dims.x, old.dims.y, old.dims.z, grid.dims.x, grid.dims.y, grid.dims.z, pitch,
        100 * (volume_of(grid) / volume_of(old) - 1)));
    for (std::size_t m = 0; m < labelled.labels.size(); ++m) {
        if (std::find(grid.label.begin(), grid.label.end(), std::uint8_t(m + 1)) == grid.label.end())
            labelled.notes.push_back("label " + labelled.labels[m].name + " fills no voxel any more");
    }
    labelled.grid = std::move(grid);
    // The offset from the centre of the old voxel (0, 0, 0) to that of the new one; both grids have the same
    // middle.
    return (extent - glm::dvec3(labelled.grid.dims - 1) * pitch - old.spacing) / 2.0;
}

}  // namespace voxspring
