#include "backends/gl/feed_pass.h"

#include <utility>

#include "backends/glsl/compute.h"

namespace voxspring::gl {
namespace {

constexpr GLuint fed_binding = 11, displacements_binding = 12;  // as in shaders/feed.comp

}  // namespace

FeedPass::FeedPass(const Context& context, const std::vector<layout::FedWord<float>>& fed, GLuint buffer,
                   const Program& program, std::function<void()> bind_state)
    : context_(context),
      program_(program),
      count_(fed.size()),
      buffer_(buffer),
      bind_state_(std::move(bind_state)) {
    fed_.upload(context, fed);
}

void FeedPass::write() {
    if (count_ == 0) return;
    context_.make_current();
    GLint stepping = 0;
    glGetIntegerv(GL_CURRENT_PROGRAM, &stepping);
    bind_state_();
    fed_.bind(fed_binding);
    glBindBufferBase(GL_SHADER_STORAGE_BUFFER, displacements_binding, buffer_);
    program_.set("count", int(count_));
    glUseProgram(program_.get());
    glDispatchCompute(glsl::striding_groups(count_), 1, 1);
    glUseProgram(GLuint(stepping));
    // Makes the result visible to another context once this one has finished, and to copies.
    glMemoryBarrier(GL_SHADER_STORAGE_BARRIER_BIT | GL_BUFFER_UPDATE_BARRIER_BIT);
    glFinish();
    context_.check("copying displacements to a window");
}

}  // namespace voxspring::gl
