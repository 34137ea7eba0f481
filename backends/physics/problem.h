// A scene's particles and springs, as all backends receive them.
#pragma once

#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <glm/vec3.hpp>
#include <optional>
#include <utility>
#include <vector>

namespace voxspring {

/// The spring groups of the paper: springs to the 6 face, 12 edge and 8 corner neighbours of a voxel.
enum class SpringGroup : std::uint8_t { face, edge, corner };

inline constexpr int neighbour_count = 26;

/// A direction from a voxel to one of its 26 neighbours: the voxel offset, and the mask bit that stands for
/// it.
struct Direction {
    int bit;
    glm::ivec3 offset;
    SpringGroup group;
};

/// All 26 directions in the order of neighbours.h. Element b has mask bit b.
const std::array<Direction, neighbour_count>& directions();

/// What a particle is made of. A lattice spring between two particles acts like half a spring of each
/// particle's `stiffness`, in series (spring.h). If a problem has only one material, Problem::group_stiffness
/// is used instead.
struct Material {
    double mass = 1;       ///< of one particle
    double stiffness = 1;  ///< force per length
};

/// A regular grid with particles at the centres of its active voxels. x is the fastest axis. If a network of
/// springs lies on no grid, dims are 0 and there are no masks.
struct Lattice {
    glm::ivec3 dims{0};                ///< voxels along x, y, z
    glm::dvec3 spacing{1};             ///< distance between voxel centres along x, y, z
    std::vector<std::uint32_t> voxel;  ///< per particle: index of its voxel, ascending
    std::vector<std::uint32_t> mask;   ///< per particle: neighbour, active and pinned bits (neighbours.h)

    std::size_t voxel_count() const {
        return std::size_t(dims.x) * std::size_t(dims.y) * std::size_t(dims.z);
    }
    glm::ivec3 coordinates(std::uint32_t voxel_index) const;
    /// The index of a voxel's neighbour in `direction` minus the index of the voxel. Only the mask says
    /// whether a spring leads to the neighbour.
    std::ptrdiff_t stride(const Direction& direction) const;
    /// The particles in the planes from z = `begin` to `end` (exclusive): the first, and the one after the
    /// last.
    std::pair<std::size_t, std::size_t> particles_between(int begin, int end) const;
    /// The first and the last layer across `axis` that has a particle; dims and 0 if there is no particle.
    std::pair<int, int> occupied_layers(int axis) const;
};

/// One undirected spring between particles `first` < `second`.
struct Spring {
    std::uint32_t first;
    std::uint32_t second;
    double stiffness;
    double rest_length;

    friend bool operator==(const Spring&, const Spring&) = default;
};

/// A tool that has taken hold of some particles. A spring of rest length 0 pulls each of them towards the
/// place where it would be if it had moved with the tool. If the tool has moved by d since it took hold
/// (ToolFacet::move_tool()), the force on a particle is
///
///     stiffness (held + d - u)
///
/// where u is the particle's displacement and `held` was its displacement when the tool took hold. The force
/// on the tool is minus the sum of these forces. The tool may hold pinned particles, and no cut frees the
/// particles that it holds.
struct Tool {
    std::vector<std::uint32_t> particles;  ///< ascending, each once; empty: there is no tool
    std::vector<glm::dvec3> held;          ///< per particle: displacement when the tool took hold; empty: 0
    double stiffness = 0;                  ///< of the spring to each held particle: force per length

    glm::dvec3 held_at(std::size_t n) const { return held.empty() ? glm::dvec3(0) : held[n]; }
};

/// Everything in a simulation that steps do not change. Particles on a lattice are in canonical order: active
/// voxels only, x fastest. Vectors that a scene does not need are empty, so that a backend can skip their
/// work.
struct Problem {
    std::vector<glm::dvec3> rest_position;  ///< one per particle
    std::vector<Material> materials{1};     ///< at least one
    std::vector<std::uint8_t> material;     ///< one per particle, index into `materials`; empty: 0 for all
    std::vector<std::uint8_t> pinned;       ///< one per particle, 1 = does not move; empty: none is pinned
    /// If the problem is a part of a body (layout/decomposition.h): the particles that other parts step,
    /// ascending. All of them are pinned.
    std::vector<std::uint32_t> ghosts;
    std::vector<glm::dvec3> load;  ///< one per particle, constant force; empty: none
    Tool tool;                     ///< if it holds particles, take_hold() has filled `load`

    Lattice lattice;
    /// Rest length of the lattice springs in each direction, by mask bit.
    std::array<double, neighbour_count> rest_length{};
    /// Stiffness of each spring group of the lattice, used if there is only one material.
    std::array<double, 3> group_stiffness{1, 1, 1};
    /// The mask bits of all directions of the spring groups in use. No mask has other neighbour bits.
    std::uint32_t group_bits = 0;

    /// Springs beyond the lattice: those between particles that are not neighbours in a direction in use,
    /// those whose stiffness is not that of a lattice spring (sutures, or springs of a scene with particles
    /// at corners), or all springs of a network without a lattice. Backends with implicit addressing refuse a
    /// problem that has any.
    std::vector<Spring> springs;

    glm::dvec3 gravity{0};  ///< acceleration
    double damping = 0;     ///< lambda of the integrator, 0 <= lambda < 2
    double time_step = 0;

    std::size_t particle_count() const { return rest_position.size(); }
    const Material& material_of(std::size_t particle) const {
        return materials[material.empty() ? 0 : material[particle]];
    }
    bool is_pinned(std::size_t particle) const { return !pinned.empty() && pinned[particle] != 0; }
    /// Whether there are several materials. If so, a lattice spring takes its stiffness from its two
    /// particles.
    bool has_materials() const { return !material.empty(); }
    bool has_gravity() const { return gravity != glm::dvec3(0); }
    bool has_tool() const { return !tool.particles.empty(); }
    /// Stiffness of the lattice spring from `particle` along `direction` to `neighbour`.
    double spring_stiffness(std::size_t particle, std::size_t neighbour, const Direction& direction) const;
    /// The shortest spacing of the lattice or, without a lattice, the shortest rest length that is not 0; 1
    /// if there is none.
    double shortest_spacing() const;
    /// The force of a spring is computed with at least this squared distance between its ends, so that
    /// coincident particles give no NaN (spring.h). It is (1e-6 shortest_spacing())^2.
    double shortest_squared() const;
};

/// How a spring lies at rest, seen from its end i; its other end is j. X: rest position.
struct RestSpring {
    glm::dvec3 offset{0};  ///< X_i - X_j
    double length = 0;     ///< l
    double deficit = 0;    ///< l^2 - |offset|^2; exactly 0 if l is the rounded |offset|
};
/// How a lattice spring from particle i to its neighbour j in `direction` lies at rest.
RestSpring rest_spring(const Problem& problem, const Direction& direction);
/// How `spring` lies at rest, seen from particle i = `spring.first`.
RestSpring rest_spring(const Problem& problem, const Spring& spring);

/// Numbers of undirected springs, each counted once.
struct SpringCounts {
    std::array<std::uint64_t, 3> group{};  ///< face, edge, corner
    std::uint64_t beyond = 0;              ///< size of Problem::springs
    std::uint64_t total() const { return group[0] + group[1] + group[2] + beyond; }
};
SpringCounts count_springs(const Problem& problem);

/// Lists every spring once: first lattice springs, ordered by `first` and then by direction; then springs
/// beyond the lattice.
std::vector<Spring> list_springs(const Problem& problem);
/// How the springs of list_springs() lie at rest, in the same order. For a lattice spring the offset follows
/// from its direction, not from positions.
std::vector<RestSpring> list_rest_springs(const Problem& problem);

/// Stands for the particle of a voxel that has none.
inline constexpr std::uint32_t no_particle = 0xFFFFFFFFu;
/// The particle in each voxel, or `no_particle`.
std::vector<std::uint32_t> particle_of_voxel(const Lattice& lattice);

/// Calls visit(direction) for each neighbour bit that is set in `mask`, in the order of neighbours.h.
template <class Visit>
void visit_directions(std::uint32_t mask, Visit visit) {
    constexpr std::uint32_t neighbour_bits = (1U << neighbour_count) - 1;
    const auto& by_bit = directions();
    for (std::uint32_t bits = mask & neighbour_bits; bits != 0; bits &= bits - 1)
        visit(by_bit[std::size_t(std::countr_zero(bits))]);
}

/// Visits the springs of a lattice one by one. A list of them would take up to 31 GB at 10^8 particles.
/// Without a lattice it visits none.
class LatticeSprings {
public:
    explicit LatticeSprings(const Problem& problem);

    /// The particle in each voxel, or `no_particle`.
    const std::vector<std::uint32_t>& particle_by_voxel() const { return particle_; }

    /// Calls visit(j, direction) for each spring from i to a later particle j (j > i), in the order of
    /// list_springs().
    template <class Visit>
    void of(std::size_t i, Visit visit) const {
        visit_neighbours(i, later_bits, visit);
    }
    /// Calls visit(j, direction) for each spring from particle i to a particle j, in the order of
    /// neighbours.h.
    template <class Visit>
    void all_of(std::size_t i, Visit visit) const {
        visit_neighbours(i, all_bits, visit);
    }

private:
    // Mask bits: all 26 neighbours, and those 13 that come later in canonical order (odd bits).
    static constexpr std::uint32_t all_bits = 0x03FFFFFF, later_bits = 0x02AAAAAA;

    template <class Visit>
    void visit_neighbours(std::size_t i, std::uint32_t wanted, Visit visit) const {
        const Lattice& lattice = problem_->lattice;
        if (lattice.mask.empty()) return;
        visit_directions(lattice.mask[i] & wanted, [&](const Direction& direction) {
            const std::ptrdiff_t voxel =
                std::ptrdiff_t(lattice.voxel[i]) + stride_[std::size_t(direction.bit)];
            visit(particle_[std::size_t(voxel)], direction);
        });
    }

    const Problem* problem_;
    std::vector<std::uint32_t> particle_;
    std::array<std::ptrdiff_t, neighbour_count> stride_{};
};

/// What steps change: the displacements and increments of all particles, in float64 and canonical order. A
/// backend that stores each displacement as one number per axis can return it without loss.
struct State {
    // One element per particle. An empty list stands for zeros and takes no memory.
    std::vector<glm::dvec3> displacement;  ///< x(t) - rest position
    std::vector<glm::dvec3> increment;     ///< x(t) - x(t - dt)

    glm::dvec3 displacement_of(std::size_t particle) const {
        return displacement.empty() ? glm::dvec3(0) : displacement[particle];
    }
    glm::dvec3 increment_of(std::size_t particle) const {
        return increment.empty() ? glm::dvec3(0) : increment[particle];
    }
    /// This state with both lists filled in: each has one element for each of `particles` particles.
    State in_full(std::size_t particles) const;
};

/// The state in which all particles are at their rest position and do not move. Displacement
/// and increment have one element per particle.
State state_at_rest(const Problem& problem);

/// The input of make_lattice_problem(): labels of a voxel grid.
struct VoxelGrid {
    glm::ivec3 dims{0};
    glm::dvec3 spacing{1};
    /// One per voxel, x fastest: 0 = inactive, m + 1 = material m.
    std::vector<std::uint8_t> label;
};

/// Makes particles at the centres of the active voxels, and springs between neighbours of the groups in
/// `group_bits`. The caller fills in materials, pins, loads, gravity, damping and time step. For pins it
/// calls pin(), which changes both Problem::pinned and the masks.
Problem make_lattice_problem(const VoxelGrid& grid, std::uint32_t group_bits);

/// Pins the particles for which `pinned` (one per particle) is not zero, and no others.
void pin(Problem& problem, std::vector<std::uint8_t> pinned);

/// Gives the problem a tool and, if it has no loads, loads of zero. A step adds the tool's forces to the
/// loads, so a problem without a tool needs no extra work.
void take_hold(Problem& problem, Tool tool);

}  // namespace voxspring
