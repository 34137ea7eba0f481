// Implicit addressing in a compute shader: one invocation a voxel, neighbours by their place in the grid.
#include <algorithm>
#include <array>

#include "backends/gl/compute_backend.h"
#include "backends/layout/springs.h"
#include "backends/layout/work.h"
#include "backends/physics/addressing.h"

namespace voxspring {
namespace {

std::uint64_t upload_bytes(const Problem& problem, const Options& options) {
    const cuda::Placement placement = cuda::place_on_grid(problem.lattice);
    const auto shape = cuda::BlockShape::parse(options.tuning.at("block"));
    return gl::compute_bytes(problem, options, placement) +
           (gl::needs_materials(problem, options.tuning.at("terms") == "all")
                ? placement.words * sizeof(float)
                : 0) +
           cuda::occupied_blocks(problem.lattice, shape).size() * sizeof(cuda::BlockOrigin);
}

class GlComputeImplicit final : public gl::ComputeBackend {
public:
    explicit GlComputeImplicit(const Options& options)
        : ComputeBackend(options, "gl_compute_implicit.comp"),
          shape_(cuda::BlockShape::parse(options.tuning.at("block"))),
          tiled_(options.tuning.at("tile") == "shared"),
          votes_(context().has_subgroup_vote() && votes(options)) {}

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
        return cuda::implicit_work<float>(problem, formulation());
    }

private:
    std::uint64_t bytes_needed(const Problem& problem) const override {
        return upload_bytes(problem, options());
    }

    /// What was faster on an H200 (gl/README.md).
    static bool votes(const Options& options) {
        const std::string& interior = options.tuning.at("interior");
        return interior == "auto" ? !on_positions(options.formulation) : interior == "vote";
    }

    std::size_t tile_bytes() const {
        const std::size_t axes = formulation() == Formulation::compensated ? 6 : 3;
        return axes * std::size_t(shape_.x + 2) * std::size_t(shape_.y + 2) * std::size_t(shape_.z + 2) *
               sizeof(float);
    }
    glm::ivec3 groups(glm::ivec3 dims) const {
        return {(dims.x + shape_.x - 1) / shape_.x, (dims.y + shape_.y - 1) / shape_.y,
                (dims.z + shape_.z - 1) / shape_.z};
    }

    std::string refused_layout(const Problem& problem) const override {
        if (std::string why = implicit_refusal(problem); !why.empty()) return why;
        const auto shared = std::size_t(context().max_shared_memory());
        if (tiled_ && tile_bytes() > shared)
            return "tiles of " + std::to_string(tile_bytes()) + " bytes exceed the " +
                   std::to_string(shared) + " of shared memory that a work group may have";
        if (const int along_x = groups(problem.lattice.dims).x; along_x > max_groups)
            return std::to_string(along_x) + " work groups along x exceed the " + std::to_string(max_groups) +
                   " that every driver takes";
        return {};
    }
    cuda::Placement place(const Problem& problem) const override {
        return cuda::place_on_grid(problem.lattice);
    }

    Layout lay_out(const Problem& problem) override {
        Layout layout{place(problem), problem.lattice.mask, {}};
        std::vector<cuda::BlockOrigin> origins = cuda::occupied_blocks(problem.lattice, shape_);
        const glm::ivec3 dims = problem.lattice.dims;
        layout.groups = groups(dims);
        has_origins_ = !origins.empty();
        if (has_origins_) {
            layout.groups = rows_of_groups(int(origins.size()));
            // The last row is filled up with groups that lie outside.
            origins.resize(std::size_t(layout.groups.x) * std::size_t(layout.groups.y),
                           {dims.x, dims.y, dims.z, 0});
        }
        origins_.upload(context(), origins);
        std::vector<float> compliance = cuda::pack_compliance<float>(problem, layout.placement);
        // One material has its stiffness by group, which compliances of 1 leave as it is.
        if (compliance.empty() && all_terms()) compliance.assign(layout.placement.words, 1);
        compliance_.upload(context(), compliance);
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
        // Brought 1% to 10% with the vote and nothing without (gl/README.md), and costs a program a lattice.
        if (votes_) {
            const glm::ivec3 dims = problem.lattice.dims;
            defines["DIMS"] = "ivec3(" + std::to_string(dims.x) + ", " + std::to_string(dims.y) + ", " +
                              std::to_string(dims.z) + ")";
            defines["FIRST_WORD"] = std::to_string(place(problem).first);
        }
        if (has_origins_) defines["ORIGINS"] = "";
        if (tiled_) defines["TILE"] = "";
        if (votes_) defines["VOTE"] = "";
        return defines;
    }

    void set_uniforms(const gl::Program& program, const Problem& problem) override {
        cuda::ImplicitStep<float> step =
            cuda::make_implicit_step<float>(problem, place(problem), formulation());
        if (!by_increments(formulation())) measure(step.rest_length);
        program.set("dims", problem.lattice.dims);
        program.set("first_word", step.first);
        program.set("rest_length", step.rest_length);
        program.set("rest_deficit", step.deficit);
        std::array<float, 3> stiffness{1, 1, 1};  // materials carry it themselves
        if (!problem.has_materials()) std::copy_n(step.stiffness, 3, stiffness.begin());
        program.set("group_stiffness", stiffness);
    }

    static constexpr int max_groups = 65535;  // along an axis, of every driver
    const cuda::BlockShape shape_;
    const bool tiled_;
    const bool votes_;
    bool has_origins_ = false;
    gl::StorageBuffer origins_, compliance_;
};

const Registered entry({
    .name = "gl_compute_implicit",
    .summary = "OpenGL compute shader, one invocation a voxel, neighbours by grid offset and mask.",
    .precisions = {Precision::float32},
    .formulations = every_formulation,
    .tuning = {{"block", {"32x4x2", "64x4x1", "32x8x1", "128x1x1", "8x8x4"}},
               {"fetch", {"buffer", "texture"}},
               {"interior", {"auto", "mask", "vote"}},
               {"terms", {"needed", "all"}},
               {"tile", {"none", "shared"}}},
    .make = [](const Options& options) { return std::make_unique<GlComputeImplicit>(options); },
    .bytes = upload_bytes,
});

}  // namespace
}  // namespace voxspring
