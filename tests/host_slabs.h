// Slabs whose steps are those of a CUDA kernel on the host, and whose borders go by way of its kernels too.
#pragma once

#include <gtest/gtest.h>

#include <memory>
#include <utility>
#include <vector>

#include "backends/layout/border_blocks.h"
#include "backends/layout/slabs.h"
#include "cuda/kernels/border.h"
#include "tests/support.h"

namespace voxspring::testing {

template <class Real>
std::vector<Real> gathered(const cuda::BorderPlaces<Real>& places) {
    // The last number stands behind what the message has room for.
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

/// When slabs exchange their borders: once a step is whole, or once the borders are stepped alone.
enum class BordersGo : std::uint8_t { last, first };

/// The whole after `steps` steps of all slabs, each in a simulation that `make(problem, start)` points to.
/// `left` grows by the blocks that are left to be stepped once borders have gone.
template <class MakeSimulation>
State stepped_as(int slabs, const Problem& whole, const State& start, int steps, MakeSimulation make,
                 BordersGo go, std::size_t& left) {
    struct Part {
        Slab slab;
        State start;
        decltype(make(whole, start)) simulation = nullptr;
    };
    const SlabCuts cuts(whole, slabs);
    std::vector<Part> parts;
    for (int n = 0; n < slabs; ++n) {
        Slab slab = cuts.slab(whole, n);
        State of_slab = slab.part_of(start);
        parts.push_back({std::move(slab), std::move(of_slab)});
    }
    for (Part& part : parts) {
        part.simulation = make(part.slab.problem, part.start);
        if (go == BordersGo::last) continue;
        std::vector<std::uint32_t> border;
        for (const Slab::Border& shared : part.slab.borders) {
            border.insert(border.end(), shared.sent.begin(), shared.sent.end());
            border.insert(border.end(), shared.received.begin(), shared.received.end());
        }
        left += part.simulation->split(border);
    }
    const auto copy = [](Part& from, const Slab::Border& sent, Part& to, const Slab::Border& received) {
        const auto out = from.simulation->elements_of(sent.sent);
        const auto in = to.simulation->elements_of(received.received);
        scatter(to.simulation->places(in), gathered(from.simulation->places(out)));
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
        for (std::size_t n = 0; n + 1 < parts.size(); ++n) {
            Part &low = parts[n], &high = parts[n + 1];
            copy(low, low.slab.borders.back(), high, high.slab.borders.front());
            copy(high, high.slab.borders.front(), low, low.slab.borders.back());
        }
        for (Part& part : parts) {
            if (go == BordersGo::first) part.simulation->step_part(cuda::StepPart::interior);
        }
    }
    State state = state_at_rest(whole);
    for (const Part& part : parts) part.slab.copy_own(part.simulation->download(), state);
    return state;
}

template <class MakeSimulation>
void expect_bits_of_each(const std::vector<Problem>& problems, MakeSimulation make) {
    constexpr int steps = 12;
    std::size_t left = 0;
    for (const Problem& whole : problems) {
        const State start = random_state(whole, 0.05, 3);
        const auto stepped = [&](int slabs, BordersGo go) {
            return stepped_as(slabs, whole, start, steps, make, go, left);
        };
        const State expected = stepped(1, BordersGo::last);
        EXPECT_NE(expected.displacement, start.displacement);
        for (const int slabs : {2, 4}) expect_same_bits(stepped(slabs, BordersGo::last), expected);
        expect_same_bits(stepped(2, BordersGo::first), expected);
    }
    EXPECT_GT(left, 0U) << "no step had an interior";
}

}  // namespace voxspring::testing
