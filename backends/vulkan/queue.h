// The order in which a device runs commands, and how the host learns that they are done.
#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <span>
#include <utility>
#include <vector>

#include "backends/vulkan/buffer.h"

namespace voxspring::vulkan {

using Commands = vk::raii::CommandBuffer;

/// Commands run in the order in which they are enqueued. Every recording that writes to buffers ends with a
/// barrier for the shaders that may use them later. Copies begin with a barrier for what shaders wrote
/// before, or wait for it. So later command buffers see what earlier ones wrote.
class Queue {
public:
    /// The most submissions that may be unfinished as far as the host knows. Beyond this number the host
    /// waits for the oldest one. The number is large enough that steps handed over one by one keep the device
    /// busy.
    static constexpr std::uint64_t max_submissions = 64;

    /// `device` must outlive the queue.
    explicit Queue(const Device& device);
    Queue(const Queue&) = delete;
    Queue& operator=(const Queue&) = delete;
    ~Queue() { abandon(); }

    const Device& device() const { return device_; }

    /// Records commands that can be enqueued again and again, even before earlier runs have finished.
    Commands record(const std::function<void(const Commands&)>& write) const;

    /// Enqueues commands for the next submit(). They must exist until they have run.
    void enqueue(const Commands& commands) { enqueued_.push_back(*commands); }
    /// Records commands that run once. The queue keeps them until they have run.
    void enqueue_once(const std::function<void(const Commands&)>& write);
    /// Submits the enqueued commands, if there are any. Waits if more than max_submissions are unfinished.
    void submit();
    /// Waits for everything that is enqueued.
    void wait();
    /// Drops commands that were not submitted, and waits for the others unless the device is lost.
    void abandon() noexcept;
    /// Keeps an object alive until everything enqueued by now has run.
    void keep(std::shared_ptr<const void> object);

    /// Copies bytes into a buffer of the same size, for later commands. Waits for what is enqueued already.
    void upload(const Buffer& to, std::span<const std::byte> bytes);
    /// Copies bytes out of a buffer, once everything enqueued has run.
    void download(const Buffer& from, std::span<std::byte> bytes);
    /// Copies one buffer into another of the same size. Does not wait.
    void copy(const Buffer& from, const Buffer& to);
    /// Writes at most max_inline_bytes bytes into a buffer. Does not wait.
    void update(const Buffer& to, std::span<const std::byte> bytes);
    static constexpr std::size_t max_inline_bytes = 65536;

private:
    Commands begin(vk::CommandBufferUsageFlags usage) const;
    void wait_for(std::uint64_t submission) const;
    void forget_finished();
    const Buffer& staging(std::size_t bytes);

    const Device& device_;
    vk::raii::Queue queue_;
    vk::raii::CommandPool pool_;
    vk::raii::Semaphore finished_;  // counts finished submissions
    std::uint64_t submitted_ = 0;
    std::vector<vk::CommandBuffer> enqueued_;
    // Objects, each kept alive until the submission with the number beside it has finished.
    std::deque<std::pair<std::uint64_t, std::shared_ptr<const void>>> kept_;
    Buffer staging_;
};

/// Makes what shaders wrote visible to later shaders.
void shaders_then_shaders(const Commands& commands);
/// Makes everything that was written visible to everything that reads later.
void all_then_all(const Commands& commands);

}  // namespace voxspring::vulkan
