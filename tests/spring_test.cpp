// The shared formulas of spring.h by themselves, against float64 and against their symmetries.
#include "backends/physics/spring.h"

#include <gtest/gtest.h>

#include <cmath>
#include <glm/geometric.hpp>
#include <glm/vec3.hpp>
#include <random>

namespace voxspring::testing {
namespace {

/// A spring between random ends, in float32: `rest_offset` apart at rest, and displaced by `relative` now.
struct RandomSpring {
    glm::vec3 relative, rest_offset;
    float rest_length, stiffness;
};

class Springs {
public:
    /// The relative displacement is at most `size` in each component.
    RandomSpring next(float size) {
        const auto vector = [this](float most) {
            std::uniform_real_distribution<float> uniform(-most, most);
            const float x = uniform(generator_), y = uniform(generator_), z = uniform(generator_);
            return glm::vec3(x, y, z);
        };
        std::uniform_int_distribution<int> voxels(-1, 1);
        glm::vec3 rest(0);
        while (rest == glm::vec3(0))
            rest = glm::vec3(voxels(generator_), voxels(generator_), voxels(generator_));
        std::uniform_real_distribution<float> stiffness(0.1F, 10);
        return {vector(size), rest, std::sqrt(glm::dot(rest, rest)), stiffness(generator_)};
    }

private:
    std::mt19937 generator_{51};
};

constexpr float shortest_squared = 1e-12F;

float density_of(const RandomSpring& s) {
    return strain_density(s.relative, s.rest_offset, s.rest_length, 0.0F, s.stiffness, shortest_squared);
}

/// The force density by its definition, in extended precision. The rest length is that of the offset, of
/// which float32's rest length is a rounding.
long double exact_density(const RandomSpring& s) {
    long double squared = 0, rest = 0;
    for (int a = 0; a < 3; ++a) {
        const long double d = static_cast<long double>(s.rest_offset[a]) + s.relative[a];
        squared += d * d;
        rest += static_cast<long double>(s.rest_offset[a]) * s.rest_offset[a];
    }
    return s.stiffness * (std::sqrt(rest) - std::sqrt(squared)) / std::sqrt(squared);
}

// However small the strain is, the error is a few roundings of the largest product in it: k |w| / |d|.
TEST(StrainDensity, KeepsItsAccuracyAtSmallStrain) {
    Springs springs;
    for (const float size : {0.2F, 1e-3F, 1e-6F, 1e-12F}) {
        double worst_naive = 0;
        for (int n = 0; n < 1000; ++n) {
            const RandomSpring s = springs.next(size);
            const double scale = double(s.stiffness * glm::length(s.relative) / s.rest_length);
            const double exact = double(exact_density(s));
            EXPECT_NEAR(double(density_of(s)), exact, 20 * 0x1p-24 * scale);
            const double naive = double(
                force_density(s.rest_offset + s.relative, s.rest_length, s.stiffness, shortest_squared));
            worst_naive = std::max(worst_naive, std::abs(naive - exact) / scale);
        }
        // By then the difference of lengths has lost every bit, which is why the other formula exists.
        if (size <= 1e-6F) {
            EXPECT_GT(worst_naive, 0.01);
        }
    }
}

TEST(StrainDensity, IsTheSameToTheBitFromEitherEnd) {
    Springs springs;
    for (int n = 0; n < 1000; ++n) {
        const RandomSpring s = springs.next(0.5F);
        RandomSpring other = s;
        other.relative = -s.relative;
        other.rest_offset = -s.rest_offset;
        EXPECT_EQ(density_of(s), density_of(other));
        const auto force = [](const RandomSpring& t) {
            return strain_force(t.relative, t.rest_offset, t.rest_length, 0.0F, t.stiffness,
                                shortest_squared);
        };
        EXPECT_EQ(force(s), -force(other));
    }
}

TEST(StrainDensity, IsZeroAtRest) {
    Springs springs;
    for (int n = 0; n < 100; ++n) {
        RandomSpring s = springs.next(0);
        s.rest_offset *= 0.7F;  // |rest_offset| then differs from the rest length
        EXPECT_EQ(density_of(s), 0);
    }
}

TEST(StrainDensity, TakesAStressAtRestFromTheDeficit) {
    const glm::dvec3 rest_offset(1, -2, 2), relative(0.1, 0.2, -0.05);
    const double length = 2, deficit = length * length - 9;
    const double density = strain_density(relative, rest_offset, length, deficit, 3.0, 1e-12);
    const double expected = force_density(rest_offset + relative, length, 3.0, 1e-12);
    EXPECT_NEAR(density, expected, 1e-14);
    EXPECT_EQ(strain_force(relative, rest_offset, length, deficit, 3.0, 1e-12),
              (rest_offset + relative) * density);
}

TEST(StrainDensity, IsFiniteForCoincidentParticlesAndNoRestLength) {
    const glm::vec3 rest_offset(1, 0, 0);
    const glm::vec3 force = strain_force(-rest_offset, rest_offset, 1.0F, 0.0F, 1.0F, shortest_squared);
    EXPECT_EQ(force, glm::vec3(0));
    // A rest length of zero, with ends together and apart: the force is exactly k |d| along d.
    EXPECT_EQ(strain_force(-rest_offset, rest_offset, 0.0F, -1.0F, 2.0F, shortest_squared), glm::vec3(0));
    EXPECT_EQ(strain_force(rest_offset, rest_offset, 0.0F, -1.0F, 2.0F, shortest_squared),
              glm::vec3(-4, 0, 0));
    EXPECT_EQ(strain_force(glm::vec3(0), glm::vec3(0), 0.0F, 0.0F, 2.0F, shortest_squared), glm::vec3(0));
}

TEST(Split, SumsKeepTwiceTheBits) {
    std::mt19937 generator(52);
    std::uniform_real_distribution<float> uniform(-1, 1);
    std::uniform_int_distribution<int> exponent(-30, 0);
    for (int n = 0; n < 10000; ++n) {
        const float high = std::ldexp(uniform(generator), exponent(generator));
        const float low = high * 0x1p-25F * uniform(generator);
        const float added = std::ldexp(uniform(generator), exponent(generator));
        const float added_low = added * 0x1p-25F * uniform(generator);
        const glm::vec3 h =
            split_high(glm::vec3(high), glm::vec3(low), glm::vec3(added), glm::vec3(added_low));
        const glm::vec3 l =
            split_low(glm::vec3(high), glm::vec3(low), glm::vec3(added), glm::vec3(added_low));
        const long double exact = static_cast<long double>(high) + low + added + added_low;
        const long double scale = std::max(std::abs(high), std::abs(added));
        // In units of the scale, two sums are rounded: that of the low parts, which is below 2^-24; and that
        // of the result and the error of the high parts' sum, which is below 3 x 2^-24. A sum is rounded by
        // at most 2^-24 of itself: together by less than 2^-46.
        EXPECT_LE(std::abs(static_cast<long double>(h.x) + l.x - exact), 0x1p-46L * scale);
        EXPECT_EQ(h.x + l.x, h.x) << "the high part is the nearest to the sum";
    }
}

TEST(Split, SumErrorIsExact) {
    std::mt19937 generator(53);
    std::uniform_real_distribution<float> uniform(-1, 1);
    std::uniform_int_distribution<int> exponent(-14, 14);
    for (int n = 0; n < 10000; ++n) {
        const float a = std::ldexp(uniform(generator), exponent(generator));
        const float b = std::ldexp(uniform(generator), exponent(generator));
        const float error = sum_error(glm::vec3(a), glm::vec3(b), glm::vec3(a + b)).x;
        EXPECT_EQ(double(a + b) + double(error), double(a) + double(b));
    }
}

TEST(Update, TheFourAreOneInExactArithmetic) {
    const glm::dvec3 x(0.3, -0.2, 0.9), previous(0.29, -0.21, 0.88), force(1, 2, -3), gravity(0, 0, -0.5);
    const double inverse_mass = 0.5, damping = 0.125, time_step_squared = 0.0625;
    const glm::dvec3 v = x - previous;
    const glm::dvec3 next =
        next_position(x, previous, force, inverse_mass, gravity, 1 - damping, time_step_squared);
    const glm::dvec3 printed = paper_position(x, previous, force, inverse_mass, gravity, 2 - damping,
                                              1 - damping, time_step_squared);
    const glm::dvec3 by_increment =
        x + (v + increment_change(v, force, inverse_mass, gravity, damping, time_step_squared));
    EXPECT_LT(glm::length(next - printed), 1e-15);
    EXPECT_LT(glm::length(next - by_increment), 1e-15);
    EXPECT_NEAR(next.x, 0.3 + 0.875 * 0.01 + 0.5 * 0.0625, 1e-15);
    EXPECT_NEAR(next.z, 0.9 + 0.875 * 0.02 - 2 * 0.0625, 1e-15);
}

}  // namespace
}  // namespace voxspring::testing
