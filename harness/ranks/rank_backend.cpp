#include "harness/ranks/rank_backend.h"

#include <algorithm>

namespace voxspring {
namespace {

double seconds_from(std::chrono::steady_clock::time_point begin, std::chrono::steady_clock::time_point end) {
    return std::chrono::duration<double>(end - begin).count();
}

}  // namespace

std::string RankBackend::unsupported(const Problem& problem) const {
    if (!inner_.capabilities().has_borders) return "it cannot step a part of a body: it gives no borders";
    return inner_.unsupported(problem);
}

void RankBackend::upload(const Problem& problem, const State& state) {
    links_.clear();
    inner_.upload(problem, state);
    for (const Slab::Border& border : slab_.borders)
        links_.push_back({border.slab, inner_.border(border.sent), inner_.border(border.received)});
}

void RankBackend::step(int count) {
    for (int n = 0; n < count; ++n) {
        const auto begin = Clock::now();
        inner_.step(1);
        inner_.synchronize();
        seconds_.compute += seconds_from(begin, Clock::now());
        exchange_borders();
    }
}

void RankBackend::exchange_borders() {
    const auto begin = Clock::now();
    for (const Link& link : links_) {
        link.sent->read(exchange_.outbox(link.rank, link.sent->bytes()));
        exchange_.post(link.rank);
    }
    auto latest = Clock::now();
    seconds_.exchange += seconds_from(begin, latest);
    for (const Link& link : links_) {
        const std::byte* const message = exchange_.inbox(link.rank);
        const auto arrived = Clock::now();
        link.received->write(message);
        exchange_.release(link.rank);
        seconds_.waiting += seconds_from(latest, arrived);
        latest = Clock::now();
        seconds_.exchange += seconds_from(arrived, latest);
    }
}

std::size_t RankBackend::border_bytes() const {
    std::size_t largest = 0;
    for (const Link& link : links_) largest = std::max(largest, link.sent->bytes());
    return largest;
}

}  // namespace voxspring
