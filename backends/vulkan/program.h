// Shaders as a device runs them: specialised, with the uniforms and buffers that they read and write.
#pragma once

#include <cstdint>
#include <glm/vec3.hpp>
#include <map>
#include <memory>
#include <string>

#include "backends/glsl/terms.h"
#include "backends/vulkan/module.h"
#include "backends/vulkan/queue.h"

namespace voxspring::vulkan {

/// A shader specialised by constants. The driver's compiled code is kept in the user's cache folder
/// (disk_cache.h).
class Program {
public:
    /// `module`: the name of a module of the build. `group`: the extents of a work group, if the module
    /// leaves them open. Constants that the module does not have are skipped.
    Program(const Device& device, const std::string& module, const glsl::Constants& constants,
            glm::ivec3 group = {64, 1, 1});

    const Module& module() const { return module_; }
    vk::Pipeline pipeline() const { return *pipeline_; }
    vk::PipelineLayout layout() const { return *layout_; }
    vk::DescriptorSetLayout set_layout() const { return *set_layout_; }
    CompileTime compile_time() const { return compile_time_; }

private:
    const Module& module_;
    vk::raii::DescriptorSetLayout set_layout_;
    vk::raii::PipelineLayout layout_;
    vk::raii::Pipeline pipeline_{nullptr};
    CompileTime compile_time_;
};

/// Storage buffers by binding. A buffer is null or absent if the shader has no use for it.
using Buffers = std::map<std::uint32_t, const Buffer*>;

/// A program with its uniforms and its buffers, all of which must outlive commands recorded with it.
class Pass {
public:
    /// Also enqueues the values of the uniforms. `dummy` is bound to each binding for which there is no
    /// buffer.
    Pass(Queue& queue, const std::shared_ptr<const Program>& program, const glsl::Uniforms& uniforms,
         const Buffers& buffers, const Buffer& dummy);
    /// A pass whose uniforms are in a buffer already.
    Pass(const Device& device, std::shared_ptr<const Program> program, std::shared_ptr<const Buffer> uniforms,
         const Buffers& buffers, const Buffer& dummy);

    const Module& module() const { return program_->module(); }
    /// Enqueues other values of the uniforms, which all commands see that are enqueued later.
    void set(Queue& queue, const glsl::Uniforms& uniforms) const {
        queue.update(*uniforms_, bytes_of(module(), uniforms));
    }
    /// Binds the program that dispatch() runs from here on.
    void bind_program(const Commands& commands) const;
    /// Binds uniforms and buffers, and dispatches. After one bind_program() all passes of that program may
    /// dispatch.
    void dispatch(const Commands& commands, glm::uvec3 groups) const;

private:
    std::shared_ptr<const Program> program_;
    std::shared_ptr<const Buffer> uniforms_;
    vk::raii::DescriptorPool pool_{nullptr};
    vk::DescriptorSet set_;  // owned by the pool
};

}  // namespace voxspring::vulkan
