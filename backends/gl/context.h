// An OpenGL context: a headless one, made by EGL without a window system, or that of a window.
#pragma once

#include <epoxy/egl.h>
#include <epoxy/gl.h>

#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include "backends/backend.h"

namespace voxspring::gl {

/// A context and the surface that it draws to.
struct SurfaceContext {
    EGLDisplay display = EGL_NO_DISPLAY;
    EGLSurface surface = EGL_NO_SURFACE;
    EGLContext context = EGL_NO_CONTEXT;
};

/// An OpenGL 4.5 core context. Several may exist in one process and be used in turns: the caller makes the
/// one that it needs current before it calls GL.
class Context {
public:
    /// A context on the first EGL device that offers one, hardware before software. Hardware is taken only if
    /// it is the card that this process measures (api.h). While a Sharing object exists, the new context is
    /// on the display of that object's context and shares buffers and textures with it, if the driver allows
    /// that. Throws Unavailable.
    Context();
    /// The context of a window, which the caller has made and will destroy. Throws Unavailable if it cannot
    /// be used, for example because it is older than 4.5.
    explicit Context(const SurfaceContext& window);
    ~Context();
    Context(const Context&) = delete;
    Context& operator=(const Context&) = delete;

    /// Directs later GL calls of this thread to this context. Throws DeviceError if the driver refuses.
    void make_current() const;
    /// Like make_current(), but for destructors: returns false if the driver refuses.
    bool try_make_current() const noexcept;

    /// Throws DeviceError if this context, which must be current, has reported an error, run out of memory or
    /// been reset since the last call. `doing` says what was going on ("uploading").
    void check(const std::string& doing) const;

    /// Whether this context shares buffers and textures with another one (class Sharing).
    bool shares() const { return shares_; }

    /// Names as GL_RENDERER and GL_VERSION give them. A software renderer is marked as software.
    const Capabilities& capabilities() const { return capabilities_; }
    int max_texture_size() const { return max_texture_size_; }
    int max_array_texture_layers() const { return max_array_texture_layers_; }
    GLint64 max_storage_block_size() const { return max_storage_block_size_; }
    int max_shared_memory() const { return max_shared_memory_; }
    int max_texture_buffer_size() const { return max_texture_buffer_size_; }
    /// Free bytes of the device's memory, if the driver tells (GL_NVX_gpu_memory_info, GL_ATI_meminfo). The
    /// context must be current.
    std::optional<std::uint64_t> free_memory_bytes() const;
    bool has_pipeline_statistics() const { return has_pipeline_statistics_; }
    /// Whether compute shaders have subgroups that can vote.
    bool has_subgroup_vote() const { return has_subgroup_vote_; }

private:
    friend class Sharing;
    class ErrorLog;
    struct Destroy {
        EGLDisplay display;
        void operator()(EGLContext context) const noexcept;
    };

    /// Asks the context, which is current, for its properties.
    void describe(const std::string& uuid, bool software);

    std::unique_ptr<ErrorLog> errors_;  // outlives the context that reports to it
    std::unique_ptr<void, Destroy> owned_;
    SurfaceContext bound_;
    Capabilities capabilities_;
    bool shares_ = false;
    GLint max_texture_size_ = 0;
    GLint max_array_texture_layers_ = 0;
    GLint64 max_storage_block_size_ = 0;
    GLint max_shared_memory_ = 0;
    GLint max_texture_buffer_size_ = 0;
    bool has_pipeline_statistics_ = false;
    bool has_subgroup_vote_ = false;
    enum class MemoryQuery : std::uint8_t { none, nvx, ati } memory_query_ = MemoryQuery::none;
};

/// While an object of this type exists, every new context of this process shares buffers and textures with
/// `context` if the driver allows that (Context::shares()). So one context can draw what another has written.
/// Only one such object may exist at a time, and `context` must outlive it.
class Sharing {
public:
    explicit Sharing(const Context& context);
    ~Sharing();
    Sharing(const Sharing&) = delete;
    Sharing& operator=(const Sharing&) = delete;
};

}  // namespace voxspring::gl
