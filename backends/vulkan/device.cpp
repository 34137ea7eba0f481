#include "backends/vulkan/device.h"

#include <dlfcn.h>
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cstdlib>
#include <cstring>
#include <vector>

#include "backends/api.h"
#include "backends/glsl/compute.h"
#include "backends/vulkan/validation.h"

namespace voxspring::vulkan {
namespace {

constexpr std::uint32_t needed_version = VK_API_VERSION_1_2;
constexpr const char* validation_layer = "VK_LAYER_KHRONOS_validation";

/// Opens the loader and returns the entry point that all others come from. The loader stays loaded, because
/// drivers start threads, and have destructors that run at exit.
PFN_vkGetInstanceProcAddr open_loader() {
    const char* chosen = std::getenv("VOXSPRING_VULKAN_LOADER");
    const std::string library = chosen != nullptr && *chosen != '\0' ? chosen : "libvulkan.so.1";
    void* const handle = dlopen(library.c_str(), RTLD_NOW | RTLD_LOCAL | RTLD_NODELETE);
    if (handle == nullptr)
        throw Unavailable("no Vulkan loader (Debian: libvulkan1): " + std::string(dlerror()));
    void* const entry = dlsym(handle, "vkGetInstanceProcAddr");
    if (entry == nullptr) throw Unavailable("no Vulkan loader: " + std::string(dlerror()));
    return reinterpret_cast<PFN_vkGetInstanceProcAddr>(entry);
}

template <class Properties>
bool names(const Properties& all, const char* name) {
    return std::any_of(all.begin(), all.end(), [name](const auto& property) {
        if constexpr (
            requires { property.layerName; } && !requires { property.extensionName; }) {
            return std::strcmp(property.layerName, name) == 0;
        } else {
            return std::strcmp(property.extensionName, name) == 0;
        }
    });
}

/// Creates an instance. If `messages` is not null, the instance has the validation layer, which sends its
/// messages there.
vk::raii::Instance create_instance(const vk::raii::Context& loader, Messages* messages) {
    if (loader.enumerateInstanceVersion() < needed_version)
        throw Unavailable("no Vulkan: the loader is older than version 1.2");
    const vk::ApplicationInfo application("voxspring", 1, "voxspring", 1, needed_version);
    vk::InstanceCreateInfo info({}, &application);
    std::vector<const char*> layers, extensions;
    if (names(loader.enumerateInstanceExtensionProperties(), VK_KHR_PORTABILITY_ENUMERATION_EXTENSION_NAME)) {
        extensions.push_back(VK_KHR_PORTABILITY_ENUMERATION_EXTENSION_NAME);
        info.flags |= vk::InstanceCreateFlagBits::eEnumeratePortabilityKHR;
    }
    // With this feature the layer also checks hazards between dispatches, which tells whether the barriers
    // are enough.
    constexpr std::array features = {vk::ValidationFeatureEnableEXT::eSynchronizationValidation};
    const vk::ValidationFeaturesEXT validation(features, {});
    vk::DebugUtilsMessengerCreateInfoEXT messenger;
    if (messages != nullptr) {
        layers.push_back(validation_layer);
        extensions.push_back(VK_EXT_DEBUG_UTILS_EXTENSION_NAME);
        messenger = messages->messenger();
        messenger.pNext = &validation;
        info.pNext = &messenger;
    }
    info.setPEnabledLayerNames(layers);
    info.setPEnabledExtensionNames(extensions);
    return {loader, info};
}

bool is_software(const vk::PhysicalDeviceProperties& properties) {
    return properties.deviceType == vk::PhysicalDeviceType::eCpu;
}

/// The UUID as uuid_text() writes it; empty for software.
std::string uuid_of(const vk::raii::PhysicalDevice& physical) {
    const auto chain =
        physical.getProperties2<vk::PhysicalDeviceProperties2, vk::PhysicalDeviceIDProperties>();
    if (is_software(chain.get<vk::PhysicalDeviceProperties2>().properties)) return {};
    std::array<unsigned char, 16> bytes{};
    const auto& uuid = chain.get<vk::PhysicalDeviceIDProperties>().deviceUUID;
    std::copy_n(uuid.begin(), bytes.size(), bytes.begin());
    return uuid_text(bytes);
}

/// The first family of queues that can compute and has time stamps; empty if none does.
std::optional<std::uint32_t> queue_family_of(const vk::raii::PhysicalDevice& physical) {
    const auto families = physical.getQueueFamilyProperties();
    for (std::uint32_t n = 0; n < families.size(); ++n) {
        if ((families[n].queueFlags & vk::QueueFlagBits::eCompute) && families[n].timestampValidBits > 0)
            return n;
    }
    return std::nullopt;
}

/// The smallest of the limits that apply to a buffer which shaders read and write.
BufferLimits buffer_limits_of(const vk::raii::PhysicalDevice& physical) {
    const auto chain =
        physical.getProperties2<vk::PhysicalDeviceProperties2, vk::PhysicalDeviceMaintenance3Properties>();
    BufferLimits limits{
        .max_bytes = chain.get<vk::PhysicalDeviceProperties2>().properties.limits.maxStorageBufferRange,
        .limit = "maxStorageBufferRange"};
    const auto lower = [&limits](std::uint64_t bytes, const char* limit) {
        if (bytes >= limits.max_bytes) return;
        limits.max_bytes = bytes;
        limits.limit = limit;
    };
    lower(chain.get<vk::PhysicalDeviceMaintenance3Properties>().maxMemoryAllocationSize,
          "maxMemoryAllocationSize");
    if (names(physical.enumerateDeviceExtensionProperties(), VK_KHR_MAINTENANCE_4_EXTENSION_NAME)) {
        const auto newer =
            physical
                .getProperties2<vk::PhysicalDeviceProperties2, vk::PhysicalDeviceMaintenance4Properties>();
        lower(newer.get<vk::PhysicalDeviceMaintenance4Properties>().maxBufferSize, "maxBufferSize");
    }
    limits.has_addresses =
        physical.getFeatures2<vk::PhysicalDeviceFeatures2, vk::PhysicalDeviceBufferDeviceAddressFeatures>()
            .get<vk::PhysicalDeviceBufferDeviceAddressFeatures>()
            .bufferDeviceAddress == VK_TRUE;
    return limits;
}

bool votes(const vk::raii::PhysicalDevice& physical) {
    const auto chain =
        physical.getProperties2<vk::PhysicalDeviceProperties2, vk::PhysicalDeviceSubgroupProperties>();
    const auto& subgroups = chain.get<vk::PhysicalDeviceSubgroupProperties>();
    return (subgroups.supportedStages & vk::ShaderStageFlagBits::eCompute) &&
           (subgroups.supportedOperations & vk::SubgroupFeatureFlagBits::eVote);
}

DeviceKind kind_of(const vk::PhysicalDeviceProperties& properties) {
    switch (properties.deviceType) {
        case vk::PhysicalDeviceType::eDiscreteGpu:
            return DeviceKind::discrete;
        case vk::PhysicalDeviceType::eIntegratedGpu:
            return DeviceKind::integrated;
        case vk::PhysicalDeviceType::eVirtualGpu:
            return DeviceKind::virtual_card;
        case vk::PhysicalDeviceType::eCpu:
            return DeviceKind::software;
        default:
            return DeviceKind::other;
    }
}

/// An empty string, or why a device cannot be used. `asked_for`: whether the user has chosen the device.
std::string refusal(const vk::raii::PhysicalDevice& physical, bool asked_for) {
    const auto properties = physical.getProperties();
    if (properties.apiVersion < needed_version) return "does not support Vulkan 1.2";
    if (!asked_for) {
        const std::string why =
            reason_to_pass_over(uuid_of(physical), is_software(properties), measured_card());
        if (!why.empty()) return why + " (--vulkan-device can choose it)";
    }
    if (!queue_family_of(physical)) return "has no compute queue with timestamps";
    const auto buffers = properties.limits.maxPerStageDescriptorStorageBuffers;
    if (buffers < glsl::storage_blocks)
        return fmt::format("allows {} storage buffers per shader, and {} are needed", buffers,
                           glsl::storage_blocks);
    if (!votes(physical)) return "has no subgroup votes in compute shaders";
    return {};
}

std::vector<ListedDevice> listed(const std::vector<vk::raii::PhysicalDevice>& devices) {
    std::vector<ListedDevice> all;
    for (const vk::raii::PhysicalDevice& physical : devices) {
        const auto properties = physical.getProperties();
        all.push_back({std::string(properties.deviceName), kind_of(properties)});
    }
    return all;
}

std::vector<ListedDevice> listed_with_refusals() {
    try {
        const vk::raii::Context loader(open_loader());
        const vk::raii::Instance instance = create_instance(loader, nullptr);
        const std::vector<vk::raii::PhysicalDevice> devices = vk::raii::PhysicalDevices(instance);
        std::vector<ListedDevice> all = listed(devices);
        const std::string asked = asked_device("vulkan");
        const std::vector<std::size_t> tried = devices_to_try(all, asked);
        for (std::size_t n = 0; n < all.size(); ++n) {
            all[n].refusal = std::find(tried.begin(), tried.end(), n) == tried.end()
                                 ? "does not match the requested device '" + asked + "'"
                                 : refusal(devices[n], !asked.empty());
        }
        return all;
    } catch (const vk::SystemError& error) {
        throw Unavailable(std::string("no Vulkan: ") + error.what());
    }
}

const RegisteredApi api({.name = "vulkan", .title = "Vulkan", .devices = listed_with_refusals});

}  // namespace

Device::Device(Precision precision) : messages_(std::make_unique<Messages>()), loader_(open_loader()) {
    std::string reasons;
    try {
        validates_ =
            wants_validation() && names(loader_.enumerateInstanceLayerProperties(), validation_layer);
        instance_ = create_instance(loader_, validates_ ? messages_.get() : nullptr);
        if (validates_) messenger_ = {instance_, messages_->messenger()};
        std::vector<vk::raii::PhysicalDevice> devices = vk::raii::PhysicalDevices(instance_);
        const std::vector<ListedDevice> all = listed(devices);
        const std::string asked = asked_device("vulkan");
        const std::vector<std::size_t> tried = devices_to_try(all, asked);
        for (const std::size_t n : tried) {
            const std::string why = refusal(devices[n], !asked.empty());
            if (why.empty()) {
                // Another device would be a second card in the same table.
                if (precision == Precision::float64 && !devices[n].getFeatures().shaderFloat64)
                    throw Unavailable("no float64 in Vulkan: " + all[n].name +
                                      " does not support it in shaders (--vulkan-device can choose another)");
                take(std::move(devices[n]));
                return;
            }
            reasons += "; " + all[n].name + " " + why;
        }
        if (tried.empty())
            reasons = devices.empty() ? ": no driver has a device"
                                      : " device matches '" + asked + "'; devices: " + names_of(all);
    } catch (const vk::IncompatibleDriverError&) {
        reasons =
            " driver was found: install a card's driver, or Debian's mesa-vulkan-drivers, which use the "
            "processor";
    } catch (const vk::SystemError& error) {
        reasons += std::string(": ") + error.what();
    }
    throw Unavailable("no Vulkan" + reasons);
}

void Device::take(vk::raii::PhysicalDevice physical) {
    physical_ = std::move(physical);
    const auto chain =
        physical_.getProperties2<vk::PhysicalDeviceProperties2, vk::PhysicalDeviceDriverProperties>();
    properties_ = chain.get<vk::PhysicalDeviceProperties2>().properties;
    const auto& driver = chain.get<vk::PhysicalDeviceDriverProperties>();
    buffer_limits_ = buffer_limits_of(physical_);
    queue_family_ = *queue_family_of(physical_);
    const bool software = is_software(properties_);
    capabilities_ = {
        .api = fmt::format("Vulkan {}.{}", VK_API_VERSION_MAJOR(properties_.apiVersion),
                           VK_API_VERSION_MINOR(properties_.apiVersion)),
        .device = std::string(properties_.deviceName) + (software ? ", software" : ""),
        .driver = fmt::format("{} {}", std::string(driver.driverName), std::string(driver.driverInfo)),
        .uuid = uuid_of(physical_),
        .clock = "Vulkan time stamp",
        .deterministic = true,
        .family = "vulkan",
        .is_software = software,
        .limits_of = "Vulkan"};
    create_device();
}

void Device::create_device() {
    const auto offered = physical_.enumerateDeviceExtensionProperties();
    std::vector<const char*> extensions;
    has_budget_ = names(offered, VK_EXT_MEMORY_BUDGET_EXTENSION_NAME);
    if (has_budget_) extensions.push_back(VK_EXT_MEMORY_BUDGET_EXTENSION_NAME);
    // A device that implements only a part of Vulkan requires that this extension is enabled.
    constexpr const char* subset = "VK_KHR_portability_subset";
    if (names(offered, subset)) extensions.push_back(subset);

    const vk::PhysicalDeviceFeatures has = physical_.getFeatures();
    has_float64_ = has.shaderFloat64 == VK_TRUE;
    has_pipeline_statistics_ = has.pipelineStatisticsQuery == VK_TRUE;
    vk::PhysicalDeviceFeatures features;
    features.shaderFloat64 = has.shaderFloat64;
    features.pipelineStatisticsQuery = has.pipelineStatisticsQuery;
    vk::PhysicalDeviceBufferDeviceAddressFeatures addresses(buffer_limits_.has_addresses);
    vk::PhysicalDeviceTimelineSemaphoreFeatures timeline(VK_TRUE, &addresses);
    const float priority = 1;
    const vk::DeviceQueueCreateInfo queue({}, queue_family_, 1, &priority);
    vk::DeviceCreateInfo info({}, queue, {}, extensions, &features, &timeline);
    device_ = {physical_, info};
}

std::uint64_t Device::free_memory_bytes() const {
    const auto chain = has_budget_
                           ? physical_.getMemoryProperties2<vk::PhysicalDeviceMemoryProperties2,
                                                            vk::PhysicalDeviceMemoryBudgetPropertiesEXT>()
                           : vk::StructureChain<vk::PhysicalDeviceMemoryProperties2,
                                                vk::PhysicalDeviceMemoryBudgetPropertiesEXT>();
    const vk::PhysicalDeviceMemoryProperties memory =
        has_budget_ ? chain.get<vk::PhysicalDeviceMemoryProperties2>().memoryProperties
                    : physical_.getMemoryProperties();
    const auto& budget = chain.get<vk::PhysicalDeviceMemoryBudgetPropertiesEXT>();
    std::uint64_t most = 0;
    for (std::uint32_t heap = 0; heap < memory.memoryHeapCount; ++heap) {
        if (!(memory.memoryHeaps[heap].flags & vk::MemoryHeapFlagBits::eDeviceLocal)) continue;
        std::uint64_t bytes = memory.memoryHeaps[heap].size;
        if (has_budget_)
            bytes = budget.heapBudget[heap] - std::min(budget.heapBudget[heap], budget.heapUsage[heap]);
        most = std::max(most, bytes);
    }
    return most;
}

std::vector<std::uint32_t> memory_types(const vk::PhysicalDeviceMemoryProperties& memory,
                                        std::uint32_t allowed, vk::MemoryPropertyFlags wanted,
                                        vk::MemoryPropertyFlags preferred, std::uint64_t bytes) {
    constexpr std::uint64_t share = 8;  // more than 1/8 of a heap is a large share
    std::vector<std::uint32_t> types, others;
    for (std::uint32_t type = 0; type < memory.memoryTypeCount; ++type) {
        const vk::MemoryType& known = memory.memoryTypes[type];
        if ((allowed >> type & 1U) == 0 || (known.propertyFlags & wanted) != wanted) continue;
        const bool is_preferred = preferred && (known.propertyFlags & preferred) == preferred &&
                                  bytes <= memory.memoryHeaps[known.heapIndex].size / share;
        (is_preferred ? types : others).push_back(type);
    }
    types.insert(types.end(), others.begin(), others.end());
    return types;
}

}  // namespace voxspring::vulkan
