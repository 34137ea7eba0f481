#include "backends/gl/limits.h"

#include <array>
#include <chrono>
#include <cstddef>
#include <string>

#include "backends/gl/handles.h"
#include "backends/gl/program.h"
#include "backends/gl/texture.h"
#include "backends/glsl/limits.h"

namespace voxspring::gl {
namespace {

constexpr int row = 2048;  // width of textures in texels; at every footprint they have whole rows
constexpr glm::ivec2 arithmetic_size{glsl::arithmetic_side, glsl::arithmetic_side};
using glsl::launch_patience, glsl::rounds;
/// Times a batch on the host's clock. Batches are long enough for that, and OpenGL's time stamps may be taken
/// before compute shaders have ended.
template <class Enqueue>
double seconds(Enqueue enqueue) {
    glFinish();
    const auto begin = std::chrono::steady_clock::now();
    enqueue();
    glFinish();
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
}

/// Three frames of one size. Draws step through them as a FragmentBackend with three frames does.
class Frames {
public:
    Frames(const Context& context, glm::ivec2 size) : size_(size) {
        for (std::size_t i = 0; i < textures_.size(); ++i) {
            textures_[i] = make_texture(context, rgba32f, size, nullptr);
            glClearTexImage(textures_[i].get(), 0, rgba32f.external, rgba32f.type, nullptr);
            framebuffers_[i] = make_framebuffer(context);
            glNamedFramebufferTexture(framebuffers_[i].get(), GL_COLOR_ATTACHMENT0, textures_[i].get(), 0);
        }
    }

    void step(const Program& program, int count) const {
        use(program);
        for (std::size_t n = 0; n < std::size_t(count); ++n) {
            bind(n % 3, (n + 1) % 3, (n + 2) % 3);
            glDrawArrays(GL_TRIANGLES, 0, 3);
        }
    }
    /// Draws `count` times, each time from the first two frames to the third.
    void repeat(const Program& program, int count) const {
        use(program);
        bind(0, 1, 2);
        for (int n = 0; n < count; ++n) glDrawArrays(GL_TRIANGLES, 0, 3);
    }
    const Texture& texture() const { return textures_[0]; }

private:
    void use(const Program& program) const {
        glViewport(0, 0, size_.x, size_.y);
        glUseProgram(program.get());
    }
    void bind(std::size_t first, std::size_t second, std::size_t written) const {
        const GLuint sources[] = {textures_[first].get(), textures_[second].get()};
        glBindFramebuffer(GL_FRAMEBUFFER, framebuffers_[written].get());
        glBindTextures(0, 2, sources);
    }

    glm::ivec2 size_;
    std::array<Texture, 3> textures_;
    std::array<Framebuffer, 3> framebuffers_;
};

Program fragment_program(const Context& context, const char* fragment_shader, const Defines& defines) {
    return {context, load_source("full_screen.vert", {}), load_source(fragment_shader, defines)};
}

/// Multiply-adds per second of `program`, which `dispatch()` runs. The uniform `rounds` sets how many it
/// makes.
template <class Dispatch>
double operations_per_second(const Program& program, Dispatch dispatch) {
    program.set("factor", 0.5F);
    const double seconds_of_rounds = min_seconds([&](int count) {
        program.set("rounds", rounds * count);
        return seconds(dispatch);
    });
    return double(arithmetic_size.x) * arithmetic_size.y * rounds * glsl::operations_per_round /
           seconds_of_rounds;
}

/// Multiply-adds per second in compute shaders with work groups of 16 x 16 invocations.
double compute_operations_per_second(const Context& context, const Texture& target) {
    const Program program(context, load_source("limits_arithmetic.comp", {{"COMPUTE", ""}}));
    glBindImageTexture(0, target.get(), 0, GL_FALSE, 0, GL_WRITE_ONLY, rgba32f.internal);
    return operations_per_second(program, [&] {
        glUseProgram(program.get());
        glDispatchCompute(arithmetic_size.x / glsl::arithmetic_group,
                          arithmetic_size.y / glsl::arithmetic_group, 1);
    });
}

/// The macros of shaders/limits_copy.frag.
Defines copy_defines(const glsl::CopyPass& pass) {
    Defines defines = {{"READS", std::to_string(pass.reads)}};
    if (pass.writes) defines["WRITES"] = "";
    return defines;
}

}  // namespace

double measure_draw(const Context& context) {
    const Program nothing = fragment_program(context, "limits_launch.frag", {});
    const Frames fragments(context, {1, 1});
    return min_seconds([&](int count) { return seconds([&] { fragments.step(nothing, count); }); },
                       launch_patience);
}

DeviceLimits measure_limits(const Context& context) {
    DeviceLimits limits;
    // A draw cannot write to what it reads, so no pass writes in place.
    constexpr glsl::CopyPass passes[] = {{2, false, false}, {2, true, false}, {1, true, false}};
    glsl::measure_bandwidth(limits, passes, [&](const glsl::CopyPass& pass, std::size_t words) {
        const Program program = fragment_program(context, "limits_copy.frag", copy_defines(pass));
        program.set("impossible", -1.0F);
        const Frames frames(context, {row, int(words) / row});
        return min_seconds([&](int count) { return seconds([&] { frames.repeat(program, count); }); },
                           one_of_many(words * std::size_t(rgba32f.bytes)));
    });
    limits.launch_seconds = measure_draw(context);

    const Frames frames(context, arithmetic_size);
    const Program fragment = fragment_program(context, "limits_arithmetic.comp", {});
    limits.float32_operations_per_second = operations_per_second(fragment, [&] { frames.step(fragment, 1); });

    limits.compute_shader_float32_operations_per_second =
        compute_operations_per_second(context, frames.texture());
    context.check("measuring limits");
    return limits;
}

}  // namespace voxspring::gl
