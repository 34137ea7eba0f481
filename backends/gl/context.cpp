#include "backends/gl/context.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <mutex>
#include <vector>

#include "backends/api.h"

namespace voxspring::gl {

namespace {

// A constant and a function of EGL_EXT_device_persistent_id, which libepoxy 1.5.10 does not know.
constexpr EGLint egl_device_uuid = 0x335C;
using QueryDeviceBinary = EGLBoolean (*)(EGLDeviceEXT, EGLint, EGLint, void*, EGLint*);

/// A display that might give a context, before it is initialised.
struct Candidate {
    std::string name;
    EGLenum platform;
    EGLDeviceEXT device;  ///< EGL_NO_DEVICE_EXT: the driver picks one when the display is initialised
};

bool has_client_extension(const char* name) { return epoxy_has_egl_extension(EGL_NO_DISPLAY, name); }

bool has_device_query() {
    return has_client_extension("EGL_EXT_device_base") || has_client_extension("EGL_EXT_device_query");
}

bool has_extension(EGLDeviceEXT device, const char* name) {
    const char* extensions = eglQueryDeviceStringEXT(device, EGL_EXTENSIONS);
    return extensions != nullptr && std::string(extensions).find(name) != std::string::npos;
}

bool is_software(EGLDeviceEXT device) { return has_extension(device, "EGL_MESA_device_software"); }

/// The device's UUID as uuid_text() writes it; empty if the driver does not tell.
std::string uuid_of(EGLDeviceEXT device) {
    if (!has_extension(device, "EGL_EXT_device_persistent_id")) return {};
    const auto query = reinterpret_cast<QueryDeviceBinary>(eglGetProcAddress("eglQueryDeviceBinaryEXT"));
    std::array<unsigned char, 16> bytes{};
    EGLint size = 0;
    if (query == nullptr ||
        query(device, egl_device_uuid, EGLint(bytes.size()), bytes.data(), &size) == EGL_FALSE ||
        size != EGLint(bytes.size())) {
        return {};
    }
    return uuid_text(bytes);
}

/// The device of an initialised display, or EGL_NO_DEVICE_EXT.
EGLDeviceEXT device_of(EGLDisplay display) {
    EGLAttrib device = 0;
    if (!has_device_query() || eglQueryDisplayAttribEXT(display, EGL_DEVICE_EXT, &device) == EGL_FALSE)
        return {};
    return reinterpret_cast<EGLDeviceEXT>(device);  // NOLINT(performance-no-int-to-ptr): EGL's own way
}

/// The card that a context is on. A software renderer is on no card.
struct Card {
    std::string uuid;
    bool software = false;
};

/// The card of `device`. Throws Unavailable if `device` is hardware other than the card that this process
/// measures.
Card card_of(EGLDeviceEXT device) {
    Card card;
    if (device != EGL_NO_DEVICE_EXT) {
        card.software = is_software(device);
        if (!card.software) card.uuid = uuid_of(device);
    }
    const std::string reason = reason_to_pass_over(card.uuid, card.software, measured_card());
    if (!reason.empty()) throw Unavailable(reason);
    return card;
}

/// All displays without a window system, the preferred ones first: devices in the driver's order, hardware
/// before software, then whatever Mesa picks by itself.
std::vector<Candidate> candidates() {
    if (!epoxy_has_egl()) throw Unavailable("no OpenGL: libEGL.so.1 cannot be loaded");
    std::vector<Candidate> hardware, software;
    if (has_client_extension("EGL_EXT_platform_device") && has_device_query() &&
        (has_client_extension("EGL_EXT_device_base") || has_client_extension("EGL_EXT_device_enumeration"))) {
        EGLint count = 0;
        eglQueryDevicesEXT(0, nullptr, &count);
        std::vector<EGLDeviceEXT> devices(std::size_t(std::max(count, 0)));
        eglQueryDevicesEXT(count, devices.data(), &count);
        for (std::size_t i = 0; i < devices.size(); ++i) {
            (is_software(devices[i]) ? software : hardware)
                .push_back({"EGL device " + std::to_string(i), EGL_PLATFORM_DEVICE_EXT, devices[i]});
        }
    }
    if (has_client_extension("EGL_MESA_platform_surfaceless")) {
        software.push_back({"EGL surfaceless", EGL_PLATFORM_SURFACELESS_MESA, EGL_NO_DEVICE_EXT});
    }
    hardware.insert(hardware.end(), software.begin(), software.end());
    if (hardware.empty())
        throw Unavailable("no OpenGL: EGL offers neither a device nor Mesa's surfaceless platform");
    return hardware;
}

/// The initialised display of a candidate. Throws Unavailable. EGL gives a process only one display per
/// candidate. The display is never terminated, because that would end it for all its contexts, and Mesa would
/// unload its driver.
EGLDisplay open(const Candidate& candidate) {
    EGLDisplay display = eglGetPlatformDisplayEXT(candidate.platform, candidate.device, nullptr);
    if (display == EGL_NO_DISPLAY) throw Unavailable("eglGetPlatformDisplay failed");
    if (eglInitialize(display, nullptr, nullptr) == EGL_FALSE) throw Unavailable("eglInitialize failed");
    return display;
}

/// A 4.5 core context without a surface. It shares the objects of `shared` unless that is EGL_NO_CONTEXT.
/// Throws Unavailable.
EGLContext create_context(EGLDisplay display, EGLContext shared) {
    for (const char* needed : {"EGL_KHR_surfaceless_context", "EGL_KHR_no_config_context"}) {
        if (!epoxy_has_egl_extension(display, needed))
            throw Unavailable(std::string("EGL does not support ") + needed);
    }
    if (eglBindAPI(EGL_OPENGL_API) == EGL_FALSE) throw Unavailable("EGL does not support OpenGL");
    // No debug context: with one, drivers may check every call, and the timings would include these checks.
    const EGLint attributes[] = {EGL_CONTEXT_MAJOR_VERSION,
                                 4,
                                 EGL_CONTEXT_MINOR_VERSION,
                                 5,
                                 EGL_CONTEXT_OPENGL_PROFILE_MASK,
                                 EGL_CONTEXT_OPENGL_CORE_PROFILE_BIT,
                                 EGL_CONTEXT_OPENGL_RESET_NOTIFICATION_STRATEGY,
                                 EGL_LOSE_CONTEXT_ON_RESET,
                                 EGL_NONE};
    EGLContext context = eglCreateContext(display, EGL_NO_CONFIG_KHR, shared, attributes);
    if (context == EGL_NO_CONTEXT) throw Unavailable("EGL cannot make an OpenGL 4.5 core context");
    return context;
}

// Constants of GL_KHR_shader_subgroup, which libepoxy 1.5.10 does not know.
constexpr GLenum subgroup_supported_stages = 0x9533;
constexpr GLenum subgroup_supported_features = 0x9534;
constexpr GLint subgroup_feature_vote = 0x00000002;

bool offers_subgroup_vote() {
    if (!epoxy_has_gl_extension("GL_KHR_shader_subgroup")) return false;
    GLint stages = 0;
    GLint features = 0;
    glGetIntegerv(subgroup_supported_stages, &stages);
    glGetIntegerv(subgroup_supported_features, &features);
    return (stages & GL_COMPUTE_SHADER_BIT) != 0 && (features & subgroup_feature_vote) != 0;
}

const RegisteredApi api({.name = "opengl", .title = "OpenGL", .device_field = "gl_renderer"});

/// The context of the Sharing object, if one exists; otherwise `display` is EGL_NO_DISPLAY.
SurfaceContext shared_context;

std::string text(GLenum name) { return reinterpret_cast<const char*>(glGetString(name)); }

std::string name_of_error(GLenum error) {
    switch (error) {
        case GL_INVALID_ENUM:
            return "GL_INVALID_ENUM";
        case GL_INVALID_VALUE:
            return "GL_INVALID_VALUE";
        case GL_INVALID_OPERATION:
            return "GL_INVALID_OPERATION";
        case GL_INVALID_FRAMEBUFFER_OPERATION:
            return "GL_INVALID_FRAMEBUFFER_OPERATION";
        case GL_OUT_OF_MEMORY:
            return "GL_OUT_OF_MEMORY";
        case GL_CONTEXT_LOST:
            return "GL_CONTEXT_LOST";
        default:
            return "GL error " + std::to_string(error);
    }
}

}  // namespace

/// Collects the errors of one context. A driver may call back from one of its threads.
class Context::ErrorLog {
public:
    /// Errors of the current context go to this log, which must outlive that context.
    void attach();

    /// Throws DeviceError if the current context has reported an error, run out of memory or been reset since
    /// the last call. `doing` says what was going on ("uploading").
    void check(const std::string& doing);

private:
    static void APIENTRY receive(GLenum source, GLenum type, GLuint id, GLenum severity, GLsizei length,
                                 const GLchar* message, const void* log);

    std::mutex mutex_;
    std::string first_;  ///< the first message since the last check; later ones follow from it
};

void Context::ErrorLog::attach() {
    glDebugMessageCallback(receive, this);
    glDebugMessageControl(GL_DONT_CARE, GL_DONT_CARE, GL_DONT_CARE, 0, nullptr, GL_FALSE);
    glDebugMessageControl(GL_DONT_CARE, GL_DEBUG_TYPE_ERROR, GL_DONT_CARE, 0, nullptr, GL_TRUE);
    // Class Program reads a shader's compile status and log, which say more than these messages.
    glDebugMessageControl(GL_DEBUG_SOURCE_SHADER_COMPILER, GL_DONT_CARE, GL_DONT_CARE, 0, nullptr, GL_FALSE);
    glEnable(GL_DEBUG_OUTPUT);
}

void APIENTRY Context::ErrorLog::receive(GLenum, GLenum, GLuint, GLenum, GLsizei, const GLchar* message,
                                         const void* log) {
    auto* self = static_cast<ErrorLog*>(const_cast<void*>(log));
    try {
        const std::lock_guard lock(self->mutex_);
        if (self->first_.empty()) self->first_ = message;
    } catch (...) {
        // An exception must not pass through the driver. check() still finds the error by glGetError().
    }
}

void Context::ErrorLog::check(const std::string& doing) {
    std::string reason;
    if (const GLenum status = glGetGraphicsResetStatus(); status != GL_NO_ERROR) {
        throw DeviceError("GL context was reset while " + doing);
    }
    // Only a debug context has to send messages. So the error flags are read as well, and a message explains
    // the error. Reading a flag clears it, except that a lost context sets GL_CONTEXT_LOST for ever.
    if (const GLenum error = glGetError(); error != GL_NO_ERROR) {
        reason = name_of_error(error);
        while (error != GL_CONTEXT_LOST && glGetError() != GL_NO_ERROR) continue;
    }
    const std::lock_guard lock(mutex_);
    if (!first_.empty()) reason += (reason.empty() ? "" : ": ") + first_;
    first_.clear();
    if (!reason.empty()) throw DeviceError(reason + " (while " + doing + ")");
}

void Context::Destroy::operator()(EGLContext context) const noexcept {
    if (eglGetCurrentContext() == context) {
        eglMakeCurrent(display, EGL_NO_SURFACE, EGL_NO_SURFACE, EGL_NO_CONTEXT);
    }
    eglDestroyContext(display, context);
}

Context::Context() : errors_(std::make_unique<ErrorLog>()) {
    std::string reasons;
    Card card;
    const auto takes = [&](EGLDisplay display, EGLContext shared) {
        owned_ = {create_context(display, shared), Destroy{display}};
        bound_ = {.display = display, .context = owned_.get()};
        if (try_make_current() && epoxy_gl_version() >= 45) return;
        owned_.reset();
        throw Unavailable("the context cannot be made current or is older than OpenGL 4.5");
    };
    if (shared_context.display != EGL_NO_DISPLAY) {
        try {
            card = card_of(device_of(shared_context.display));
            takes(shared_context.display, shared_context.context);
            shares_ = true;
        } catch (const Unavailable& absent) {
            reasons += fmt::format("; on the window's display: {}", absent.what());
        }
    }
    for (const Candidate& candidate : owned_ ? std::vector<Candidate>{} : candidates()) {
        try {
            // Skips a card that is not the measured one, if possible before anything is initialised on it.
            if (candidate.device != EGL_NO_DEVICE_EXT) card = card_of(candidate.device);
            EGLDisplay display = open(candidate);
            if (candidate.device == EGL_NO_DEVICE_EXT) card = card_of(device_of(display));
            takes(display, EGL_NO_CONTEXT);
            break;
        } catch (const Unavailable& absent) {
            reasons += fmt::format("; {}: {}", candidate.name, absent.what());
        }
    }
    if (!owned_) throw Unavailable("no OpenGL" + reasons);
    describe(card.uuid, card.software);
}

Context::Context(const SurfaceContext& window)
    : errors_(std::make_unique<ErrorLog>()), owned_(nullptr, Destroy{window.display}), bound_(window) {
    if (!try_make_current() || epoxy_gl_version() < 45)
        throw Unavailable("no OpenGL: the window's context cannot be made current or is older than 4.5");
    const EGLDeviceEXT device = device_of(window.display);
    const bool software = device != EGL_NO_DEVICE_EXT && is_software(device);
    describe(device != EGL_NO_DEVICE_EXT && !software ? uuid_of(device) : "", software);
}

void Context::describe(const std::string& uuid, bool software) {
    GLint timer_bits = 0;
    glGetQueryiv(GL_TIMESTAMP, GL_QUERY_COUNTER_BITS, &timer_bits);
    if (timer_bits == 0)
        throw Unavailable("no OpenGL: " + text(GL_RENDERER) + " has no time stamps (GL_TIMESTAMP)");
    errors_->attach();
    glGetIntegerv(GL_MAX_TEXTURE_SIZE, &max_texture_size_);
    glGetIntegerv(GL_MAX_ARRAY_TEXTURE_LAYERS, &max_array_texture_layers_);
    glGetInteger64v(GL_MAX_SHADER_STORAGE_BLOCK_SIZE, &max_storage_block_size_);
    glGetIntegerv(GL_MAX_COMPUTE_SHARED_MEMORY_SIZE, &max_shared_memory_);
    glGetIntegerv(GL_MAX_TEXTURE_BUFFER_SIZE, &max_texture_buffer_size_);
    has_subgroup_vote_ = offers_subgroup_vote();
    if (epoxy_has_gl_extension("GL_NVX_gpu_memory_info")) {
        memory_query_ = MemoryQuery::nvx;
    } else if (epoxy_has_gl_extension("GL_ATI_meminfo")) {
        memory_query_ = MemoryQuery::ati;
    }
    has_pipeline_statistics_ = epoxy_has_gl_extension("GL_ARB_pipeline_statistics_query");
    capabilities_ = {.api = "OpenGL 4.5 core",
                     .device = text(GL_RENDERER) + (software ? ", software" : ""),
                     .driver = text(GL_VERSION),
                     .uuid = uuid,
                     .clock = "GL_TIMESTAMP",
                     .deterministic = true,
                     .family = "opengl",
                     .is_software = software,
                     .limits_of = "OpenGL"};
}

Context::~Context() = default;

void Context::check(const std::string& doing) const { errors_->check(doing); }

std::optional<std::uint64_t> Context::free_memory_bytes() const {
    // Both extensions count in units of 1024 bytes. The first of ATI's four numbers is the pool's total free
    // memory.
    std::array<GLint, 4> kilobytes{};
    if (memory_query_ == MemoryQuery::none) return std::nullopt;
    glGetIntegerv(memory_query_ == MemoryQuery::nvx ? GL_GPU_MEMORY_INFO_CURRENT_AVAILABLE_VIDMEM_NVX
                                                    : GL_TEXTURE_FREE_MEMORY_ATI,
                  kilobytes.data());
    return std::uint64_t(std::uint32_t(kilobytes[0])) * 1024;
}

void Context::make_current() const {
    if (!try_make_current()) throw DeviceError("eglMakeCurrent failed");
}

bool Context::try_make_current() const noexcept {
    return eglGetCurrentContext() == bound_.context ||
           eglMakeCurrent(bound_.display, bound_.surface, bound_.surface, bound_.context) == EGL_TRUE;
}

Sharing::Sharing(const Context& context) { shared_context = context.bound_; }

Sharing::~Sharing() { shared_context = {}; }

}  // namespace voxspring::gl
