// Tests of the Vulkan backends alone: how their failures read, that validation messages are noticed, what a
// module says about itself, and which compiled code is kept.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <memory>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "backends/api.h"
#include "backends/disk_cache.h"
#include "backends/glsl/compute.h"
#include "backends/glsl/implicit.h"
#include "backends/registry.h"
#include "backends/vulkan/compute_device.h"
#include "backends/vulkan/program.h"
#include "tests/required.h"
#include "tests/shader_support.h"
#include "tests/support.h"
#include "tests/surroundings.h"

namespace voxspring::testing {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

/// Why a backend is not available; empty if it is.
std::string absence(const std::string& specification) {
    return message_of<Unavailable>([&] { (void)BackendSpec::parse(specification).make(); });
}

TEST(NoVulkan, AMissingLoaderIsASkip) {
    const Variable loader("VOXSPRING_VULKAN_LOADER", "/nonexistent/libvulkan.so.1");
    EXPECT_THAT(absence("vulkan_implicit"), AllOf(HasSubstr("no Vulkan loader"), HasSubstr("/nonexistent")));
}

TEST(NoVulkan, ALibraryThatIsNoLoaderIsASkip) {
    const Variable loader("VOXSPRING_VULKAN_LOADER", "libm.so.6");
    EXPECT_THAT(absence("vulkan_implicit"),
                AllOf(HasSubstr("no Vulkan loader"), HasSubstr("vkGetInstanceProcAddr")));
}

/// Skips its tests if there is no Vulkan.
class Vulkan : public ::testing::Test {
protected:
    void SetUp() override {
        std::unique_ptr<Backend> probe;
        make_or_skip(BackendSpec::parse("vulkan_implicit"), probe);
    }
};

TEST_F(Vulkan, AMissingDriverIsASkip) {
    // The newer and the older name.
    const Variable drivers("VK_DRIVER_FILES", "/dev/null"), files("VK_ICD_FILENAMES", "/dev/null");
    EXPECT_THAT(
        absence("vulkan_explicit"),
        HasSubstr("no Vulkan driver was found: install a card's driver, or Debian's mesa-vulkan-drivers"));
}

TEST_F(Vulkan, SaysWhatItRunsOn) {
    const Capabilities capabilities = BackendSpec::parse("vulkan_implicit").make()->capabilities();
    EXPECT_THAT(capabilities.api, HasSubstr("Vulkan 1."));
    EXPECT_EQ(capabilities.family, "vulkan");
    EXPECT_EQ(capabilities.is_software, capabilities.uuid.empty());
    if (capabilities.is_software) {
        EXPECT_TRUE(capabilities.device.ends_with(", software")) << capabilities.device;
    }
}

// --- Which device ----------------------------------------------------------------------------------------

TEST_F(Vulkan, ADeviceIsTakenByNumberOrName) {
    const std::vector<ListedDevice> devices = apis().at("vulkan").devices();
    bool is_taken = false;
    for (std::size_t n = 0; n < devices.size(); ++n) {
        const Variable asked(device_variable("vulkan"), std::to_string(n));
        if (!absence("vulkan_implicit").empty()) continue;
        is_taken = true;
        EXPECT_THAT(BackendSpec::parse("vulkan_implicit").make()->capabilities().device,
                    HasSubstr(devices[n].name));
        const std::vector<ListedDevice> now = apis().at("vulkan").devices();
        for (std::size_t other = 0; other < now.size(); ++other)
            EXPECT_EQ(now[other].refusal.empty(), other == n) << now[other].refusal;
    }
    EXPECT_TRUE(is_taken);
    const Variable asked(device_variable("vulkan"), "no such card");
    EXPECT_THAT(absence("vulkan_implicit"),
                AllOf(HasSubstr("no Vulkan device matches 'no such card'"), HasSubstr(names_of(devices))));
}

// --- Messages of validation layers ------------------------------------------------------------------------

bool has_validation() {
    const Variable wanted("VOXSPRING_VULKAN_VALIDATION", "1");
    const vulkan::Device device(Precision::float32);
    return device.validates();
}

TEST_F(Vulkan, WhatValidationLayersSayIsAnError) {
    if (!has_validation()) GTEST_SKIP() << "no VK_LAYER_KHRONOS_validation";
    const vulkan::Device device(Precision::float32);
    EXPECT_NO_THROW(device.check("testing"));
    // A buffer without any usage.
    const vk::raii::Buffer useless(device.get(), vk::BufferCreateInfo({}, 16, {}));
    EXPECT_THAT(message_of<DeviceError>([&] { device.check("testing"); }),
                AllOf(HasSubstr("VUID-VkBufferCreateInfo"), HasSubstr("while testing")));
    EXPECT_NO_THROW(device.check("testing")) << "a message is told once";
}

TEST_F(Vulkan, AMissingBarrierIsAnError) {
    if (!has_validation()) GTEST_SKIP() << "no VK_LAYER_KHRONOS_validation";
    const vulkan::Device device(Precision::float32);
    vulkan::Queue queue(device);
    const vulkan::Buffer from(device, 256, vulkan::Place::device), to(device, 256, vulkan::Place::device);
    const auto copy_and_back = [&](bool in_order) {
        queue.enqueue_once([&](const vulkan::Commands& commands) {
            commands.copyBuffer(from.get(), to.get(), vk::BufferCopy(0, 0, 256));
            if (in_order) vulkan::all_then_all(commands);
            commands.copyBuffer(to.get(), from.get(), vk::BufferCopy(0, 0, 256));
            vulkan::all_then_all(commands);
        });
        queue.wait();
        device.check("testing");
    };
    EXPECT_NO_THROW(copy_and_back(true));
    EXPECT_THROW(copy_and_back(false), DeviceError);
}

TEST_F(Vulkan, BuffersThatWereReadAreUsedAgainAndOthersAreNot) {
    const vulkan::Device device(Precision::float32);
    vulkan::BufferPool pool(device);
    const auto holding = [&](std::size_t count, std::byte value) {
        return pool.holding(std::vector(count, value));
    };
    auto first = holding(100, std::byte{1});
    const auto second = holding(100, std::byte{2});
    const vk::Buffer given = first->get();
    EXPECT_NE(second->get(), given);
    EXPECT_EQ(first->host()[99], std::byte{1}) << "of the one that is still read";
    first.reset();
    const auto third = holding(200, std::byte{3});
    EXPECT_EQ(third->get(), given) << "of the same size as a power of two";
    EXPECT_EQ(third->host()[199], std::byte{3});
    EXPECT_GE(holding(1000, std::byte{4})->bytes(), 1000U);
    EXPECT_EQ(holding(0, std::byte{5})->bytes(), 0U);

    const std::size_t large = (std::size_t(1) << 20) + 1;
    EXPECT_EQ(holding(large, std::byte{6})->bytes(), large) << "what is not kept has no room beyond";
}

TEST_F(Vulkan, BuffersMayOutliveTheirPool) {
    const vulkan::Device device(Precision::float32);
    std::optional<vulkan::BufferPool> pool(device);
    const auto given = pool->holding(std::vector(8, std::byte{7}));
    pool.reset();
    EXPECT_EQ(given->host()[7], std::byte{7});
}

// --- A lost device ----------------------------------------------------------------------------------------

/// The functions of a device, or of its instance, which a test may replace.
template <class Object>
auto& functions_of(const Object& object) {
    return const_cast<std::remove_cvref_t<decltype(*object.getDispatcher())>&>(*object.getDispatcher());
}

TEST_F(Vulkan, ALostDeviceIsAnErrorOfItsOwnBackendAlone) {
    const Problem problem = plain_problem();
    const auto other = BackendSpec::parse("vulkan_explicit").make();
    other->upload(problem, random_state(problem, 0.05, 3));
    for (const char* const name : {"vulkan_implicit", "vulkan_explicit"}) {
        const auto backend = BackendSpec::parse(name).make();
        backend->upload(problem, random_state(problem, 0.05, 3));
        backend->step(3);
        const Replaced lost(
            functions_of(vulkan::device_of(*backend).get()).vkQueueSubmit,
            [](VkQueue, std::uint32_t, const VkSubmitInfo*, VkFence) { return VK_ERROR_DEVICE_LOST; });
        const auto step = [&] {
            backend->step(3);
            backend->synchronize();
        };
        EXPECT_THAT(message_of<DeviceError>(step),
                    AllOf(HasSubstr("DeviceLost"), HasSubstr("while stepping")));
        EXPECT_THROW((void)backend->download(), DeviceError);
        EXPECT_THROW(backend->upload(problem, random_state(problem, 0.05, 3)), DeviceError);
    }
    EXPECT_NO_THROW(other->step(3));
    EXPECT_NO_THROW((void)other->download());
}

// A driver that drives a display would reset a device that is busy for seconds.
TEST_F(Vulkan, NoSubmissionKeepsADeviceForLong) {
    const Problem problem = plain_problem();
    const auto backend = BackendSpec::parse("vulkan_implicit").make();
    backend->upload(problem, random_state(problem, 0.05, 3));
    {
        // A step takes more than a submission may.
        static int submissions = 0;
        auto& functions = functions_of(vulkan::device_of(*backend).get());
        static const auto submit = functions.vkQueueSubmit;
        const Replaced slow(functions.vkQueueSubmit,
                            [](VkQueue queue, std::uint32_t count, const VkSubmitInfo* infos, VkFence fence) {
                                ++submissions;
                                std::this_thread::sleep_for(std::chrono::milliseconds(300));
                                return submit(queue, count, infos, fence);
                            });
        backend->step(5);
        EXPECT_EQ(submissions, 5);
        backend->synchronize();
    }
    expect_same_bits(backend->download(), after(*BackendSpec::parse("vulkan_implicit").make(), problem, 5));
}

// --- Memory -----------------------------------------------------------------------------------------------

/// A card with memory that the host does not see, some that it does, and the host's memory.
vk::PhysicalDeviceMemoryProperties memory_of_a_card() {
    using Flag = vk::MemoryPropertyFlagBits;
    vk::PhysicalDeviceMemoryProperties memory;
    memory.memoryHeapCount = 3;
    memory.memoryHeaps[0] = vk::MemoryHeap(std::uint64_t(16) << 30, vk::MemoryHeapFlagBits::eDeviceLocal);
    memory.memoryHeaps[1] = vk::MemoryHeap(std::uint64_t(256) << 20, vk::MemoryHeapFlagBits::eDeviceLocal);
    memory.memoryHeaps[2] = vk::MemoryHeap(std::uint64_t(32) << 30, {});
    memory.memoryTypeCount = 4;
    memory.memoryTypes[0] = vk::MemoryType(Flag::eHostVisible | Flag::eHostCoherent, 2);
    memory.memoryTypes[1] = vk::MemoryType(Flag::eDeviceLocal, 0);
    memory.memoryTypes[2] = vk::MemoryType(Flag::eDeviceLocal | Flag::eHostVisible | Flag::eHostCoherent, 1);
    memory.memoryTypes[3] = vk::MemoryType(Flag::eHostVisible | Flag::eHostCoherent | Flag::eHostCached, 2);
    return memory;
}

TEST(VulkanMemory, IsTriedWhereItIsPreferredAndThenElsewhere) {
    using Flag = vk::MemoryPropertyFlagBits;
    using ::testing::ElementsAre;
    const auto memory = memory_of_a_card();
    const vk::MemoryPropertyFlags host = Flag::eHostVisible | Flag::eHostCoherent;
    EXPECT_THAT(vulkan::memory_types(memory, ~0U, host, Flag::eDeviceLocal, 1024), ElementsAre(2, 0, 3));
    EXPECT_THAT(vulkan::memory_types(memory, ~0U, host, Flag::eDeviceLocal, std::uint64_t(64) << 20),
                ElementsAre(0, 2, 3))
        << "much of a small heap";
    EXPECT_THAT(vulkan::memory_types(memory, ~0U, host, Flag::eHostCached, 1024), ElementsAre(3, 0, 2));
    EXPECT_THAT(vulkan::memory_types(memory, ~0U, Flag::eDeviceLocal, {}, std::uint64_t(1) << 30),
                ElementsAre(1, 2));
    EXPECT_THAT(vulkan::memory_types(memory, 1U << 3, host, Flag::eDeviceLocal, 1024), ElementsAre(3))
        << "what the buffer allows";
}

TEST_F(Vulkan, TheNextTypeOfMemoryIsTriedWhereOneIsFull) {
    const vulkan::Device device(Precision::float32);
    auto& of_instance = functions_of(device.physical());
    auto& of_device = functions_of(device.get());
    static std::vector<std::uint32_t> tried;
    static std::uint32_t types;
    static const auto properties = of_instance.vkGetPhysicalDeviceMemoryProperties;
    static const auto requirements = of_device.vkGetBufferMemoryRequirements;
    static const auto allocate = of_device.vkAllocateMemory;
    // Each type of memory is there twice, and only the second has room.
    const Replaced twice(of_instance.vkGetPhysicalDeviceMemoryProperties,
                         [](VkPhysicalDevice physical, VkPhysicalDeviceMemoryProperties* memory) {
                             properties(physical, memory);
                             types = memory->memoryTypeCount;
                             for (std::uint32_t n = 0; n < types; ++n)
                                 memory->memoryTypes[types + n] = memory->memoryTypes[n];
                             memory->memoryTypeCount = 2 * types;
                         });
    const Replaced any(of_device.vkGetBufferMemoryRequirements,
                       [](VkDevice its_device, VkBuffer buffer, VkMemoryRequirements* needs) {
                           requirements(its_device, buffer, needs);
                           needs->memoryTypeBits = ~0U;
                       });
    const Replaced full(of_device.vkAllocateMemory,
                        [](VkDevice its_device, const VkMemoryAllocateInfo* info,
                           const VkAllocationCallbacks* callbacks, VkDeviceMemory* memory) {
                            tried.push_back(info->memoryTypeIndex);
                            if (info->memoryTypeIndex < types) return VK_ERROR_OUT_OF_DEVICE_MEMORY;
                            VkMemoryAllocateInfo as_it_is = *info;
                            as_it_is.memoryTypeIndex -= types;
                            return allocate(its_device, &as_it_is, callbacks, memory);
                        });
    EXPECT_EQ(vulkan::Buffer(device, 256, vulkan::Place::host).host().size(), 256U);
    ASSERT_GE(tried.size(), 2U);
    EXPECT_LT(tried.front(), types);
    EXPECT_GE(tried.back(), types);
}

TEST_F(Vulkan, WhatABufferCannotHoldIsRefused) {
    const auto backend = BackendSpec::parse("vulkan_implicit").make();
    const std::uint64_t most = vulkan::device_of(*backend).buffer_limits().max_bytes;
    Problem problem;
    problem.lattice.dims = {1024, 1024, int(most / 16 / 1024 / 1024)};
    EXPECT_THAT(backend->unsupported(problem),
                AllOf(HasSubstr("positions of "), HasSubstr("exceed the " + std::to_string(most))));
}

TEST_F(Vulkan, FreeMemoryIsWhatTheDriverTells) {
    const vulkan::Device device(Precision::float32);
    const std::uint64_t free = device.free_memory_bytes();
    EXPECT_GT(free, 0u);
    std::uint64_t heaps = 0;
    const auto memory = device.physical().getMemoryProperties();
    for (std::uint32_t n = 0; n < memory.memoryHeapCount; ++n) heaps += memory.memoryHeaps[n].size;
    EXPECT_LE(free, heaps);
}

TEST_F(Vulkan, AStartMayBeKeptAgainWhileItIsGoneBackTo) {
    const Problem problem = plain_problem();
    const auto backend = BackendSpec::parse("vulkan_implicit").make();
    backend->upload(problem, random_state(problem, 0.05, 3));
    ASSERT_TRUE(backend->keep_start());
    backend->step(100);
    backend->rewind();
    ASSERT_TRUE(backend->keep_start());
    backend->step(20);
    backend->rewind();
    backend->step(20);
    expect_same_bits(backend->download(), after(*BackendSpec::parse("vulkan_implicit").make(), problem, 20));
}

// --- Modules ----------------------------------------------------------------------------------------------

TEST(VulkanModule, KnowsTheNamesOfItsSource) {
    const vulkan::Module& module = vulkan::Module::named("compute_implicit_position_float32");
    EXPECT_EQ(module.constants().at("DAMPING"), 3u);
    EXPECT_EQ(module.uniforms().at("rest_length").stride, 16u) << "std140";
    EXPECT_EQ(module.uniforms().at("gravity").stride, 0u);
    EXPECT_THAT(module.storage(), ::testing::Contains(std::uint32_t(glsl::words)));
    EXPECT_THROW((void)vulkan::Module::named("nonsense"), DeviceError);
}

/// The names that a module's constants do not have, which Vulkan would ignore silently.
std::vector<std::string> unknown(const std::string& module, std::vector<std::string> names) {
    std::erase_if(names, [&, known = vulkan::Module::named(module).constants()](const std::string& name) {
        return known.contains(name);
    });
    return names;
}

TEST(VulkanModule, HasEveryConstantThatAProblemSets) {
    std::vector<std::string> terms;
    for (const auto& [name, value] : glsl::term_constants(plain_problem(), Formulation::increment, false))
        terms.push_back(name);
    for (const Formulation formulation : all_formulations) {
        for (const char* const precision : {"_float32", "_float64"}) {
            const std::string suffix = "_" + to_string(formulation) + precision;
            EXPECT_THAT(unknown("compute_implicit" + suffix, terms), IsEmpty());
            EXPECT_THAT(unknown("compute_implicit" + suffix,
                                {"ORIGINS", "VOTE", "DIMS_X", "DIMS_Y", "DIMS_Z", "FIRST_WORD"}),
                        IsEmpty());
            for (const std::string lists : {"", "_addressed"}) {
                const std::string module = "compute_explicit" + lists + suffix;
                EXPECT_THAT(unknown(module, terms), IsEmpty());
                EXPECT_THAT(unknown(module, {"SECONDARY", "OFF_LATTICE_REST", "ALL_GROUPS"}), IsEmpty());
                EXPECT_THAT(
                    unknown("edit_rows" + lists + precision, {"SECONDARY", "OFF_LATTICE_REST", "SQUARED"}),
                    IsEmpty());
            }
        }
    }
}

TEST(ImplicitAddressing, VotesWhereItIsFaster) {
    const auto votes = [](const char* tuning, bool is_software) {
        return glsl::votes(BackendSpec::parse(std::string("vulkan_implicit:") + tuning).options, is_software);
    };
    EXPECT_TRUE(votes("formulation=increment", false));
    EXPECT_FALSE(votes("formulation=increment", true));
    EXPECT_FALSE(votes("formulation=position", false));
    EXPECT_TRUE(votes("formulation=position,interior=vote", true));
    EXPECT_FALSE(votes("formulation=increment,interior=mask", false));
}

TEST(VulkanModule, SetsUniformsWhereTheModuleHasThem) {
    const vulkan::Module& module = vulkan::Module::named("compute_explicit_increment_float64");
    glsl::Uniforms uniforms;
    const std::array<double, 3> lengths = {1.5, 2.5, 3.5};
    uniforms.set("rest_length", lengths);
    uniforms.set("particles", 77);
    uniforms.set("of another module", 1);
    const std::vector<std::byte> bytes = bytes_of(module, uniforms);
    const auto at = [&](const char* name, std::size_t element, auto value) {
        const vulkan::Uniform& uniform = module.uniforms().at(name);
        std::memcpy(&value, bytes.data() + uniform.offset + element * uniform.stride, sizeof value);
        return value;
    };
    EXPECT_EQ(at("particles", 0, 0), 77);
    for (std::size_t n = 0; n < lengths.size(); ++n) EXPECT_EQ(at("rest_length", n, 0.0), lengths[n]);
}

// --- What is kept of compiled code
// --------------------------------------------------------------------------

TEST_F(Vulkan, KeepsWhatItCompiledInTheUsersCacheFolder) {
    const TemporaryFolder folder;
    const Variable cache("VOXSPRING_CACHE", folder.path().string());
    const Problem problem = plain_problem();
    const auto compiled = [&] {
        const auto backend = BackendSpec::parse("vulkan_implicit").make();
        (void)after(*backend, problem, 3);
        const CompileTime first = backend->compile_time();
        backend->upload(problem, random_state(problem, 0.05, 3));
        EXPECT_EQ(backend->compile_time().spent, 0) << "the same problem again";
        return first;
    };
    const CompileTime cold = compiled();
    EXPECT_GT(cold.spent, 0);
    EXPECT_EQ(cold.cold, cold.spent);
    const auto files = std::distance(std::filesystem::directory_iterator(folder.path()), {});
    EXPECT_GT(files, 0);
    const CompileTime warm = compiled();
    EXPECT_EQ(warm.cold, cold.cold) << "what it took when it was compiled";
    EXPECT_EQ(std::distance(std::filesystem::directory_iterator(folder.path()), {}), files);
}

// The file of the cache is whole, but its data are those of another driver.
TEST_F(Vulkan, WhatTheDriverRejectsIsCompiledAndKeptAnew) {
    const TemporaryFolder folder;
    const Variable cache("VOXSPRING_CACHE", folder.path().string());
    const Problem problem = plain_problem();
    const auto compiled = [&] {
        const auto backend = BackendSpec::parse("vulkan_implicit").make();
        backend->upload(problem, random_state(problem, 0.05, 3));
        return backend->compile_time();
    };
    (void)compiled();
    const DiskCache disk(folder.path());
    std::vector<std::string> names;
    for (const auto& entry : std::filesystem::directory_iterator(folder.path()))
        names.push_back(entry.path().stem().string());
    ASSERT_FALSE(names.empty());
    constexpr double other_seconds = 1e6;
    for (const std::string& name : names) {
        // An entry is the seconds that compiling took, and the data. Bytes 16 to 31 of the data's header are
        // the driver's UUID. The data are longer than those of any empty cache.
        std::string entry = disk.find(name).value();
        ASSERT_GE(entry.size(), sizeof other_seconds + 32);
        std::memcpy(entry.data(), &other_seconds, sizeof other_seconds);
        for (std::size_t n = 16; n < 32; ++n) entry[sizeof other_seconds + n] ^= 0x55;
        disk.keep(name, entry + std::string(4096, '\0'));
    }
    const CompileTime anew = compiled();
    EXPECT_EQ(anew.cold, anew.spent);
    EXPECT_EQ(compiled().cold, anew.cold);
}

TEST_F(Vulkan, ADamagedCacheIsNoCache) {
    const TemporaryFolder folder;
    const Variable cache("VOXSPRING_CACHE", folder.path().string());
    const Problem problem = plain_problem();
    const auto run = [&] { return after(*BackendSpec::parse("vulkan_explicit").make(), problem, 5); };
    const State state = run();
    for (const auto& entry : std::filesystem::directory_iterator(folder.path()))
        std::filesystem::resize_file(entry.path(), 5);
    expect_same_bits(run(), state);
}

}  // namespace
}  // namespace voxspring::testing
