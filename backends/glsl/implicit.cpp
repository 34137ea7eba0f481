// Implicit addressing in a compute shader: one invocation per voxel, neighbours by their place in the grid.
#include "backends/glsl/implicit.h"

#include <algorithm>
#include <optional>
#include <span>

#include "backends/by_precision.h"
#include "backends/glsl/compute_backend.h"
#include "backends/layout/work.h"
#include "backends/physics/addressing.h"

namespace voxspring::glsl {
namespace {

glm::ivec3 covering(glm::ivec3 dims, layout::BlockShape shape) {
    return {(dims.x + shape.x - 1) / shape.x, (dims.y + shape.y - 1) / shape.y,
            (dims.z + shape.z - 1) / shape.z};
}

/// The work groups of a step.
struct VoxelGroups {
    glm::ivec3 groups;
    std::vector<layout::BlockOrigin> origins;
};
VoxelGroups groups_of(const Lattice& lattice, layout::BlockShape shape) {
    const glm::ivec3 dims = lattice.dims;
    VoxelGroups voxels{covering(dims, shape), layout::occupied_blocks(lattice, shape)};
    if (voxels.origins.empty()) return voxels;
    voxels.groups = rows_of_groups(int(voxels.origins.size()));
    // The last row is filled up with groups that lie outside of the lattice.
    voxels.origins.resize(std::size_t(voxels.groups.x) * std::size_t(voxels.groups.y),
                          {dims.x, dims.y, dims.z, 0});
    return voxels;
}

/// 1 / stiffness of each word's material. If the problem has only one material but the shader needs a value
/// for each word, all values are 1.
template <class Real>
std::vector<Real> compliances(const Problem& problem, const layout::Placement& placement, bool all_terms) {
    std::vector<Real> compliance = layout::pack_compliance<Real>(problem, placement);
    // With one material the shader multiplies by the stiffness of each group, which compliances of 1 leave as
    // it is.
    if (compliance.empty() && all_terms) compliance.assign(placement.words, 1);
    return compliance;
}

}  // namespace

std::string too_long(const Lattice& lattice, layout::BlockShape shape) {
    const glm::ivec3 groups = covering(lattice.dims, shape);
    for (int axis = 0; axis < 3; ++axis) {
        if (groups[axis] > max_groups)
            return std::to_string(groups[axis]) + " work groups along " + "xyz"[axis] + " exceed the " +
                   std::to_string(max_groups) + " that every driver accepts";
    }
    return {};
}

namespace {

template <class Real>
class ImplicitBackend final : public ComputeBackend<Real> {
public:
    ImplicitBackend(const Options& options, std::unique_ptr<Device> device)
        : ImplicitBackend(options, std::move(device), layout::BlockShape::parse(options.tuning.at("block"))) {
    }

    std::optional<Choice> choice() const override {
        return choice_of_auto(this->options(), {{"interior", votes_ ? "vote" : "mask"}});
    }

    StepWork step_work(const Problem& problem) const override {
        return layout::implicit_work<Real>(problem, this->formulation());
    }

private:
    enum Own : unsigned { compliances_binding = first_own_binding, origins_binding };
    using typename ComputeBackend<Real>::Layout;

    ImplicitBackend(const Options& options, std::unique_ptr<Device> device, layout::BlockShape shape)
        : ComputeBackend<Real>(options, std::move(device), {shape.x, shape.y, shape.z}),
          shape_(shape),
          tiled_(options.tuning.contains("tile") && options.tuning.at("tile") == "shared"),
          votes_(const_device().can_vote() && votes(options, const_device().capabilities().is_software)) {}
    const Device& const_device() const { return ComputeBackend<Real>::device(); }

    std::uint64_t bytes_needed(const Problem& problem) const override {
        return implicit_bytes(problem, this->options());
    }
    std::size_t tile_bytes() const {
        const std::size_t axes = this->formulation() == Formulation::compensated ? 6 : 3;
        return axes * std::size_t(shape_.x + 2) * std::size_t(shape_.y + 2) * std::size_t(shape_.z + 2) *
               sizeof(Real);
    }
    std::string refused_layout(const Problem& problem) const override {
        if (std::string why = implicit_refusal(problem); !why.empty()) return why;
        const std::size_t shared = const_device().work_group_limits().shared_bytes;
        if (tiled_ && tile_bytes() > shared)
            return "a tile (tile=shared) needs " + std::to_string(tile_bytes()) +
                   " bytes of shared memory, but a work group may have at most " + std::to_string(shared);
        return too_long(problem.lattice, shape_);
    }
    layout::Placement place(const Problem& problem) const override {
        return layout::place_on_grid(problem.lattice);
    }

    Layout lay_out(const Problem& problem) override {
        const VoxelGroups voxels = groups_of(problem.lattice, shape_);
        Layout layout{place(problem), problem.lattice.mask, voxels.groups};
        has_origins_ = !voxels.origins.empty();
        this->put_own(origins_binding, voxels.origins);
        this->put_own(compliances_binding, compliances<Real>(problem, layout.placement, this->all_terms()));
        return layout;
    }

    /// With interior=vote the constants include the extents of the grid, so that each size of a grid needs a
    /// program. On an H200 these constants made steps up to 10% faster, and with interior=mask up to 4%
    /// (gl/README.md).
    Shader shader(const Problem& problem) const override {
        const glm::ivec3 dims = votes_ ? problem.lattice.dims : glm::ivec3(0);
        const std::size_t first = votes_ ? place(problem).first : 0;
        Shader shader{.file = "compute_implicit",
                      .constants = {{"ORIGINS", text(has_origins_)},
                                    {"VOTE", text(votes_)},
                                    {"DIMS_X", std::to_string(dims.x)},
                                    {"DIMS_Y", std::to_string(dims.y)},
                                    {"DIMS_Z", std::to_string(dims.z)},
                                    {"FIRST_WORD", std::to_string(first)}}};
        if (tiled_) shader.constants["TILE"] = "";
        return shader;
    }

    void set_uniforms(Uniforms& uniforms, const Problem& problem) override {
        layout::ImplicitStep<Real> step =
            layout::make_implicit_step<Real>(problem, place(problem), this->formulation());
        if (!by_increments(this->formulation())) this->measure_numbers(step.rest_length);
        uniforms.set("grid_dims", problem.lattice.dims);
        uniforms.set("grid_first_word", step.first);
        uniforms.set("rest_length", step.rest_length);
        uniforms.set("rest_deficit", step.deficit);
        std::array<Real, 3> stiffness{1, 1, 1};  // with several materials, particles give the stiffness
        if (!problem.has_materials()) std::copy_n(step.stiffness, 3, stiffness.begin());
        uniforms.set("group_stiffness", stiffness);
    }

    void enqueue_edit(const Problem&, const SpringEdit& edit) override {
        std::vector<std::uint32_t> particles, masks;
        for (const SpringEdit::Touched& touched : edit.touched) {
            particles.push_back(touched.particle);
            masks.push_back(touched.mask);
        }
        this->write_bits(particles, masks);
    }

    const layout::BlockShape shape_;
    const bool tiled_;
    const bool votes_;
    bool has_origins_ = false;
};

}  // namespace

std::uint64_t implicit_bytes(const Problem& problem, const Options& options) {
    const layout::Placement placement = layout::place_on_grid(problem.lattice);
    const auto shape = layout::BlockShape::parse(options.tuning.at("block"));
    const std::size_t real = scalar_bytes(options.precision);
    return compute_bytes(problem, options, placement) +
           (needs_materials(problem, options.tuning.at("terms") == "all") ? placement.words * real : 0) +
           layout::occupied_blocks(problem.lattice, shape).size() * sizeof(layout::BlockOrigin);
}

bool votes(const Options& options, bool is_software) {
    const std::string& interior = options.tuning.at("interior");
    return interior == "auto" ? !is_software && !on_positions(options.formulation) : interior == "vote";
}

std::unique_ptr<Backend> make_implicit(const Options& options, std::unique_ptr<Device> device) {
    return make_by_precision<ImplicitBackend>(options, options, std::move(device));
}

}  // namespace voxspring::glsl
