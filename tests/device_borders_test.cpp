// Borders from device to device over a fake CUDA whose devices are the host's memory. Streams are queues, and
// at random any of them goes on that does not wait for an event. This tries the orders that the enqueueing
// permits.
#include "cuda/common/device_borders.h"

#include <dlfcn.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <cmath>
#include <cstddef>
#include <cstdlib>
#include <cstring>
#include <deque>
#include <functional>
#include <limits>
#include <map>
#include <memory>
#include <mutex>
#include <numeric>
#include <optional>
#include <random>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "backends/device_choice.h"
#include "cuda/device/check.h"
#include "cuda/device/nccl.h"
#include "cuda/device/stream.h"
#include "tests/surroundings.h"

namespace {

struct FakeEvent {
    int recorded = 0;  ///< so many times it was enqueued
    int passed = 0;    ///< of them the device has passed
};
struct Operation {
    std::function<void()> run;
    const FakeEvent* event = nullptr;  ///< that it waits for; null: none
    int until = 0;
    std::function<bool()> is_ready = [] { return true; };  ///< what a kernel waits for
};
using FakeStream = std::deque<Operation>;

std::vector<FakeStream*> streams;
std::mt19937 random_numbers;
bool peers_reach_each_other = true;

std::size_t random_below(std::size_t end) { return random_numbers() % end; }

void run_front(FakeStream& stream) {
    const Operation next = stream.front();
    stream.pop_front();
    next.run();
}

/// Runs one operation of a stream, not of `stopped`, that can go on; returns false if there is none.
bool run_one(const std::vector<FakeStream*>& stopped = {}) {
    std::vector<FakeStream*> ready;
    for (FakeStream* stream : streams) {
        if (stream->empty() || std::find(stopped.begin(), stopped.end(), stream) != stopped.end()) continue;
        const Operation& next = stream->front();
        if ((next.event == nullptr || next.event->passed >= next.until) && next.is_ready())
            ready.push_back(stream);
    }
    if (ready.empty()) return false;
    run_front(*ready[random_below(ready.size())]);
    return true;
}

thread_local int current_device = 0;

struct FakeCommunicator {
    int ranks, rank, device;
    std::vector<std::string> ended = {};  ///< how
};
struct FakeChannel {
    int sent = 0, received = 0;  ///< enqueued
    FakeEvent arrived;
    std::map<int, std::vector<std::byte>> messages;
};
std::mutex nccl_mutex;
std::vector<std::unique_ptr<FakeCommunicator>> communicators;
std::map<std::pair<int, int>, FakeChannel> channels;  ///< from and to
std::atomic<bool> nccl_hangs = false;

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
cudaError_t cudaDeviceGetStreamPriorityRange(int* least, int* greatest) {
    *least = 0;
    *greatest = -5;
    return cudaSuccess;
}
cudaError_t cudaStreamCreateWithPriority(cudaStream_t* stream, unsigned flags, int priority) {
    EXPECT_EQ(priority, -5) << "the greatest is the least number";
    return cudaStreamCreateWithFlags(stream, flags);
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
cudaError_t cudaMemsetAsync(void* memory, int value, std::size_t bytes, cudaStream_t stream) {
    enqueue(stream, [=] { std::memset(memory, value, bytes); });
    return cudaSuccess;
}
cudaError_t cudaMemcpyPeerAsync(void* to, int to_device, const void* from, int from_device, std::size_t bytes,
                                cudaStream_t stream) {
    EXPECT_NE(to_device, from_device);
    return enqueue_copy(to, from, bytes, stream);
}
cudaError_t cudaDeviceGetP2PAttribute(int* value, cudaDeviceP2PAttr, int, int) {
    *value = 1;
    return cudaSuccess;
}
cudaError_t cudaDeviceCanAccessPeer(int* possible, int, int) {
    *possible = peers_reach_each_other ? 1 : 0;
    return cudaSuccess;
}
// Both borders of a part may be shared with the same device.
cudaError_t cudaDeviceEnablePeerAccess(int, unsigned) {
    EXPECT_TRUE(peers_reach_each_other) << "CUDA refuses that";
    return cudaErrorPeerAccessAlreadyEnabled;
}
cudaError_t cudaGetLastError() { return cudaSuccess; }
cudaError_t cudaGetDevice(int* device) {
    *device = current_device;
    return cudaSuccess;
}
cudaError_t cudaSetDevice(int device) {
    current_device = device;
    return cudaSuccess;
}
const char* cudaGetErrorName(cudaError_t) { return "cudaErrorOfTheFake"; }
const char* cudaGetErrorString(cudaError_t) { return "a stream waits for ever"; }

int fake_nccl_init(void** communicator, int ranks, int rank) {
    while (nccl_hangs) std::this_thread::sleep_for(std::chrono::milliseconds(1));
    const std::lock_guard lock(nccl_mutex);
    communicators.push_back(
        std::make_unique<FakeCommunicator>(FakeCommunicator{ranks, rank, current_device}));
    *communicator = communicators.back().get();
    return 0;
}
int fake_nccl_end(void* communicator, const char* how) {
    static_cast<FakeCommunicator*>(communicator)->ended.emplace_back(how);
    return 0;
}
/// The n-th transfer from one rank to another: the receiver's stream waits for the sender's.
int fake_nccl_transfer(void* memory, std::size_t bytes, int peer, void* communicator, void* stream,
                       bool sends) {
    const FakeCommunicator& own = *static_cast<FakeCommunicator*>(communicator);
    FakeChannel& channel = channels[sends ? std::pair(own.rank, peer) : std::pair(peer, own.rank)];
    const int number = ++(sends ? channel.sent : channel.received);
    auto& queue = *static_cast<FakeStream*>(stream);
    if (sends) {
        queue.push_back({[=, &channel] {
            const auto* const from = static_cast<const std::byte*>(memory);
            channel.messages[number].assign(from, from + bytes);
            channel.arrived.passed = number;
        }});
    } else {
        queue.push_back({[=, &channel] {
                             EXPECT_EQ(channel.messages.at(number).size(), bytes);
                             std::memcpy(memory, channel.messages.at(number).data(), bytes);
                             channel.messages.erase(number);
                         },
                         &channel.arrived, number});
    }
    return 0;
}
}

namespace voxspring::cuda {

Device::Device() {
    number = DeviceOfThread::now().number;
    check(cudaSetDevice(number));
}

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
/// As the kernel does it, in two parts: it stores its messages, and it takes those that have arrived.
template <class Real>
void exchange_places(const BorderPlaces<Real>& places, const BorderLinks<Real>& links,
                     const ExchangeLaunch& launch, const WaitLimit&, const Stream& stream) {
    EXPECT_EQ(launch.blocks, 1u) << "enough for a message of one particle";
    const BorderLink<Real>* const first = links.data();
    for (const BorderLink<Real>* link = first; launch.stores && link < first + links.size(); ++link) {
        enqueue(stream.get(), [=] {
            const std::uint32_t number = *link->taken;
            const auto leaving = link->leaving(places);
            for (std::size_t n = 0; n < leaving.count; ++n) {
                split_place(leaving, n, [&](int k, Vector<float> numbers) {
                    TaggedPoint& word = link->outbox[number % 2][std::size_t(k) * leaving.count + n];
                    EXPECT_EQ(word.tag + 1, std::max(number, 1U)) << "it overwrites a message not yet taken";
                    word = {numbers, number + 1};
                });
            }
        });
    }
    for (const BorderLink<Real>* link = first; launch.takes && link < first + links.size(); ++link) {
        const auto here = [=](std::size_t word) { return link->inbox[*link->taken % 2][word]; };
        const auto take = [=] {
            const auto arriving = link->arriving(places);
            for (std::size_t n = 0; n < arriving.count; ++n) {
                join_place(arriving, n, [&](int k) {
                    const TaggedPoint word = here(std::size_t(k) * arriving.count + n);
                    EXPECT_EQ(word.tag, *link->taken + 1);
                    return word.point;
                });
            }
            ++*link->taken;
        };
        // A launch that only takes does not wait: what it takes has been sent by then.
        const auto is_ready = [=, waits = launch.stores] {
            return !waits || here(0).tag == *link->taken + 1;
        };
        fake(stream.get()).push_back({.run = take, .is_ready = is_ready});
    }
}
template void exchange_places(const BorderPlaces<float>&, const BorderLinks<float>&, const ExchangeLaunch&,
                              const WaitLimit&, const Stream&);
template void exchange_places(const BorderPlaces<double>&, const BorderLinks<double>&, const ExchangeLaunch&,
                              const WaitLimit&, const Stream&);
template void gather_places(const BorderPlaces<float>&, float*, const Stream&);
template void scatter_places(const BorderPlaces<float>&, const float*, const Stream&);
template void gather_places(const BorderPlaces<double>&, double*, const Stream&);
template void scatter_places(const BorderPlaces<double>&, const double*, const Stream&);

namespace {

/// A part of six particles. Particles 0 and 5 are ghosts if there is a part before or behind it. The part
/// knows where all of them have to be after each step, and its steps check this. A step reads one buffer and
/// writes the other.
class Part {
public:
    /// The part at position `place` of a row of parts, whose numbers are `numbers`.
    Part(int place, const std::vector<int>& numbers, int device, const std::string& way)
        : place_(place), parts_(int(numbers.size())) {
        for (auto& buffer : state_) buffer.fill(nan);
        if (overlaps(way)) first_.emplace(stream_);
        std::vector<SharedParticles> shared;
        if (has_before()) shared.push_back({numbers[std::size_t(place) - 1], {1}, {0}});
        if (has_behind()) shared.push_back({numbers[std::size_t(place) + 1], {4}, {5}});
        std::sort(shared.begin(), shared.end(), [](const SharedParticles& one, const SharedParticles& other) {
            return one.part < other.part;
        });
        const DeviceOfThread taken({device, false});
        borders = make_device_borders<float>(
            shared, way, Device(),
            {.stream = stream_,
             .now =
                 [this] {
                     return BorderPlaces<float>{nullptr, 0, state_[current_].data(), nullptr, 1, particles};
                 },
             .written = [this] { ++written_; },
             .wait = {},
             .first = first_ ? &*first_ : nullptr});
        start();
    }

    /// Resets to step 0, whatever the state was.
    void start() {
        steps_ = 0;
        current_ = 0;
        if (first_) first_->order_after_main_stream();
        enqueue(stream_.get(), [this] {
            for (auto& buffer : state_) buffer.fill(nan);
            for (int particle = 0; particle < particles; ++particle) place(0, particle, 0);
        });
    }
    void step() {
        const int step = ++steps_;
        const auto all = [this, step, reading = current_](std::vector<int> which) {
            return [this, step, reading, which = std::move(which)] {
                for (const int particle : which) step_one(reading, particle, step);
                if (std::find(which.begin(), which.end(), 2) != which.end()) ++done_;
            };
        };
        if (first_) {
            first_->step(
                [&](const Stream& in) {
                    enqueue(in.get(), all({0, 1, 4, 5}));
                },
                [&](const Stream& in) {
                    enqueue(in.get(), all({2, 3}));
                });
        } else {
            enqueue(stream_.get(), all({0, 1, 2, 3, 4, 5}));
        }
        current_ = 1 - current_;
    }
    /// Reads the state as the latest step left it, before ghosts arrive.
    void check() {
        if (first_) first_->order_after_main_stream();
        enqueue(stream_.get(), [this, step = steps_, now = current_] {
            for (int particle = 0; particle < particles; ++particle) {
                if (is_ghost(particle)) {
                    EXPECT_TRUE(std::isnan(state_[now][index(particle, 0)])) << "it arrived too early";
                } else {
                    expect_at(now, particle, step);
                }
            }
        });
    }
    void step_follows(bool follows) { first_->step_follows(follows); }
    /// Reads the state between two steps, as a download does.
    void look() {
        enqueue(stream_.get(), [this, step = steps_, now = current_] {
            for (int particle = 0; particle < particles; ++particle) expect_at(now, particle, step);
        });
    }
    /// The number of steps that the interior has done.
    int steps_done() const { return done_; }
    int written() const { return written_; }
    FakeStream* stream() const { return &fake(stream_.get()); }
    /// Requires a way that sends borders first.
    FakeStream* stream_of_borders() const { return &fake(first_->stream().get()); }
    /// Whether the ghost next to part `other` is where it was after `step`.
    bool has_ghost_of(int other, int step) const {
        const int particle = other < place_ ? 0 : 5;
        return state_[current_][index(particle, 0)] == expected(particle, 0, step);
    }

    std::shared_ptr<DeviceBorders> borders;
    int sent = 0, received = 0;

private:
    static constexpr int particles = 6;
    static constexpr float nan = std::numeric_limits<float>::quiet_NaN();

    bool has_before() const { return place_ > 0; }
    bool has_behind() const { return place_ + 1 < parts_; }
    bool is_ghost(int particle) const {
        return (particle == 0 && has_before()) || (particle == 5 && has_behind());
    }
    static std::size_t index(int particle, int axis) { return std::size_t(particle + particles * axis); }
    /// The expected coordinate in the numbering of the whole body: each part has four particles and sees one
    /// more on either side.
    float expected(int particle, int axis, int step) const {
        return float(1000 * step + 10 * (4 * place_ + particle) + axis);
    }
    void place(std::size_t buffer, int particle, int step) {
        for (int axis = 0; axis < 3; ++axis)
            state_[buffer][index(particle, axis)] = expected(particle, axis, step);
    }
    void expect_at(std::size_t buffer, int particle, int step) const {
        for (int axis = 0; axis < 3; ++axis)
            EXPECT_EQ(state_[buffer][index(particle, axis)], expected(particle, axis, step))
                << "part " << place_ << ", particle " << particle << " after step " << step;
    }
    /// A particle reads itself and its neighbours; a ghost reads only itself.
    void step_one(std::size_t reading, int particle, int step) {
        const int reach = is_ghost(particle) ? 0 : 1;
        for (int other = std::max(0, particle - reach); other <= std::min(particles - 1, particle + reach);
             ++other)
            expect_at(reading, other, step - 1);
        // The overwritten value is that of the step before the latest. A ghost becomes NaN, so that the next
        // step fails if no border arrives.
        if (step > 1 && !is_ghost(particle)) expect_at(1 - reading, particle, step - 2);
        place(1 - reading, particle, step);
        if (is_ghost(particle)) {
            for (int axis = 0; axis < 3; ++axis) state_[1 - reading][index(particle, axis)] = nan;
        }
    }

    const int place_, parts_;
    const Stream stream_;
    std::optional<BordersFirst> first_;
    std::array<std::array<float, 3 * particles>, 2> state_{};
    std::size_t current_ = 0;
    int steps_ = 0, done_ = 0, written_ = 0;
};

using Parts = std::vector<std::unique_ptr<Part>>;

/// Parts in a row, with the numbers `numbers`. `before`: parts of an earlier upload, if any, whose borders
/// they take over.
Parts parts_on(const std::vector<int>& devices, const std::string& way, const std::vector<int>& numbers,
               const Parts* before = nullptr) {
    Parts parts;
    std::vector<std::shared_ptr<DeviceBorders>> all(devices.size());
    for (const int device : devices) {
        const int place = int(parts.size());
        parts.push_back(std::make_unique<Part>(place, numbers, device, way));
        all[std::size_t(numbers[std::size_t(place)])] = parts.back()->borders;
    }
    for (std::size_t n = 0; n < parts.size(); ++n) {
        if (before != nullptr) parts[n]->borders->take_over(*before->at(n)->borders);
        // As in a rank's thread, which has its device selected.
        check(cudaSetDevice(devices[n]));
        parts[n]->borders->connect(all, std::size_t(numbers[n]));
    }
    return parts;
}
Parts parts_on(const std::vector<int>& devices, const std::string& way) {
    std::vector<int> numbers(devices.size());
    std::iota(numbers.begin(), numbers.end(), 0);
    return parts_on(devices, way, numbers);
}

/// Whether the host of a part may send, or receive, once more, by the rules of DeviceBorders.
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

/// Makes one exchange before any step and one after each of `steps` steps. Where devices wait for each other,
/// the hosts go on in any order.
void run(const std::vector<std::unique_ptr<Part>>& parts, int steps) {
    for (const auto& part : parts) part->sent = part->received = 0;
    for (;;) {
        std::vector<Part*> ready;
        for (std::size_t n = 0; n < parts.size(); ++n) {
            const bool is_done = parts[n]->received == steps + 1;
            const bool may = parts[n]->borders->waits_on_device() || may_go_on(parts, n);
            if (!is_done && may) ready.push_back(parts[n].get());
        }
        if (ready.empty()) break;
        Part& part = *ready[random_below(ready.size())];
        if (part.sent == part.received) {
            if (part.sent > 0) part.step();
            if (part.sent % 7 == 5) part.check();
            part.borders->send();
            ++part.sent;
        } else {
            part.borders->receive();
            ++part.received;
            if (part.received % 3 == 0) part.look();
        }
        for (std::size_t n = random_below(6); n > 0 && run_one(); --n) continue;
    }
}
void run_to_the_end(const std::vector<std::unique_ptr<Part>>& parts, int steps) {
    run(parts, steps);
    while (run_one()) continue;
}

bool has_fake_nccl() {
    static void* const library = dlopen(FAKE_NCCL, RTLD_NOW);
    communicators.clear();
    channels.clear();
    return library != nullptr;
}

class DeviceBorderWays : public ::testing::TestWithParam<std::string> {};
INSTANTIATE_TEST_SUITE_P(, DeviceBorderWays,
                         ::testing::Values("peer", "peer_overlap", "stores", "stores_overlap"));

TEST_P(DeviceBorderWays, BringEveryStepItsGhosts) {
    constexpr int steps = 30;
    const bool by_stores = GetParam().starts_with("stores");
    const std::size_t bytes_of_place = by_stores ? sizeof(TaggedPoint) : 3 * sizeof(float);
    for (const std::vector<int>& devices : {std::vector<int>{0, 1}, {0, 0, 0}, {2, 0, 1, 1, 0}}) {
        for (unsigned seed = 0; seed < 100; ++seed) {
            random_numbers.seed(seed);
            // With bricks, neighbours may have any numbers.
            std::vector<int> numbers(devices.size());
            std::iota(numbers.begin(), numbers.end(), 0);
            std::shuffle(numbers.begin(), numbers.end(), random_numbers);
            const auto parts = parts_on(devices, GetParam(), numbers);
            for (std::size_t n = 0; n < parts.size(); ++n)
                EXPECT_EQ(parts[n]->borders->bytes(),
                          (n == 0 || n + 1 == parts.size() ? 1 : 2) * bytes_of_place);
            run_to_the_end(parts, steps);
            for (std::size_t n = 0; n < parts.size(); ++n) {
                EXPECT_EQ(parts[n]->steps_done(), steps);
                const bool is_last = n == 0 || n + 1 == parts.size();
                // With stores one kernel takes the messages of all borders.
                EXPECT_EQ(parts[n]->written(), (steps + 1) * (is_last || by_stores ? 1 : 2));
            }
            if (HasFailure()) FAIL() << "with seed " << seed << " on " << devices.size() << " devices";
        }
    }
}

TEST_P(DeviceBorderWays, StartAnewAfterAStepThatSentNothing) {
    for (unsigned seed = 0; seed < 100; ++seed) {
        random_numbers.seed(seed);
        const auto parts = parts_on({0, 1}, GetParam());
        run(parts, 3);
        for (const auto& part : parts) {
            part->step();
            part->start();
        }
        run_to_the_end(parts, 3);
        if (HasFailure()) FAIL() << "with seed " << seed;
    }
}

// The backend's main stream is stopped.
TEST_P(DeviceBorderWays, SendWhileTheInteriorIsSteppedWhereTheyOverlap) {
    random_numbers.seed(1);
    const auto parts = parts_on({0, 1}, GetParam());
    run_to_the_end(parts, 0);
    std::vector<FakeStream*> stopped;
    for (const auto& part : parts) {
        part->step();
        part->borders->send();
        // The event says that everything before the step has been done.
        if (overlaps(GetParam())) run_front(*part->stream());
    }
    for (const auto& part : parts) {
        part->borders->receive();
        stopped.push_back(part->stream());
    }
    while (run_one(stopped)) continue;
    for (int n = 0; n < 2; ++n) {
        EXPECT_EQ(parts[std::size_t(n)]->steps_done(), 0) << "an interior was stepped";
        EXPECT_EQ(parts[std::size_t(n)]->has_ghost_of(1 - n, 1), overlaps(GetParam()));
    }
    while (run_one()) continue;
    for (int n = 0; n < 2; ++n) {
        EXPECT_EQ(parts[std::size_t(n)]->steps_done(), 1);
        EXPECT_TRUE(parts[std::size_t(n)]->has_ghost_of(1 - n, 1));
    }
}

TEST(BordersFirst, LetTheInteriorBeSteppedWhileABorderWaits) {
    for (const char* way : {"peer_overlap", "stores_overlap"}) {
        random_numbers.seed(1);
        const auto parts = parts_on({0, 1}, way);
        run_to_the_end(parts, 0);
        std::vector<FakeStream*> stopped;
        for (const auto& part : parts) {
            part->step();
            stopped.push_back(part->stream_of_borders());
        }
        while (run_one(stopped)) continue;
        for (const auto& part : parts) EXPECT_EQ(part->steps_done(), 1);
        while (run_one()) continue;
    }
}

// As in a graph, where a step follows each exchange but the last.
TEST(BordersFirst, LetTheInteriorGoOnBeforeTheGhostsArrive) {
    for (unsigned seed = 0; seed < 100; ++seed) {
        random_numbers.seed(seed);
        const auto parts = parts_on({0, 1}, "stores_overlap");
        run_to_the_end(parts, 0);
        for (int step = 1; step <= 4; ++step) {
            for (const auto& part : parts) {
                part->step();
                part->step_follows(step < 4);
                part->borders->send();
                part->borders->receive();
            }
        }
        const std::vector<FakeStream*> stopped = {parts[1]->stream_of_borders()};
        while (run_one(stopped)) continue;
        EXPECT_EQ(parts[0]->steps_done(), 2) << "the border of part 1 is never stepped";
        for (const auto& part : parts) part->look();
        while (run_one()) continue;
        for (const auto& part : parts) EXPECT_EQ(part->steps_done(), 4);
        if (HasFailure()) FAIL() << "with seed " << seed;
    }
}

// Stores need peer access. Copies do not: the driver takes them through the host's memory.
TEST_P(DeviceBorderWays, SayWhichDevicesHaveNoPeerAccess) {
    const bool by_stores = GetParam().starts_with("stores");
    // The message appears once for each pair of devices.
    const int other = overlaps(GetParam()) ? 4 : 3;
    const std::string without = "device 1 has no peer access to device " + std::to_string(other);
    peers_reach_each_other = false;
    EXPECT_EQ(parts_on({1, 1}, GetParam()).size(), 2u) << "a device reaches itself";
    ::testing::internal::CaptureStderr();
    const std::string reason = testing::message_of<Unavailable>([&] {
        for (int n = 0; n < 2; ++n) run_to_the_end(parts_on({1, other}, GetParam()), 3);
    });
    const std::string said = ::testing::internal::GetCapturedStderr();
    peers_reach_each_other = true;
    EXPECT_EQ(reason, by_stores ? without : "");
    EXPECT_EQ(said.find(without + ": copies between them go through the host's memory\n") == 0, !by_stores)
        << said;
}

/// How each communicator has ended.
std::vector<std::vector<std::string>> ends_of_communicators() {
    std::vector<std::vector<std::string>> all;
    for (const auto& one : communicators) all.push_back(one->ended);
    return all;
}

TEST(NcclBorders, BringEveryStepItsGhosts) {
    for (const char* way : {"nccl", "nccl_overlap"}) {
        for (const std::vector<int>& devices : {std::vector<int>{0, 1}, {2, 0, 3, 1}}) {
            for (unsigned seed = 0; seed < 30; ++seed) {
                ASSERT_TRUE(has_fake_nccl()) << FAKE_NCCL;
                random_numbers.seed(seed);
                const auto parts = parts_on(devices, way);
                run_to_the_end(parts, 20);
                ASSERT_EQ(communicators.size(), devices.size());
                for (std::size_t n = 0; n < devices.size(); ++n) {
                    EXPECT_EQ(communicators[n]->rank, int(n));
                    EXPECT_EQ(communicators[n]->ranks, int(devices.size()));
                    EXPECT_EQ(communicators[n]->device, devices[n]) << "in the thread that starts it";
                    EXPECT_EQ(parts[n]->steps_done(), 20);
                }
                if (HasFailure()) FAIL() << "with seed " << seed << " on " << devices.size() << " devices";
            }
        }
    }
}

TEST(NcclBorders, KeepOneCommunicatorForAllUploadsAndEndIt) {
    ASSERT_TRUE(has_fake_nccl());
    const auto first = parts_on({0, 1}, "nccl");
    run_to_the_end(first, 3);
    {
        const auto second = parts_on({0, 1}, "nccl", {0, 1}, &first);
        run_to_the_end(second, 3);
        for (const auto& part : second) part->borders->disconnect();
    }
    const std::vector<std::string> well = {"finalized", "destroyed"};
    EXPECT_EQ(ends_of_communicators(), (std::vector<std::vector<std::string>>{well, well}));
}

TEST(NcclBorders, GiveUpARunThatFailed) {
    ASSERT_TRUE(has_fake_nccl());
    run_to_the_end(parts_on({0, 1}, "nccl"), 3);
    const std::vector<std::string> given_up = {"aborted"};
    EXPECT_EQ(ends_of_communicators(), (std::vector<std::vector<std::string>>{given_up, given_up}));
}

TEST(NcclBorders, WaitNoLongerThanTheirLimitForTheStart) {
    ASSERT_TRUE(has_fake_nccl());
    nccl_hangs = true;
    const std::string reason = testing::message_of<DeviceError>([] {
        const NcclRanks ranks(Nccl::load(), 2, Nccl::load().new_id(), 0, std::chrono::milliseconds(100));
    });
    nccl_hangs = false;
    for (bool begun = false; !begun; std::this_thread::yield()) {  // the thread that was left behind
        const std::lock_guard lock(nccl_mutex);
        begun = !communicators.empty();
    }
    EXPECT_EQ(reason.find("NCCL did not start within 0 s"), 0u) << reason;
}

TEST(NcclBorders, TakeADeviceForEachRank) {
    ASSERT_TRUE(has_fake_nccl());
    EXPECT_THROW((void)parts_on({0, 0}, "nccl"), Unavailable);
}

TEST_P(DeviceBorderWays, MayEndInAnyOrder) {
    for (const bool first : {true, false}) {
        auto parts = parts_on({0, 1}, GetParam());
        run_to_the_end(parts, 3);
        (first ? parts.front() : parts.back()).reset();
        (first ? parts.back() : parts.front())->borders.reset();
    }
}

}  // namespace
}  // namespace voxspring::cuda
