#include "cuda/common/device_borders.h"

#include <algorithm>
#include <array>
#include <cstdio>
#include <future>
#include <memory>
#include <mutex>
#include <set>
#include <stdexcept>
#include <string_view>
#include <utility>

#include "cuda/device/buffer.h"
#include "cuda/device/check.h"
#include "cuda/device/nccl.h"
#include "cuda/device/stream.h"

namespace voxspring::cuda {
namespace {

/// One part's side of a border: gathers the message for the other part, and scatters that part's message.
template <class Real>
class Side {
public:
    Side(const SharedParticles& elements, const BorderState<Real>& state)
        : part_(elements.part), state_(state) {
        sent_.upload(elements.sent, state.lane());
        received_.upload(elements.received, state.lane());
    }
    /// The number of the part on the other side.
    int part() const { return part_; }
    /// How many numbers this side's message has, and how many the other side's message has.
    std::size_t to_send() const { return state_.places(sent_).numbers(); }
    std::size_t to_receive() const { return state_.places(received_).numbers(); }

    void gather(Real* message) const { gather_places(state_.places(sent_), message, state_.lane()); }
    void scatter(const Real* message) const {
        scatter_places(state_.places(received_), message, state_.lane());
        if (received_.size() > 0) state_.written();
    }

private:
    const int part_;
    const BorderState<Real> state_;
    Buffer<std::uint32_t> sent_, received_;
};

/// Casts the borders of another part to `Borders`, the class of this part's borders. Throws if they are of
/// another class.
template <class Borders>
Borders& same_kind(const std::shared_ptr<DeviceBorders>& other) {
    auto* const borders = dynamic_cast<Borders*>(other.get());
    if (borders == nullptr) throw std::logic_error("the parts of a body exchange borders in different ways");
    return *borders;
}

/// Finds the link of a part for which leads_there(link) holds. Throws if there is none.
template <class Links, class LeadsThere>
auto find_side(const Links& links, LeadsThere leads_there) {
    const auto link = std::find_if(links.begin(), links.end(), leads_there);
    if (link == links.end())
        throw std::logic_error(
            "a part of the body has a border with another part, but that part has none with it");
    return link;
}

/// Bytes that this part sends over all its borders in one exchange.
template <class Real, class Links>
std::size_t bytes_sent(const Links& links) {
    std::size_t bytes = 0;
    for (const auto& link : links) bytes += link.side.to_send() * sizeof(Real);
    return bytes;
}

void copy_message(void* to, int to_device, const void* from, int from_device, std::size_t bytes,
                  const Stream& stream) {
    if (bytes == 0) return;
    if (to_device == from_device) {
        check(cudaMemcpyAsync(to, from, bytes, cudaMemcpyDeviceToDevice, stream.get()));
    } else {
        check(cudaMemcpyPeerAsync(to, to_device, from, from_device, bytes, stream.get()));
    }
}

std::string without_peer_access(int own, int other) {
    return "device " + std::to_string(own) + " has no peer access to device " + std::to_string(other);
}

/// Writes `line` to standard error, but each line only once per process.
void say_once(const std::string& line) {
    static std::mutex mutex;
    static std::set<std::string> said;
    const std::lock_guard lock(mutex);
    if (said.insert(line).second) std::fprintf(stderr, "%s\n", line.c_str());
}

/// Borders whose messages are copied to the device that receives them.
///
/// Every part sends a message over every border in every exchange. Before a part sends message n + 2, its
/// stream has waited for message n + 1 from the other side, which sent that message only after it had taken
/// message n. So two buffers per side of a border are enough, and the receiver need not say when a buffer is
/// free.
template <class Real>
class PeerBorders final : public DeviceBorders {
public:
    PeerBorders(const std::vector<SharedParticles>& borders, const Device& device,
                const BorderState<Real>& state)
        : device_(device.number), state_(state), stream_(state.lane()) {
        for (const SharedParticles& elements : borders) {
            Link& link = links_.emplace_back(elements, state);
            link.own = std::make_shared<BorderInbox>();
            for (Buffer<Real>& message : link.own->arrived) message.resize(link.side.to_receive());
            link.leaving.resize(link.side.to_send());
        }
    }

    std::size_t bytes() const override { return bytes_sent<Real>(links_); }

    void connect(const std::vector<std::shared_ptr<DeviceBorders>>& parts, std::size_t part) override {
        for (Link& link : links_) {
            const auto& borders = same_kind<PeerBorders>(parts.at(std::size_t(link.side.part())));
            connect_to(borders.device_);
            link.their_device = borders.device_;
            link.theirs = borders.link_with(int(part)).own;
        }
    }

    void send() override {
        const std::size_t turn = sent_++ % 2;
        state_.begin_send();
        for (Link& link : links_) {
            link.side.gather(link.leaving.data());
            copy_message(link.theirs->arrived[turn].data(), link.their_device, link.leaving.data(), device_,
                         link.leaving.bytes(), stream_);
            link.own->sent[turn].record(stream_);
        }
    }

    void receive() override {
        const std::size_t turn = received_++ % 2;
        for (const Link& link : links_) {
            link.theirs->sent[turn].hold(stream_);
            link.side.scatter(link.own->arrived[turn].data());
        }
        state_.end_receive();
    }

private:
    /// The two buffers for messages that arrive at one side of a border, and the events that this side
    /// records after its sends. Both sides share this object, which is freed when neither needs it any more.
    struct BorderInbox {
        std::array<Buffer<Real>, 2> arrived;
        std::array<Event, 2> sent{Event::without_time(), Event::without_time()};
    };
    struct Link {
        Link(const SharedParticles& elements, const BorderState<Real>& state) : side(elements, state) {}
        Side<Real> side;
        Buffer<Real> leaving;  ///< the message before it is copied
        std::shared_ptr<BorderInbox> own, theirs = nullptr;
        int their_device = 0;
    };

    /// Enables copies by peer access. Without it the driver copies through the host's memory.
    void connect_to(int device) const {
        if (enable_peer_access(device_, device)) return;
        say_once(without_peer_access(device_, device) + ": copies between them go through the host's memory");
    }
    const Link& link_with(int part) const {
        return *find_side(links_, [&](const Link& one) { return one.side.part() == part; });
    }

    const int device_;
    const BorderState<Real> state_;
    const Stream& stream_;
    std::vector<Link> links_;
    std::size_t sent_ = 0, received_ = 0;  ///< calls of send() and of receive()
};

/// Borders whose messages a kernel stores into the memory of the device that receives them. A kernel there
/// waits for the messages and writes them to the state. If no two parts share a device, no host takes part,
/// so graphs can hold exchanges. If two parts share one, no kernel may wait, since it might keep the kernel
/// that it waits for from running. Then each part sends by one launch and takes by another, and events order
/// these launches.
///
/// Buffers are free in time for the same reason as those of PeerBorders: a part sends message n + 2 only
/// after message n + 1 has arrived, and the other part sends that only after it has taken message n.
template <class Real>
class StoredBorders final : public DeviceBorders {
public:
    StoredBorders(const std::vector<SharedParticles>& borders, const Device& device,
                  const BorderState<Real>& state)
        : device_(device.number),
          state_(state),
          launch_{.blocks = blocks_for(borders, device),
                  .stores = true,
                  .takes = true,
                  .dependent = device.has_dependent_launches()} {
        for (const SharedParticles& elements : borders) {
            Side& side = sides_.emplace_back();
            side.part = elements.part;
            side.sent.upload(elements.sent, state.lane());
            side.received.upload(elements.received, state.lane());
            side.taken.resize(launch_.threads());
            side.taken.fill_with_zeros(state.lane());
            side.own = std::make_shared<BorderInbox>();
            for (Buffer<TaggedPoint>& message : side.own->arrived) {
                message.resize(state.places(side.received).words());
                message.fill_with_zeros(state.lane());
            }
        }
        state.lane().synchronize();  // inboxes must be empty before another part writes to them
    }

    std::size_t bytes() const override {
        std::size_t words = 0;
        for (const Side& side : sides_) words += state_.places(side.sent).words();
        return words * sizeof(TaggedPoint);
    }

    void connect(const std::vector<std::shared_ptr<DeviceBorders>>& parts, std::size_t part) override {
        std::set<int> devices;
        for (const auto& other : parts) devices.insert(same_kind<StoredBorders>(other).device_);
        waits_on_device_ = devices.size() == parts.size();
        std::vector<BorderLink<Real>> links;
        for (Side& side : sides_) {
            const auto& borders = same_kind<StoredBorders>(parts.at(std::size_t(side.part)));
            require_whole_words(device_, borders.device_);
            require_peer_access(device_, borders.device_);
            side.theirs =
                find_side(borders.sides_, [&](const Side& one) { return one.part == int(part); })->own;
            links.push_back({.sent = side.sent.data(),
                             .received = side.received.data(),
                             .sent_count = side.sent.size(),
                             .received_count = side.received.size(),
                             .outbox = {side.theirs->arrived[0].data(), side.theirs->arrived[1].data()},
                             .inbox = {side.own->arrived[0].data(), side.own->arrived[1].data()},
                             .taken = side.taken.data()});
        }
        links_.upload(links, state_.lane());
    }

    bool waits_on_device() const override { return waits_on_device_; }
    void send() override {
        state_.begin_send();
        if (waits_on_device_) return;
        enqueue(true, false);
        const std::size_t turn = sent_++ % 2;
        for (const Side& side : sides_) side.own->sent[turn].record(state_.lane());
    }
    void receive() override {
        if (!waits_on_device_) {
            const std::size_t turn = received_++ % 2;
            for (const Side& side : sides_) side.theirs->sent[turn].hold(state_.lane());
        }
        enqueue(waits_on_device_, true);
        if (links_.size() > 0) state_.written();
        state_.end_receive();
    }

private:
    /// The two buffers for messages that arrive at one side of a border, and the events that this side
    /// records after its sends unless waits_on_device_. Both sides share this object, which is freed when
    /// neither needs it any more.
    struct BorderInbox {
        std::array<Buffer<TaggedPoint>, 2> arrived;
        std::array<Event, 2> sent{Event::without_time(), Event::without_time()};
    };
    struct Side {
        int part = 0;
        Buffer<std::uint32_t> sent, received, taken;
        std::shared_ptr<BorderInbox> own, theirs;
    };

    /// Blocks per link: enough for one thread per particle, but no more than run at once with those of all
    /// links. Otherwise blocks that wait could keep others from running that the other part waits for.
    static unsigned blocks_for(const std::vector<SharedParticles>& borders, const Device& device) {
        constexpr std::size_t blocks_at_once = 8;  // per multiprocessor: all cards have room for these
        std::size_t most = 1;
        for (const SharedParticles& elements : borders)
            most = std::max({most, elements.sent.size(), elements.received.size()});
        const std::size_t at_once = blocks_at_once * std::size_t(device.multiprocessors);
        const std::size_t room = at_once / std::max<std::size_t>(1, borders.size());
        return unsigned(
            std::max<std::size_t>(1, std::min((most + exchange_threads - 1) / exchange_threads, room)));
    }
    void enqueue(bool stores, bool takes) {
        ExchangeLaunch launch = launch_;
        launch.stores = stores;
        launch.takes = takes;
        exchange_places(state_.now(), links_, launch, state_.wait, state_.lane());
    }

    const int device_;
    const BorderState<Real> state_;
    const ExchangeLaunch launch_;
    bool waits_on_device_ = false;
    std::vector<Side> sides_;
    BorderLinks<Real> links_;
    std::size_t sent_ = 0, received_ = 0;  ///< calls of send() and receive() unless waits_on_device_
};

/// Borders whose messages NCCL carries.
template <class Real>
class NcclBorders final : public DeviceBorders {
public:
    NcclBorders(const std::vector<SharedParticles>& borders, const Device& device,
                const BorderState<Real>& state)
        : device_(device.number), state_(state), stream_(state.lane()) {
        Nccl::load();
        for (const SharedParticles& elements : borders) {
            Link& link = links_.emplace_back(elements, state);
            link.leaving.resize(link.side.to_send());
            link.arrived.resize(link.side.to_receive());
        }
    }

    std::size_t bytes() const override { return bytes_sent<Real>(links_); }

    void connect(const std::vector<std::shared_ptr<DeviceBorders>>& parts, std::size_t part) override {
        std::set<int> devices;
        for (const auto& other : parts) devices.insert(same_kind<NcclBorders>(other).device_);
        if (devices.size() < parts.size())
            throw Unavailable("NCCL needs one device per rank, but " + std::to_string(parts.size()) +
                              " ranks share " + std::to_string(devices.size()) +
                              (devices.size() == 1 ? " device" : " devices"));
        if (ranks_ != nullptr) return;
        auto& first = same_kind<NcclBorders>(parts.front());
        if (part == 0) {
            try {
                id_.set_value(Nccl::load().new_id());
            } catch (...) {
                id_.set_exception(std::current_exception());
            }
        }
        const std::shared_future<NcclId> id = first.known_id_;
        ranks_ = std::make_unique<NcclRanks>(Nccl::load(), int(parts.size()), id.get(), int(part));
    }
    /// Takes over the communicator of `before`, since NCCL takes seconds to start.
    void take_over(DeviceBorders& before) override {
        ranks_ = std::move(dynamic_cast<NcclBorders&>(before).ranks_);
    }
    void disconnect() override { ranks_->end(); }

    void send() override {
        state_.begin_send();
        for (Link& link : links_) link.side.gather(link.leaving.data());
    }

    /// Enqueues all sends and receives as one NCCL group: otherwise two ranks could wait for each other.
    void receive() override {
        ranks_->together([&] {
            for (const Link& link : links_) {
                ranks_->send(link.leaving.data(), link.leaving.bytes(), link.side.part(), stream_);
                ranks_->receive(link.arrived.data(), link.arrived.bytes(), link.side.part(), stream_);
            }
        });
        for (const Link& link : links_) link.side.scatter(link.arrived.data());
        state_.end_receive();
    }

private:
    struct Link {
        Link(const SharedParticles& elements, const BorderState<Real>& state) : side(elements, state) {}
        Side<Real> side;
        Buffer<Real> leaving, arrived;
    };

    const int device_;
    const BorderState<Real> state_;
    const Stream& stream_;
    std::vector<Link> links_;
    std::promise<NcclId> id_;  ///< set in the first part; all parts take the id from there
    std::shared_future<NcclId> known_id_ = id_.get_future().share();
    std::unique_ptr<NcclRanks> ranks_;
};

constexpr std::string_view overlap = "_overlap";

}  // namespace

bool enable_peer_access(int own, int other) {
    if (own == other) return true;
    int possible = 0;
    check(cudaDeviceCanAccessPeer(&possible, own, other));
    if (possible == 0) return false;
    const cudaError_t status = cudaDeviceEnablePeerAccess(other, 0);
    if (status == cudaErrorPeerAccessAlreadyEnabled) {
        cudaGetLastError();  // clears the error: access was enabled before, which is fine
    } else {
        check(status);
    }
    return true;
}

void require_whole_words(int own, int other) {
    if (own == other) return;
    int atomics = 0;
    check(cudaDeviceGetP2PAttribute(&atomics, cudaDevP2PAttrNativeAtomicSupported, own, other));
    if (atomics == 0)
        throw Unavailable(
            "devices " + std::to_string(own) + " and " + std::to_string(other) +
            " are not joined by NVLink, without which words of 16 bytes might not arrive whole");
}

void require_peer_access(int own, int other) {
    if (!enable_peer_access(own, other)) throw Unavailable(without_peer_access(own, other));
}

std::vector<std::string> border_ways(bool splits_steps) {
    std::vector<std::string> ways;
    for (const char* const way : {"peer", "stores", "nccl"}) {
        ways.emplace_back(way);
        if (splits_steps) ways.push_back(way + std::string(overlap));
    }
    return ways;
}

bool overlaps(const std::string& way) { return way.ends_with(overlap); }

template <class Real>
std::shared_ptr<DeviceBorders> make_device_borders(const std::vector<SharedParticles>& borders,
                                                   const std::string& way, const Device& device,
                                                   const BorderState<Real>& state) {
    if (way.starts_with("nccl")) return std::make_shared<NcclBorders<Real>>(borders, device, state);
    if (way.starts_with("stores")) return std::make_shared<StoredBorders<Real>>(borders, device, state);
    return std::make_shared<PeerBorders<Real>>(borders, device, state);
}

template std::shared_ptr<DeviceBorders> make_device_borders(const std::vector<SharedParticles>&,
                                                            const std::string&, const Device&,
                                                            const BorderState<float>&);
template std::shared_ptr<DeviceBorders> make_device_borders(const std::vector<SharedParticles>&,
                                                            const std::string&, const Device&,
                                                            const BorderState<double>&);

}  // namespace voxspring::cuda
