// Explicit addressing in Vulkan: one invocation per particle, neighbours from vertical lists.
#include "backends/glsl/explicit.h"
#include "backends/layout/springs.h"
#include "backends/layout/work.h"
#include "backends/vulkan/addressed_list.h"
#include "backends/vulkan/vulkan_backend.h"

namespace voxspring {
namespace {

template <class Real>
class VulkanExplicit final : public vulkan::VulkanBackend {
public:
    explicit VulkanExplicit(const Options& options)
        : VulkanBackend(options, {std::stoi(options.tuning.at("block")), 1, 1}),
          block_(std::stoi(options.tuning.at("block"))) {}
    VulkanExplicit(const VulkanExplicit&) = delete;
    VulkanExplicit& operator=(const VulkanExplicit&) = delete;
    // Steps in flight read addressed_, which is destroyed before the queue.
    ~VulkanExplicit() override { queue().abandon(); }

    StepWork step_work(const Problem& problem) const override {
        return layout::explicit_work<Real>(problem, glsl::list_kind(problem, formulation()).secondary,
                                           formulation());
    }

private:
    enum Own : std::uint32_t { neighbours = glsl::first_own_binding, spring_constants, off_lattice_rests };

    std::string shader() const override {
        return by_address_ ? "compute_explicit_addressed" : "compute_explicit";
    }
    std::uint64_t bytes_needed(const Problem& problem) const override {
        return glsl::explicit_bytes(problem, options());
    }
    std::string refused_layout(const Problem& problem) const override {
        // On positions entries have no direction, so more particles could be addressed, but no driver takes
        // as many.
        if (std::string why = layout::list_entry_refusal(problem, formulation()); !why.empty()) return why;
        return vulkan::lists_refusal(problem, options(), device().buffer_limits());
    }
    layout::Placement place(const Problem& problem) const override { return layout::place_compact(problem); }

    Layout lay_out(const Problem& problem) override {
        kind_ = glsl::list_kind(problem, formulation());
        layout::NeighbourLists<Real> lists = glsl::make_lists<Real>(problem, formulation());
        step_ = layout::make_explicit_step<Real>(problem, lists, formulation());
        by_address_ = vulkan::by_address(problem, options(), device().buffer_limits());
        put_list(neighbours, lists.neighbour);
        put_list(spring_constants, lists.constants);
        put_list(off_lattice_rests, lists.off_lattice_rest);
        if (!by_increments(formulation())) {
            for (const vulkan::Buffer& part : parts_of(spring_constants))
                measure(part, part.bytes() / sizeof(layout::SpringConstants<Real>), 2, 1);
            measure_numbers(std::span<Real>(step_.rest_length));
        }
        const int groups = int((problem.particle_count() + std::size_t(block_) - 1) / std::size_t(block_));
        return {place(problem), std::move(lists.bits), glsl::rows_of_groups(groups)};
    }

    template <class T>
    void put_list(Own list, const std::vector<T>& values) {
        addressed_[list] = {};  // frees the old buffer first
        if (!by_address_) {
            put(own(list), values);
            return;
        }
        own(list) = {};
        addressed_[list] = {queue(), std::as_bytes(std::span(values)), step_.shape.slots,
                            device().buffer_limits().max_bytes};
        put(own(list), addressed_[list].addresses());
    }
    /// The arrays that together hold a list.
    std::span<const vulkan::Buffer> parts_of(Own list) {
        if (by_address_) return addressed_[list].parts();
        return {&own(list), own(list).bytes() > 0 ? std::size_t(1) : 0};
    }

    glsl::Constants constants(const Problem&) const override {
        return glsl::explicit_constants(kind_, all_terms());
    }
    void set_uniforms(vulkan::Uniforms& uniforms, const Problem& problem) override {
        glsl::set_explicit(uniforms, problem, step_);
    }

    void enqueue_edit_of(const Problem& edited, const SpringEdit& edit) override {
        const glsl::ListKind kind = glsl::list_kind(edited, formulation());
        if (kind.secondary != kind_.secondary || layout::longest_list(edit) > step_.shape.slots ||
            (kind.off_lattice_rest && !kind_.off_lattice_rest) ||
            edit.touched.size() * row_bytes() > device().buffer_limits().max_bytes) {
            lay_out_anew();
            return;
        }
        const auto rows = glsl::edited_lists<Real>(edited, edit, step_.shape.slots, formulation());
        write_rows(rows);
        write_bits(rows.particle, rows.lists.bits);
    }

    /// Bytes of a row in the list with the largest elements. Rows travel in storage buffers, which limits
    /// them.
    std::uint64_t row_bytes() const {
        return step_.shape.slots * (kind_.off_lattice_rest ? sizeof(layout::SpringRest<Real>)
                                    : kind_.secondary      ? sizeof(layout::SpringConstants<Real>)
                                                           : sizeof(std::uint32_t));
    }

    void write_rows(const layout::EditedLists<Real>& rows) {
        const auto program = this->program(by_address_ ? "edit_rows_addressed" : "edit_rows",
                                           glsl::edit_constants(kind_, formulation()));
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
    glsl::ListKind kind_;  // which of the lists below exist
    layout::ExplicitStep<Real> step_{};
    bool by_address_ = false;
    std::map<Own, vulkan::AddressedList> addressed_;  // the lists whose addresses are in own()
};

const Registered entry({
    .name = "vulkan_explicit",
    .api = "vulkan",
    .summary = "Vulkan compute shader, one invocation per particle, neighbours from vertical lists.",
    .precisions = {Precision::float32, Precision::float64},
    .formulations = every_formulation,
    .tuning = {{"block", {"128", "256"}}, {"lists", {"auto", "addressed"}}, {"terms", {"needed", "all"}}},
    .make = [](const Options& options) -> std::unique_ptr<Backend> {
        if (options.precision == Precision::float32) return std::make_unique<VulkanExplicit<float>>(options);
        return std::make_unique<VulkanExplicit<double>>(options);
    },
    .bytes = glsl::explicit_bytes,
});

}  // namespace
}  // namespace voxspring
