// Turns the errors that GL reports asynchronously into DeviceError.
#pragma once

#include <epoxy/gl.h>

#include <mutex>
#include <string>

namespace voxspring::gl {

/// Collects the errors of one context. A driver may call back from one of its threads.
class ErrorLog {
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
    std::string first_;  ///< the first message since the last check; the rest follow from it
};

}  // namespace voxspring::gl
