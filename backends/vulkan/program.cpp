#include "backends/vulkan/program.h"

#include <chrono>
#include <cstring>
#include <optional>
#include <string_view>
#include <utility>
#include <vector>

#include "backends/disk_cache.h"

namespace voxspring::vulkan {
namespace {

vk::raii::DescriptorSetLayout make_set_layout(const Device& device, const Module& module) {
    std::vector<vk::DescriptorSetLayoutBinding> bindings;
    const auto add = [&](std::uint32_t binding, vk::DescriptorType type) {
        bindings.emplace_back(binding, type, 1, vk::ShaderStageFlagBits::eCompute);
    };
    for (const std::uint32_t binding : module.storage()) add(binding, vk::DescriptorType::eStorageBuffer);
    for (const auto& [binding, block] : module.blocks()) add(binding, vk::DescriptorType::eUniformBuffer);
    return {device.get(), vk::DescriptorSetLayoutCreateInfo({}, bindings)};
}

/// The number that stands for a value in a specialisation: 1 for "true", 0 for "false".
std::uint32_t number_of(const std::string& value) {
    return value == "true" ? 1 : value == "false" ? 0 : std::uint32_t(std::stol(value));
}

/// Values of specialisation constants by id. Ids 0 to 2 are the extents of a work group.
std::map<std::uint32_t, std::uint32_t> values_by_id(const Module& module, const glsl::Constants& constants,
                                                    glm::ivec3 group) {
    std::map<std::uint32_t, std::uint32_t> values = {
        {0, std::uint32_t(group.x)}, {1, std::uint32_t(group.y)}, {2, std::uint32_t(group.z)}};
    for (const auto& [name, id] : module.constants()) {
        if (const auto found = constants.find(name); found != constants.end())
            values[id] = number_of(found->second);
    }
    return values;
}

/// A hash of everything that determines the code that a driver compiles.
std::string cache_name(const Device& device, const Module& module,
                       const std::map<std::uint32_t, std::uint32_t>& values) {
    Hash hash;
    hash.add("vulkan 1");
    const vk::PhysicalDeviceProperties& properties = device.properties();
    hash.add(properties.pipelineCacheUUID.data(), properties.pipelineCacheUUID.size());
    for (const std::uint32_t number : {properties.vendorID, properties.deviceID, properties.driverVersion})
        hash.add_number(number);
    hash.add(module.code().data(), module.code().size_bytes());
    for (const auto& [id, value] : values) {
        hash.add_number(id);
        hash.add_number(value);
    }
    return hash.text() + ".vulkan";
}

/// The entry that an earlier Program kept: how long compiling took, and the result.
struct Kept {
    double cold = 0;
    std::string_view data;
};
std::optional<Kept> kept_in(const std::optional<std::string>& entry) {
    if (!entry || entry->size() < sizeof(double)) return std::nullopt;
    Kept kept;
    std::memcpy(&kept.cold, entry->data(), sizeof(double));
    kept.data = std::string_view(*entry).substr(sizeof(double));
    return kept;
}

/// Whether the driver rejects these data of a pipeline cache, which an earlier Program kept: a cache that
/// begins with them then holds no more than one that begins empty.
bool rejects(const Device& device, std::string_view data) {
    const auto size_from = [&](std::string_view initial) {
        const vk::PipelineCacheCreateInfo info({}, initial.size(), initial.data());
        return vk::raii::PipelineCache(device.get(), info).getData().size();
    };
    const std::size_t empty = size_from({});
    return data.size() > empty && size_from(data) <= empty;
}

std::string to_keep(double cold, const std::vector<std::uint8_t>& data) {
    std::string entry(sizeof(double), '\0');
    std::memcpy(entry.data(), &cold, sizeof(double));
    entry.append(reinterpret_cast<const char*>(data.data()), data.size());
    return entry;
}

}  // namespace

Program::Program(const Device& device, const std::string& module, const glsl::Constants& constants,
                 glm::ivec3 group)
    : module_(Module::named(module)),
      set_layout_(make_set_layout(device, module_)),
      layout_(device.get(), vk::PipelineLayoutCreateInfo({}, *set_layout_)) {
    const auto values = values_by_id(module_, constants, group);
    std::vector<vk::SpecializationMapEntry> entries;
    std::vector<std::uint32_t> data;
    for (const auto& [id, value] : values) {
        entries.emplace_back(id, std::uint32_t(data.size() * sizeof(value)), sizeof(value));
        data.push_back(value);
    }
    const vk::SpecializationInfo specialised(std::uint32_t(entries.size()), entries.data(),
                                             data.size() * sizeof(data[0]), data.data());

    const DiskCache disk;
    const std::string name = cache_name(device, module_, values);
    const auto entry = disk.find(name);
    const std::optional<Kept> kept = kept_in(entry);
    const std::string_view known = kept ? kept->data : std::string_view();
    const auto begin = std::chrono::steady_clock::now();
    const vk::raii::PipelineCache cache(device.get(),
                                        vk::PipelineCacheCreateInfo({}, known.size(), known.data()));
    const vk::raii::ShaderModule shader(
        device.get(), vk::ShaderModuleCreateInfo({}, module_.code().size_bytes(), module_.code().data()));
    const vk::PipelineShaderStageCreateInfo stage({}, vk::ShaderStageFlagBits::eCompute, *shader, "main",
                                                  &specialised);
    pipeline_ = {device.get(), cache, vk::ComputePipelineCreateInfo({}, stage, *layout_)};
    compile_time_.spent = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
    const bool found = kept && !rejects(device, known);
    compile_time_.cold = found ? kept->cold : compile_time_.spent;
    if (!found) disk.keep(name, to_keep(compile_time_.cold, cache.getData()));
}

Pass::Pass(Queue& queue, const std::shared_ptr<const Program>& program, const glsl::Uniforms& uniforms,
           const Buffers& buffers, const Buffer& dummy)
    : Pass(queue.device(), program,
           std::make_shared<Buffer>(queue.device(), program->module().uniform_bytes(), Place::device),
           buffers, dummy) {
    if (uniforms_->bytes() > 0) set(queue, uniforms);
}

Pass::Pass(const Device& of, std::shared_ptr<const Program> program, std::shared_ptr<const Buffer> uniforms,
           const Buffers& buffers, const Buffer& dummy)
    : program_(std::move(program)), uniforms_(std::move(uniforms)) {
    const vk::raii::Device& device = of.get();
    const Module& module = program_->module();
    std::vector<vk::DescriptorPoolSize> sizes;
    if (!module.storage().empty())
        sizes.emplace_back(vk::DescriptorType::eStorageBuffer, std::uint32_t(module.storage().size()));
    if (!module.blocks().empty())
        sizes.emplace_back(vk::DescriptorType::eUniformBuffer, std::uint32_t(module.blocks().size()));
    pool_ = {device, vk::DescriptorPoolCreateInfo({}, 1, sizes)};
    const vk::DescriptorSetLayout layout = program_->set_layout();
    // The set gives up its ownership by release(), because the pool frees it.
    set_ = vk::raii::DescriptorSets(device, vk::DescriptorSetAllocateInfo(*pool_, layout)).front().release();

    const auto write = [&](std::uint32_t binding, vk::DescriptorType type,
                           const vk::DescriptorBufferInfo& what) {
        device.updateDescriptorSets(vk::WriteDescriptorSet(set_, binding, 0, type, {}, what), {});
    };
    for (const std::uint32_t binding : module.storage()) {
        const auto found = buffers.find(binding);
        const bool there = found != buffers.end() && found->second != nullptr && found->second->bytes() > 0;
        // Buffers of an upload were checked before the upload began. This checks the buffers that an edit
        // makes.
        if (there) {
            const std::string why = of.buffer_limits().too_large("buffers", found->second->bytes());
            if (!why.empty()) throw DeviceError(why);
        }
        write(binding, vk::DescriptorType::eStorageBuffer,
              {(there ? *found->second : dummy).get(), 0, VK_WHOLE_SIZE});
    }
    for (const auto& [binding, block] : module.blocks()) {
        write(binding, vk::DescriptorType::eUniformBuffer, {uniforms_->get(), block.begin, block.bytes});
    }
}

void Pass::bind_program(const Commands& commands) const {
    commands.bindPipeline(vk::PipelineBindPoint::eCompute, program_->pipeline());
}

void Pass::dispatch(const Commands& commands, glm::uvec3 groups) const {
    commands.bindDescriptorSets(vk::PipelineBindPoint::eCompute, program_->layout(), 0, set_, {});
    commands.dispatch(groups.x, groups.y, groups.z);
}

}  // namespace voxspring::vulkan
