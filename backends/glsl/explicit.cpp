#include "backends/glsl/explicit.h"

#include "backends/layout/springs.h"

namespace voxspring::glsl {

ListKind list_kind(const Problem& problem, Formulation formulation) {
    return {.secondary = !layout::grouped_list_refusal(problem).empty(),
            .off_lattice_rest = !problem.springs.empty() && !on_positions(formulation)};
}

std::uint32_t list_slots(const Problem& problem) {
    return layout::grouped_list_refusal(problem).empty() ? layout::slots_by_groups(problem)
                                                         : layout::slots_by_springs(problem);
}

std::vector<std::pair<const char*, std::uint64_t>> list_bytes(const Problem& problem,
                                                              const Options& options) {
    const ListKind kind = list_kind(problem, options.formulation);
    const std::uint64_t elements =
        layout::list_size(problem.particle_count(), list_slots(problem), layout::ListLayout::vertical);
    const std::size_t real = options.precision == Precision::float32 ? sizeof(float) : sizeof(double);
    return {{"neighbour lists", elements * sizeof(std::uint32_t)},
            {"lists of springs' constants", kind.secondary ? elements * 2 * real : 0},
            {"lists of rest offsets", kind.off_lattice_rest ? elements * 4 * real : 0}};
}

std::uint64_t explicit_bytes(const Problem& problem, const Options& options) {
    std::uint64_t bytes = compute_bytes(problem, options, layout::place_compact(problem));
    for (const auto& [list, its_bytes] : list_bytes(problem, options)) bytes += its_bytes;
    return bytes;
}

template <class Real>
layout::NeighbourLists<Real> make_lists(const Problem& problem, Formulation formulation) {
    return list_kind(problem, formulation).secondary
               ? layout::list_by_springs<Real>(problem, layout::ListLayout::vertical, formulation)
               : layout::list_by_groups<Real>(problem, layout::ListLayout::vertical, formulation);
}
template layout::NeighbourLists<float> make_lists(const Problem&, Formulation);
template layout::NeighbourLists<double> make_lists(const Problem&, Formulation);

template <class Real>
layout::EditedLists<Real> edited_lists(const Problem& edited, const SpringEdit& edit, std::uint32_t slots,
                                       Formulation formulation) {
    return list_kind(edited, formulation).secondary
               ? layout::edited_by_springs<Real>(edited, edit, slots, formulation)
               : layout::edited_by_groups<Real>(edited, edit, slots, formulation);
}
template layout::EditedLists<float> edited_lists(const Problem&, const SpringEdit&, std::uint32_t,
                                                 Formulation);
template layout::EditedLists<double> edited_lists(const Problem&, const SpringEdit&, std::uint32_t,
                                                  Formulation);

Constants explicit_constants(ListKind kind, bool all_terms) {
    return {{"SECONDARY", text(kind.secondary)},
            {"OFF_LATTICE_REST", text(kind.off_lattice_rest)},
            {"ALL_GROUPS", text(all_terms)}};
}

Constants edit_constants(ListKind kind, Formulation formulation) {
    return {{"SECONDARY", text(kind.secondary)},
            {"OFF_LATTICE_REST", text(kind.off_lattice_rest)},
            {"SQUARED", text(!by_increments(formulation))}};
}

}  // namespace voxspring::glsl
