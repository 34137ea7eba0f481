// The SPIR-V modules that the build made of shaders/, and what their debug names tell about them.
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <span>
#include <string>
#include <vector>

#include "backends/glsl/uniforms.h"

namespace voxspring::vulkan {

/// A number, vector or array in a block of uniforms.
struct Uniform {
    std::size_t offset = 0;  ///< offset among the bytes of all blocks
    std::size_t stride = 0;  ///< bytes from one element to the next; 0: this is no array
};

/// The place of a block of uniforms among the bytes of all blocks.
struct Block {
    std::size_t begin = 0;
    std::size_t bytes = 0;
};

/// One shader. Constants and uniforms have the names that its source gives them.
class Module {
public:
    /// A module of the build, by its name in shaders/CMakeLists.txt. Throws DeviceError if there is none.
    static const Module& named(const std::string& name);

    explicit Module(std::span<const std::uint32_t> code);

    std::span<const std::uint32_t> code() const { return code_; }
    /// Specialisation constants: ids by name.
    const std::map<std::string, std::uint32_t>& constants() const { return constants_; }
    const std::map<std::string, Uniform>& uniforms() const { return uniforms_; }
    /// Bindings of storage buffers.
    const std::vector<std::uint32_t>& storage() const { return storage_; }
    /// Blocks of uniforms by binding.
    const std::map<std::uint32_t, Block>& blocks() const { return blocks_; }
    std::size_t uniform_bytes() const { return uniform_bytes_; }
    /// Blocks begin at multiples of this many bytes, which every device accepts.
    static constexpr std::size_t block_alignment = 256;

private:
    std::span<const std::uint32_t> code_;
    std::map<std::string, std::uint32_t> constants_;
    std::map<std::string, Uniform> uniforms_;
    std::vector<std::uint32_t> storage_;
    std::map<std::uint32_t, Block> blocks_;
    std::size_t uniform_bytes_ = 0;
};

/// The content of all blocks. Uniforms without a value are zero; values without a uniform are left out.
std::vector<std::byte> bytes_of(const Module& module, const glsl::Uniforms& uniforms);

}  // namespace voxspring::vulkan
