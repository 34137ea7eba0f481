// Implicit addressing in Vulkan: one invocation per voxel, neighbours by their place in the grid.
#include "backends/glsl/implicit.h"
#include "backends/layout/work.h"
#include "backends/physics/addressing.h"
#include "backends/vulkan/vulkan_backend.h"

namespace voxspring {
namespace {

glm::ivec3 extents(layout::BlockShape shape) { return {shape.x, shape.y, shape.z}; }

template <class Real>
class VulkanImplicit final : public vulkan::VulkanBackend {
public:
    explicit VulkanImplicit(const Options& options)
        : VulkanBackend(options, extents(layout::BlockShape::parse(options.tuning.at("block")))),
          shape_(layout::BlockShape::parse(options.tuning.at("block"))),
          votes_(glsl::votes(options, device().capabilities().is_software)) {}

    StepWork step_work(const Problem& problem) const override {
        return layout::implicit_work<Real>(problem, formulation());
    }

private:
    enum Own : std::uint32_t { compliances = glsl::first_own_binding, origins };

    std::string shader() const override { return "compute_implicit"; }
    std::uint64_t bytes_needed(const Problem& problem) const override {
        return glsl::implicit_bytes(problem, options());
    }
    std::string refused_layout(const Problem& problem) const override {
        if (std::string why = implicit_refusal(problem); !why.empty()) return why;
        return glsl::too_long(problem.lattice, shape_);
    }
    layout::Placement place(const Problem& problem) const override {
        return layout::place_on_grid(problem.lattice);
    }

    Layout lay_out(const Problem& problem) override {
        const glsl::VoxelGroups voxels = glsl::groups_of(problem.lattice, shape_);
        Layout layout{place(problem), problem.lattice.mask, voxels.groups};
        has_origins_ = !voxels.origins.empty();
        put(own(origins), voxels.origins);
        put(own(compliances), glsl::compliances<Real>(problem, layout.placement, all_terms()));
        return layout;
    }

    glsl::Constants constants(const Problem& problem) const override {
        return glsl::implicit_constants(problem, has_origins_, votes_);
    }
    void set_uniforms(vulkan::Uniforms& uniforms, const Problem& problem) override {
        glsl::set_implicit<Real>(uniforms, problem, formulation(),
                                 [this](std::span<Real> squares) { measure_numbers(squares); });
    }

    void enqueue_edit_of(const Problem&, const SpringEdit& edit) override {
        std::vector<std::uint32_t> particles, masks;
        for (const SpringEdit::Touched& touched : edit.touched) {
            particles.push_back(touched.particle);
            masks.push_back(touched.mask);
        }
        write_bits(particles, masks);
    }

    const layout::BlockShape shape_;
    const bool votes_;
    bool has_origins_ = false;
};

const Registered entry({
    .name = "vulkan_implicit",
    .api = "vulkan",
    .addressing = Addressing::by_grid,
    .summary = "Vulkan compute shader, one invocation per voxel, neighbours by grid offset and mask.",
    .precisions = {Precision::float32, Precision::float64},
    .formulations = every_formulation,
    .tuning = {{"block", {"32x4x2", "64x4x1", "32x8x1", "128x1x1", "8x8x4"}},
               {"interior", {"auto", "mask", "vote"}},
               {"terms", {"needed", "all"}}},
    .make = [](const Options& options) -> std::unique_ptr<Backend> {
        if (options.precision == Precision::float32) return std::make_unique<VulkanImplicit<float>>(options);
        return std::make_unique<VulkanImplicit<double>>(options);
    },
    .bytes = glsl::implicit_bytes,
});

}  // namespace
}  // namespace voxspring
