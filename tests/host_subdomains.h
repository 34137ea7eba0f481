// Subdomains that a CUDA kernel steps on the host, and whose borders pass through CUDA's border kernels, also
// on the host.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <utility>
#include <vector>

#include "backends/layout/blocks.h"
#include "backends/layout/decomposition.h"
#include "cuda/kernels/border.h"
#include "tests/support.h"

namespace voxspring::testing {

template <class Real>
std::vector<Real> gathered(const cuda::BorderPlaces<Real>& places) {
    // The message ends with a guard number.
    std::vector<Real> message(places.numbers() + 1, Real(-1));
    for (std::size_t n = 0; n < places.count; ++n) gather_place(places, n, message.data());
    EXPECT_EQ(message.back(), -1);
    message.pop_back();
    return message;
}

template <class Real>
void scatter(const cuda::BorderPlaces<Real>& places, const std::vector<Real>& message) {
    ASSERT_EQ(message.size(), places.numbers());
    for (std::size_t n = 0; n < places.count; ++n) scatter_place(places, n, message.data());
}

/// The border that a subdomain shares with another one; there must be one.
inline const Subdomain::Border& border_with(const Subdomain& subdomain, int other) {
    return *std::find_if(subdomain.borders.begin(), subdomain.borders.end(),
                         [&](const Subdomain::Border& border) { return border.subdomain == other; });
}

/// When subdomains exchange their borders: after whole steps, or once only the borders have been stepped.
enum class BordersGo : std::uint8_t { last, first };

/// The whole state after `steps` steps of subdomains that are cut as `cut` says along each axis, each in a
/// simulation that `make(problem, start)` returns. Adds to `left` the number of blocks that remain to be
/// stepped once borders have been sent.
template <class MakeSimulation>
State stepped_as(glm::ivec3 cut, const Problem& whole, const State& start, int steps, MakeSimulation make,
                 BordersGo go, std::size_t& left) {
    struct Part {
        Subdomain subdomain;
        State start;
        decltype(make(whole, start)) simulation = nullptr;
    };
    const Decomposition decomposition(whole, cut);
    std::vector<Part> parts;
    for (int n = 0; n < decomposition.count(); ++n) {
        Subdomain subdomain = decomposition.subdomain(whole, n);
        State of_part = subdomain.part_of(start);
        parts.push_back({std::move(subdomain), std::move(of_part)});
    }
    for (Part& part : parts) {
        part.simulation = make(part.subdomain.problem, part.start);
        if (go == BordersGo::last) continue;
        std::vector<std::uint32_t> border;
        for (const Subdomain::Border& shared : part.subdomain.borders) {
            border.insert(border.end(), shared.sent.begin(), shared.sent.end());
            border.insert(border.end(), shared.received.begin(), shared.received.end());
        }
        left += part.simulation->split(border);
    }
    const auto copy_ghosts = [&](std::size_t to) {
        for (const Subdomain::Border& border : parts[to].subdomain.borders) {
            Part& from = parts[std::size_t(border.subdomain)];
            const auto out = from.simulation->elements_of(border_with(from.subdomain, int(to)).sent);
            const auto in = parts[to].simulation->elements_of(border.received);
            scatter(parts[to].simulation->places(in), gathered(from.simulation->places(out)));
        }
    };
    for (int step = 0; step < steps; ++step) {
        for (Part& part : parts) {
            if constexpr (requires { part.simulation->move_tool(glm::dvec3(0)); })
                part.simulation->move_tool({0.01 * step, 0, -0.02 * step});
            if (go == BordersGo::last) {
                part.simulation->step(1);
            } else {
                part.simulation->step_part(cuda::StepPart::border);
            }
        }
        for (std::size_t to = 0; to < parts.size(); ++to) copy_ghosts(to);
        for (Part& part : parts) {
            if (go == BordersGo::first) part.simulation->step_part(cuda::StepPart::interior);
        }
    }
    State state = state_at_rest(whole);
    for (const Part& part : parts) part.subdomain.copy_own(part.simulation->download(), state);
    return state;
}

/// Tries two and four slabs, and each of `cuts`, which say how many subdomains lie along each axis.
template <class MakeSimulation>
void expect_bits_of_each(const std::vector<Problem>& problems, const std::vector<glm::ivec3>& cuts,
                         MakeSimulation make) {
    constexpr int steps = 12;
    std::size_t left = 0;
    for (const Problem& whole : problems) {
        const State start = random_state(whole, 0.05, 3);
        const auto stepped = [&](glm::ivec3 cut, BordersGo go) {
            return stepped_as(cut, whole, start, steps, make, go, left);
        };
        const auto slabs = [&](int count) { return Decomposition::slabs(whole, count); };
        const State expected = stepped(slabs(1), BordersGo::last);
        EXPECT_NE(expected.displacement, start.displacement);
        for (const int count : {2, 4}) expect_same_bits(stepped(slabs(count), BordersGo::last), expected);
        expect_same_bits(stepped(slabs(2), BordersGo::first), expected);
        for (const BordersGo go : {BordersGo::last, BordersGo::first}) {
            for (const glm::ivec3 cut : cuts) expect_same_bits(stepped(cut, go), expected);
        }
    }
    EXPECT_GT(left, 0U) << "no step had an interior";
}

}  // namespace voxspring::testing
