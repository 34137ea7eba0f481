// Explicit addressing in Vulkan: one invocation a particle, neighbours from vertical lists.
#include "backends/glsl/explicit.h"
#include "backends/layout/springs.h"
#include "backends/layout/work.h"
#include "backends/vulkan/vulkan_backend.h"

namespace voxspring {
namespace {

template <class Real>
class VulkanExplicit final : public vulkan::VulkanBackend {
public:
    explicit VulkanExplicit(const Options& options)
        : VulkanBackend(options, "compute_explicit", {std::stoi(options.tuning.at("block")), 1, 1}),
          block_(std::stoi(options.tuning.at("block"))) {}

    StepWork step_work(const Problem& problem) const override {
        return cuda::explicit_work<Real>(problem, glsl::list_kind(problem, formulation()).secondary,
                                         formulation());
    }

private:
    enum Own : std::uint32_t { neighbours = glsl::first_own_binding, spring_constants, off_lattice_rests };

    std::uint64_t bytes_needed(const Problem& problem) const override {
        return glsl::explicit_bytes(problem, options());
    }
    std::string refused_layout(const Problem& problem) const override {
        // Positions have no direction in their entries, yet no driver takes as many particles.
        if (std::string why = cuda::beyond_entries(problem, formulation()); !why.empty()) return why;
        for (const auto& [list, bytes] : glsl::list_bytes(problem, options())) {
            if (std::string why = too_large(list, bytes); !why.empty()) return why;
        }
        return {};
    }
    cuda::Placement place(const Problem& problem) const override { return cuda::place_compact(problem); }

    Layout lay_out(const Problem& problem) override {
        kind_ = glsl::list_kind(problem, formulation());
        cuda::NeighbourLists<Real> lists = glsl::make_lists<Real>(problem, formulation());
        step_ = cuda::make_explicit_step<Real>(problem, lists, formulation());
        put(own(neighbours), lists.neighbour);
        put(own(spring_constants), lists.constants);
        put(own(off_lattice_rests), lists.off_lattice_rest);
        if (!by_increments(formulation())) {
            if (kind_.secondary) measure(own(spring_constants), lists.constants.size(), 2, 1);
            measure_numbers(std::span<Real>(step_.rest_length));
        }
        const int groups = int((problem.particle_count() + std::size_t(block_) - 1) / std::size_t(block_));
        return {place(problem), std::move(lists.bits), glsl::rows_of_groups(groups)};
    }

    glsl::Constants constants(const Problem&) const override {
        return glsl::explicit_constants(kind_, all_terms());
    }
    void set_uniforms(vulkan::Uniforms& uniforms, const Problem& problem) override {
        glsl::set_explicit(uniforms, problem, step_);
    }

    void enqueue_edit_of(const Problem& edited, const SpringEdit& edit) override {
        const glsl::ListKind kind = glsl::list_kind(edited, formulation());
        if (kind.secondary != kind_.secondary || cuda::longest_list(edit) > step_.shape.slots ||
            (kind.off_lattice_rest && !kind_.off_lattice_rest)) {
            lay_out_anew();
            return;
        }
        const auto rows = glsl::edited_lists<Real>(edited, edit, step_.shape.slots, formulation());
        write_rows(rows);
        write_bits(rows.particle, rows.lists.bits);
    }

    void write_rows(const cuda::EditedLists<Real>& rows) {
        const auto program = this->program("edit_rows", glsl::edit_constants(kind_, formulation()));
        vulkan::Uniforms uniforms(program->module());
        uniforms.set("count", int(rows.lists.neighbour.size()));
        uniforms.set("list_slots", int(step_.shape.slots));
        uniforms.set("slot_stride", int(step_.shape.slot_stride));
        const std::vector sent = {send(rows.particle), send(rows.lists.neighbour), send(rows.lists.constants),
                                  send(rows.lists.off_lattice_rest)};
        vulkan::Buffers buffers;
        for (const Own list : {neighbours, spring_constants, off_lattice_rests}) buffers[list] = &own(list);
        for (std::uint32_t n = 0; n < sent.size(); ++n) buffers[n] = sent[n].get();
        enqueue_dispatch(program, rows.lists.neighbour.size(), uniforms, buffers, sent);
    }

    const int block_;
    glsl::ListKind kind_;  // which of the lists are there
    cuda::ExplicitStep<Real> step_{};
};

const Registered entry({
    .name = "vulkan_explicit",
    .summary = "Vulkan compute shader, one invocation a particle, neighbours from vertical lists.",
    .precisions = {Precision::float32, Precision::float64},
    .formulations = every_formulation,
    .tuning = {{"block", {"128", "256"}}, {"terms", {"needed", "all"}}},
    .make = [](const Options& options) -> std::unique_ptr<Backend> {
        if (options.precision == Precision::float32) return std::make_unique<VulkanExplicit<float>>(options);
        return std::make_unique<VulkanExplicit<double>>(options);
    },
    .bytes = glsl::explicit_bytes,
});

}  // namespace
}  // namespace voxspring
