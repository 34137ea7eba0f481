// Explicit addressing: active particles lie side by side in a texture, and each has a list of its neighbours,
// so springs need no grid. The lists are interleaved: first the first neighbour of every particle, then the
// second one of every particle, and so on.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <bit>

#include "backends/gl/fragment_backend.h"
#include "backends/gl/texture.h"
#include "backends/layout/springs.h"
#include "backends/physics/neighbours.h"

namespace voxspring {
namespace {

/// How many bits of w hold the number of a particle's neighbours in one spring group, which is at most 12.
constexpr int count_bits = 4;

/// The size of a texture for `particles` texels: as narrow as a height of at most `limit` allows, but for at
/// least 64 particles at least as wide as one screen tile of llvmpipe. Neighbouring rows are then close in
/// memory. On llvmpipe this is 1.2 times as fast as a square. The width is a power of two, so lists need to
/// store only a particle's index, which gives the texel's coordinates. Less than one row is wasted.
glm::ivec2 compact_size(std::size_t particles, int limit) {
    constexpr std::size_t tile = 64;
    const std::size_t width = std::bit_ceil(
        std::max(std::min(particles, tile), (particles + std::size_t(limit) - 1) / std::size_t(limit)));
    return {int(width), int((particles + width - 1) / width)};
}

int layer_count(const Problem& problem) {
    const auto degree = layout::degrees(problem);
    return degree.empty() ? 1 : std::max(1, int(*std::max_element(degree.begin(), degree.end())));
}

/// An entry of a particle's list (neighbours.h). `bit` is the mask bit of the neighbour's direction, or -1
/// for a spring of Problem::springs.
std::uint32_t list_entry(std::uint32_t neighbour, int bit) {
    return neighbour | (bit < 0 ? OWN_DIRECTION : std::uint32_t(bit)) << LISTED_INDEX_BITS;
}

/// Whether stiffness or rest length may differ between springs of one group.
bool differ_within_a_group(const Problem& problem) {
    if (problem.has_materials() || !problem.springs.empty()) return true;
    std::array<double, 3> length{};
    for (const Direction& direction : directions()) {
        double& group = length[std::size_t(direction.group)];
        const double own = problem.rest_length[std::size_t(direction.bit)];
        if (group != 0 && group != own) return true;
        group = own;
    }
    return false;
}

bool needs_spring_values(const Problem& problem, bool all_terms) {
    return all_terms || differ_within_a_group(problem);
}
bool needs_off_lattice_rest(const Problem& problem, Formulation formulation, bool all_terms) {
    return !on_positions(formulation) && (all_terms || !problem.springs.empty());
}

std::uint64_t upload_bytes(const Problem& problem, const Options& options) {
    const glm::ivec2 size = compact_size(problem.particle_count(), gl::guaranteed_texture_size);
    const std::uint64_t texels = std::uint64_t(size.x) * std::uint64_t(size.y);
    const bool all_terms = options.tuning.at("terms") == "all";
    std::uint64_t bytes_per_spring = gl::r32ui.bytes;
    if (needs_spring_values(problem, all_terms)) bytes_per_spring += gl::rg32f.bytes;
    if (needs_off_lattice_rest(problem, options.formulation, all_terms))
        bytes_per_spring += gl::rgba32f.bytes;
    return gl::fragment_bytes(problem, options, texels) +
           texels * std::uint64_t(layer_count(problem)) * bytes_per_spring;
}

class GlFragmentExplicit final : public gl::FragmentBackend {
public:
    explicit GlFragmentExplicit(const Options& options)
        : FragmentBackend(options, "gl_fragment_explicit.frag") {}

    StepWork step_work(const Problem& problem) const override {
        StepWork work = fragment_work(problem, problem.particle_count());
        const std::uint64_t ends = 2 * count_springs(problem).total();
        work.operations += ends;  // each spring is scaled by its stiffness
        work.read_once(ends * std::uint64_t(gl::r32ui.bytes + (per_spring(problem) ? gl::rg32f.bytes : 0)));
        if (has_off_lattice_rest(problem))
            work.read_once(2 * problem.springs.size() * std::uint64_t(gl::rgba32f.bytes));
        return work;
    }

private:
    std::uint64_t bytes_needed(const Problem& problem) const override {
        return upload_bytes(problem, options());
    }

    std::string refused(const Problem& problem) const override {
        const int limit = context().max_texture_size();
        const glm::ivec2 size = compact_size(problem.particle_count(), limit);
        const int layers = layer_count(problem);
        if (problem.particle_count() > layout::max_listed_particles)
            return fmt::format("{} particles are too many for an index of {} bits, as neighbour lists have",
                               problem.particle_count(), LISTED_INDEX_BITS);
        if (size.x > limit)
            return fmt::format("{} particles exceed the texture limit of {} x {} texels",
                               problem.particle_count(), limit, limit);
        if (layers > context().max_array_texture_layers())
            return fmt::format("lists of {} springs need as many texture layers, and the driver allows {}",
                               layers, context().max_array_texture_layers());
        if (!gl::fits(gl::rgba32f, size) || !gl::fits(gl::r32ui, size, layers) ||
            (per_spring(problem) && !gl::fits(gl::rg32f, size, layers)) ||
            (has_off_lattice_rest(problem) && !gl::fits(gl::rgba32f, size, layers)))
            return fmt::format(
                "neighbour lists of {} x {} x {} texels take more bytes than the driver allows one "
                "texture",
                size.x, size.y, layers);
        return {};
    }

    bool per_spring(const Problem& problem) const { return needs_spring_values(problem, all_terms()); }
    bool has_off_lattice_rest(const Problem& problem) const {
        return needs_off_lattice_rest(problem, formulation(), all_terms());
    }

    Layout lay_out(const Problem& problem) override {
        neighbour_ = {};
        spring_ = {};
        off_lattice_rest_ = {};
        Layout layout;
        layout.size = compact_size(problem.particle_count(), context().max_texture_size());
        const bool has_constants = per_spring_ = per_spring(problem);
        has_off_lattice_rest_ = has_off_lattice_rest(problem);
        const std::size_t texels = std::size_t(layout.size.x) * std::size_t(layout.size.y);
        const int layers = layers_ = layer_count(problem);
        std::vector<std::uint32_t> neighbour(texels * std::size_t(layers), 0);
        std::vector<glm::vec2> spring(has_constants ? neighbour.size() : 0, glm::vec2(0));
        std::vector<glm::vec4> off_lattice_rest(has_off_lattice_rest_ ? neighbour.size() : 0, glm::vec4(0));
        std::vector<std::uint32_t> degree(problem.particle_count(), 0);
        const auto add = [&](std::size_t i, const ListedSpring& s) {
            const std::size_t slot = degree[i]++ * texels + i;
            neighbour[slot] = list_entry(s.neighbour, s.bit);
            if (has_constants) spring[slot] = constants_of(problem, std::uint32_t(i), s);
            if (has_off_lattice_rest_) off_lattice_rest[slot] = rest_of(problem, std::uint32_t(i), s);
        };

        layout.bits.assign(problem.particle_count(), ACTIVE_BIT);
        const LatticeSprings springs(problem);
        for (std::size_t i = 0; i < problem.lattice.mask.size(); ++i) {
            springs.all_of(i, [&](std::uint32_t j, const Direction& direction) {
                add(i, {j, direction.bit, problem.spring_stiffness(i, j, direction),
                        problem.rest_length[std::size_t(direction.bit)]});
                if (!has_constants) layout.bits[i] += 1u << count_bits * int(direction.group);
            });
        }
        for (const Spring& s : problem.springs) {
            add(s.first, {s.second, -1, s.stiffness, s.rest_length});
            add(s.second, {s.first, -1, s.stiffness, s.rest_length});
        }
        for (std::size_t i = 0; i < problem.particle_count(); ++i) {
            layout.texel.push_back(std::uint32_t(i));
            if (has_constants) layout.bits[i] |= degree[i];
            if (problem.is_pinned(i)) layout.bits[i] |= PINNED_BIT;
        }

        neighbour_ = gl::make_array_texture(context(), gl::r32ui, layout.size, layers, neighbour.data());
        glBindTextureUnit(first_own_unit, neighbour_.get());
        if (has_constants) {
            spring_ = gl::make_array_texture(context(), gl::rg32f, layout.size, layers, spring.data());
            glBindTextureUnit(first_own_unit + 1, spring_.get());
        }
        if (has_off_lattice_rest_) {
            off_lattice_rest_ =
                gl::make_array_texture(context(), gl::rgba32f, layout.size, layers, off_lattice_rest.data());
            glBindTextureUnit(first_own_unit + 2, off_lattice_rest_.get());
        }
        return layout;
    }

    /// The texel of spring_ for a spring of particle i.
    glm::vec2 constants_of(const Problem& problem, std::uint32_t i, const ListedSpring& s) const {
        if (s.bit >= 0) {
            const Direction& direction = directions()[std::size_t(s.bit)];
            return {float(s.stiffness), layout::listed_length<float>(problem, direction, formulation())};
        }
        const Spring spring{i, s.neighbour, s.stiffness, s.rest_length};
        return {float(s.stiffness), layout::listed_length<float>(spring, formulation())};
    }
    /// The texel of off_lattice_rest_ for a spring of particle i.
    static glm::vec4 rest_of(const Problem& problem, std::uint32_t i, const ListedSpring& s) {
        if (s.bit >= 0) return glm::vec4(0);
        const auto rest = layout::off_lattice_rest_of<float>(problem, i, s.neighbour, s.rest_length);
        return {rest.offset.x, rest.offset.y, rest.offset.z, rest.deficit};
    }

    gl::Defines specialise(const Problem& problem) const override {
        const glm::ivec2 size = compact_size(problem.particle_count(), context().max_texture_size());
        gl::Defines defines{{"COUNT_BITS", std::to_string(count_bits)},
                            {"WIDTH_BITS", std::to_string(std::countr_zero(unsigned(size.x)))}};
        if (per_spring(problem)) defines["PER_SPRING"] = "";
        if (has_off_lattice_rest(problem)) defines["OFF_LATTICE_REST"] = "";
        return defines;
    }

    void set_uniforms(const gl::Program& program, const Problem& problem) override {
        std::array<float, 3> rest_length{};
        std::array<float, 3> stiffness{};
        for (const Direction& direction : directions()) {
            rest_length[std::size_t(direction.group)] =
                layout::listed_length<float>(problem, direction, formulation());
        }
        if (!by_increments(formulation())) measure(rest_length);
        std::copy(problem.group_stiffness.begin(), problem.group_stiffness.end(), stiffness.begin());
        program.set("rest_length", rest_length);
        program.set("group_stiffness", stiffness);
    }

    bool has_room(const Problem& edited, const SpringEdit& edit) const override {
        return per_spring(edited) == per_spring_ && has_off_lattice_rest(edited) == has_off_lattice_rest_ &&
               std::all_of(edit.touched.begin(), edit.touched.end(), [&](const auto& touched) {
                   return edit.springs_of(touched).size() <= std::size_t(layers_);
               });
    }

    TexelEdit edited_texels(const Problem& edited, const SpringEdit& edit) const override {
        TexelEdit texels;
        for (const SpringEdit::Touched& touched : edit.touched) {
            std::uint32_t bits = touched.mask & (ACTIVE_BIT | PINNED_BIT);
            for (const ListedSpring& s : edit.springs_of(touched)) {
                texels.neighbour.push_back(list_entry(s.neighbour, s.bit));
                bits += per_spring_ ? 1U : 1U << count_bits * int(directions()[std::size_t(s.bit)].group);
                if (per_spring_) texels.spring.push_back(constants_of(edited, touched.particle, s));
                if (has_off_lattice_rest_)
                    texels.off_lattice_rest.push_back(rest_of(edited, touched.particle, s));
            }
            texels.particles.push_back({texel_of(touched.particle), bits, touched.begin, touched.end});
        }
        return texels;
    }

    gl::Defines bind_lists() const override {
        gl::Defines defines{{"LISTS", ""}};
        glBindImageTexture(1, neighbour_.get(), 0, GL_TRUE, 0, GL_WRITE_ONLY, gl::r32ui.internal);
        if (per_spring_) {
            defines["PER_SPRING"] = "";
            glBindImageTexture(2, spring_.get(), 0, GL_TRUE, 0, GL_WRITE_ONLY, gl::rg32f.internal);
        }
        if (has_off_lattice_rest_) {
            defines["OFF_LATTICE_REST"] = "";
            glBindImageTexture(3, off_lattice_rest_.get(), 0, GL_TRUE, 0, GL_WRITE_ONLY,
                               gl::rgba32f.internal);
        }
        return defines;
    }

    gl::Texture neighbour_, spring_, off_lattice_rest_;
    int layers_ = 0;                     // layers per list texture
    bool per_spring_ = false;            // whether spring_ exists
    bool has_off_lattice_rest_ = false;  // whether off_lattice_rest_ exists
};

const Registered entry({
    .name = "gl_fragment_explicit",
    .api = "opengl",
    .summary = "OpenGL fragment shader over the active particles, neighbours from a list.",
    .precisions = {Precision::float32},
    .formulations = every_formulation,
    .tuning = gl::fragment_tuning(),
    .make = [](const Options& options) { return std::make_unique<GlFragmentExplicit>(options); },
    .bytes = upload_bytes,
});

}  // namespace
}  // namespace voxspring
