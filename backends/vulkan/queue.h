// The order in which a device does things, and when the host knows that they are done.
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

/// Commands run in the order in which they are enqueued. What is recorded for it ends with a barrier to
/// whatever may read what it wrote, so that no two command buffers overlap where it matters.
class Queue {
public:
    /// Submissions that may be enqueued and not known to be finished; the host then waits for the oldest. So
    /// many that steps handed over one by one keep the device busy.
    static constexpr std::uint64_t max_submissions = 64;

    /// `device` must outlive the queue.
    explicit Queue(const Device& device);
    Queue(const Queue&) = delete;
    Queue& operator=(const Queue&) = delete;
    ~Queue() { abandon(); }

    const Device& device() const { return device_; }

    /// Commands to enqueue again and again, before earlier ones have finished too.
    Commands record(const std::function<void(const Commands&)>& write) const;

    /// They go with the next submit(), which does not outlive them.
    void enqueue(const Commands& commands) { enqueued_.push_back(*commands); }
    /// The same of commands that run once, from now on kept until they have.
    void enqueue_once(const std::function<void(const Commands&)>& write);
    /// Hands over what is enqueued, if anything. May wait.
    void submit();
    /// Waits for all of it.
    void wait();
    /// Drops what was not submitted and waits for the rest, where the device is not lost.
    void abandon() noexcept;
    /// Keeps an object alive until everything enqueued by now has run.
    void keep(std::shared_ptr<const void> object);

    /// Bytes into a buffer of as many, after what is enqueued and before what will be; may wait.
    void upload(const Buffer& to, std::span<const std::byte> bytes);
    /// Bytes out of a buffer, once all that is enqueued has run.
    void download(const Buffer& from, std::span<std::byte> bytes);
    /// The same from device to device, of one size; does not wait.
    void copy(const Buffer& from, const Buffer& to);
    /// No more than max_inline_bytes into a buffer; does not wait.
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
    vk::raii::Semaphore finished_;  // counts submissions
    std::uint64_t submitted_ = 0;
    std::vector<vk::CommandBuffer> enqueued_;
    std::deque<std::pair<std::uint64_t, std::shared_ptr<const void>>> kept_;  // until that submission
    Buffer staging_;
};

/// What shaders wrote is there for later shaders.
void shaders_then_shaders(const Commands& commands);
/// Whatever was written is there for whatever reads.
void all_then_all(const Commands& commands);

}  // namespace voxspring::vulkan
