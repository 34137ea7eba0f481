#include "backends/glsl/implicit.h"

namespace voxspring::glsl {
namespace {

glm::ivec3 covering(glm::ivec3 dims, layout::BlockShape shape) {
    return {(dims.x + shape.x - 1) / shape.x, (dims.y + shape.y - 1) / shape.y,
            (dims.z + shape.z - 1) / shape.z};
}

}  // namespace

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

template <class Real>
std::vector<Real> compliances(const Problem& problem, const layout::Placement& placement, bool all_terms) {
    std::vector<Real> compliance = layout::pack_compliance<Real>(problem, placement);
    // With one material the shader uses stiffness by group, which compliances of 1 leave as it is.
    if (compliance.empty() && all_terms) compliance.assign(placement.words, 1);
    return compliance;
}
template std::vector<float> compliances(const Problem&, const layout::Placement&, bool);
template std::vector<double> compliances(const Problem&, const layout::Placement&, bool);

std::uint64_t implicit_bytes(const Problem& problem, const Options& options) {
    const layout::Placement placement = layout::place_on_grid(problem.lattice);
    const auto shape = layout::BlockShape::parse(options.tuning.at("block"));
    const std::size_t real = options.precision == Precision::float32 ? sizeof(float) : sizeof(double);
    return compute_bytes(problem, options, placement) +
           (needs_materials(problem, options.tuning.at("terms") == "all") ? placement.words * real : 0) +
           layout::occupied_blocks(problem.lattice, shape).size() * sizeof(layout::BlockOrigin);
}

std::string too_long(const Lattice& lattice, layout::BlockShape shape) {
    const glm::ivec3 groups = covering(lattice.dims, shape);
    for (int axis = 0; axis < 3; ++axis) {
        if (groups[axis] > max_groups)
            return std::to_string(groups[axis]) + " work groups along " + "xyz"[axis] + " exceed the " +
                   std::to_string(max_groups) + " that every driver takes";
    }
    return {};
}

bool votes(const Options& options, bool is_software) {
    const std::string& interior = options.tuning.at("interior");
    return interior == "auto" ? !is_software && !on_positions(options.formulation) : interior == "vote";
}

Constants implicit_constants(const Problem& problem, bool has_origins, bool votes) {
    const glm::ivec3 dims = votes ? problem.lattice.dims : glm::ivec3(0);
    const std::size_t first = votes ? layout::place_on_grid(problem.lattice).first : 0;
    return {{"ORIGINS", text(has_origins)},     {"VOTE", text(votes)},
            {"DIMS_X", std::to_string(dims.x)}, {"DIMS_Y", std::to_string(dims.y)},
            {"DIMS_Z", std::to_string(dims.z)}, {"FIRST_WORD", std::to_string(first)}};
}

}  // namespace voxspring::glsl
