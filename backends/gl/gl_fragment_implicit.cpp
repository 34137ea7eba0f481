// The method of Mosegaard and Sorensen (2005): the whole grid lies in a flat texture, with one fragment per
// voxel. Neighbours are found by their coordinates in the grid, and the stencil buffer masks inactive voxels.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <optional>

#include "backends/gl/fragment_backend.h"
#include "backends/gl/texture.h"
#include "backends/layout/springs.h"
#include "backends/physics/addressing.h"
#include "backends/physics/neighbours.h"

namespace voxspring {
namespace {

/// Slices of the grid side by side in a texture, `columns` slices per row, z slowest.
struct FlatGrid {
    glm::ivec3 dims{0};
    int columns = 0;

    glm::ivec2 size() const { return {columns * dims.x, (dims.z + columns - 1) / columns * dims.y}; }
    std::uint32_t texel(glm::ivec3 voxel) const {
        const int x = voxel.z % columns * dims.x + voxel.x;
        const int y = voxel.z / columns * dims.y + voxel.y;
        return std::uint32_t(y) * std::uint32_t(size().x) + std::uint32_t(x);
    }
};

/// The narrowest way to lay `dims` flat within `limit` x `limit` texels, or none if it does not fit. A narrow
/// layout keeps a voxel's neighbours in the rows and slices beside it close in memory, which matters where
/// textures are stored row by row (llvmpipe). Less than one row of slices is wasted.
std::optional<FlatGrid> lay_flat(glm::ivec3 dims, int limit) {
    if (dims.x > limit || dims.y > limit) return std::nullopt;
    const int rows = limit / dims.y;
    const int columns = (dims.z + rows - 1) / rows;
    if (columns > limit / dims.x) return std::nullopt;
    return FlatGrid{dims, columns};
}

std::uint64_t upload_bytes(const Problem& problem, const Options& options) {
    const auto flat = lay_flat(problem.lattice.dims, gl::guaranteed_texture_size);
    const std::uint64_t texels =
        flat ? std::uint64_t(flat->size().x) * std::uint64_t(flat->size().y) : problem.lattice.voxel_count();
    return gl::fragment_bytes(problem, options, texels);
}

class GlFragmentImplicit final : public gl::FragmentBackend {
public:
    explicit GlFragmentImplicit(const Options& options)
        : FragmentBackend(options, "gl_fragment_implicit.frag") {}

    StepWork step_work(const Problem& problem) const override {
        StepWork work = fragment_work(problem, problem.lattice.voxel_count());
        // The operations of fast_series_stiffness() and of the product with its result.
        if (all_terms() || problem.has_materials()) work.operations += 2 * count_springs(problem).total() * 3;
        return work;
    }

private:
    std::uint64_t bytes_needed(const Problem& problem) const override {
        return upload_bytes(problem, options());
    }

    std::string refused(const Problem& problem) const override {
        if (std::string why = implicit_refusal(problem); !why.empty()) return why;
        const glm::ivec3 dims = problem.lattice.dims;
        const int limit = context().max_texture_size();
        const auto flat = lay_flat(dims, limit);
        if (flat && gl::fits(gl::rgba32f, flat->size())) return {};
        const std::string grid = fmt::format("grid of {} x {} x {}", dims.x, dims.y, dims.z);
        if (flat)
            return fmt::format(
                "{} needs a texture of {} x {} RGBA32F texels, which is more bytes than the driver allows",
                grid, flat->size().x, flat->size().y);
        return fmt::format("{}, with its slices side by side, exceeds the texture limit of {} x {} texels",
                           grid, limit, limit);
    }

    Layout lay_out(const Problem& problem) override {
        flat_ = lay_flat(problem.lattice.dims, context().max_texture_size()).value();
        Layout layout{flat_.size(), {}, problem.lattice.mask};
        layout.texel.reserve(problem.particle_count());
        for (const std::uint32_t voxel : problem.lattice.voxel) {
            layout.texel.push_back(flat_.texel(problem.lattice.coordinates(voxel)));
        }
        return layout;
    }

    gl::Defines specialise(const Problem&) const override { return {}; }

    void set_uniforms(const gl::Program& program, const Problem& problem) override {
        std::array<float, neighbour_count / 2> rest_length{};
        for (std::size_t b = 0; b < rest_length.size(); ++b)
            rest_length[b] = layout::listed_length<float>(problem, directions()[2 * b], formulation());
        if (!by_increments(formulation())) measure(rest_length);
        program.set("rest_length", rest_length);
        // With several materials the stiffness comes from the particles, and each group has stiffness 1.
        std::array<float, 3> stiffness{1, 1, 1};
        if (!problem.has_materials()) {
            std::copy(problem.group_stiffness.begin(), problem.group_stiffness.end(), stiffness.begin());
        }
        program.set("group_stiffness", stiffness);
        program.set("slice_width", flat_.dims.x);
        program.set("slice_height", flat_.dims.y);
        program.set("last_column", (flat_.columns - 1) * flat_.dims.x);
    }

    bool has_room(const Problem&, const SpringEdit&) const override { return true; }

    TexelEdit edited_texels(const Problem&, const SpringEdit& edit) const override {
        TexelEdit texels;
        for (const SpringEdit::Touched& touched : edit.touched)
            texels.particles.push_back({texel_of(touched.particle), touched.mask, 0, 0});
        return texels;
    }

    FlatGrid flat_;
};

const Registered entry({
    .name = "gl_fragment_implicit",
    .api = "opengl",
    .addressing = Addressing::by_grid,
    .summary =
        "OpenGL fragment shader over the flattened grid, neighbours by grid offset (Mosegaard and Sorensen "
        "2005).",
    .strength = "a lattice needs no neighbour lists, and the stencil mask skips empty voxels",
    .precisions = {Precision::float32},
    .formulations = every_formulation,
    .tuning = gl::fragment_tuning(),
    .make = [](const Options& options) { return std::make_unique<GlFragmentImplicit>(options); },
    .bytes = upload_bytes,
});

}  // namespace
}  // namespace voxspring
