#include "harness/ranks/rank_backend.h"

#include <algorithm>
#include <utility>

namespace voxspring {

std::string RankBackend::unsupported(const Problem& problem) const {
    const Capabilities capabilities = inner_.capabilities();
    if (goes_by_device()) {
        const std::vector<std::string>& ways = capabilities.border_ways;
        if (std::find(ways.begin(), ways.end(), way_) == ways.end())
            return "it cannot exchange borders by " + way_;
    } else if (!subdomain_.borders.empty() && !capabilities.has_borders) {
        return "it cannot step a part of a body: it cannot exchange borders";
    }
    return inner_.unsupported(problem);
}

void RankBackend::upload(const Problem& problem, const State& state) {
    links_.clear();
    connected_ = false;
    is_held_ = problem.has_tool();
    inner_.upload(problem, state);
    if (goes_by_device()) {
        std::vector<SharedParticles> borders;
        for (const Subdomain::Border& border : subdomain_.borders)
            borders.push_back({border.subdomain, border.sent, border.received});
        const auto before = std::exchange(own_borders(), inner_.borders()->device_borders(borders, way_));
        if (before != nullptr) own_borders()->take_over(*before);
        return;
    }
    for (const Subdomain::Border& border : subdomain_.borders) {
        BorderFacet& inner = *inner_.borders();
        links_.push_back({border.subdomain, inner.border(border.sent), inner.border(border.received)});
    }
}

bool RankBackend::keep_start() {
    const bool kept = inner_.keep_start();
    if (!goes_by_device()) return kept;
    if (!kept) parts_->all_keep_start = false;
    meet(exchange_);
    return parts_->all_keep_start;
}

void RankBackend::connect() {
    if (!goes_by_device() || connected_) return;
    own_borders()->connect(parts_->borders, std::size_t(exchange_.rank()));
    connected_ = true;
}

void RankBackend::disconnect() {
    if (!connected_) return;
    connected_ = false;
    own_borders()->disconnect();
}

int RankBackend::steps_per_call() const { return goes_by_device() ? own_borders()->steps_per_call() : 0; }

/// The devices wait for each other within these steps. A rank that allocates or frees memory, or loads a
/// kernel, may wait until its device is idle, and meanwhile keep other ranks from enqueueing. To avoid a
/// deadlock a rank does such work only before the first meet() or after the second one. Between them it only
/// enqueues its steps.
template <class Enqueue>
void RankBackend::step_together(Enqueue enqueue) {
    const auto begin = Clock::now();
    meet(exchange_);
    const auto here = Clock::now();
    enqueue();
    meet(exchange_);  // waits until all ranks have enqueued; the devices step meanwhile
    if (waits_) inner_.synchronize();
    seconds_.waiting += Seconds(here - begin).count();
    seconds_.compute += seconds_since(here);
}

/// Steps without exchanging borders.
void RankBackend::step_alone(int count) {
    const auto begin = Clock::now();
    inner_.step(count);
    if (waits_) inner_.synchronize();
    seconds_.compute += seconds_since(begin);
}

void RankBackend::step(int count) {
    if (const int most = steps_per_call(); most > 0) {
        for (; count > 0; count -= most) step_together([&] { inner_.step(std::min(count, most)); });
        return;
    }
    // A rank without a border also steps in this way, because all ranks meet in step_together().
    if (goes_by_device() && !waits_ && inner_.borders()->prepare_exchanges(*own_borders(), count)) {
        step_together([&] { inner_.borders()->step_and_exchange(*own_borders(), count); });
        return;
    }
    // Without a border there is nothing to exchange. A run with a single rank is the baseline for runs with
    // several ranks, and must not be slowed down.
    if (subdomain_.borders.empty()) return step_alone(count);
    for (int n = 0; n < count; ++n) {
        step_alone(1);
        exchange_borders();
    }
}

void RankBackend::exchange_borders() { goes_by_device() ? exchange_by_device() : exchange_by_host(); }

/// If the devices do not wait for each other, the hosts do. inbox() waits for the neighbour's message of the
/// same step, so the host of a rank is at most one step ahead of its neighbour's.
void RankBackend::exchange_by_device() {
    const auto begin = Clock::now();
    DeviceBorders& borders = *own_borders();
    const std::vector<int> others = borders.waits_on_device() ? std::vector<int>() : neighbours();
    for (const int rank : others) (void)exchange_.outbox(rank, 0);
    borders.send();
    for (const int rank : others) exchange_.post(rank);
    for (const int rank : others) (void)exchange_.inbox(rank);
    borders.receive();
    for (const int rank : others) exchange_.release(rank);
    if (waits_) inner_.synchronize();
    seconds_.exchange += seconds_since(begin);
}

void RankBackend::exchange_by_host() {
    const auto begin = Clock::now();
    for (const Link& link : links_) {
        link.sent->read(exchange_.outbox(link.rank, link.sent->bytes()));
        exchange_.post(link.rank);
    }
    auto latest = Clock::now();
    seconds_.exchange += Seconds(latest - begin).count();
    for (const Link& link : links_) {
        const std::byte* const message = exchange_.inbox(link.rank);
        const auto arrived = Clock::now();
        link.received->write(message);
        exchange_.release(link.rank);
        seconds_.waiting += Seconds(arrived - latest).count();
        latest = Clock::now();
        seconds_.exchange += Seconds(latest - arrived).count();
    }
}

std::vector<int> RankBackend::neighbours() const {
    std::vector<int> ranks;
    for (const Subdomain::Border& border : subdomain_.borders) ranks.push_back(border.subdomain);
    return ranks;
}

std::size_t RankBackend::border_bytes() const {
    if (goes_by_device()) return own_borders()->bytes();
    std::size_t bytes = 0;
    for (const Link& link : links_) bytes += link.sent->bytes();
    return bytes;
}

}  // namespace voxspring
