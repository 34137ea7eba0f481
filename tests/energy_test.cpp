// Energy of a device: its meters, the leaps of their counters, and what is refused.
#include "harness/device/energy.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <filesystem>
#include <fstream>
#include <stdexcept>
#include <thread>

#include "tests/surroundings.h"

namespace voxspring {
namespace {

using ::testing::HasSubstr;

/// A folder in which Linux shows energy counters.
class Rapl : public ::testing::Test {
protected:
    void SetUp() override {
        add("intel-rapl:0", "package-0", "1000000");
        add("intel-rapl:0:0", "core", "1");
        add("intel-rapl:1", "package-1", "2000000");
    }

    void add(const std::string& domain, const std::string& name, const std::string& microjoules) const {
        std::filesystem::create_directories(folder_ / domain);
        std::ofstream(folder_ / domain / "name") << name << "\n";
        std::ofstream(folder_ / domain / "max_energy_range_uj") << "10000000\n";
        count(domain, microjoules);
    }
    void count(const std::string& domain, const std::string& microjoules) const {
        std::ofstream(folder_ / domain / "energy_uj") << microjoules << "\n";
    }

    const testing::TemporaryFolder temporary_;
    const std::filesystem::path folder_ = temporary_.path();
};

TEST_F(Rapl, SumsPackagesAndCountsPastTheirRange) {
    const auto meter = rapl_meter(folder_);
    EXPECT_DOUBLE_EQ(meter->joules(), 3);
    count("intel-rapl:0", "9500000");
    EXPECT_DOUBLE_EQ(meter->joules(), 11.5);
    count("intel-rapl:0", "500000");  // past 10 J
    EXPECT_DOUBLE_EQ(meter->joules(), 12.5);
    EXPECT_EQ(meter->watts(), std::nullopt);
    EXPECT_EQ(meter->name(), "RAPL");
    std::filesystem::remove(folder_ / "intel-rapl:1/energy_uj");
    EXPECT_THROW((void)meter->joules(), UnknownEnergy);
}

TEST_F(Rapl, CountsAPackageOnceThatLinuxShowsTwice) {
    add("intel-rapl-mmio:0", "package-0", "999000");
    add("intel-rapl-mmio:1", "package-1", "1999000");
    add("intel-rapl-mmio:2", "package-2", "500000");  // which appears only here
    EXPECT_DOUBLE_EQ(rapl_meter(folder_)->joules(), 3.5);
}

TEST_F(Rapl, SaysWhyThereIsNone) {
    const auto refusal_of = [](const std::filesystem::path& folder) {
        return testing::message_of<UnknownEnergy>([&] { (void)rapl_meter(folder); });
    };
    EXPECT_THAT(refusal_of(folder_ / "nosuch"), HasSubstr("has no energy counter"));
    // A sum without one of the packages would be too small.
    for (const char* lost : {"intel-rapl:1/max_energy_range_uj", "intel-rapl:0/energy_uj"}) {
        SetUp();
        std::filesystem::remove(folder_ / lost);
        EXPECT_THAT(refusal_of(folder_), HasSubstr("usually only root may"));
    }
}

/// A device that uses 200 W, counted in leaps of a twentieth of a second.
class Leaping : public EnergyMeter {
public:
    double joules() override {
        const auto now = std::chrono::steady_clock::now() - begin_;
        return 10 * double(now / std::chrono::milliseconds(50));
    }
    std::optional<double> watts() override { return sampled; }
    std::string name() const override { return "test"; }
    double sampled = 200;

private:
    const std::chrono::steady_clock::time_point begin_ = std::chrono::steady_clock::now();
};

void nap() { std::this_thread::sleep_for(std::chrono::milliseconds(1)); }

TEST(Energy, IsTakenFromLeapToLeap) {
    Leaping meter;
    const EnergyUse use = measure_energy(meter, 0.1, 1.03, nap);
    // A leap is seen one interval of 10 ms late at most, more where the machine is busy: of 1.03 s or more.
    EXPECT_NEAR(use.watts, 200, 200 * 0.1);
    EXPECT_GE(use.seconds, 1.03);
    EXPECT_LT(use.seconds, 1.1);
    EXPECT_TRUE(powers_agree(use));
    EXPECT_FALSE(powers_agree({.watts = 200, .sampled_watts = 211}));
    EXPECT_TRUE(powers_agree({.watts = 200, .sampled_watts = 209}));
    EXPECT_TRUE(powers_agree({.watts = 200}));
}

TEST(Energy, OfACounterThatStandsStillIsNotKnown) {
    class Still : public Leaping {
        double joules() override { return 1; }
    } meter;
    EXPECT_THROW((void)measure_energy(meter, 0, 0.05, nap), UnknownEnergy);
}

TEST(Energy, OfADeviceWithoutAMeterIsNotKnown) {
    Capabilities no_card;
    no_card.family = "opengl";
    no_card.uuid = "GPU-that-nobody-has";
    EXPECT_THROW((void)energy_meter_of(no_card), UnknownEnergy);
    // The processor's meter would give a card's rows the energy of the processor.
    no_card.uuid.clear();
    no_card.device = "a card of some driver";
    EXPECT_THAT(testing::message_of<UnknownEnergy>([&] { (void)energy_meter_of(no_card); }),
                ::testing::HasSubstr("a card of some driver has no UUID"));
}

TEST(Energy, OfABrokenMeterIsNotKnown) {
    class Broken : public Leaping {
        double joules() override { throw UnknownEnergy("it broke"); }
    } meter;
    EXPECT_THROW((void)measure_energy(meter, 0, 0.05, nap), UnknownEnergy);
}

}  // namespace
}  // namespace voxspring
