#include "backends/vulkan/queue.h"

#include <algorithm>
#include <array>
#include <cstring>
#include <limits>

namespace voxspring::vulkan {
namespace {

vk::raii::Semaphore make_counter(const Device& device) {
    const vk::SemaphoreTypeCreateInfo counts(vk::SemaphoreType::eTimeline, 0);
    return {device.get(), vk::SemaphoreCreateInfo({}, &counts)};
}

/// The largest size of the staging buffer, through which uploads and downloads go.
constexpr std::size_t max_staging_bytes = std::size_t(64) << 20;

void barrier(const Commands& commands, vk::PipelineStageFlags from, vk::AccessFlags written,
             vk::PipelineStageFlags to, vk::AccessFlags used) {
    commands.pipelineBarrier(from, to, {}, vk::MemoryBarrier(written, used), {}, {});
}

}  // namespace

void shaders_then_shaders(const Commands& commands) {
    using Stage = vk::PipelineStageFlagBits;
    using Access = vk::AccessFlagBits;
    barrier(commands, Stage::eComputeShader, Access::eShaderWrite, Stage::eComputeShader,
            Access::eShaderRead | Access::eShaderWrite);
}

void all_then_all(const Commands& commands) {
    using Stage = vk::PipelineStageFlagBits;
    using Access = vk::AccessFlagBits;
    constexpr auto stages = Stage::eComputeShader | Stage::eTransfer;
    barrier(commands, stages, Access::eShaderWrite | Access::eTransferWrite, stages | Stage::eHost,
            Access::eShaderRead | Access::eShaderWrite | Access::eUniformRead | Access::eTransferRead |
                Access::eTransferWrite | Access::eHostRead);
}

Queue::Queue(const Device& device)
    : device_(device),
      queue_(device.get(), device.queue_family(), 0),
      pool_(device.get(), vk::CommandPoolCreateInfo({}, device.queue_family())),
      finished_(make_counter(device)) {}

void Queue::abandon() noexcept {
    try {
        enqueued_.clear();
        wait_for(submitted_);
    } catch (const std::exception&) {
        // The wait throws if the device is lost. Such a device runs nothing any more.
    }
}

Commands Queue::begin(vk::CommandBufferUsageFlags usage) const {
    const vk::CommandBufferAllocateInfo one(*pool_, vk::CommandBufferLevel::ePrimary, 1);
    Commands commands = std::move(vk::raii::CommandBuffers(device_.get(), one).front());
    commands.begin(vk::CommandBufferBeginInfo(usage));
    return commands;
}

Commands Queue::record(const std::function<void(const Commands&)>& write) const {
    Commands commands = begin(vk::CommandBufferUsageFlagBits::eSimultaneousUse);
    write(commands);
    commands.end();
    return commands;
}

void Queue::enqueue_once(const std::function<void(const Commands&)>& write) {
    auto commands = std::make_shared<Commands>(begin(vk::CommandBufferUsageFlagBits::eOneTimeSubmit));
    write(*commands);
    commands->end();
    enqueue(*commands);
    keep(std::move(commands));
}

void Queue::submit() {
    if (enqueued_.empty()) return;
    const std::uint64_t submission = submitted_ + 1;
    const vk::TimelineSemaphoreSubmitInfo count({}, submission);
    const vk::Semaphore finished = *finished_;
    queue_.submit(vk::SubmitInfo({}, {}, enqueued_, finished, &count));
    enqueued_.clear();
    submitted_ = submission;
    if (submitted_ > max_submissions) wait_for(submitted_ - max_submissions);
    forget_finished();
}

void Queue::wait_for(std::uint64_t submission) const {
    const vk::Semaphore finished = *finished_;
    const vk::SemaphoreWaitInfo wait({}, finished, submission);
    constexpr std::uint64_t nanoseconds = 1'000'000'000;
    while (device_.get().waitSemaphores(wait, nanoseconds) == vk::Result::eTimeout) continue;
}

void Queue::wait() {
    submit();
    wait_for(submitted_);
    forget_finished();
}

void Queue::keep(std::shared_ptr<const void> object) {
    kept_.emplace_back(submitted_ + (enqueued_.empty() ? 0 : 1), std::move(object));
}

void Queue::forget_finished() {
    if (kept_.empty()) return;
    const std::uint64_t finished = finished_.getCounterValue();
    while (!kept_.empty() && kept_.front().first <= finished) kept_.pop_front();
}

const Buffer& Queue::staging(std::size_t bytes) {
    const std::size_t size = std::min(bytes, max_staging_bytes);
    if (staging_.bytes() < size) {
        staging_ = {};
        staging_ = Buffer(device_, size, Place::staging);
    }
    return staging_;
}

void Queue::upload(const Buffer& to, std::span<const std::byte> bytes) {
    for (std::size_t done = 0; done < bytes.size();) {
        wait();  // earlier commands may still read this buffer
        const Buffer& from = staging(bytes.size());
        const std::size_t part = std::min(from.bytes(), bytes.size() - done);
        std::memcpy(from.host().data(), bytes.data() + done, part);
        enqueue_once([&](const Commands& commands) {
            commands.copyBuffer(from.get(), to.get(), vk::BufferCopy(0, done, part));
            all_then_all(commands);
        });
        submit();
        done += part;
    }
}

void Queue::download(const Buffer& from, std::span<std::byte> bytes) {
    for (std::size_t done = 0; done < bytes.size();) {
        wait();
        const Buffer& to = staging(bytes.size());
        const std::size_t part = std::min(to.bytes(), bytes.size() - done);
        enqueue_once([&](const Commands& commands) {
            all_then_all(commands);
            commands.copyBuffer(from.get(), to.get(), vk::BufferCopy(done, 0, part));
            all_then_all(commands);
        });
        wait();
        std::memcpy(bytes.data() + done, to.host().data(), part);
        done += part;
    }
}

void Queue::copy(const Buffer& from, const Buffer& to) {
    if (from.bytes() == 0) return;
    enqueue_once([&](const Commands& commands) {
        all_then_all(commands);
        commands.copyBuffer(from.get(), to.get(), vk::BufferCopy(0, 0, from.bytes()));
        all_then_all(commands);
    });
}

void Queue::update(const Buffer& to, std::span<const std::byte> bytes) {
    enqueue_once([&](const Commands& commands) {
        all_then_all(commands);
        commands.updateBuffer<std::byte>(to.get(), 0, bytes);
        all_then_all(commands);
    });
}

}  // namespace voxspring::vulkan
