#include "backends/gl/limits.h"

#include <array>
#include <chrono>
#include <cstddef>

#include "backends/gl/handles.h"
#include "backends/gl/program.h"
#include "backends/gl/texture.h"

namespace voxspring::gl {
namespace {

/// Three arrays of 64 MiB: a pass over them leaves nothing of one in a cache until it is read again.
constexpr glm::ivec2 copy_size{2048, 2048};
/// More fragments than any card has in flight, and work enough in each that its texel's write does not count.
constexpr glm::ivec2 arithmetic_size{1024, 1024};
constexpr int work_group = 16;  // along x and y, as in limits_arithmetic.glsl
constexpr int rounds = 4;
constexpr int operations_a_round = 64;

/// On the host's clock: batches are long, and a clock of the device need not wait for compute shaders.
template <class Enqueue>
double seconds(Enqueue enqueue) {
    glFinish();
    const auto begin = std::chrono::steady_clock::now();
    enqueue();
    glFinish();
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
}

/// Three frames of one size that draws step through, as those of a FragmentBackend.
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

    void draw(const Program& program, int count) const {
        glViewport(0, 0, size_.x, size_.y);
        glUseProgram(program.get());
        for (std::size_t n = 0; n < std::size_t(count); ++n) {
            const GLuint sources[] = {textures_[n % 3].get(), textures_[(n + 1) % 3].get()};
            glBindFramebuffer(GL_FRAMEBUFFER, framebuffers_[(n + 2) % 3].get());
            glBindTextures(0, 2, sources);
            glDrawArrays(GL_TRIANGLES, 0, 3);
        }
    }
    const Texture& texture() const { return textures_[0]; }

private:
    glm::ivec2 size_;
    std::array<Texture, 3> textures_;
    std::array<Framebuffer, 3> framebuffers_;
};

Program fragment_program(const Context& context, const char* fragment_shader) {
    return {context, load_source("full_screen.vert", {}), load_source(fragment_shader, {})};
}

double seconds_a_draw(const Context& context, glm::ivec2 size, const char* fragment_shader) {
    const Frames frames(context, size);
    const Program program = fragment_program(context, fragment_shader);
    return min_seconds([&](int count) { return seconds([&] { frames.draw(program, count); }); });
}

/// `dispatch()` runs `program`, whose every invocation does as many rounds as it is told.
template <class Dispatch>
double operations_per_second(const Program& program, Dispatch dispatch) {
    program.set("factor", 0.5F);
    const double seconds_of_rounds = min_seconds([&](int count) {
        program.set("rounds", rounds * count);
        return seconds(dispatch);
    });
    return double(arithmetic_size.x) * arithmetic_size.y * rounds * operations_a_round / seconds_of_rounds;
}

/// Of compute shaders; 16 x 16 invocations a work group.
double compute_operations_per_second(const Context& context, const Texture& target) {
    const Program program(context, load_source("limits_arithmetic.glsl", {{"COMPUTE", ""}}));
    glBindImageTexture(0, target.get(), 0, GL_FALSE, 0, GL_WRITE_ONLY, rgba32f.internal);
    return operations_per_second(program, [&] {
        glUseProgram(program.get());
        glDispatchCompute(arithmetic_size.x / work_group, arithmetic_size.y / work_group, 1);
    });
}

/// Three storage buffers of `words` words that dispatches of `groups` work groups step through, as those of a
/// ComputeBackend.
double seconds_a_dispatch(const Context& context, std::size_t words, GLuint groups, const char* shader) {
    std::array<Buffer, 3> buffers;
    for (Buffer& buffer : buffers) {
        buffer = make_buffer(context);
        glNamedBufferStorage(buffer.get(), GLsizeiptr(words * std::size_t(rgba32f.bytes)), nullptr, 0);
        glClearNamedBufferData(buffer.get(), rgba32f.internal, rgba32f.external, rgba32f.type, nullptr);
    }
    const Program program(context, load_source(shader, {}));
    glUseProgram(program.get());
    return min_seconds([&](int count) {
        return seconds([&] {
            for (std::size_t n = 0; n < std::size_t(count); ++n) {
                const GLuint order[] = {buffers[n % 3].get(), buffers[(n + 1) % 3].get(),
                                        buffers[(n + 2) % 3].get()};
                glBindBuffersBase(GL_SHADER_STORAGE_BUFFER, 0, 3, order);
                glDispatchCompute(groups, 1, 1);
                glMemoryBarrier(GL_SHADER_STORAGE_BARRIER_BIT);
            }
        });
    });
}

}  // namespace

DeviceLimits measure_limits(const Context& context) {
    DeviceLimits limits;
    const double bytes = 3.0 * copy_size.x * copy_size.y * rgba32f.bytes;
    limits.copy_bytes_per_second = bytes / seconds_a_draw(context, copy_size, "limits_copy.frag");
    limits.launch_seconds = seconds_a_draw(context, {1, 1}, "limits_launch.frag");

    const Frames frames(context, arithmetic_size);
    const Program fragment = fragment_program(context, "limits_arithmetic.glsl");
    limits.float32_operations_per_second = operations_per_second(fragment, [&] { frames.draw(fragment, 1); });

    limits.compute_shader_float32_operations_per_second =
        compute_operations_per_second(context, frames.texture());
    context.check("measuring limits");
    return limits;
}

DeviceLimits measure_compute_limits(const Context& context) {
    DeviceLimits limits;
    constexpr std::size_t words = std::size_t(copy_size.x) * std::size_t(copy_size.y);
    constexpr std::size_t copy_group = 256;  // as in limits_copy.comp
    constexpr std::size_t launch_group = 32;
    limits.copy_bytes_per_second =
        3.0 * double(words) * rgba32f.bytes /
        seconds_a_dispatch(context, words, GLuint(words / copy_group), "limits_copy.comp");
    limits.launch_seconds = seconds_a_dispatch(context, launch_group, 1, "limits_launch.comp");
    const Texture target = make_texture(context, rgba32f, arithmetic_size, nullptr);
    limits.float32_operations_per_second = compute_operations_per_second(context, target);
    context.check("measuring limits");
    return limits;
}

}  // namespace voxspring::gl
