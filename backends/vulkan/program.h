// Shaders as a device runs them: specialised, and with what they read and write.
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

/// A shader specialised by constants. Vulkan's own caches of what a driver compiled are kept in the user's
/// cache folder (disk_cache.h).
class Program {
public:
    /// `module`: a name of the build. `group`: extents of a work group, of a module that leaves them open;
    /// constants that it does not have are passed over.
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

/// Storage buffers by binding; null or absent: the shader has no use for it.
using Buffers = std::map<std::uint32_t, const Buffer*>;

/// A program with its uniforms and its buffers, which outlive what is recorded of it.
class Pass {
public:
    /// Enqueues the values of the uniforms. `nothing` stands where a binding has no buffer.
    Pass(Queue& queue, std::shared_ptr<const Program> program, const Uniforms& uniforms,
         const Buffers& buffers, const Buffer& nothing);
    /// Of uniforms that a buffer has already.
    Pass(const Device& device, std::shared_ptr<const Program> program, std::shared_ptr<const Buffer> uniforms,
         const Buffers& buffers, const Buffer& nothing);

    const Module& module() const { return program_->module(); }
    /// Enqueues other values of the uniforms: what is enqueued later reads those.
    void set(Queue& queue, const Uniforms& uniforms) const { queue.update(*uniforms_, uniforms.bytes()); }
    /// What dispatch() runs from here on.
    void bind_program(const Commands& commands) const;
    /// Binds uniforms and buffers, and dispatches. Passes of one program may follow one bind_program().
    void dispatch(const Commands& commands, glm::uvec3 groups) const;

private:
    std::shared_ptr<const Program> program_;
    std::shared_ptr<const Buffer> uniforms_;
    vk::raii::DescriptorPool pool_{nullptr};
    vk::DescriptorSet set_;  // the pool's
};

}  // namespace voxspring::vulkan
