// A scene's particles and springs, as all backends receive them.
#pragma once

#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <glm/vec3.hpp>
#include <optional>
#include <vector>

namespace voxspring {

/// Spring groups of the paper: 6 face, 12 edge and 8 corner neighbours.
enum class SpringGroup : std::uint8_t { face, edge, corner };

inline constexpr int neighbour_count = 26;

/// One direction of the stencil: the voxel offset that mask bit `bit` stands for.
struct Direction {
    int bit;
    glm::ivec3 offset;
    SpringGroup group;
};

/// All 26 directions in summation order, from neighbours.h; element b is mask bit b.
const std::array<Direction, neighbour_count>& directions();

/// What a particle is made of. A spring between two materials has the `stiffness` of two half springs in
/// series (spring.h). `stiffness` is unused if the problem has one per spring group.
struct Material {
    double mass = 1;       ///< of one particle
    double stiffness = 1;  ///< force per length
};

/// A regular grid with particles at the centres of its active voxels. x is the fastest axis. A network that
/// lies on no grid has dims 0 and no masks.
struct Lattice {
    glm::ivec3 dims{0};                ///< voxels along x, y, z
    glm::dvec3 spacing{1};             ///< distance between voxel centres along x, y, z
    std::vector<std::uint32_t> voxel;  ///< per particle: index of its voxel, ascending
    std::vector<std::uint32_t> mask;   ///< per particle: neighbour, active and pinned bits (neighbours.h)

    std::size_t voxel_count() const {
        return std::size_t(dims.x) * std::size_t(dims.y) * std::size_t(dims.z);
    }
    glm::ivec3 coordinates(std::uint32_t voxel_index) const;
    /// Offset of a direction in voxel indices. Only the mask says whether the neighbour exists.
    std::ptrdiff_t stride(const Direction& direction) const;
};

/// One undirected spring between particles `first` < `second`.
struct Spring {
    std::uint32_t first;
    std::uint32_t second;
    double stiffness;
    double rest_length;

    friend bool operator==(const Spring&, const Spring&) = default;
};

/// A tool that has taken hold of some particles, each with a spring of rest length 0 to the place to which
/// the tool has carried the particle. If the tool has moved by d since then (Backend::move_tool()), the force
/// on a particle is
///
///     stiffness (held + d - u)
///
/// where u is its displacement and `held` is what the displacement was when the tool took hold. The force on
/// the tool is minus the sum of these. A cut does not separate the tool from what it holds, and it may hold
/// pinned particles.
struct Tool {
    std::vector<std::uint32_t> particles;  ///< ascending, each once; empty: there is no tool
    std::vector<glm::dvec3> held;          ///< one per particle; empty: all were at rest
    double stiffness = 0;                  ///< stiffness of each of these springs: force per length

    glm::dvec3 held_at(std::size_t n) const { return held.empty() ? glm::dvec3(0) : held[n]; }
};

/// Everything that does not change while a simulation runs. Particles are in canonical order: active voxels
/// only, x fastest. Vectors that a scene does not need are empty, so that a backend can skip the work for
/// them.
struct Problem {
    std::vector<glm::dvec3> rest_position;  ///< one per particle
    std::vector<Material> materials{1};     ///< at least one
    std::vector<std::uint8_t>
        material;                      ///< one per particle, index into `materials`; empty: all materials[0]
    std::vector<std::uint8_t> pinned;  ///< one per particle, 1 = does not move; empty: none is pinned
    /// Ghost particles of a part of a body (layout/decomposition.h), which another part steps. They ascend
    /// and are pinned.
    std::vector<std::uint32_t> ghosts;
    std::vector<glm::dvec3> load;  ///< one per particle, constant force; empty: none
    Tool tool;                     ///< if it holds particles, `load` is not empty (take_hold())

    Lattice lattice;
    /// Rest length of each direction of the lattice, by mask bit.
    std::array<double, neighbour_count> rest_length{};
    /// Stiffness of each spring group of the lattice, used while there is one material.
    std::array<double, 3> group_stiffness{1, 1, 1};
    /// The mask bits of the groups that are in use. No mask has a neighbour bit that is not in it.
    std::uint32_t group_bits = 0;

    /// Springs beyond the lattice: sutures between particles that are no grid neighbours, or all springs of
    /// an unstructured network. Backends with implicit addressing refuse a problem that has any.
    std::vector<Spring> springs;

    glm::dvec3 gravity{0};  ///< acceleration
    double damping = 0;     ///< lambda of the integrator, 0 <= lambda < 2
    double time_step = 0;

    std::size_t particle_count() const { return rest_position.size(); }
    const Material& material_of(std::size_t particle) const {
        return materials[material.empty() ? 0 : material[particle]];
    }
    bool is_pinned(std::size_t particle) const { return !pinned.empty() && pinned[particle] != 0; }
    /// Whether there are several materials: springs then take their stiffness from the two particles they
    /// join.
    bool has_materials() const { return !material.empty(); }
    bool has_gravity() const { return gravity != glm::dvec3(0); }
    bool has_tool() const { return !tool.particles.empty(); }
    /// Stiffness of the lattice spring from `particle` along `direction` to `neighbour`.
    double spring_stiffness(std::size_t particle, std::size_t neighbour, const Direction& direction) const;
    /// The least |d|^2 that a spring's force is computed with, so that coincident particles give no NaN
    /// (spring.h): (1e-6 of the shortest spacing, or of the shortest spring of an unstructured network)^2.
    double shortest_squared() const;
};

/// A spring at rest, as the particle i at one end sees the particle j at the other.
struct RestSpring {
    glm::dvec3 offset{0};  ///< X_i - X_j
    double length = 0;     ///< l
    double deficit = 0;    ///< l^2 - |offset|^2; exactly 0 if l is the rounded |offset|
};
/// i is a particle of the lattice, and j is its neighbour in `direction`.
RestSpring rest_spring(const Problem& problem, const Direction& direction);
/// i is `spring.first`.
RestSpring rest_spring(const Problem& problem, const Spring& spring);

/// Numbers of undirected springs, each counted once.
struct SpringCounts {
    std::array<std::uint64_t, 3> group{};  ///< face, edge, corner
    std::uint64_t beyond = 0;              ///< of Problem::springs
    std::uint64_t total() const { return group[0] + group[1] + group[2] + beyond; }
};
SpringCounts count_springs(const Problem& problem);

/// Every spring once: those of the lattice by `first`, then by direction; then those beyond the lattice.
std::vector<Spring> list_springs(const Problem& problem);
/// The springs of list_springs() at rest, in that order. At rest a lattice spring lies along its direction.
std::vector<RestSpring> list_rest_springs(const Problem& problem);

/// The particle in each voxel, or `no_particle`.
inline constexpr std::uint32_t no_particle = 0xFFFFFFFFu;
std::vector<std::uint32_t> particle_of_voxel(const Lattice& lattice);

/// Calls visit(direction) for each neighbour bit of `mask`, in the order of neighbours.h.
template <class Visit>
void visit_directions(std::uint32_t mask, Visit visit) {
    constexpr std::uint32_t neighbour_bits = (1U << neighbour_count) - 1;
    const auto& by_bit = directions();
    for (std::uint32_t bits = mask & neighbour_bits; bits != 0; bits &= bits - 1)
        visit(by_bit[std::size_t(std::countr_zero(bits))]);
}

/// The springs of a lattice, visited without a list, which at 10^8 particles would fit into no memory. A
/// network without a lattice has none.
class LatticeSprings {
public:
    explicit LatticeSprings(const Problem& problem);

    /// The particle in each voxel, or `no_particle`.
    const std::vector<std::uint32_t>& particle_by_voxel() const { return particle_; }

    /// Calls visit(j, direction) for each spring between particle i and a later one j, in the order of
    /// list_springs().
    template <class Visit>
    void of(std::size_t i, Visit visit) const {
        visit_neighbours(i, later_bits, visit);
    }
    /// Visits each neighbour j of particle i, in the order of neighbours.h.
    template <class Visit>
    void all_of(std::size_t i, Visit visit) const {
        visit_neighbours(i, all_bits, visit);
    }

private:
    // Mask bits: all 26 neighbours, and the neighbours that come later in canonical order (odd bits).
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

/// The moving part of a simulation, in float64 and canonical order. A backend that keeps displacements can
/// return them without loss.
struct State {
    // One per particle. Empty: all are zero, which takes no memory.
    std::vector<glm::dvec3> displacement;  ///< x(t) - rest position
    std::vector<glm::dvec3> increment;     ///< x(t) - x(t - dt)

    glm::dvec3 displacement_of(std::size_t particle) const {
        return displacement.empty() ? glm::dvec3(0) : displacement[particle];
    }
    glm::dvec3 increment_of(std::size_t particle) const {
        return increment.empty() ? glm::dvec3(0) : increment[particle];
    }
    /// This state without empty lists: both have one element for each of `particles` particles.
    State in_full(std::size_t particles) const;
};

/// All particles at their rest position and at rest, with one element per particle in both lists.
State state_at_rest(const Problem& problem);

/// The input of make_lattice_problem: labels of a voxel grid.
struct VoxelGrid {
    glm::ivec3 dims{0};
    glm::dvec3 spacing{1};
    /// One per voxel, x fastest: 0 = inactive, m + 1 = material m.
    std::vector<std::uint8_t> label;
};

/// Makes particles at the centres of the active voxels and springs to the active neighbours of the chosen
/// groups. The caller fills in materials, pins, loads, gravity, damping and time step; for pins it calls
/// pin(), which keeps masks and list consistent.
Problem make_lattice_problem(const VoxelGrid& grid, std::uint32_t group_bits);

/// Pins the particles for which `pinned` (one per particle) is not zero.
void pin(Problem& problem, std::vector<std::uint8_t> pinned);

/// Gives the problem a tool, and loads of zero if it has none. A step adds the tool's forces to the loads, so
/// a problem without a tool pays nothing for it.
void take_hold(Problem& problem, Tool tool);

}  // namespace voxspring
