// Implicit addressing in a compute shader: one invocation per voxel, neighbours by their place in the grid.
#include "backends/gl/compute_backend.h"
#include "backends/glsl/implicit.h"
#include "backends/layout/work.h"
#include "backends/physics/addressing.h"

namespace voxspring {
namespace {

class GlComputeImplicit final : public gl::ComputeBackend {
public:
    explicit GlComputeImplicit(const Options& options)
        : ComputeBackend(options, "compute_implicit.comp"),
          shape_(layout::BlockShape::parse(options.tuning.at("block"))),
          tiled_(options.tuning.at("tile") == "shared"),
          votes_(context().has_subgroup_vote() &&
                 glsl::votes(options, context().capabilities().is_software)) {}

    void edit(const Problem& edited, const SpringEdit& edit) override {
        set_problem(edited);
        std::vector<std::uint32_t> particles, masks;
        for (const SpringEdit::Touched& touched : edit.touched) {
            particles.push_back(touched.particle);
            masks.push_back(touched.mask);
        }
        write_bits(particles, masks);
    }

    StepWork step_work(const Problem& problem) const override {
        return layout::implicit_work<float>(problem, formulation());
    }

private:
    std::uint64_t bytes_needed(const Problem& problem) const override {
        return glsl::implicit_bytes(problem, options());
    }

    std::size_t tile_bytes() const {
        const std::size_t axes = formulation() == Formulation::compensated ? 6 : 3;
        return axes * std::size_t(shape_.x + 2) * std::size_t(shape_.y + 2) * std::size_t(shape_.z + 2) *
               sizeof(float);
    }
    std::string refused_layout(const Problem& problem) const override {
        if (std::string why = implicit_refusal(problem); !why.empty()) return why;
        const auto shared = std::size_t(context().max_shared_memory());
        if (tiled_ && tile_bytes() > shared)
            return "tiles of " + std::to_string(tile_bytes()) + " bytes exceed the " +
                   std::to_string(shared) + " of shared memory that a work group may have";
        return glsl::too_long(problem.lattice, shape_);
    }
    layout::Placement place(const Problem& problem) const override {
        return layout::place_on_grid(problem.lattice);
    }

    Layout lay_out(const Problem& problem) override {
        const glsl::VoxelGroups voxels = glsl::groups_of(problem.lattice, shape_);
        Layout layout{place(problem), problem.lattice.mask, voxels.groups};
        has_origins_ = !voxels.origins.empty();
        origins_.upload(context(), voxels.origins);
        compliance_.upload(context(), glsl::compliances<float>(problem, layout.placement, all_terms()));
        return layout;
    }

    void bind_own() const override {
        compliance_.bind(first_own_binding);
        origins_.bind(first_own_binding + 1);
    }

    gl::Defines specialise(const Problem& problem) const override {
        gl::Defines defines{{"BLOCK_X", std::to_string(shape_.x)},
                            {"BLOCK_Y", std::to_string(shape_.y)},
                            {"BLOCK_Z", std::to_string(shape_.z)}};
        defines.merge(glsl::implicit_constants(problem, has_origins_, votes_));
        if (tiled_) defines["TILE"] = "";
        if (votes_) defines["SUBGROUPS"] = "";
        return defines;
    }

    void set_uniforms(const gl::Program& program, const Problem& problem) override {
        glsl::set_implicit<float>(program, problem, formulation(),
                                  [this](std::span<float> squares) { measure(squares); });
    }

    const layout::BlockShape shape_;
    const bool tiled_;
    const bool votes_;
    bool has_origins_ = false;
    gl::StorageBuffer origins_, compliance_;
};

const Registered entry({
    .name = "gl_compute_implicit",
    .api = "opengl",
    .addressing = Addressing::by_grid,
    .summary = "OpenGL compute shader, one invocation per voxel, neighbours by grid offset and mask.",
    .precisions = {Precision::float32},
    .formulations = every_formulation,
    .tuning = {{"block", {"32x4x2", "64x4x1", "32x8x1", "128x1x1", "8x8x4"}},
               {"fetch", {"buffer", "texture"}},
               {"interior", {"auto", "mask", "vote"}},
               {"terms", {"needed", "all"}},
               {"tile", {"none", "shared"}}},
    .make = [](const Options& options) { return std::make_unique<GlComputeImplicit>(options); },
    .bytes = glsl::implicit_bytes,
});

}  // namespace
}  // namespace voxspring
