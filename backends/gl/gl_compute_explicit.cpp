// Explicit addressing in a compute shader: one invocation a particle, neighbours from vertical lists.
#include <algorithm>
#include <array>
#include <numeric>

#include "backends/gl/compute_backend.h"
#include "backends/layout/springs.h"
#include "backends/layout/work.h"

namespace voxspring {
namespace {

/// Springs that differ within a group have their stiffness and rest length in a list of their own.
bool has_secondary(const Problem& problem) { return !cuda::beyond_groups(problem).empty(); }

bool needs_off_lattice_rest(const Problem& problem, Formulation formulation) {
    return !problem.springs.empty() && !on_positions(formulation);
}

/// Elements of each list of `problem`.
std::uint64_t list_elements(const Problem& problem) {
    const std::uint32_t slots =
        has_secondary(problem) ? cuda::slots_by_springs(problem) : cuda::slots_by_groups(problem);
    return cuda::list_size(problem.particle_count(), slots, cuda::ListLayout::vertical);
}

std::uint64_t upload_bytes(const Problem& problem, const Options& options) {
    return gl::compute_bytes(problem, options, cuda::place_compact(problem)) +
           list_elements(problem) *
               (sizeof(std::uint32_t) + (has_secondary(problem) ? sizeof(cuda::SpringConstants<float>) : 0) +
                (needs_off_lattice_rest(problem, options.formulation) ? sizeof(cuda::SpringRest<float>) : 0));
}

class GlComputeExplicit final : public gl::ComputeBackend {
public:
    explicit GlComputeExplicit(const Options& options)
        : ComputeBackend(options, "gl_compute_explicit.comp"),
          block_(std::stoi(options.tuning.at("block"))) {}

    void edit(const Problem& edited, const SpringEdit& edit) override {
        set_problem(edited);
        if (edit.empty()) return;
        const bool secondary = has_secondary(edited);
        if (secondary != secondary_ || cuda::longest_list(edit) > shape_.slots ||
            (needs_off_lattice_rest(edited, formulation()) && !has_off_lattice_rest_)) {
            lay_out_anew();
            return;
        }
        const auto rows = secondary
                              ? cuda::edited_by_springs<float>(edited, edit, shape_.slots, formulation())
                              : cuda::edited_by_groups<float>(edited, edit, shape_.slots, formulation());
        write_rows(rows);
        write_bits(rows.particle, rows.lists.bits);
    }

    StepWork step_work(const Problem& problem) const override {
        return cuda::explicit_work<float>(problem, has_secondary(problem), formulation());
    }

private:
    std::uint64_t bytes_needed(const Problem& problem) const override {
        return upload_bytes(problem, options());
    }

    std::string refused_layout(const Problem& problem) const override {
        // Positions have no direction in their entries, yet no driver takes as many particles.
        if (std::string why = cuda::beyond_entries(problem, formulation()); !why.empty()) return why;
        const std::uint64_t elements = list_elements(problem);
        std::string why = too_large("neighbour lists", elements * sizeof(std::uint32_t));
        if (why.empty() && has_secondary(problem))
            why = too_large("lists of springs' constants", elements * sizeof(cuda::SpringConstants<float>));
        if (why.empty() && needs_off_lattice_rest(problem, formulation()))
            why = too_large("lists of rest offsets", elements * sizeof(cuda::SpringRest<float>));
        return why;
    }
    cuda::Placement place(const Problem& problem) const override { return cuda::place_compact(problem); }

    Layout lay_out(const Problem& problem) override {
        secondary_ = has_secondary(problem);
        has_off_lattice_rest_ = needs_off_lattice_rest(problem, formulation());
        cuda::NeighbourLists<float> lists =
            secondary_ ? cuda::list_by_springs<float>(problem, cuda::ListLayout::vertical, formulation())
                       : cuda::list_by_groups<float>(problem, cuda::ListLayout::vertical, formulation());
        shape_ = lists.shape;
        step_ = cuda::make_explicit_step<float>(problem, lists, formulation());
        neighbour_.upload(context(), lists.neighbour);
        constants_.upload(context(), lists.constants);
        off_lattice_rest_.upload(context(), lists.off_lattice_rest);
        if (!by_increments(formulation())) {
            if (secondary_) measure(constants_, lists.constants.size(), 2, 1);
            measure(step_.rest_length);
        }
        const int groups = int((problem.particle_count() + std::size_t(block_) - 1) / std::size_t(block_));
        return {place(problem), std::move(lists.bits), rows_of_groups(groups)};
    }

    void bind_own() const override {
        neighbour_.bind(first_own_binding);
        constants_.bind(first_own_binding + 1);
        off_lattice_rest_.bind(first_own_binding + 2);
    }

    gl::Defines specialise(const Problem&) const override {
        gl::Defines defines = list_defines();
        defines["BLOCK"] = std::to_string(block_);
        if (all_terms()) defines["ALL_GROUPS"] = "";
        return defines;
    }

    gl::Defines list_defines() const {
        gl::Defines defines;
        if (secondary_) defines["SECONDARY"] = "";
        if (has_off_lattice_rest_) defines["OFF_LATTICE_REST"] = "";
        return defines;
    }

    void set_uniforms(const gl::Program& program, const Problem& problem) override {
        program.set("particles", step_.particles);
        program.set("slot_stride", int(shape_.slot_stride));
        std::vector<glm::vec4> rest;
        for (const cuda::SpringRest<float>& r : step_.rest)
            rest.emplace_back(r.offset.x, r.offset.y, r.offset.z, r.deficit);
        program.set("rest", rest);
        program.set("rest_length", step_.rest_length);
        program.set("group_stiffness", step_.stiffness);
        const std::array<std::uint32_t, 3> bits = {FACE_BITS, EDGE_BITS, CORNER_BITS};
        for (std::size_t g = 0; g < bits.size(); ++g) {
            const std::string element = "[" + std::to_string(g) + "]";
            program.set(("first_slot" + element).c_str(), int(step_.first_slot[g]));
            program.set(("slots" + element).c_str(), (problem.group_bits & bits[g]) != 0 ? 1 : 0);
        }
    }

    void write_rows(const cuda::EditedLists<float>& rows) {
        gl::Defines defines = list_defines();
        if (!by_increments(formulation())) defines["SQUARED"] = "";
        if (rows_program_.get() == 0 || defines != rows_defines_) {
            rows_program_ = gl::Program(context(), gl::load_source("edit_rows.comp", defines));
            rows_defines_ = defines;
        }
        edited_particle_.replace(context(), rows.particle);
        edited_neighbour_.replace(context(), rows.lists.neighbour);
        edited_constants_.replace(context(), rows.lists.constants);
        edited_off_lattice_rest_.replace(context(), rows.lists.off_lattice_rest);
        edited_particle_.bind(0);
        edited_neighbour_.bind(1);
        edited_constants_.bind(2);
        edited_off_lattice_rest_.bind(3);
        rows_program_.set("count", int(rows.lists.neighbour.size()));
        rows_program_.set("list_slots", int(shape_.slots));
        rows_program_.set("slot_stride", int(shape_.slot_stride));
        dispatch_edit(rows_program_, rows.lists.neighbour.size());
    }

    const int block_;
    bool secondary_ = false;             // whether constants_ is there
    bool has_off_lattice_rest_ = false;  // whether off_lattice_rest_ is there
    cuda::ListShape shape_;
    cuda::ExplicitStep<float> step_{};
    gl::StorageBuffer neighbour_, constants_, off_lattice_rest_;
    gl::Program rows_program_;
    gl::Defines rows_defines_;  // that rows_program_ was made with
    gl::StorageBuffer edited_particle_, edited_neighbour_, edited_constants_, edited_off_lattice_rest_;
};

const Registered entry({
    .name = "gl_compute_explicit",
    .summary = "OpenGL compute shader, one invocation a particle, neighbours from vertical lists.",
    .precisions = {Precision::float32},
    .formulations = every_formulation,
    .tuning = {{"block", {"128", "256"}}, {"fetch", {"buffer", "texture"}}, {"terms", {"needed", "all"}}},
    .make = [](const Options& options) { return std::make_unique<GlComputeExplicit>(options); },
    .bytes = upload_bytes,
});

}  // namespace
}  // namespace voxspring
