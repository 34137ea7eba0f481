// Fills a buffer of a window's context with particles' displacements by a compute shader (shaders/feed.comp),
// wherever a backend keeps the particles.
#pragma once

#include <functional>
#include <vector>

#include "backends/gl/program.h"
#include "backends/gl/storage_buffer.h"
#include "backends/layout/records/feed.h"

namespace voxspring::gl {

class FeedPass final : public Feed {
public:
    /// `buffer` has 16 bytes per particle and belongs to a context that shares objects with `context`.
    /// `program` is the shader and must outlive this object. `bind_state` binds the state that is current
    /// when it is called. `context` must be current.
    FeedPass(const Context& context, const std::vector<layout::FedWord<float>>& fed, GLuint buffer,
             const Program& program, std::function<void()> bind_state);

    void write() override;

private:
    const Context& context_;
    const Program& program_;
    StorageBuffer fed_;
    std::size_t count_;
    GLuint buffer_;
    std::function<void()> bind_state_;
};

}  // namespace voxspring::gl
