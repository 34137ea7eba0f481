#include "backends/vulkan/compute_device.h"

#include <algorithm>
#include <bit>
#include <chrono>

#include "backends/glsl/compute_backend.h"
#include "backends/pace.h"
#include "backends/vulkan/program.h"

namespace voxspring::vulkan {
namespace {

/// A recording (a command buffer that is replayed) has at most 2^max_power steps: few enough that it takes
/// little memory, and that recording it pays off soon. A submission has at most most_steps_a_submission steps
/// or, if steps are long, fewer (Pace).
constexpr int max_power = 8;
constexpr int most_steps_a_submission = 512;

class BufferArray final : public glsl::Array {
public:
    explicit BufferArray(Buffer values) : Array(values.bytes()), buffer(std::move(values)) {}
    Buffer buffer;
};

Buffers buffers_of(const glsl::Arrays& arrays) {
    Buffers buffers;
    for (const auto& [binding, array] : arrays) {
        if (array != nullptr) buffers[binding] = &buffer_of(*array);
    }
    return buffers;
}

class ComputePass final : public glsl::Pass {
public:
    explicit ComputePass(vulkan::Pass made) : pass(std::move(made)) {}
    vulkan::Pass pass;
};
vulkan::Pass& pass_of(glsl::Pass& pass) { return static_cast<ComputePass&>(pass).pass; }

Commands record_mark(const Queue& queue, vk::QueryPool marks, std::uint32_t which) {
    return queue.record([&](const Commands& commands) {
        commands.resetQueryPool(marks, which, 1);
        commands.writeTimestamp(vk::PipelineStageFlagBits::eBottomOfPipe, marks, which);
    });
}

class ComputeDevice final : public glsl::Device {
public:
    explicit ComputeDevice(Precision precision)
        : precision_(precision),
          device_(precision),
          marks_(device_.get(), vk::QueryPoolCreateInfo({}, vk::QueryType::eTimestamp, 2)),
          dummy_buffer_(device_, Module::block_alignment, Place::device),
          sent_once_(device_),
          queue_(device_),
          pace_(most_steps_a_submission),
          mark_{record_mark(queue_, *marks_, 0), record_mark(queue_, *marks_, 1)} {}
    ~ComputeDevice() override { queue_.abandon(); }

    const vulkan::Device& device() const { return device_; }

    const Capabilities& capabilities() const override { return device_.capabilities(); }
    glsl::WorkGroupLimits work_group_limits() const override {
        const vk::PhysicalDeviceLimits& limits = device_.limits();
        const auto& extents = limits.maxComputeWorkGroupSize;
        return {limits.maxComputeWorkGroupInvocations,
                {extents[0], extents[1], extents[2]},
                limits.maxComputeSharedMemorySize};
    }
    const glsl::BufferLimits& buffer_limits() const override { return device_.buffer_limits(); }
    std::optional<std::uint64_t> free_memory_bytes() const override { return device_.free_memory_bytes(); }

    void use(const char* doing, const std::function<void()>& work) const override { guarded(doing, work); }
    void check(const char* doing) const override { device_.check(doing); }
    void wait() override { queue_.wait(); }
    void abandon() noexcept override { queue_.abandon(); }

    std::unique_ptr<glsl::Array> make(std::span<const std::byte> values) override {
        Buffer buffer(device_, values.size(), Place::device);
        queue_.upload(buffer, values);
        return std::make_unique<BufferArray>(std::move(buffer));
    }
    std::unique_ptr<glsl::Array> make_zeros(std::size_t bytes) override {
        Buffer buffer(device_, bytes, Place::device);
        queue_.enqueue_once([&](const Commands& commands) {
            commands.fillBuffer(buffer.get(), 0, VK_WHOLE_SIZE, 0);
            all_then_all(commands);
        });
        return std::make_unique<BufferArray>(std::move(buffer));
    }
    void overwrite(glsl::Array& array, std::span<const std::byte> values) override {
        queue_.upload(buffer_of(array), values);
    }
    void download(const glsl::Array& array, std::span<std::byte> values) override {
        queue_.download(buffer_of(array), values);
    }
    std::unique_ptr<glsl::Array> copy_of(const glsl::Array& array) override {
        Buffer buffer(device_, array.bytes(), Place::device);
        queue_.copy(buffer_of(array), buffer);
        queue_.wait();
        return std::make_unique<BufferArray>(std::move(buffer));
    }
    void copy(const glsl::Array& from, glsl::Array& to) override {
        queue_.copy(buffer_of(from), buffer_of(to));
        queue_.submit();
    }
    glsl::AddressedList make_addressed(std::span<const std::byte> values, std::size_t slots) override {
        return addressed_list(queue_, values, slots, device_.buffer_limits().max_bytes);
    }

    std::shared_ptr<glsl::Pass> pass(const glsl::Shader& shader, const glsl::Uniforms& uniforms,
                                     const glsl::Arrays& arrays) override {
        return std::make_shared<ComputePass>(
            Pass(queue_, program(shader), uniforms, buffers_of(arrays), dummy_buffer_));
    }
    void set(glsl::Pass& pass, const glsl::Uniforms& uniforms) override {
        pass_of(pass).set(queue_, uniforms);
    }
    void dispatch_once(const glsl::Shader& shader, std::size_t count, const glsl::Uniforms& uniforms,
                       const glsl::Arrays& arrays,
                       const std::map<unsigned, std::span<const std::byte>>& sent) override {
        Buffers buffers = buffers_of(arrays);
        std::vector<std::shared_ptr<const Buffer>> handed_over;
        for (const auto& [binding, values] : sent) {
            handed_over.push_back(sent_once_.holding(values));
            buffers[binding] = handed_over.back().get();
        }
        const auto made = program(shader);
        const auto pass = std::make_shared<Pass>(
            device_, made, sent_once_.holding(bytes_of(made->module(), uniforms)), buffers, dummy_buffer_);
        queue_.enqueue_once([&](const Commands& commands) {
            pass->bind_program(commands);
            pass->dispatch(commands, {glsl::striding_groups(count), 1, 1});
            shaders_then_shaders(commands);
        });
        queue_.keep(pass);
        for (const auto& buffer : handed_over) queue_.keep(buffer);
        queue_.submit();
    }

    bool records_checks() const override { return true; }
    void step_by(glsl::Dispatches step) override {
        if (step_) queue_.keep(std::move(step_));
        step_ = std::make_shared<RecordedSteps>(RecordedSteps{std::move(step)});
    }
    void forget_pace() override { pace_.forget(); }
    void step(int count) override {
        while (count > 0 && pace_.is_unknown()) {
            const int steps = std::min(count, pace_.steps());
            queue_.wait();
            const auto begin = std::chrono::steady_clock::now();
            enqueue_steps(steps);
            queue_.wait();
            pace_.measured(steps,
                           std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count());
            count -= steps;
        }
        enqueue_steps(count);
    }
    std::optional<std::uint64_t> step_counted() override {
        if (!device_.has_pipeline_statistics()) {
            step(1);
            return std::nullopt;
        }
        const vk::raii::QueryPool query(
            device_.get(),
            vk::QueryPoolCreateInfo({}, vk::QueryType::ePipelineStatistics, 1,
                                    vk::QueryPipelineStatisticFlagBits::eComputeShaderInvocations));
        queue_.enqueue_once([&](const Commands& commands) {
            commands.resetQueryPool(*query, 0, 1);
            commands.beginQuery(*query, 0, {});
            dispatch_all(commands, step_->dispatches[current()]);
            commands.endQuery(*query, 0);
        });
        have_enqueued(1);
        queue_.wait();
        using Result = vk::QueryResultFlagBits;
        return query.getResult<std::uint64_t>(0, 1, sizeof(std::uint64_t), Result::e64 | Result::eWait)
            .second;
    }

    void mark(bool at_end) override {
        queue_.enqueue(mark_[at_end ? 1 : 0]);
        // The first mark is submitted together with the first steps.
        if (at_end) queue_.submit();
    }
    double seconds_between_marks() const override {
        using Result = vk::QueryResultFlagBits;
        const auto ticks = marks_
                               .getResults<std::uint64_t>(0, 2, 2 * sizeof(std::uint64_t),
                                                          sizeof(std::uint64_t), Result::e64 | Result::eWait)
                               .second;
        const auto families = device_.physical().getQueueFamilyProperties();
        const std::uint32_t bits = families[device_.queue_family()].timestampValidBits;
        const std::uint64_t mask = bits == 64 ? ~std::uint64_t(0) : (std::uint64_t(1) << bits) - 1;
        return 1e-9 * double(device_.limits().timestampPeriod) * double((ticks[1] - ticks[0]) & mask);
    }
    double seconds_of(const std::vector<glsl::Dispatch>& cycle, int count) override {
        queue_.wait();
        queue_.enqueue_once([&](const Commands& commands) {
            pass_of(*cycle[0].pass).bind_program(commands);
            for (std::size_t n = 0; n < std::size_t(count); ++n) {
                const glsl::Dispatch& next = cycle[n % cycle.size()];
                pass_of(*next.pass).dispatch(commands, next.groups);
                shaders_then_shaders(commands);
            }
        });
        const auto begin = std::chrono::steady_clock::now();
        queue_.wait();
        return std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
    }
    bool has_float64() const override { return device_.has_float64(); }

private:
    /// What steps dispatch, and the recordings of these dispatches.
    struct RecordedSteps {
        glsl::Dispatches dispatches;
        /// Recordings of 2^power steps, by power and by the number of the current words (0 or 1) at the first
        /// step.
        std::map<std::pair<int, std::size_t>, Commands> recorded = {};
    };
    struct RecordedChecks {
        glsl::Dispatches dispatches;
        std::array<Commands, 2> recorded;
    };

    void check_by(glsl::Dispatches check) override {
        if (check_) queue_.keep(std::move(check_));
        check_ = nullptr;
        if (check_every() == 0) return;
        const auto record = [&](std::size_t current) {
            return queue_.record([&](const Commands& commands) { dispatch_all(commands, check[current]); });
        };
        std::array recorded = {record(0), record(1)};
        check_ = std::make_shared<RecordedChecks>(RecordedChecks{std::move(check), std::move(recorded)});
    }

    std::shared_ptr<const Program> program(const glsl::Shader& shader) {
        const std::string module =
            shader.file + shader.variant + "_" + to_string(shader.precision.value_or(precision_));
        const glm::ivec3 group = shader.group.value_or(glm::ivec3(64, 1, 1));
        std::string key = module;
        for (const int extent : {group.x, group.y, group.z}) key += " " + std::to_string(extent);
        for (const auto& [name, value] : shader.constants) key += " " + name + "=" + value;
        std::shared_ptr<const Program>& made = programs_.of(key);
        if (made) return made;
        made = std::make_shared<const Program>(device_, module, shader.constants, group);
        compile_time_ += made->compile_time();
        return made;
    }

    static void dispatch_all(const Commands& commands, const std::vector<glsl::Dispatch>& dispatches) {
        for (const glsl::Dispatch& dispatch : dispatches) {
            pass_of(*dispatch.pass).bind_program(commands);
            pass_of(*dispatch.pass).dispatch(commands, dispatch.groups);
            shaders_then_shaders(commands);
        }
    }
    /// The recording of 2^power steps. The first step reads the current one of the two arrays of words.
    const Commands& steps_of(int power) {
        const std::pair key(power, current());
        const auto found = step_->recorded.find(key);
        if (found != step_->recorded.end()) return found->second;
        Commands commands = queue_.record([&](const Commands& recording) {
            const glsl::Dispatches& both = step_->dispatches;
            const bool one_program = both[0].size() == 1;
            if (one_program) pass_of(*both[0][0].pass).bind_program(recording);
            for (std::size_t n = 0; n < std::size_t(1) << power; ++n) {
                const std::vector<glsl::Dispatch>& step = both[(current() + n) % 2];
                if (!one_program) {
                    dispatch_all(recording, step);
                    continue;
                }
                pass_of(*step[0].pass).dispatch(recording, step[0].groups);
                shaders_then_shaders(recording);
            }
        });
        return step_->recorded.emplace(key, std::move(commands)).first->second;
    }
    /// To be called after `count` steps were enqueued. Enqueues a check if one is due.
    void have_enqueued(int count) {
        count_steps(count);
        if (is_check_due()) queue_.enqueue(check_->recorded[current()]);
    }
    /// Hands over `count` steps, in submissions of at most pace_.steps() steps.
    void enqueue_steps(int count) {
        int unsubmitted = 0;
        while (count > 0) {
            int most = std::min({count, 1 << max_power, pace_.steps() - unsubmitted});
            if (const int every = check_every(); every > 0)
                most = int(std::min<std::int64_t>(most, every - steps() % every));
            const int power = int(std::bit_width(unsigned(most))) - 1;
            queue_.enqueue(steps_of(power));
            have_enqueued(1 << power);
            count -= 1 << power;
            unsubmitted += 1 << power;
            if (unsubmitted < pace_.steps()) continue;
            queue_.submit();
            unsubmitted = 0;
        }
        queue_.submit();
    }

    const Precision precision_;
    vulkan::Device device_;
    vk::raii::QueryPool marks_;
    glsl::ProgramCache<Program> programs_;
    Buffer dummy_buffer_;  // bound in place of buffers that a shader declares but does not use
    BufferPool sent_once_;
    Queue queue_;
    Pace pace_;
    std::array<Commands, 2> mark_;
    std::shared_ptr<RecordedSteps> step_;
    std::shared_ptr<RecordedChecks> check_;  // null: the state is not checked
};

}  // namespace

std::unique_ptr<glsl::Device> make_compute_device(const Options& options) {
    return guarded("opening the device", [&] { return std::make_unique<ComputeDevice>(options.precision); });
}

const Buffer& buffer_of(const glsl::Array& array) { return static_cast<const BufferArray&>(array).buffer; }

const Device& device_of(Backend& backend) {
    return dynamic_cast<ComputeDevice&>(dynamic_cast<glsl::OnDevice&>(backend).device()).device();
}

glsl::AddressedList addressed_list(Queue& queue, std::span<const std::byte> values, std::size_t slots,
                                   std::uint64_t max_bytes) {
    glsl::AddressedList list;
    if (values.empty()) return list;
    const std::size_t slot = values.size() / slots;
    const std::size_t part = slot * std::min<std::size_t>(slots, max_bytes / slot);
    for (std::size_t at = 0; at < values.size(); at += part) {
        const auto here = values.subspan(at, std::min(part, values.size() - at));
        Buffer buffer(queue.device(), here.size(), Place::addressed);
        queue.upload(buffer, here);
        for (std::size_t begin = 0; begin < here.size(); begin += slot)
            list.addresses.push_back(buffer.address() + begin);
        list.parts.push_back(std::make_unique<BufferArray>(std::move(buffer)));
    }
    return list;
}

}  // namespace voxspring::vulkan
