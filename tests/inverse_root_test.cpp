// The force through an approximate inverse root against the shared formula, for every error that a device's
// root may have.
#include "backends/physics/inverse_root.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "backends/physics/spring.h"

namespace voxspring {
namespace {

// NVIDIA gives 2^-22.9 as the largest relative error of rsqrt.approx.f32.
constexpr double approximate_error = 1.28e-7;

// A root with a relative error of `error`; equal arguments give equal results.
float approximate_inverse_root(float squared, double error) {
    return float((1 + error) / std::sqrt(double(squared)));
}

struct Scalar {
    double value;
};
double dot(Scalar a, Scalar b) { return a.value * b.value; }
Scalar operator*(Scalar a, double s) { return {a.value * s}; }

// The shared formula, k = 1, along one axis: its force over the offset.
double shared_density(double length, double rest_length) {
    return spring_force(Scalar{length}, rest_length, 1.0, 1e-12).value / length;
}

TEST(InverseRoot, RestIsZeroToTheBitWhateverTheError) {
    std::mt19937 generator(1);
    std::uniform_real_distribution<float> squares(0.01F, 100);
    for (int n = 0; n < 10000; ++n) {
        const float squared = n < 3 ? float(n + 1) : squares(generator);
        for (const double error : {-approximate_error, 0.3 * approximate_error, approximate_error}) {
            const float inverse = approximate_inverse_root(squared, error);
            const float rest_length = rounded_product(squared, inverse);
            EXPECT_EQ(unit_force_density(squared, rest_length, inverse), 0.0F);
        }
    }
}

TEST(InverseRoot, AgreesWithTheSharedFormula) {
    std::mt19937 generator(2);
    std::uniform_real_distribution<double> stretch(0.2, 3), rests(0.5, 4), errors(-1, 1);
    for (int n = 0; n < 10000; ++n) {
        const double rest_length = rests(generator);
        const double length = rest_length * stretch(generator);
        const double expected = shared_density(length, rest_length);
        // l / |d| and 1 each carry the error of a root and of a few roundings, 2^-24 each.
        const double relative = 2 * approximate_error + 4 * std::ldexp(1.0, -24);
        const auto squared = float(length * length);
        const auto rest_squared = float(rest_length * rest_length);
        const float measured = rounded_product(
            rest_squared, approximate_inverse_root(rest_squared, approximate_error * errors(generator)));
        const float density = unit_force_density(
            squared, measured, approximate_inverse_root(squared, approximate_error * errors(generator)));
        EXPECT_NEAR(double(density), expected, 2 * relative * (1 + rest_length / length));

        const double exact = unit_force_density(length * length, measured_length(rest_length * rest_length),
                                                inverse_root(length * length));
        EXPECT_NEAR(exact, expected, 8 * std::ldexp(1.0, -53) * (1 + rest_length / length));
    }
}

TEST(InverseRoot, TheLeanStrainDensityIsTheSame) {
    std::mt19937 generator(3);
    std::uniform_real_distribution<double> stretch(0.2, 3), rests(0.5, 4);
    for (int n = 0; n < 10000; ++n) {
        const double rest_length = rests(generator);
        const double length = rest_length * stretch(generator);
        const double squared = length * length;
        const double deficit = rest_length * rest_length - squared;
        const double expected = deficit / ((rest_length + length) * length);
        // Half a unit each for the root, the sum, the reciprocal and the product in host code, and for their
        // arguments.
        constexpr double roundings = 8;
        EXPECT_NEAR(double(lean_strain_density(float(squared), float(rest_length), float(deficit))), expected,
                    roundings * std::ldexp(1.0, -24) * std::fabs(expected));
        EXPECT_NEAR(lean_strain_density(squared, rest_length, deficit), expected,
                    roundings * std::ldexp(1.0, -53) * std::fabs(expected));
    }
    EXPECT_EQ(lean_strain_density(2.0F, std::sqrt(2.0F), 0.0F), 0.0F);
}

TEST(InverseRoot, CoincidentParticlesStayFinite) {
    const float squared = squared_length(0.0F, 0.0F, 0.0F, 1e-12F);
    const float density = unit_force_density(squared, 1.0F, inverse_root(squared));
    EXPECT_TRUE(std::isfinite(density));
    EXPECT_EQ(0.0F * density, 0.0F);
}

TEST(InverseRoot, TheAddedShortestLengthIsLostAtRest) {
    for (const float edge : {1.0F, 2.0F, 0.75F}) {
        EXPECT_EQ(squared_length(edge, 0.0F, 0.0F, 1e-12F * edge * edge), edge * edge);
        EXPECT_EQ(squared_length(edge, edge, 0.0F, 1e-12F * edge * edge), 2 * edge * edge);
        EXPECT_EQ(squared_length(0.0F, edge, edge, 1e-12F * edge * edge), 2 * edge * edge);
        EXPECT_EQ(squared_length(edge, edge, edge, 1e-12F * edge * edge), 3 * edge * edge);
    }
}

// The hardware's float64 approximations are good to 20 bits.
TEST(InverseRoot, RefinementReachesDoublePrecision) {
    std::mt19937 generator(3);
    std::uniform_real_distribution<double> exponents(-60, 60), errors(-1, 1);
    for (int n = 0; n < 10000; ++n) {
        const double value = std::exp2(exponents(generator));
        const double error = errors(generator) * std::ldexp(1.0, -20);
        const double root = 1 / std::sqrt(value);
        // Roundings of the last operations; the iteration's own error is of the order of 2^-60.
        EXPECT_NEAR(refined_inverse_root(value, root * (1 + error)) / root, 1, 3 * std::ldexp(1.0, -53));
        EXPECT_NEAR(refined_reciprocal(value, (1 + error) / value) * value, 1, 3 * std::ldexp(1.0, -53));
    }
}

TEST(InverseRoot, SeriesStiffnessIsTheSharedOne) {
    EXPECT_FLOAT_EQ(fast_series_stiffness(0.5F, 2.0F), series_stiffness(0.5F, 2.0F));
    EXPECT_DOUBLE_EQ(fast_series_stiffness(0.5, 2.0), series_stiffness(0.5, 2.0));
}

}  // namespace
}  // namespace voxspring
