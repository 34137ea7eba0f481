// When tiles are checked for rest: the rules that every backend with the tuning parameter `rest` follows.
#include "backends/rest_policy.h"

#include <gtest/gtest.h>

#include <string>

#include "backends/registry.h"
#include "tests/support.h"

namespace voxspring::testing {
namespace {

constexpr RestPolicy::Parameters parameters{
    .period = 10, .min_pause = 20, .max_pause = 50, .paying_numerator = 3, .paying_denominator = 4};

Rest rest_of_spec(const std::string& options) {
    return rest_of(BackendSpec::parse("cpu_parallel:" + options).options);
}

TEST(RestOf, IsWhatTheTuningParameterSays) {
    EXPECT_EQ(rest_of_spec("rest=auto"), Rest::choose);
    EXPECT_EQ(rest_of_spec("rest=auto,terms=all"), Rest::step);
    EXPECT_EQ(rest_of_spec("rest=step"), Rest::step);
    EXPECT_EQ(rest_of_spec("rest=skip"), Rest::skip);
    EXPECT_EQ(rest_of_spec("rest=flush"), Rest::flush);
}

TEST(StaysAtRest, WhereNothingButSpringsActs) {
    Problem problem = make_lattice_problem(solid({3, 3, 3}), FACE_BITS);
    EXPECT_TRUE(stays_at_rest(problem));
    Problem falling = problem;
    falling.gravity = {0, 0, -1};
    EXPECT_FALSE(stays_at_rest(falling));
    problem.load.assign(problem.particle_count(), glm::dvec3(0));
    EXPECT_FALSE(stays_at_rest(problem));
}

TEST(RestPolicy, SaysWhatItAmountsTo) {
    RestPolicy policy(parameters);
    policy.start(false, false);
    EXPECT_EQ(policy.choice(), "step");
    policy.start(true, false);
    EXPECT_EQ(policy.choice(), "skip");
    policy.start(true, true);
    EXPECT_EQ(policy.choice(), "skip_or_step");
}

TEST(RestPolicy, NeverDecidesWhereItMayNotChoose) {
    RestPolicy policy(parameters);
    for (const bool checks : {false, true}) {
        policy.start(checks, false);
        policy.stepped(1000000);
        EXPECT_EQ(policy.checks(), checks);
        EXPECT_EQ(policy.may_check(), checks);
        EXPECT_FALSE(policy.is_due());
        EXPECT_GT(policy.steps_to_decision(), 1000000);
    }
}

/// Steps on to the next decision and returns how many steps that took.
int steps_to_due(RestPolicy& policy) {
    const int steps = policy.steps_to_decision();
    EXPECT_FALSE(policy.is_due());
    policy.stepped(steps);
    EXPECT_TRUE(policy.is_due());
    return steps;
}

TEST(RestPolicy, PausesWhereTooFewRestAndLongerEachTime) {
    RestPolicy policy(parameters);
    policy.start(true, true);
    for (const int pause : {20, 40, 50, 50}) {
        EXPECT_TRUE(policy.checks());
        EXPECT_EQ(steps_to_due(policy), 10);
        policy.decide(76, 100);
        EXPECT_FALSE(policy.checks());
        EXPECT_TRUE(policy.may_check());
        EXPECT_EQ(steps_to_due(policy), pause);
        policy.begin_checks();
    }
    // Once checking pays, the next pause is short again.
    EXPECT_EQ(steps_to_due(policy), 10);
    policy.decide(75, 100);
    EXPECT_TRUE(policy.checks());
    EXPECT_EQ(steps_to_due(policy), 10);
    policy.decide(100, 100);
    EXPECT_EQ(steps_to_due(policy), 20);
}

TEST(RestPolicy, GoesOnForAPeriodWhereTheCountIsNotKnownYet) {
    RestPolicy policy(parameters);
    policy.start(true, true);
    EXPECT_EQ(steps_to_due(policy), 10);
    policy.go_on();
    EXPECT_TRUE(policy.checks());
    EXPECT_EQ(steps_to_due(policy), 10);
}

TEST(RestPolicy, DecidesLateWhereMoreStepsWereMade) {
    RestPolicy policy(parameters);
    policy.start(true, true);
    policy.stepped(25);
    EXPECT_TRUE(policy.is_due());
    policy.decide(1, 100);
    EXPECT_EQ(policy.steps_to_decision(), 10);
}

}  // namespace
}  // namespace voxspring::testing
