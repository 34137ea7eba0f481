#include "backends/gl/step_queue.h"

#include "backends/backend.h"

namespace voxspring::gl {

StepQueue::~StepQueue() {
    if (!context_.try_make_current()) return;
    for (GLsync fence : fences_) glDeleteSync(fence);
}

void StepQueue::enqueued() {
    if (++steps_ < steps_per_fence) return;
    steps_ = 0;
    if (fences_.size() == max_fences) wait_for_oldest();
    fences_.push_back(glFenceSync(GL_SYNC_GPU_COMMANDS_COMPLETE, 0));
    if (fences_.back() != nullptr) return;
    fences_.pop_back();
    context_.check("stepping");
}

void StepQueue::wait_for_oldest() {
    constexpr GLuint64 nanoseconds = 1'000'000'000;
    GLenum status = GL_TIMEOUT_EXPIRED;
    while (status == GL_TIMEOUT_EXPIRED) {
        status = glClientWaitSync(fences_.front(), GL_SYNC_FLUSH_COMMANDS_BIT, nanoseconds);
        context_.check("stepping");  // a context that was reset never signals a fence
    }
    glDeleteSync(fences_.front());
    fences_.pop_front();
}

}  // namespace voxspring::gl
