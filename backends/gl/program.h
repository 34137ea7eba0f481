// Programs made of the GLSL files that are embedded at build time.
#pragma once

#include <glm/vec3.hpp>
#include <glm/vec4.hpp>
#include <map>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "backends/gl/handles.h"
#include "backends/glsl/terms.h"
#include "backends/glsl/uniforms.h"

namespace voxspring::gl {

/// Macros that specialise a shader, with their values.
using glsl::Defines;

/// Texts of files by the names that `#include "..."` uses.
using Files = std::map<std::string_view, std::string_view>;

/// A translation unit that knows where its lines come from. `#line` is not used, because Mesa 22.3 forgets
/// the file.
struct Source {
    std::string name;  ///< the file that was asked for
    std::string text;
    std::vector<std::string> origin;  ///< FILE:LINE of each line of the text; empty for the loader's lines
};

/// `file` with all that it includes, after `#version 450 core`, VOXSPRING_GLSL and `defines`. A file is
/// included once. The C++ headers that a shared header includes in angle brackets are left out. If a file is
/// unknown, this throws DeviceError, which names the file and the one that includes it.
Source load_source(const std::string& file, const Defines& defines, const Files& files);
/// load_source() with the files of shaders/ and the headers of backends/physics/ that GLSL shares.
Source load_source(const std::string& file, const Defines& defines);

/// A linked program. Errors of the compiler become DeviceErrors that name file and line, and errors of the
/// linker become DeviceErrors that name the files.
class Program {
public:
    Program() = default;
    Program(const Context& context, const Source& vertex, const Source& fragment);
    Program(const Context& context, const Source& compute);

    GLuint get() const { return program_.get(); }

    /// Sets a uniform. Nothing happens if the specialised program does not need it.
    template <class T>
    void set(const char* name, const T& value) const {
        set_value(name, glsl::uniform_value(value));
    }
    void set(const glsl::Uniforms& uniforms) const;

private:
    void set_value(const char* name, const glsl::UniformValue& value) const;
    void link(std::span<const Handle<Object::shader>> stages, const std::string& failure) const;

    Handle<Object::program> program_;
};

}  // namespace voxspring::gl
