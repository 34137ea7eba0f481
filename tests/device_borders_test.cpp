// Borders from device to device over a CUDA whose devices are the host's memory: streams are queues, of which
// any may go on that does not wait for an event. So whatever an order of enqueueing leaves open is tried.
#include "cuda/common/device_borders.h"

#include <gtest/gtest.h>

#include <cstdlib>
#include <cstring>
#include <deque>
#include <functional>
#include <limits>
#include <memory>
#include <random>
#include <string>
#include <vector>

#include "backends/device_choice.h"
#include "cuda/device/stream.h"

namespace {

struct FakeEvent {
    int recorded = 0;  ///< so many times it was enqueued
    int passed = 0;    ///< of them the device has passed
};
struct Operation {
    std::function<void()> run;
    const FakeEvent* event = nullptr;  ///< that it waits for; null: none
    int until = 0;
};
using FakeStream = std::deque<Operation>;

std::vector<FakeStream*> streams;
std::mt19937 random_numbers;
bool peers_reach_each_other = true;

std::size_t random_below(std::size_t end) { return random_numbers() % end; }

/// One operation of a stream that can go on; false where none can.
bool run_one() {
    std::vector<FakeStream*> ready;
    for (FakeStream* stream : streams) {
        if (stream->empty()) continue;
        const Operation& next = stream->front();
        if (next.event == nullptr || next.event->passed >= next.until) ready.push_back(stream);
    }
    if (ready.empty()) return false;
    FakeStream& stream = *ready[random_below(ready.size())];
    const Operation next = stream.front();
    stream.pop_front();
    next.run();
    return true;
}

FakeStream& fake(cudaStream_t stream) { return *reinterpret_cast<FakeStream*>(stream); }
FakeEvent& fake(cudaEvent_t event) { return *reinterpret_cast<FakeEvent*>(event); }

void enqueue(cudaStream_t stream, std::function<void()> run) { fake(stream).push_back({std::move(run)}); }

cudaError_t enqueue_copy(void* to, const void* from, std::size_t bytes, cudaStream_t stream) {
    enqueue(stream, [=] { std::memcpy(to, from, bytes); });
    return cudaSuccess;
}

}  // namespace

// --- The calls that are made ---------------------------------------------------------------------------

extern "C" {
cudaError_t cudaMalloc(void** memory, std::size_t bytes) {
    *memory = std::malloc(bytes);
    return cudaSuccess;
}
cudaError_t cudaFree(void* memory) {
    std::free(memory);
    return cudaSuccess;
}
cudaError_t cudaMallocHost(void** memory, std::size_t bytes) { return cudaMalloc(memory, bytes); }
cudaError_t cudaFreeHost(void* memory) { return cudaFree(memory); }
cudaError_t cudaStreamCreateWithFlags(cudaStream_t* stream, unsigned) {
    streams.push_back(new FakeStream);
    *stream = reinterpret_cast<cudaStream_t>(streams.back());
    return cudaSuccess;
}
cudaError_t cudaStreamDestroy(cudaStream_t stream) {
    std::erase(streams, &fake(stream));
    delete &fake(stream);
    return cudaSuccess;
}
cudaError_t cudaStreamSynchronize(cudaStream_t stream) {
    while (!fake(stream).empty()) {
        if (!run_one()) return cudaErrorLaunchTimeout;
    }
    return cudaSuccess;
}
cudaError_t cudaStreamWaitEvent(cudaStream_t stream, cudaEvent_t event, unsigned) {
    fake(stream).push_back({[] {}, &fake(event), fake(event).recorded});
    return cudaSuccess;
}
cudaError_t cudaEventCreateWithFlags(cudaEvent_t* event, unsigned) {
    *event = reinterpret_cast<cudaEvent_t>(new FakeEvent);
    return cudaSuccess;
}
cudaError_t cudaEventDestroy(cudaEvent_t event) {
    delete &fake(event);
    return cudaSuccess;
}
cudaError_t cudaEventRecord(cudaEvent_t event, cudaStream_t stream) {
    enqueue(stream, [&event = fake(event), number = ++fake(event).recorded] { event.passed = number; });
    return cudaSuccess;
}
cudaError_t cudaEventSynchronize(cudaEvent_t event) {
    while (fake(event).passed < fake(event).recorded) {
        if (!run_one()) return cudaErrorLaunchTimeout;
    }
    return cudaSuccess;
}
cudaError_t cudaMemcpyAsync(void* to, const void* from, std::size_t bytes, cudaMemcpyKind,
                            cudaStream_t stream) {
    return enqueue_copy(to, from, bytes, stream);
}
cudaError_t cudaMemcpyPeerAsync(void* to, int to_device, const void* from, int from_device, std::size_t bytes,
                                cudaStream_t stream) {
    EXPECT_NE(to_device, from_device);
    return enqueue_copy(to, from, bytes, stream);
}
cudaError_t cudaDeviceCanAccessPeer(int* possible, int, int) {
    *possible = peers_reach_each_other ? 1 : 0;
    return cudaSuccess;
}
// Both borders of a part may be with the same device.
cudaError_t cudaDeviceEnablePeerAccess(int, unsigned) { return cudaErrorPeerAccessAlreadyEnabled; }
cudaError_t cudaGetLastError() { return cudaSuccess; }
const char* cudaGetErrorName(cudaError_t) { return "cudaErrorOfTheFake"; }
const char* cudaGetErrorString(cudaError_t) { return "a stream waits for ever"; }
}

namespace voxspring::cuda {

Device::Device() { number_ = DeviceOfThread::now().number; }

template <class Real>
void gather_places(const BorderPlaces<Real>& places, Real* message, const Stream& stream) {
    enqueue(stream.get(), [=] {
        for (std::size_t n = 0; n < places.count; ++n) gather_place(places, n, message);
    });
}
template <class Real>
void scatter_places(const BorderPlaces<Real>& places, const Real* message, const Stream& stream) {
    enqueue(stream.get(), [=] {
        for (std::size_t n = 0; n < places.count; ++n) scatter_place(places, n, message);
    });
}
template void gather_places(const BorderPlaces<float>&, float*, const Stream&);
template void scatter_places(const BorderPlaces<float>&, const float*, const Stream&);
template void gather_places(const BorderPlaces<double>&, double*, const Stream&);
template void scatter_places(const BorderPlaces<double>&, const double*, const Stream&);

namespace {

/// A part of four particles, 0 and 3 of which are ghosts where there is a part before or behind. It knows
/// where they have to be after each step, and its steps look whether they are.
class Part {
public:
    Part(int number, int parts, int device, const std::string& way) : number_(number), parts_(parts) {
        for (int particle = 0; particle < 4; ++particle) place(particle, 0);
        std::vector<SharedElements> shared;
        if (has_before()) shared.push_back({{1}, {0}});
        if (has_behind()) shared.push_back({{2}, {3}});
        const DeviceOfThread taken({device, false});
        borders = make_device_borders<float>(
            shared, way, Device(),
            {.stream = stream_,
             .now = [this] { return BorderPlaces<float>{nullptr, 0, state_.data(), nullptr, 1, 4}; },
             .written = [this] { ++written_; }});
    }

    void step() {
        ++steps_;
        enqueue(stream_.get(), [this, step = steps_] {
            for (int particle = 0; particle < 4; ++particle) {
                for (int axis = 0; axis < 3; ++axis)
                    EXPECT_EQ(state_[index(particle, axis)], expected(particle, axis, step - 1))
                        << "part " << number_ << ", particle " << particle << ", step " << step;
                // A ghost that nothing is written to is of no use to the next step.
                if (is_ghost(particle)) {
                    for (int axis = 0; axis < 3; ++axis)
                        state_[index(particle, axis)] = std::numeric_limits<float>::quiet_NaN();
                } else {
                    place(particle, step);
                }
            }
            ++done_;
        });
    }
    int steps_done() const { return done_; }
    int written() const { return written_; }

    std::shared_ptr<DeviceBorders> borders;
    int sent = 0, received = 0;

private:
    bool has_before() const { return number_ > 0; }
    bool has_behind() const { return number_ + 1 < parts_; }
    bool is_ghost(int particle) const {
        return (particle == 0 && has_before()) || (particle == 3 && has_behind());
    }
    static std::size_t index(int particle, int axis) { return std::size_t(particle + 4 * axis); }
    /// Of what the whole has there: parts have two particles each and see those beside them.
    float expected(int particle, int axis, int step) const {
        return float(1000 * step + 10 * (2 * number_ + particle) + axis);
    }
    void place(int particle, int step) {
        for (int axis = 0; axis < 3; ++axis) state_[index(particle, axis)] = expected(particle, axis, step);
    }

    const int number_, parts_;
    const Stream stream_;
    std::vector<float> state_ = std::vector<float>(12);
    int steps_ = 0, done_ = 0, written_ = 0;
};

std::vector<std::unique_ptr<Part>> parts_on(const std::vector<int>& devices, const std::string& way) {
    std::vector<std::unique_ptr<Part>> parts;
    for (const int device : devices)
        parts.push_back(std::make_unique<Part>(int(parts.size()), int(devices.size()), device, way));
    std::vector<std::shared_ptr<DeviceBorders>> all;
    for (const auto& part : parts) all.push_back(part->borders);
    for (std::size_t n = 0; n < parts.size(); ++n) parts[n]->borders->connect(all, n);
    return parts;
}

/// Whether the host of a part may send, or receive, once more: DeviceBorders.
bool may_go_on(const std::vector<std::unique_ptr<Part>>& parts, std::size_t n) {
    const Part& part = *parts[n];
    const bool sends = part.sent == part.received;
    for (const std::size_t other : {n - 1, n + 1}) {
        if (other >= parts.size()) continue;
        if (sends && parts[other]->received + 1 < part.sent) return false;
        if (!sends && parts[other]->sent < part.sent) return false;
    }
    return true;
}

void run(const std::vector<std::unique_ptr<Part>>& parts, int steps) {
    for (;;) {
        std::vector<Part*> ready;
        for (std::size_t n = 0; n < parts.size(); ++n) {
            const bool is_done = parts[n]->received == steps;
            if (!is_done && may_go_on(parts, n)) ready.push_back(parts[n].get());
        }
        if (ready.empty()) break;
        Part& part = *ready[random_below(ready.size())];
        if (part.sent == part.received) {
            part.step();
            part.borders->send();
            ++part.sent;
        } else {
            part.borders->receive();
            ++part.received;
        }
        for (std::size_t n = random_below(6); n > 0 && run_one(); --n) continue;
    }
    while (run_one()) continue;
}

class DeviceBorderWays : public ::testing::TestWithParam<std::string> {};
INSTANTIATE_TEST_SUITE_P(, DeviceBorderWays, ::testing::Values("peer", "stores"));

TEST_P(DeviceBorderWays, BringEveryStepItsGhosts) {
    constexpr int steps = 30;
    for (const std::vector<int>& devices : {std::vector<int>{0, 1}, {0, 0, 0}, {2, 0, 1, 1, 0}}) {
        for (unsigned seed = 0; seed < 100; ++seed) {
            random_numbers.seed(seed);
            const auto parts = parts_on(devices, GetParam());
            for (std::size_t n = 0; n < parts.size(); ++n)
                EXPECT_EQ(parts[n]->borders->bytes(), 3 * sizeof(float));
            run(parts, steps);
            for (std::size_t n = 0; n < parts.size(); ++n) {
                EXPECT_EQ(parts[n]->steps_done(), steps);
                const bool is_last = n == 0 || n + 1 == parts.size();
                EXPECT_EQ(parts[n]->written(), steps * (is_last ? 1 : 2));
            }
            if (HasFailure()) FAIL() << "with seed " << seed << " on " << devices.size() << " devices";
        }
    }
}

TEST_P(DeviceBorderWays, SayWhichDevicesDoNotReachEachOther) {
    peers_reach_each_other = false;
    EXPECT_EQ(parts_on({1, 1}, GetParam()).size(), 2u) << "a device reaches itself";
    std::string reason = "none";
    try {
        (void)parts_on({1, 3}, GetParam());
    } catch (const Unavailable& refusal) {
        reason = refusal.what();
    }
    peers_reach_each_other = true;
    EXPECT_EQ(reason, "device 1 has no peer access to device 3");
}

TEST_P(DeviceBorderWays, MayEndInAnyOrder) {
    for (const bool first : {true, false}) {
        auto parts = parts_on({0, 1}, GetParam());
        run(parts, 3);
        (first ? parts.front() : parts.back()).reset();
        (first ? parts.back() : parts.front())->borders.reset();
    }
}

}  // namespace
}  // namespace voxspring::cuda
