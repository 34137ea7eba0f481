#include "backends/gl/check.h"

#include "backends/backend.h"

namespace voxspring::gl {
namespace {

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

void ErrorLog::attach() {
    glDebugMessageCallback(receive, this);
    glDebugMessageControl(GL_DONT_CARE, GL_DONT_CARE, GL_DONT_CARE, 0, nullptr, GL_FALSE);
    glDebugMessageControl(GL_DONT_CARE, GL_DEBUG_TYPE_ERROR, GL_DONT_CARE, 0, nullptr, GL_TRUE);
    // Program reads a shader's compile status and log itself. They say more than these messages.
    glDebugMessageControl(GL_DEBUG_SOURCE_SHADER_COMPILER, GL_DONT_CARE, GL_DONT_CARE, 0, nullptr, GL_FALSE);
    glEnable(GL_DEBUG_OUTPUT);
}

void APIENTRY ErrorLog::receive(GLenum, GLenum, GLuint, GLenum, GLsizei, const GLchar* message,
                                const void* log) {
    auto* self = static_cast<ErrorLog*>(const_cast<void*>(log));
    try {
        const std::lock_guard lock(self->mutex_);
        if (self->first_.empty()) self->first_ = message;
    } catch (...) {
        // An exception must not pass through the driver. check() still finds the error by glGetError().
    }
}

void ErrorLog::check(const std::string& doing) {
    std::string reason;
    if (const GLenum status = glGetGraphicsResetStatus(); status != GL_NO_ERROR) {
        throw DeviceError("GL context was reset while " + doing);
    }
    // Only a debug context has to send messages, so the error flags decide whether there was an error, and a
    // message only explains it. Reading a flag clears it, but a lost context raises one for ever.
    if (const GLenum error = glGetError(); error != GL_NO_ERROR) {
        reason = name_of_error(error);
        while (error != GL_CONTEXT_LOST && glGetError() != GL_NO_ERROR) continue;
    }
    const std::lock_guard lock(mutex_);
    if (!first_.empty()) reason += (reason.empty() ? "" : ": ") + first_;
    first_.clear();
    if (!reason.empty()) throw DeviceError(reason + " (while " + doing + ")");
}

}  // namespace voxspring::gl
