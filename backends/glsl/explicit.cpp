// Explicit addressing in a compute shader: one invocation per particle, which reads its neighbours from a
// list. The lists are interleaved: first the first slot of every particle, then the second slot of every
// particle, and so on.
#include "backends/glsl/explicit.h"

#include <algorithm>
#include <glm/vec4.hpp>
#include <optional>

#include "backends/by_precision.h"
#include "backends/glsl/compute_backend.h"
#include "backends/layout/neighbour_lists.h"
#include "backends/layout/springs.h"
#include "backends/layout/work.h"

namespace voxspring::glsl {
namespace {

constexpr const char* no_addresses = "the device does not support addresses of buffers (bufferDeviceAddress)";

bool asks_for_addresses(const Options& options) {
    const auto lists = options.tuning.find("lists");
    return lists != options.tuning.end() && lists->second == "addressed";
}

/// The number of slots that each list has: the room for a particle's neighbours.
std::uint32_t list_slots(const Problem& problem) {
    return layout::grouped_list_refusal(problem).empty() ? layout::slots_by_groups(problem)
                                                         : layout::slots_by_springs(problem);
}

template <class Real>
class ExplicitBackend final : public ComputeBackend<Real> {
public:
    ExplicitBackend(const Options& options, std::unique_ptr<Device> device)
        : ComputeBackend<Real>(options, std::move(device), {std::stoi(options.tuning.at("block")), 1, 1}),
          block_(std::stoul(options.tuning.at("block"))) {}

    std::optional<Choice> choice() const override {
        return choice_of_auto(this->options(), {{"lists", by_address_ ? "addressed" : "arrays"}});
    }

    StepWork step_work(const Problem& problem) const override {
        return layout::explicit_work<Real>(problem, kind_of(problem).secondary, this->formulation());
    }

private:
    enum Own : unsigned { neighbours = first_own_binding, spring_constants, off_lattice_rests };
    using typename ComputeBackend<Real>::Layout;

    ListKind kind_of(const Problem& problem) const { return list_kind(problem, this->formulation()); }
    const BufferLimits& buffer_limits() const {
        const Device& device = ComputeBackend<Real>::device();
        return device.buffer_limits();
    }

    std::uint64_t bytes_needed(const Problem& problem) const override {
        return explicit_bytes(problem, this->options());
    }
    std::string refused_layout(const Problem& problem) const override {
        // In formulations on positions this refuses nothing. Their list entries have no direction code, and
        // so room for more particles than any driver has memory for.
        if (std::string why = layout::list_entry_refusal(problem.particle_count(), this->formulation());
            !why.empty())
            return why;
        return lists_refusal(problem, this->options(), buffer_limits());
    }
    layout::Placement place(const Problem& problem) const override { return layout::place_compact(problem); }

    Layout lay_out(const Problem& problem) override {
        const Formulation formulation = this->formulation();
        kind_ = kind_of(problem);
        layout::NeighbourLists<Real> lists =
            kind_.secondary
                ? layout::list_by_springs<Real>(problem, layout::ListLayout::vertical, formulation)
                : layout::list_by_groups<Real>(problem, layout::ListLayout::vertical, formulation);
        step_ = layout::make_explicit_step<Real>(problem, lists, formulation);
        by_address_ = by_address(problem, this->options(), buffer_limits());
        put_list(neighbours, lists.neighbour);
        put_list(spring_constants, lists.constants);
        put_list(off_lattice_rests, lists.off_lattice_rest);
        if (!by_increments(formulation)) {
            for (const Array* const part : this->parts_of(spring_constants))
                this->measure(*part, part->bytes() / sizeof(layout::SpringConstants<Real>), 2, 1);
            this->measure_numbers(step_.rest_length);
        }
        const int groups = int((problem.particle_count() + block_ - 1) / block_);
        return {place(problem), std::move(lists.bits), rows_of_groups(groups)};
    }
    template <class T>
    void put_list(Own list, const std::vector<T>& values) {
        if (by_address_) {
            this->put_addressed(list, values, step_.shape.slots);
        } else {
            this->put_own(list, values);
        }
    }

    Shader shader(const Problem&) const override {
        return {.file = "compute_explicit",
                .variant = by_address_ ? "_addressed" : "",
                .constants = {{"SECONDARY", text(kind_.secondary)},
                              {"OFF_LATTICE_REST", text(kind_.off_lattice_rest)},
                              {"ALL_GROUPS", text(this->all_terms())}}};
    }

    /// Unless the formulation is by increments, the device has measured step_.rest_length (lay_out()).
    void set_uniforms(Uniforms& uniforms, const Problem& problem) override {
        uniforms.set("particles", step_.particles);
        uniforms.set("slot_stride", int(step_.shape.slot_stride));
        std::vector<glm::vec<4, Real>> rest;
        for (const layout::SpringRest<Real>& r : step_.rest)
            rest.emplace_back(r.offset.x, r.offset.y, r.offset.z, r.deficit);
        uniforms.set("rest", rest);
        uniforms.set("rest_length", step_.rest_length);
        uniforms.set("group_stiffness", step_.stiffness);
        std::array<int, 3> first_slot{}, slots{};
        const std::array<std::uint32_t, 3> bits = {FACE_BITS, EDGE_BITS, CORNER_BITS};
        for (std::size_t g = 0; g < bits.size(); ++g) {
            first_slot[g] = int(step_.first_slot[g]);
            slots[g] = (problem.group_bits & bits[g]) != 0 ? 1 : 0;
        }
        uniforms.set("first_slot", first_slot);
        uniforms.set("slots", slots);
    }

    void enqueue_edit(const Problem& edited, const SpringEdit& edit) override {
        const ListKind kind = kind_of(edited);
        if (kind.secondary != kind_.secondary || layout::longest_list(edit) > step_.shape.slots ||
            (kind.off_lattice_rest && !kind_.off_lattice_rest) ||
            edit.touched.size() * row_bytes() > buffer_limits().max_bytes) {
            this->lay_out_anew();
            return;
        }
        const auto rows =
            kind.secondary
                ? layout::edited_by_springs<Real>(edited, edit, step_.shape.slots, this->formulation())
                : layout::edited_by_groups<Real>(edited, edit, step_.shape.slots, this->formulation());
        write_rows(rows);
        this->write_bits(rows.particle, rows.lists.bits);
    }

    /// Bytes of a particle's row (one element per slot) in the list with the largest elements. An edit sends
    /// such rows in one array, whose size is limited.
    std::uint64_t row_bytes() const {
        return step_.shape.slots * (kind_.off_lattice_rest ? sizeof(layout::SpringRest<Real>)
                                    : kind_.secondary      ? sizeof(layout::SpringConstants<Real>)
                                                           : sizeof(std::uint32_t));
    }

    /// A list of rest offsets outlives the last spring beyond the lattice. If the edited problem has no such
    /// spring, the rows have no rest offsets, and the shader must not read any.
    void write_rows(const layout::EditedLists<Real>& rows) {
        Uniforms uniforms;
        uniforms.set("count", int(rows.lists.neighbour.size()));
        uniforms.set("list_slots", int(step_.shape.slots));
        uniforms.set("slot_stride", int(step_.shape.slot_stride));
        Arrays arrays;
        for (const Own list : {neighbours, spring_constants, off_lattice_rests})
            arrays[list] = this->own(list);
        const auto bytes = [](const auto& values) { return std::as_bytes(std::span(values)); };
        this->device().dispatch_once(
            {.file = "edit_rows",
             .variant = by_address_ ? "_addressed" : "",
             .constants = {{"SECONDARY", text(kind_.secondary)},
                           {"OFF_LATTICE_REST", text(!rows.lists.off_lattice_rest.empty())},
                           {"SQUARED", text(!by_increments(this->formulation()))}}},
            rows.lists.neighbour.size(), uniforms, arrays,
            {{0, bytes(rows.particle)},
             {1, bytes(rows.lists.neighbour)},
             {2, bytes(rows.lists.constants)},
             {3, bytes(rows.lists.off_lattice_rest)}});
    }

    const std::size_t block_;
    ListKind kind_;  // which lists exist beside that of neighbours
    layout::ExplicitStep<Real> step_{};
    bool by_address_ = false;
};

}  // namespace

ListKind list_kind(const Problem& problem, Formulation formulation) {
    return {.secondary = !layout::grouped_list_refusal(problem).empty(),
            .off_lattice_rest = !problem.springs.empty() && !on_positions(formulation)};
}

std::vector<std::pair<const char*, std::uint64_t>> list_bytes(const Problem& problem,
                                                              const Options& options) {
    const ListKind kind = list_kind(problem, options.formulation);
    const std::uint64_t elements =
        layout::list_size(problem.particle_count(), list_slots(problem), layout::ListLayout::vertical);
    const std::size_t real = scalar_bytes(options.precision);
    return {{"neighbour lists", elements * sizeof(std::uint32_t)},
            {"lists of springs' stiffness and rest length", kind.secondary ? elements * 2 * real : 0},
            {"lists of rest offsets", kind.off_lattice_rest ? elements * 4 * real : 0}};
}

std::uint64_t explicit_bytes(const Problem& problem, const Options& options) {
    std::uint64_t bytes = compute_bytes(problem, options, layout::place_compact(problem));
    for (const auto& [list, its_bytes] : list_bytes(problem, options)) bytes += its_bytes;
    return bytes;
}

bool by_address(const Problem& problem, const Options& options, const BufferLimits& limits) {
    const auto lists = list_bytes(problem, options);
    return asks_for_addresses(options) || std::any_of(lists.begin(), lists.end(), [&](const auto& list) {
               return list.second > limits.max_bytes;
           });
}

std::string lists_refusal(const Problem& problem, const Options& options, const BufferLimits& limits) {
    if (asks_for_addresses(options) && !limits.has_addresses) return no_addresses;
    for (const auto& [list, bytes] : list_bytes(problem, options)) {
        const std::string why = limits.has_addresses ? limits.too_large(std::string("slots of ") + list,
                                                                        bytes / list_slots(problem))
                                                     : limits.too_large(list, bytes);
        if (why.empty()) continue;
        return limits.has_addresses || !options.tuning.contains("lists") ? why
                                                                         : why + ", and " + no_addresses;
    }
    return {};
}

std::unique_ptr<Backend> make_explicit(const Options& options, std::unique_ptr<Device> device) {
    return make_by_precision<ExplicitBackend>(options, options, std::move(device));
}

}  // namespace voxspring::glsl
