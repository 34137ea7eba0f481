// Explicit addressing in a compute shader: one invocation per particle, neighbours from vertical lists.
#include "backends/gl/compute_backend.h"
#include "backends/glsl/explicit.h"
#include "backends/layout/springs.h"
#include "backends/layout/work.h"

namespace voxspring {
namespace {

class GlComputeExplicit final : public gl::ComputeBackend {
public:
    explicit GlComputeExplicit(const Options& options)
        : ComputeBackend(options, "compute_explicit.comp"), block_(std::stoi(options.tuning.at("block"))) {}

    void edit(const Problem& edited, const SpringEdit& edit) override {
        set_problem(edited);
        if (edit.empty()) return;
        const glsl::ListKind kind = glsl::list_kind(edited, formulation());
        if (kind.secondary != kind_.secondary || layout::longest_list(edit) > step_.shape.slots ||
            (kind.off_lattice_rest && !kind_.off_lattice_rest)) {
            lay_out_anew();
            return;
        }
        const auto rows = glsl::edited_lists<float>(edited, edit, step_.shape.slots, formulation());
        write_rows(rows);
        write_bits(rows.particle, rows.lists.bits);
    }

    StepWork step_work(const Problem& problem) const override {
        return layout::explicit_work<float>(problem, glsl::list_kind(problem, formulation()).secondary,
                                            formulation());
    }

private:
    std::uint64_t bytes_needed(const Problem& problem) const override {
        return glsl::explicit_bytes(problem, options());
    }

    std::string refused_layout(const Problem& problem) const override {
        // On positions entries have no direction, so more particles could be addressed, but no driver takes
        // as many.
        if (std::string why = layout::list_entry_refusal(problem, formulation()); !why.empty()) return why;
        for (const auto& [list, bytes] : glsl::list_bytes(problem, options())) {
            if (std::string why = too_large(list, bytes); !why.empty()) return why;
        }
        return {};
    }
    layout::Placement place(const Problem& problem) const override { return layout::place_compact(problem); }

    Layout lay_out(const Problem& problem) override {
        kind_ = glsl::list_kind(problem, formulation());
        layout::NeighbourLists<float> lists = glsl::make_lists<float>(problem, formulation());
        step_ = layout::make_explicit_step<float>(problem, lists, formulation());
        neighbour_.upload(context(), lists.neighbour);
        constants_.upload(context(), lists.constants);
        off_lattice_rest_.upload(context(), lists.off_lattice_rest);
        if (!by_increments(formulation())) {
            if (kind_.secondary) measure(constants_, lists.constants.size(), 2, 1);
            measure(step_.rest_length);
        }
        const int groups = int((problem.particle_count() + std::size_t(block_) - 1) / std::size_t(block_));
        return {place(problem), std::move(lists.bits), glsl::rows_of_groups(groups)};
    }

    void bind_own() const override {
        neighbour_.bind(first_own_binding);
        constants_.bind(first_own_binding + 1);
        off_lattice_rest_.bind(first_own_binding + 2);
    }

    gl::Defines specialise(const Problem&) const override {
        gl::Defines defines = glsl::explicit_constants(kind_, all_terms());
        defines["BLOCK"] = std::to_string(block_);
        return defines;
    }

    void set_uniforms(const gl::Program& program, const Problem& problem) override {
        glsl::set_explicit(program, problem, step_);
    }

    void write_rows(const layout::EditedLists<float>& rows) {
        const gl::Defines defines = glsl::edit_constants(kind_, formulation());
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
        rows_program_.set("list_slots", int(step_.shape.slots));
        rows_program_.set("slot_stride", int(step_.shape.slot_stride));
        dispatch_edit(rows_program_, rows.lists.neighbour.size());
    }

    const int block_;
    glsl::ListKind kind_;  // which of the lists below exist
    layout::ExplicitStep<float> step_{};
    gl::StorageBuffer neighbour_, constants_, off_lattice_rest_;
    gl::Program rows_program_;
    gl::Defines rows_defines_;  // the defines that rows_program_ was made with
    gl::StorageBuffer edited_particle_, edited_neighbour_, edited_constants_, edited_off_lattice_rest_;
};

const Registered entry({
    .name = "gl_compute_explicit",
    .api = "opengl",
    .summary = "OpenGL compute shader, one invocation per particle, neighbours from vertical lists.",
    .precisions = {Precision::float32},
    .formulations = every_formulation,
    .tuning = {{"block", {"128", "256"}}, {"fetch", {"buffer", "texture"}}, {"terms", {"needed", "all"}}},
    .make = [](const Options& options) { return std::make_unique<GlComputeExplicit>(options); },
    .bytes = glsl::explicit_bytes,
});

}  // namespace
}  // namespace voxspring
