#include "backends/gl/context.h"

#include <algorithm>
#include <sstream>
#include <vector>

namespace voxspring::gl {

namespace {

/// A display that might give a context, before it is initialised.
struct Candidate {
    std::string name;
    EGLenum platform;
    void* native;
};

bool has_client_extension(const char* name) { return epoxy_has_egl_extension(EGL_NO_DISPLAY, name); }

bool is_software(EGLDeviceEXT device) {
    const char* extensions = eglQueryDeviceStringEXT(device, EGL_EXTENSIONS);
    return extensions != nullptr &&
           std::string(extensions).find("EGL_MESA_device_software") != std::string::npos;
}

/// Every display without a window system, the preferred one first: devices in the driver's order,
/// hardware before software, then whatever Mesa picks by itself. Whoever wants one particular device
/// narrows this list.
std::vector<Candidate> candidates() {
    if (!epoxy_has_egl()) throw Unavailable("no OpenGL: libEGL.so.1 cannot be loaded");
    std::vector<Candidate> hardware, software;
    if (has_client_extension("EGL_EXT_platform_device") &&
        (has_client_extension("EGL_EXT_device_base") || (has_client_extension("EGL_EXT_device_enumeration") &&
                                                         has_client_extension("EGL_EXT_device_query")))) {
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
        software.push_back({"EGL surfaceless", EGL_PLATFORM_SURFACELESS_MESA, nullptr});
    }
    hardware.insert(hardware.end(), software.begin(), software.end());
    if (hardware.empty()) throw Unavailable("no OpenGL: EGL offers neither a device nor surfaceless Mesa");
    return hardware;
}

/// The initialised display of a candidate. There is one in a process, and it is never terminated: that
/// would end it for every context on it, and Mesa would unload its driver. Throws Unavailable.
EGLDisplay open(const Candidate& candidate) {
    EGLDisplay display = eglGetPlatformDisplayEXT(candidate.platform, candidate.native, nullptr);
    if (display == EGL_NO_DISPLAY) throw Unavailable("eglGetPlatformDisplay failed");
    if (eglInitialize(display, nullptr, nullptr) == EGL_FALSE) throw Unavailable("eglInitialize failed");
    return display;
}

/// A 4.5 core context without a surface. Throws Unavailable.
EGLContext create_context(EGLDisplay display) {
    for (const char* needed : {"EGL_KHR_surfaceless_context", "EGL_KHR_no_config_context"}) {
        if (!epoxy_has_egl_extension(display, needed)) throw Unavailable(std::string("no ") + needed);
    }
    if (eglBindAPI(EGL_OPENGL_API) == EGL_FALSE) throw Unavailable("EGL has no OpenGL");
    // No debug context: drivers may then check every call, and what is timed would be something else.
    const EGLint attributes[] = {EGL_CONTEXT_MAJOR_VERSION,
                                 4,
                                 EGL_CONTEXT_MINOR_VERSION,
                                 5,
                                 EGL_CONTEXT_OPENGL_PROFILE_MASK,
                                 EGL_CONTEXT_OPENGL_CORE_PROFILE_BIT,
                                 EGL_CONTEXT_OPENGL_RESET_NOTIFICATION_STRATEGY,
                                 EGL_LOSE_CONTEXT_ON_RESET,
                                 EGL_NONE};
    EGLContext context = eglCreateContext(display, EGL_NO_CONFIG_KHR, EGL_NO_CONTEXT, attributes);
    if (context == EGL_NO_CONTEXT) throw Unavailable("no OpenGL 4.5 core context");
    return context;
}

std::string text(GLenum name) { return reinterpret_cast<const char*>(glGetString(name)); }

}  // namespace

void Context::Destroy::operator()(EGLContext context) const noexcept {
    if (eglGetCurrentContext() == context) {
        eglMakeCurrent(display, EGL_NO_SURFACE, EGL_NO_SURFACE, EGL_NO_CONTEXT);
    }
    eglDestroyContext(display, context);
}

Context::Context() : errors_(std::make_unique<ErrorLog>()) {
    std::ostringstream reasons;
    for (const Candidate& candidate : candidates()) {
        try {
            EGLDisplay display = open(candidate);
            context_ = {create_context(display), Destroy{display}};
            if (try_make_current() && epoxy_gl_version() >= 45) break;
            reasons << "; " << candidate.name << ": the context cannot be made current";
            context_.reset();
        } catch (const Unavailable& absent) {
            reasons << "; " << candidate.name << ": " << absent.what();
        }
    }
    if (!context_) throw Unavailable("no OpenGL" + reasons.str());

    GLint timer_bits = 0;
    glGetQueryiv(GL_TIMESTAMP, GL_QUERY_COUNTER_BITS, &timer_bits);
    if (timer_bits == 0) throw Unavailable("no OpenGL: " + text(GL_RENDERER) + " has no GL_TIMESTAMP");
    errors_->attach();
    glGetIntegerv(GL_MAX_TEXTURE_SIZE, &max_texture_size_);
    glGetIntegerv(GL_MAX_ARRAY_TEXTURE_LAYERS, &max_array_texture_layers_);
    has_pipeline_statistics_ = epoxy_has_gl_extension("GL_ARB_pipeline_statistics_query");
    capabilities_ = {.api = "OpenGL 4.5 core",
                     .device = text(GL_RENDERER),
                     .driver = text(GL_VERSION),
                     .uuid = {},
                     .clock = "GL_TIMESTAMP",
                     .deterministic = true};
}

Context::~Context() = default;

void Context::make_current() const {
    if (!try_make_current()) throw DeviceError("eglMakeCurrent failed");
}

bool Context::try_make_current() const noexcept {
    return eglGetCurrentContext() == context_.get() ||
           eglMakeCurrent(context_.get_deleter().display, EGL_NO_SURFACE, EGL_NO_SURFACE, context_.get()) ==
               EGL_TRUE;
}

}  // namespace voxspring::gl
