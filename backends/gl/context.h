// An OpenGL context: a headless one, by EGL without a window system, or a window's.
#pragma once

#include <epoxy/egl.h>
#include <epoxy/gl.h>

#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include "backends/backend.h"
#include "backends/gl/check.h"

namespace voxspring::gl {

/// A context and the surface that it draws to.
struct SurfaceContext {
    EGLDisplay display = EGL_NO_DISPLAY;
    EGLSurface surface = EGL_NO_SURFACE;
    EGLContext context = EGL_NO_CONTEXT;
};

/// An OpenGL 4.5 core context of its own. Several may live in one process, interleaved: whoever calls GL
/// makes its own current first.
class Context {
public:
    /// On the first EGL device that gives one, hardware before software; hardware only if it is the card that
    /// this process measures (device_choice.h). While there is a Sharing, on its context's display and with
    /// its objects where the driver allows it. Throws Unavailable.
    Context();
    /// A window's, which somebody else made and will end. Throws Unavailable where it is older than 4.5.
    explicit Context(const SurfaceContext& window);
    ~Context();
    Context(const Context&) = delete;
    Context& operator=(const Context&) = delete;

    /// GL calls of this thread go to this context from here on. Throws DeviceError.
    void make_current() const;
    /// The same for destructors; false if the driver refuses.
    bool try_make_current() const noexcept;

    /// ErrorLog::check for this context, which must be current.
    void check(const std::string& doing) const { errors_->check(doing); }

    /// Whether buffers and textures of the Sharing's context are its own as well.
    bool shares() const { return shares_; }

    /// As GL_RENDERER and GL_VERSION name them; software is called that.
    const Capabilities& capabilities() const { return capabilities_; }
    int max_texture_size() const { return max_texture_size_; }
    int max_array_texture_layers() const { return max_array_texture_layers_; }
    GLint64 max_storage_block_size() const { return max_storage_block_size_; }
    int max_shared_memory() const { return max_shared_memory_; }
    int max_texture_buffer_size() const { return max_texture_buffer_size_; }
    /// Bytes of the device's memory that are free now, where the driver tells (GL_NVX_gpu_memory_info,
    /// GL_ATI_meminfo). The context must be current.
    std::optional<std::uint64_t> free_memory_bytes() const;
    bool has_pipeline_statistics() const { return has_pipeline_statistics_; }
    /// Whether compute shaders have subgroups that vote.
    bool has_subgroup_vote() const { return has_subgroup_vote_; }

private:
    friend class Sharing;
    struct Destroy {
        EGLDisplay display;
        void operator()(EGLContext context) const noexcept;
    };

    /// Asks the context, which is current, what it offers.
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

/// While it lives, contexts that this process makes share buffers and textures with a context, so that
/// what one writes another draws. One at a time; the context must outlive it.
class Sharing {
public:
    explicit Sharing(const Context& context);
    ~Sharing();
    Sharing(const Sharing&) = delete;
    Sharing& operator=(const Sharing&) = delete;
};

}  // namespace voxspring::gl
