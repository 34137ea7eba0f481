#include "backends/vulkan/limits.h"

#include <array>
#include <chrono>

#include "backends/glsl/limits.h"
#include "backends/vulkan/program.h"

namespace voxspring::vulkan {
namespace {

/// Seconds on the host's clock that the commands recorded by `write` take: from handing them over until they
/// are known to be done.
double seconds(Queue& queue, const std::function<void(const Commands&)>& write) {
    queue.wait();
    queue.enqueue_once(write);
    const auto begin = std::chrono::steady_clock::now();
    queue.wait();
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
}

/// Dispatches of one shader over storage buffers made for it, at bindings 0, 1 and so on.
class Dispatches {
public:
    Dispatches(Queue& queue, const std::string& shader, const glsl::Constants& constants, std::size_t count,
               std::size_t bytes)
        : queue_(queue),
          program_(std::make_shared<const Program>(queue.device(), shader, constants)),
          nothing_(queue.device(), Module::block_alignment, Place::device) {
        buffers_.reserve(count);
        for (std::size_t n = 0; n < count; ++n) {
            buffers_.emplace_back(queue.device(), bytes, Place::device);
            bound_[std::uint32_t(n)] = &buffers_.back();
            queue.enqueue_once([&](const Commands& commands) {
                commands.fillBuffer(buffers_.back().get(), 0, VK_WHOLE_SIZE, 0);
                all_then_all(commands);
            });
        }
    }
    Dispatches(const Dispatches&) = delete;
    Dispatches& operator=(const Dispatches&) = delete;
    ~Dispatches() { queue_.abandon(); }

    Uniforms uniforms() const { return Uniforms(program_->module()); }
    void set(const Uniforms& uniforms) {
        pass_ = std::make_unique<Pass>(queue_, program_, uniforms, bound_, nothing_);
    }
    double seconds_of(int count, glm::uvec3 groups) {
        return seconds(queue_, [&](const Commands& commands) {
            pass_->bind_program(commands);
            for (int n = 0; n < count; ++n) {
                pass_->dispatch(commands, groups);
                shaders_then_shaders(commands);
            }
        });
    }

private:
    Queue& queue_;
    std::shared_ptr<const Program> program_;
    Buffer nothing_;
    std::vector<Buffer> buffers_;
    Buffers bound_;
    std::unique_ptr<Pass> pass_;
};

/// The rate of multiply-adds. Each invocation does as many rounds as it is told.
template <class Real>
double operations_per_second(Queue& queue, const std::string& shader) {
    constexpr auto side = std::size_t(glsl::arithmetic_side);
    constexpr auto groups = unsigned(glsl::arithmetic_side / glsl::arithmetic_group);
    Dispatches dispatches(queue, shader, {}, 1, side * side * 4 * sizeof(Real));
    Uniforms uniforms = dispatches.uniforms();
    uniforms.set("factor", Real(0.5));
    const double seconds_of_rounds = min_seconds([&](int count) {
        uniforms.set("rounds", glsl::rounds * count);
        queue.wait();
        dispatches.set(uniforms);
        return dispatches.seconds_of(1, {groups, groups, 1});
    });
    return double(side * side) * glsl::rounds * glsl::operations_a_round / seconds_of_rounds;
}

}  // namespace

DeviceLimits measure_limits(Queue& queue) {
    DeviceLimits limits;
    glsl::measure_bandwidth(limits, glsl::compute_copies, [&](const glsl::CopyPass& pass, std::size_t words) {
        const std::size_t bytes = words * glsl::copied_word;
        Dispatches dispatches(queue, "limits_copy_float32", pass.constants(), 3, bytes);
        Uniforms uniforms = dispatches.uniforms();
        uniforms.set("impossible", -1.0F);
        dispatches.set(uniforms);
        const glm::uvec3 groups(words / glsl::copy_group, 1, 1);
        return min_seconds([&](int count) { return dispatches.seconds_of(count, groups); },
                           one_of_many(bytes));
    });
    constexpr std::size_t launch_group = 32;  // as in limits_launch.comp
    Dispatches nothing(queue, "limits_launch_float32", {}, 1, launch_group * glsl::copied_word);
    nothing.set(nothing.uniforms());
    limits.launch_seconds = min_seconds([&](int count) { return nothing.seconds_of(count, {1, 1, 1}); });
    limits.float32_operations_per_second = operations_per_second<float>(queue, "limits_arithmetic_float32");
    if (queue.device().has_float64()) {
        limits.float64_operations_per_second =
            operations_per_second<double>(queue, "limits_arithmetic_float64");
    }
    return limits;
}

}  // namespace voxspring::vulkan
