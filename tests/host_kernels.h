// Runs the bodies of CUDA kernels on the host, with every block, thread, list and mask of a step as on the
// device, and checks each access against its array.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <limits>
#include <memory>
#include <optional>
#include <span>
#include <stdexcept>
#include <utility>
#include <vector>

#include "backends/layout/blocks.h"
#include "backends/layout/delta_lists.h"
#include "backends/layout/neighbour_lists.h"
#include "backends/layout/particles.h"
#include "backends/layout/spring_array.h"
#include "backends/layout/springs.h"
#include "backends/layout/vectors.h"
#include "cuda/kernels/border.h"
#include "cuda/kernels/delta.h"
#include "cuda/kernels/explicit.h"
#include "cuda/kernels/implicit.h"
#include "cuda/kernels/scatter.h"
#include "cuda/kernels/tool.h"

namespace voxspring::cuda {

/// Element `index` of `values`, which a kernel reads through a pointer on the device.
template <class T>
const T& checked(const std::vector<T>& values, std::ptrdiff_t index) {
    if (index < 0 || std::size_t(index) >= values.size()) throw std::out_of_range("read outside of an array");
    return values[std::size_t(index)];
}

template <class Real>
struct HostFetch {
    const std::vector<ParticleRecord<Real>>* words;
    const NeighbourLists<Real>* lists = nullptr;

    Particle<Real> at(int index, int dx) const {
        const ParticleRecord<Real>& word = checked(*words, std::ptrdiff_t(index) + dx);
        return {word.position, word.particle_bits()};
    }
    std::uint32_t entry(const std::uint32_t* p) const {
        return lists == nullptr ? *p : checked(lists->neighbour, p - lists->neighbour.data());
    }
    FourDeltas entry(const FourDeltas* p) const { return *p; }
    Slice entry(const Slice* p) const { return *p; }
    SpringConstants<Real> entry(const SpringConstants<Real>* p) const {
        return lists == nullptr ? *p : checked(lists->constants, p - lists->constants.data());
    }
    SpringEnds entry(const SpringEnds* p) const { return *p; }
};

/// A precision and a formulation.
template <class Scalar, Formulation f>
struct Variant {
    using Real = Scalar;
    static constexpr Formulation formulation = f;
    static constexpr bool split = f == Formulation::compensated;
    /// Every term compiled in and requested at run time.
    using AllTerms =
        KernelTerms<f, NEIGHBOUR_BITS, all_terms | term_off_lattice_rests | term_off_lattice_springs, true>;
    /// The terms that a scene of the paper's two groups needs: `terms`.
    template <std::uint32_t terms>
    using Needed = KernelTerms<f, FACE_BITS | EDGE_BITS, terms, false>;
    /// AllTerms, with no neighbour fetched before its bit is tested.
    using BitByBit = KernelTerms<f, NEIGHBOUR_BITS, all_terms | term_bit_by_bit, true>;
    /// AllTerms, with blocks at rest left out, and `terms`.
    template <std::uint32_t terms>
    using Resting = KernelTerms<f, NEIGHBOUR_BITS, all_terms | term_resting | terms, true>;
};

template <class Real>
void measure(std::span<Real> lengths, Formulation formulation) {
    if (by_increments(formulation)) return;
    for (Real& length : lengths) length = length > 0 ? measured_length(length) : 0;
}

template <class Real>
void measure(std::vector<SpringConstants<Real>>& springs, Formulation formulation) {
    if (by_increments(formulation)) return;
    for (auto& spring : springs)
        spring.rest_length = spring.rest_length > 0 ? measured_length(spring.rest_length) : 0;
}

/// Null if there are no values.
template <class Values>
auto data_of(Values& values) {
    return values.empty() ? nullptr : values.data();
}

/// Which of the kernels that are compiled a simulation uses.
enum class Kernel : std::uint8_t {
    needed,      ///< has the terms of kernel_for()
    interior,    ///< has these terms, and needs no masks where no neighbour is missing
    general,     ///< tests every term at run time
    bit_by_bit,  ///< fetches no neighbour before it has tested its bit
    resting,     ///< leaves out blocks at rest
    flushing     ///< leaves out blocks at rest, with a flush
};

/// `needed` if the problem has damping, gravity and the paper's two groups and nothing else, as most do here.
inline Kernel kernel_for(const Problem& problem) {
    const bool has_common_terms = problem.group_bits == (FACE_BITS | EDGE_BITS) &&
                                  terms_of(problem) == (term_damping | term_gravity) &&
                                  problem.springs.empty();
    return has_common_terms ? Kernel::needed : Kernel::general;
}

/// Calls step(Terms) with what is compiled for that kernel.
template <class V, class Step>
void with_terms(Kernel kernel, Step step) {
    if (kernel == Kernel::interior) {
        step(typename V::template Needed<term_damping | term_gravity | term_full_stencil>{});
    } else if (kernel == Kernel::needed) {
        step(typename V::template Needed<term_damping | term_gravity>{});
    } else {
        step(typename V::AllTerms{});
    }
}

/// State and arrays that all simulations share: words, loads and masses, and the two buffers that steps swap.
template <class V>
class Simulation {
public:
    using Real = typename V::Real;
    using Current = Reader<Real, V::split, HostFetch<Real>>;

    Simulation(const Problem& problem, const State& start, const Placement& placement,
               std::span<const std::uint32_t> bits)
        : kernel_(kernel_for(problem)),
          problem_(&problem),
          placement_(placement),
          packed_(pack<Real>(problem, start, placement, bits, V::formulation)),
          load_(pack_load<Real>(problem, placement)),
          held_(pack_held<Real>(problem, placement, V::formulation)),
          held_forces_(held_.size()),
          inverse_masses_(pack_inverse_masses<Real>(problem, placement)) {
        if (packed_.previous.empty()) packed_.previous.resize(placement.words);
        next_low_.resize(packed_.current_low.size());
    }
    virtual ~Simulation() = default;

    void use(Kernel kernel) { kernel_ = kernel; }
    void step(int count) {
        for (int n = 0; n < count; ++n) {
            use_tool();
            launch();
            turn();
        }
    }
    /// Makes steps run in two parts, one of which has the particles `border`. Returns how many blocks are
    /// left to the other part.
    virtual std::size_t split(const std::vector<std::uint32_t>& /*border*/) { return 0; }
    /// Runs one part of such a step, the border's part first. Between the two parts places() returns those
    /// after the step.
    void step_part(StepPart part) {
        part_ = part;
        if (part == StepPart::border) {
            use_tool();
        } else {
            turn();
        }
        launch();
        turn();
        part_.reset();
    }
    void move_tool(const glm::dvec3& displacement) { tool_.moved = vector_of<Real>(displacement); }
    glm::dvec3 tool_force() const { return force_on_tool(held_forces_); }
    /// Places in the backend's layout.
    BorderPlaces<Real> places(const std::vector<std::uint32_t>& elements) {
        Real* const low = packed_.current_low.empty() ? nullptr : &packed_.current_low[0].position.x;
        return {elements.data(),
                elements.size(),
                &packed_.current[0].position.x,
                low,
                sizeof(ParticleRecord<Real>) / sizeof(Real),
                1};
    }
    std::vector<std::uint32_t> elements_of(const std::vector<std::uint32_t>& particles) const {
        std::vector<std::uint32_t> words;
        for (const std::uint32_t i : particles) words.push_back(std::uint32_t(placement_.at(i)));
        return words;
    }
    State download() const { return unpack<Real>(*problem_, packed_, placement_, V::formulation); }

    /// Sets words without a particle to NaN.
    void poison() {
        for (auto* buffer : {&packed_.current, &packed_.previous, &packed_.current_low, &next_low_}) {
            for (std::size_t i = 0; i < buffer->size(); ++i) {
                const Real nan = std::numeric_limits<Real>::quiet_NaN();
                if (packed_.current[i].bits == 0) (*buffer)[i].position = {nan, nan, nan};
            }
        }
    }

protected:
    void write_bits(std::uint32_t particle, std::uint32_t bits) {
        packed_.current[placement_.at(particle)].bits = ParticleRecord<Real>::with(bits);
    }
    void attach(Motion<Real>& motion) const {
        motion.load = data_of(load_);
        motion.inverse_masses = data_of(inverse_masses_);
    }
    const Problem& problem() const { return *problem_; }
    /// Calls visit(block) for the blocks of the current step: `all`, or one of the `parts`.
    template <class Block, class Visit>
    void for_each_block(const std::vector<Block>& all, const BlockParts<Block>& parts, Visit visit) const {
        const auto begin =
            part_ ? parts.blocks.begin() + std::ptrdiff_t(parts.begin_of(*part_)) : all.begin();
        const auto end = part_ ? begin + std::ptrdiff_t(parts.count_of(*part_)) : all.end();
        std::for_each(begin, end, visit);
    }
    /// A step that only checks for rest and stores nothing. What the first step then leaves out is in both
    /// buffers, as uploaded.
    void launch_look() {
        if (by_increments(V::formulation)) packed_.previous = packed_.current;
        if (V::split) next_low_ = packed_.current_low;
        launch();
    }
    virtual const NeighbourLists<Real>* lists() const { return nullptr; }
    virtual void step_once(const Current& current, const Output<Real>& output) = 0;

    Kernel kernel_;

private:
    void launch() {
        const HostFetch<Real> high{&packed_.current, lists()}, low{&packed_.current_low, lists()};
        step_once(Current{high, low}, {packed_.previous.data(), next_low_.data(), packed_.increment.data(),
                                       packed_.increment_low.data(), increment_pitch(placement_)});
    }
    void turn() {
        std::swap(packed_.current, packed_.previous);
        std::swap(packed_.current_low, next_low_);
    }
    void use_tool() {
        tool_.stiffness = Real(problem_->tool.stiffness);
        const Holding<Real> holding{
            held_.data(), held_.size(),       &tool_, packed_.current.data(), data_of(packed_.current_low),
            load_.data(), held_forces_.data()};
        for (std::size_t n = 0; n < held_.size(); ++n) pull_held(holding, n);
    }

    const Problem* problem_;
    Placement placement_;
    PackedState<Real> packed_;
    std::vector<ParticleRecord<Real>> next_low_;
    std::vector<Vector<Real>> load_;
    std::vector<HeldWord<Real>> held_;
    std::vector<HeldForce<Real>> held_forces_;
    ToolState<Real> tool_{};
    std::vector<Real> inverse_masses_;
    std::optional<StepPart> part_;  ///< that is being stepped; none: the whole
};

/// All blocks of an implicit kernel.
template <class V>
class ImplicitSimulation : public Simulation<V> {
public:
    using typename Simulation<V>::Real;
    using typename Simulation<V>::Current;

    ImplicitSimulation(const Problem& problem, const State& start, BlockShape shape)
        : Simulation<V>(problem, start, place_on_grid(problem.lattice), problem.lattice.mask),
          shape_(shape),
          compliance_(pack_compliance<Real>(problem, place_on_grid(problem.lattice))),
          step_(make_implicit_step<Real>(problem, place_on_grid(problem.lattice), V::formulation)),
          block_grid_(problem.lattice, shape),
          origins_(occupied_blocks(problem.lattice, shape)) {
        measure<Real>(step_.rest_length, V::formulation);
        step_.compliance = data_of(compliance_);
        this->attach(step_.motion);
        if (origins_.empty()) cover_the_lattice();
    }

    /// Every block of the lattice, active voxels or not.
    void cover_the_lattice() {
        origins_.clear();
        for (int z = 0; z < step_.nz; z += shape_.z) {
            for (int y = 0; y < step_.ny; y += shape_.y) {
                for (int x = 0; x < step_.nx; x += shape_.x) origins_.push_back({x, y, z, 0});
            }
        }
    }

    std::size_t split(const std::vector<std::uint32_t>& border) override {
        parts_ = part_blocks(this->problem().lattice, shape_, border);
        return parts_.count_of(StepPart::interior);
    }

    /// Uses a kernel that leaves out blocks at rest. The first step takes every block.
    void leave_out_resting(Kernel kernel = Kernel::resting) {
        this->use(kernel);
        const std::vector<BlockOrigin> all = list_blocks(this->problem().lattice, shape_);
        // Each list ends with a guard word.
        for (auto& list : lists_) list.assign(all.size() + 1, {-1, -1, -1, -1});
        for (auto& marks : marks_) {
            marks.assign(block_grid_.places(), 1);
            for (const BlockOrigin& block : all) marks[std::size_t(block.place)] = 0;
        }
        std::copy(all.begin(), all.end(), lists_[0].begin());
        for (const BlockOrigin& block : all) marks_[0][std::size_t(block.place)] = 1;
        counts_ = {unsigned(all.size()), 0};
        blocks_ = all.size();
    }
    /// The first step takes the blocks that a check of all blocks lists.
    void look_first() {
        step_.active.only_checks = true;
        this->launch_look();
        step_.active.only_checks = false;
    }
    /// The number of blocks that the latest step took.
    std::size_t blocks_stepped() const { return taken_; }
    std::size_t blocks() const { return blocks_; }

protected:
    template <class Terms>
    void step_blocks(const Current& current, const Output<Real>& output) {
        this->for_each_block(origins_, parts_, [&](const BlockOrigin& o) {
            for (int z = 0; z < shape_.z; ++z) {
                for (int y = 0; y < shape_.y; ++y) {
                    for (int x = 0; x < shape_.x; ++x)
                        step_from_memory<Terms>(step_, o.x + x, o.y + y, o.z + z, current, output);
                }
            }
        });
    }

    template <class Terms>
    void step_active_blocks(const Current& current, const Output<Real>& output) {
        const ActiveBlocks active{int(block_grid_.row()),
                                  int(block_grid_.slice()),
                                  lists_[0].data(),
                                  lists_[1].data(),
                                  &counts_[0],
                                  &counts_[1],
                                  marks_[0].data(),
                                  marks_[1].data(),
                                  nullptr,
                                  nullptr,
                                  step_.active.only_checks};
        taken_ = counts_[0];
        for (std::size_t b = 0; b < taken_; ++b) {
            const BlockOrigin& o = lists_[0][b];
            bool changed = false;
            for (int thread = 0; thread < shape_.x * shape_.y * shape_.z; ++thread) {
                const int x = thread % shape_.x, y = thread / shape_.x % shape_.y,
                          z = thread / shape_.x / shape_.y;
                changed =
                    step_from_memory<Terms>(step_, o.x + x, o.y + y, o.z + z, current, output) || changed;
            }
            list_for_next_step(active, o, shape_.x, shape_.y, shape_.z, changed);
        }
        counts_[0] = 0;
        for (const auto& list : lists_) {
            if (list.back().place != -1) throw std::out_of_range("more blocks are listed than there are");
        }
        std::swap(lists_[0], lists_[1]);
        std::swap(marks_[0], marks_[1]);
        std::swap(counts_[0], counts_[1]);
    }

    void step_once(const Current& current, const Output<Real>& output) override {
        switch (this->kernel_) {
            case Kernel::resting:
                return step_active_blocks<typename V::template Resting<0>>(current, output);
            case Kernel::flushing:
                return step_active_blocks<typename V::template Resting<term_flush>>(current, output);
            case Kernel::bit_by_bit:
                return step_blocks<typename V::BitByBit>(current, output);
            default:
                with_terms<V>(this->kernel_,
                              [&]<class Terms>(Terms) { step_blocks<Terms>(current, output); });
        }
    }

    BlockShape shape_;
    std::vector<Real> compliance_;
    ImplicitStep<Real> step_;
    BlockGrid block_grid_;
    std::vector<BlockOrigin> origins_;
    BlockParts<BlockOrigin> parts_;
    // Lists, marks and counts for the current step and for the next.
    std::array<std::vector<BlockOrigin>, 2> lists_;
    std::array<std::vector<std::uint32_t>, 2> marks_;
    std::array<unsigned, 2> counts_{};
    std::size_t taken_ = 0, blocks_ = 0;
};

/// Implicit steps through a tile, which starts as NaN: if a thread needs a value that no thread has loaded,
/// NaN shows it.
template <class V, int W, int H>
class TileSimulation final : public ImplicitSimulation<V> {
public:
    using typename Simulation<V>::Real;
    using typename Simulation<V>::Current;

    TileSimulation(const Problem& problem, const State& start)
        : ImplicitSimulation<V>(problem, start, BlockShape{W, H, 1}) {}

private:
    void step_once(const Current& current, const Output<Real>& output) override {
        const ImplicitStep<Real>& step = this->step_;
        const int row = step.nx, slice = step.nx * step.ny;
        using TileOfBlock = Tile<Real, V::split, W, H>;
        auto tile = std::make_unique<TileOfBlock>();
        this->for_each_block(this->origins_, this->parts_, [&](const BlockOrigin& o) {
            std::fill_n(&tile->axis[0][0][0][0], sizeof(TileOfBlock) / sizeof(Real),
                        std::numeric_limits<Real>::quiet_NaN());
            std::array<Self<Real, V::split>, std::size_t(W) * H> selves{};
            const auto for_each_thread = [&](auto visit) {
                for (int ty = 0; ty < H; ++ty) {
                    for (int tx = 0; tx < W; ++tx) {
                        const int x = o.x + tx, y = o.y + ty;
                        if (x < step.nx && y < step.ny)
                            visit(tx, ty, step.first + x + row * y + slice * o.z,
                                  selves[std::size_t(ty * W + tx)]);
                    }
                }
            };
            for_each_thread([&](int tx, int ty, int index, auto& self) {
                self = tile->fill(tx, ty, index, row, slice, current);
            });
            const auto step_each = [&]<class Terms>(Terms) {
                for_each_thread([&](int tx, int ty, int index, const auto& self) {
                    step_voxel<Terms>(step, index, self, output,
                                      TileNeighbours<Real, V::split, W, H>{*tile, tx, ty},
                                      GridCompliance<Real>{step.compliance, index, row, slice});
                });
            };
            if (this->kernel_ == Kernel::bit_by_bit) {
                step_each(typename V::BitByBit{});
            } else {
                step_each(typename V::AllTerms{});
            }
        });
    }
};

/// A simulation whose blocks take the particles in their order; the last block has threads without one.
template <class V>
class ParticleSimulation : public Simulation<V> {
public:
    using Simulation<V>::Simulation;

    std::size_t split(const std::vector<std::uint32_t>& border) override {
        parts_ = part_blocks(this->problem().particle_count(), width, border);
        return parts_.count_of(StepPart::interior);
    }

protected:
    /// Calls visit(particle) for the threads of the current step.
    template <class Visit>
    void for_each_thread(Visit visit) const {
        this->for_each_block(all_, parts_, [&](std::uint32_t block) {
            for (unsigned thread = 0; thread < width; ++thread) visit(int(block * width + thread));
        });
    }

private:
    static constexpr unsigned width = 32;
    const std::vector<std::uint32_t> all_ = part_blocks(this->problem().particle_count(), width, {}).blocks;
    BlockParts<std::uint32_t> parts_;
};

/// All threads of an explicit kernel.
template <class V>
class ExplicitSimulation final : public ParticleSimulation<V> {
public:
    using typename Simulation<V>::Real;
    using typename Simulation<V>::Current;

    ExplicitSimulation(const Problem& problem, const State& start, NeighbourLists<Real> lists)
        : ParticleSimulation<V>(problem, start, place_compact(problem), lists.bits),
          lists_(std::move(lists)),
          step_(make_explicit_step<Real>(problem, lists_, V::formulation)) {
        measure<Real>(step_.rest_length, V::formulation);
        measure(lists_.constants, V::formulation);
        step_.neighbour = lists_.neighbour.data();
        step_.constants = lists_.constants.data();
        step_.off_lattice_rest = data_of(lists_.off_lattice_rest);
        this->attach(step_.motion);
    }

    /// Uses the paper's rows.
    void use_rows() {
        const std::size_t entries = lists_.neighbour.size();
        put_rows_ahead(lists_);
        step_.neighbour = lists_.neighbour.data() + (lists_.neighbour.size() - entries);
        rows_ = true;
    }

private:
    const NeighbourLists<Real>* lists() const override { return &lists_; }

    void step_once(const Current& current, const Output<Real>& output) override {
        with_terms<V>(this->kernel_, [&]<class Terms>(Terms) {
            this->for_each_thread([&](int i) {
                if (rows_ && !lists_.constants.empty()) {
                    step_by_rows<Terms, true>(step_, i, current, output);
                } else if (rows_) {
                    step_by_rows<Terms, false>(step_, i, current, output);
                } else if (!lists_.constants.empty()) {
                    step_by_springs<Terms>(step_, i, current, output);
                } else {
                    step_by_groups<Terms>(step_, i, current, output);
                }
            });
        });
    }

    bool rows_ = false;
    NeighbourLists<Real> lists_;
    ExplicitStep<Real> step_;
};

/// All threads of a kernel that uses delta-compressed lists.
template <class V>
class DeltaSimulation final : public ParticleSimulation<V> {
public:
    using typename Simulation<V>::Real;
    using typename Simulation<V>::Current;

    /// `interior`: whether it has a way without masks.
    DeltaSimulation(const Problem& problem, const State& start, bool interior = false)
        : ParticleSimulation<V>(problem, start, place_guarded(problem),
                                problem.lattice.mask.empty() ? state_bits(problem) : problem.lattice.mask),
          interior_(interior && problem.springs.empty()),
          compliance_(pack_compliance<Real>(problem, place_guarded(problem))),
          lists_(compress_lists(problem)),
          own_(problem, place_guarded(problem), V::formulation, lists_.slices),
          step_(make_delta_step<Real>(problem, place_guarded(problem), V::formulation)) {
        measure<Real>(step_.rest_length, V::formulation);
        step_.compliance = data_of(compliance_);
        step_.slices = lists_.slices.data();
        step_.lists = lists_.lists.data();
        this->attach(step_.motion);
        this->poison();
    }

    /// Edits between steps, as the backend does.
    void edit(const Problem& edited, const SpringEdit& edit) {
        for (const SpringEdit::Touched& touched : edit.touched)
            this->write_bits(touched.particle, touched.mask);
        own_.change(edited, edit, lists_.slices);
        if (own_.empty()) return;
        this->use(Kernel::general);
        interior_ = false;
    }

private:
    void step_once(const Current& current, const Output<Real>& output) override {
        std::vector<SpringConstants<Real>> constants(own_.constants().begin(), own_.constants().end());
        measure(constants, V::formulation);
        step_.off_lattice_neighbour = own_.empty() ? nullptr : own_.neighbour().data();
        step_.off_lattice_constants = constants.data();
        step_.off_lattice_rest = own_.off_lattice_rest().data();
        const auto step_all = [&]<class Terms>(Terms) {
            this->for_each_thread([&](int i) { step_by_deltas<Terms>(step_, i, current, output); });
        };
        constexpr std::uint32_t terms = term_damping | term_gravity | term_full_stencil;
        if (interior_ && step_.group_bits == EDGE_BITS) {
            step_all(KernelTerms<V::formulation, EDGE_BITS, terms, false>{});
        } else if (interior_ && step_.group_bits == CORNER_BITS) {
            step_all(KernelTerms<V::formulation, CORNER_BITS, terms, false>{});
        } else {
            const bool full = interior_ && this->kernel_ == Kernel::needed;
            with_terms<V>(full ? Kernel::interior : this->kernel_, step_all);
        }
    }

    bool interior_;
    std::vector<Real> compliance_;
    DeltaLists lists_;
    OffLatticeLists<Real> own_;
    DeltaStep<Real> step_;
};

/// All threads of both scatter kernels.
template <class V>
class ScatterSimulation final : public Simulation<V> {
public:
    using typename Simulation<V>::Real;
    using typename Simulation<V>::Current;

    ScatterSimulation(const Problem& problem, const State& start)
        : Simulation<V>(problem, start, place_compact(problem), state_bits(problem)),
          springs_(list_every_spring<Real>(problem, V::formulation)),
          force_(3 * problem.particle_count()),
          step_(make_scatter_step<Real>(problem, springs_)) {
        measure(springs_.constants, V::formulation);
        step_.ends = springs_.ends.data();
        step_.constants = springs_.constants.data();
        step_.off_lattice_rest = data_of(springs_.off_lattice_rest);
        step_.force = force_.data();
        step_.pitch = problem.particle_count();
        this->attach(step_.motion);
    }

private:
    void step_once(const Current& current, const Output<Real>& output) override {
        using Terms = typename V::AllTerms;
        for (std::size_t s = 0; s < step_.springs + 7; ++s) scatter_spring<Terms>(step_, s, current);
        for (int i = 0; i < step_.particles + 7; ++i) integrate<Terms>(step_, i, current, output);
    }

    SpringArrays<Real> springs_;
    std::vector<Real> force_;
    ScatterStep<Real> step_{};
};

}  // namespace voxspring::cuda
