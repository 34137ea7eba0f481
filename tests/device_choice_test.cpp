// Which devices of OpenGL and Vulkan may appear in one table with a CUDA device, and which of several devices
// a thread takes.
#include "backends/device_choice.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <thread>
#include <vector>

#include "backends/backend.h"
#include "backends/pace.h"
#include "tests/surroundings.h"

namespace voxspring::testing {
namespace {

using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

const std::string card = "GPU-00112233-4455-6677-8899-aabbccddeeff";
const std::string other = "GPU-ffeeddcc-bbaa-9988-7766-554433221100";

struct Device {
    std::string name, uuid;
    bool software;
};

/// Names of the devices that are not passed over, in their order.
std::vector<std::string> allowed(const std::vector<Device>& devices, const std::string& measured) {
    std::vector<std::string> names;
    for (const Device& device : devices) {
        if (reason_to_pass_over(device.uuid, device.software, measured).empty()) names.push_back(device.name);
    }
    return names;
}

TEST(DeviceChoice, WithoutCudaEveryDeviceIsAllowed) {
    EXPECT_THAT(allowed({{"other", other, false}, {"nameless", "", false}, {"llvmpipe", "", true}}, ""),
                ElementsAre("other", "nameless", "llvmpipe"));
}

TEST(DeviceChoice, BesideCudaHardwareMustBeThatCard) {
    EXPECT_THAT(
        allowed(
            {{"other", other, false}, {"nameless", "", false}, {"card", card, false}, {"llvmpipe", "", true}},
            card),
        ElementsAre("card", "llvmpipe"));
}

TEST(DeviceChoice, ThePassedOverAreTold) {
    EXPECT_THAT(reason_to_pass_over(other, false, card), AllOf(HasSubstr(other), HasSubstr(card)));
    EXPECT_THAT(reason_to_pass_over("", false, card), AllOf(HasSubstr("no UUID"), HasSubstr(card)));
}

TEST(DeviceChoice, UuidsAreWrittenAsTheDriversToolsWriteThem) {
    EXPECT_EQ(uuid_text({0x00, 0x11, 0x22, 0x33, 0x44, 0x55, 0x66, 0x77, 0x88, 0x99, 0xaa, 0xbb, 0xcc, 0xdd,
                         0xee, 0xff}),
              card);
}

const std::vector<ListedDevice> several = {{"llvmpipe (LLVM 15)", DeviceKind::software},
                                           {"AMD Radeon 780M", DeviceKind::integrated},
                                           {"NVIDIA GeForce RTX 4090", DeviceKind::discrete},
                                           {"AMD Radeon RX 7900", DeviceKind::discrete}};

TEST(DevicesToTry, BeginWithThePreferredKind) {
    EXPECT_THAT(devices_to_try(several, ""), ElementsAre(2, 3, 1, 0));
    EXPECT_THAT(devices_to_try({}, ""), ElementsAre());
}

TEST(DevicesToTry, AreThoseThatAreAskedFor) {
    EXPECT_THAT(devices_to_try(several, "1"), ElementsAre(1));
    EXPECT_THAT(devices_to_try(several, "radeon"), ElementsAre(3, 1));
    EXPECT_THAT(devices_to_try(several, "780m"), ElementsAre(1));
    EXPECT_THAT(devices_to_try(several, "rtx 4090"), ElementsAre(2));
    EXPECT_THAT(devices_to_try(several, "Intel"), ElementsAre());
    EXPECT_EQ(names_of({several[0], several[1]}),
              "0 llvmpipe (LLVM 15) (software), 1 AMD Radeon 780M (integrated)");
}

TEST(DevicesToTry, AreNoneForANumberBeyondTheList) {
    for (const char* number : {"4", "7", "4090", "99999999999999999999999"})
        EXPECT_THAT(devices_to_try(several, number), ElementsAre()) << number;
    EXPECT_THAT(devices_to_try(several, "03"), ElementsAre(3));
}

TEST(APace, IsAllAtOnceWhereStepsAreShort) {
    Pace pace(512);
    EXPECT_TRUE(pace.is_unknown());
    EXPECT_EQ(pace.steps(), 1);
    pace.measured(1, 1e-5);
    EXPECT_FALSE(pace.is_unknown());
    EXPECT_EQ(pace.steps(), 512);
    pace.forget();
    EXPECT_TRUE(pace.is_unknown());
    EXPECT_EQ(pace.steps(), 1);
}

// This holds whatever else the first step needs.
TEST(APace, KeepsADeviceNoLongerThanItShould) {
    for (const double seconds : {1e-4, 1e-3, 0.01, 0.1, 1.0}) {
        Pace pace(1 << 16);
        double extra = 0.05;
        int measured = 0;
        for (; pace.is_unknown(); ++measured) {
            EXPECT_LE(pace.steps() * seconds, std::max(1.01 * Pace::longest_seconds, seconds));
            pace.measured(pace.steps(), pace.steps() * seconds + extra);
            extra = 0;
        }
        EXPECT_LE(measured, 4);
        EXPECT_LE(pace.steps() * seconds, std::max(1.01 * Pace::longest_seconds, seconds));
        EXPECT_GE(pace.steps() * seconds, 0.3 * Pace::longest_seconds);
    }
}

// Mesa compiles within the first step, which then takes longer than steps given at once may.
TEST(APace, IsNotDecidedByASlowFirstStep) {
    Pace pace(512);
    pace.measured(1, 2 * Pace::longest_seconds);
    EXPECT_TRUE(pace.is_unknown());
    EXPECT_EQ(pace.steps(), 1);
    pace.measured(1, 1e-5);
    EXPECT_FALSE(pace.is_unknown());
    EXPECT_EQ(pace.steps(), 512);
}

TEST(APace, IsNotMeasuredForEverWhereStepsComeOneByOne) {
    Pace pace(512);
    int measured = 0;
    for (; pace.is_unknown(); ++measured) pace.measured(1, 0.01);
    EXPECT_LE(measured, 4);
    EXPECT_EQ(pace.steps(), 25);
}

TEST(DeviceNumbers, AreOfTheDevicesThatThereAre) {
    const auto refusal_of = [](DeviceNumber device, int count) {
        return message_of<Unavailable>([&] { (void)device.among(count, "CUDA"); });
    };
    EXPECT_EQ((DeviceNumber{2, false}.among(3, "CUDA")), 2);
    EXPECT_EQ(refusal_of({3, false}, 3), "no CUDA device 3: there are devices 0 to 2");
    EXPECT_EQ(refusal_of({1, false}, 1), "no CUDA device 1: there is device 0 alone");
    EXPECT_EQ((DeviceNumber{7, true}.among(3, "CUDA")), 1);
}

TEST(DeviceNumbers, TellHowManyPartsShareADevice) {
    EXPECT_EQ((DeviceNumber{2, false, 3}.parts_among(4)), 3);
    // Five parts on two devices: 0, 2 and 4 are on the first.
    EXPECT_EQ((DeviceNumber{4, true, 5}.parts_among(2)), 3);
    EXPECT_EQ((DeviceNumber{3, true, 5}.parts_among(2)), 2);
    EXPECT_EQ((DeviceNumber{1, true, 2}.parts_among(8)), 1);
}

TEST(DeviceNumbers, AreOfOneThreadAndOneScope) {
    EXPECT_EQ(DeviceOfThread::now().number, 0);
    {
        const DeviceOfThread outer({3, false});
        {
            const DeviceOfThread inner({5, true});
            EXPECT_EQ(DeviceOfThread::now().number, 5);
            EXPECT_TRUE(DeviceOfThread::now().wraps);
        }
        EXPECT_EQ(DeviceOfThread::now().number, 3);
        int elsewhere = -1;
        std::thread([&] { elsewhere = DeviceOfThread::now().number; }).join();
        EXPECT_EQ(elsewhere, 0);
    }
    EXPECT_EQ(DeviceOfThread::now().number, 0);
}

}  // namespace
}  // namespace voxspring::testing
