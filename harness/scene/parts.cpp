#include "harness/scene/parts.h"

#include <fmt/format.h>

#include <algorithm>
#include <numeric>

#include "harness/base/disjoint_sets.h"

namespace voxspring {
namespace {

/// Whether every voxel has a particle and every two voxels that share a face are joined by a spring. Such a
/// box has one part. It may have 10^8 particles, for which the search for parts would take long.
bool is_whole_box(const Problem& problem) {
    const glm::dvec3 dims(problem.lattice.dims);
    const double voxels = dims.x * dims.y * dims.z;
    return voxels > 0 && double(problem.lattice.voxel.size()) == voxels &&
           double(count_springs(problem).group[0]) ==
               3 * voxels - dims.y * dims.z - dims.x * dims.z - dims.x * dims.y;
}

bool holds(const std::vector<std::uint8_t>& pinned) {
    return std::find(pinned.begin(), pinned.end(), 1) != pinned.end();
}

}  // namespace

std::vector<std::uint32_t> BodyParts::loose() const {
    std::vector<std::uint32_t> particles;
    if (!holds(is_held)) return particles;
    for (std::size_t i = 0; i < part.size(); ++i) {
        if (is_held[part[i]] == 0) particles.push_back(std::uint32_t(i));
    }
    return particles;
}

BodyParts parts_of(const Problem& problem) {
    const std::size_t count = problem.particle_count();
    if (is_whole_box(problem)) {
        const bool is_held = holds(problem.pinned) || problem.has_tool();
        return {.sizes = {count}, .part = {}, .is_held = {std::uint8_t(is_held ? 1 : 0)}};
    }
    DisjointSets sets(count);
    {
        const LatticeSprings springs(problem);
        for (std::size_t i = 0; i < problem.lattice.mask.size(); ++i)
            springs.of(i, [&](std::uint32_t j, const Direction&) { sets.join(std::uint32_t(i), j); });
    }
    for (const Spring& spring : problem.springs) sets.join(spring.first, spring.second);

    // Parts are first numbered in the order of their first particles, and then renumbered by size.
    BodyParts parts;
    parts.part.resize(count);
    std::vector<std::size_t> size;
    for (std::size_t i = 0; i < count; ++i) {
        const std::uint32_t first = sets.of(std::uint32_t(i));
        if (first == i) size.push_back(0);
        parts.part[i] = first == i ? std::uint32_t(size.size() - 1) : parts.part[first];
        ++size[parts.part[i]];
    }
    std::vector<std::uint32_t> by_size(size.size());
    std::iota(by_size.begin(), by_size.end(), 0U);
    std::stable_sort(by_size.begin(), by_size.end(), [&](auto a, auto b) { return size[a] > size[b]; });
    std::vector<std::uint32_t> number(size.size());
    for (std::size_t n = 0; n < by_size.size(); ++n) {
        number[by_size[n]] = std::uint32_t(n);
        parts.sizes.push_back(size[by_size[n]]);
    }
    parts.is_held.resize(size.size());
    for (std::size_t i = 0; i < count; ++i) {
        parts.part[i] = number[parts.part[i]];
        if (problem.is_pinned(i)) parts.is_held[parts.part[i]] = 1;
    }
    for (const std::uint32_t i : problem.tool.particles) parts.is_held[parts.part[i]] = 1;
    if (size.size() == 1) parts.part.clear();
    return parts;
}

std::string with_commas(std::size_t number) {
    std::string text = std::to_string(number);
    for (std::size_t at = text.size(); at > 3;) text.insert(at -= 3, ",");
    return text;
}

std::string describe(const BodyParts& parts, bool has_gravity) {
    constexpr std::size_t most = 3;
    const std::vector<std::size_t>& sizes = parts.sizes;
    if (sizes.size() < 2) return {};
    const std::size_t named = sizes.size() <= most + 1 ? sizes.size() : most;
    std::string list;
    for (std::size_t n = 0; n < named; ++n)
        list += (n == 0 ? "" : n + 1 == named ? " and " : ", ") + with_commas(sizes[n]);
    list += " particles";
    if (named < sizes.size())
        list += fmt::format(", and {} of at most {}", with_commas(sizes.size() - named),
                            with_commas(sizes[named]));
    const std::size_t loose = parts.loose().size();
    std::string text = fmt::format("the body has {} parts: {}", with_commas(sizes.size()), list);
    if (loose > 0)
        text += fmt::format("; {} {} in parts that nothing pins{}", with_commas(loose),
                            loose == 1 ? "particle is" : "particles are",
                            !has_gravity ? ""
                            : loose == 1 ? ", and falls"
                                         : ", and fall");
    return text;
}

std::string leave_out_parts(VoxelGrid& grid, std::uint32_t group_bits, const PartsToKeep& keep,
                            const std::string& noun) {
    const Problem problem = make_lattice_problem(grid, group_bits);
    const BodyParts parts = parts_of(problem);
    std::size_t count = 0;
    const auto is_kept = [&](std::uint32_t part) {
        return keep.least == 0 ? part == 0 : parts.sizes[part] >= keep.least;
    };
    for (std::size_t i = 0; i < problem.particle_count(); ++i) {
        if (is_kept(parts.part_of(i))) continue;
        grid.label[problem.lattice.voxel[i]] = 0;
        ++count;
    }
    if (count == 0) return {};
    const auto left_out =
        std::size_t(std::count_if(parts.sizes.begin(), parts.sizes.end(), [&](const auto& size) {
            return !is_kept(std::uint32_t(&size - parts.sizes.data()));
        }));
    return fmt::format("{} {}{} in {} of {} parts {} left out (parts: {})", with_commas(count), noun,
                       count == 1 ? "" : "s", with_commas(left_out), with_commas(parts.sizes.size()),
                       count == 1 ? "is" : "are", keep.text());
}

}  // namespace voxspring
