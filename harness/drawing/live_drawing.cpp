#include "harness/drawing/live_drawing.h"

#include <omp.h>
#include <sched.h>

#include <algorithm>
#include <exception>
#include <glm/vec4.hpp>
#include <stdexcept>
#include <utility>

#include "harness/base/statistics.h"
#include "harness/drawing/body_mesh.h"

namespace voxspring {
namespace {

/// Like mesh_of(), but throws Unavailable if the body has no surface, since that is no failure of drawing.
BodyMesh mesh_or_absent(const Problem& problem) {
    try {
        return mesh_of(problem);
    } catch (const std::runtime_error& why) {
        throw Unavailable(why.what());
    }
}

std::optional<double> median_of(const std::vector<double>& values) {
    if (values.empty()) return std::nullopt;
    return median(values);
}

}  // namespace

LiveDrawing::LiveDrawing(const gl::Context& own, Backend& backend, const Problem& problem)
    : own_(own), backend_(backend) {
    const Capabilities on = backend.capabilities();
    const bool steps_on_cores = on.steps_on_host() || on.is_software;
    // The drawing thread has its copy of the problem, to which edits are applied when the mesh is rebuilt.
    thread_ =
        std::jthread([this, steps_on_cores, own_problem = problem](const std::stop_token& stop) mutable {
            // If the backend steps on the processor's cores, building meshes may use only one of them.
            if (steps_on_cores) omp_set_num_threads(1);
            run(stop, own_problem);
        });
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [this] { return mesh_ > 0 || absent_ || failure_; });
    if (absent_) throw Unavailable(*absent_);
    if (failure_) throw DeviceError(*failure_);
    feed_mesh(std::move(lock));
    due_ = Clock::now();
}

LiveDrawing::~LiveDrawing() {
    (void)own_.try_make_current();  // destroying feed_ needs the context
}

void LiveDrawing::hand_over_if_due() {
    const auto now = Clock::now();
    if (now < due_) return;
    {
        const std::unique_lock lock(mutex_, std::try_to_lock);
        if (!lock) return;
        if (failure_) throw DeviceError(*failure_);
        if (is_full_ || fed_mesh_ != mesh_) return;
    }
    if (feed_) {
        own_.make_current();
        feed_->write();
    } else if (host_feed_) {
        brought_ = host_feed_->read();
    } else {
        downloaded_ = backend_.download().displacement;
    }
    hand_overs_.push_back(seconds_since(now));
    {
        const std::lock_guard lock(mutex_);
        is_full_ = true;
        mesh_of_full_ = fed_mesh_;
    }
    changed_.notify_all();
    constexpr std::chrono::nanoseconds between(1'000'000'000 / pictures_per_second);
    due_ = std::max(due_ + between, now);
}

void LiveDrawing::follow(const SpringEdit& edit) {
    {
        const std::lock_guard lock(mutex_);
        edits_.push_back(&edit);
    }
    changed_.notify_all();
}

void LiveDrawing::follow_mesh() {
    std::unique_lock lock(mutex_, std::try_to_lock);
    if (lock) feed_mesh(std::move(lock));
}

void LiveDrawing::feed_mesh(std::unique_lock<std::mutex> lock) {
    if (fed_mesh_ == mesh_) return;
    fed_mesh_ = mesh_;
    const std::vector<std::uint32_t> particles = std::move(particles_);
    const bool shares = shares_;
    lock.unlock();
    own_.make_current();
    feed_.reset();
    host_feed_.reset();
    // host_feed() is preferred. With feed() CUDA maps OpenGL's buffer for each picture, which delays the
    // stepping thread for longer than copying these few bytes through the host.
    FeedFacet* const feeds = backend_.feeds();
    if (feeds == nullptr) return;
    host_feed_ = feeds->host_feed(particles);
    if (host_feed_ || !shares) return;
    handed_over_.replace(own_, std::vector<glm::vec4>(particles.size()));
    feed_ = feeds->feed(particles, handed_over_.get());
}

std::string LiveDrawing::displacements_by() const {
    if (host_feed_) return "host_feed";
    return feed_ ? "feed" : "download";
}

std::int64_t LiveDrawing::pictures() const {
    const std::lock_guard lock(mutex_);
    return std::int64_t(pictures_.size());
}

std::optional<double> LiveDrawing::hand_over_seconds() const { return median_of(hand_overs_); }

std::optional<double> LiveDrawing::picture_seconds() const {
    const std::lock_guard lock(mutex_);
    return median_of(pictures_);
}

// --- In the drawing thread ------------------------------------------------------------------------------

void LiveDrawing::run(const std::stop_token& stop, Problem& problem) {
    // This thread inherits the real-time priority that the stepping thread may have, and gives it up here:
    // steps take precedence over pictures.
    const sched_param normal{.sched_priority = 0};
    sched_setscheduler(0, SCHED_OTHER, &normal);
    // Exceptions stay within the thread that throws them, so the stepping thread gets their messages.
    std::optional<std::string> absent, failure;
    try {
        draw(stop, problem);
    } catch (const Unavailable& why) {
        absent = why.what();
    } catch (const std::exception& why) {
        failure = std::string("drawing: ") + why.what();
    }
    {
        const std::lock_guard lock(mutex_);
        absent_ = std::move(absent);
        failure_ = std::move(failure);
    }
    changed_.notify_all();
}

void LiveDrawing::draw(const std::stop_token& stop, Problem& problem) {
    const gl::Context context;
    BodyPainter painter(context);
    painter.set_mesh(mesh_or_absent(problem));
    Orbit orbit;
    orbit.show(painter.mesh().low, painter.mesh().high);
    publish(painter.mesh(), context.shares());
    // Each mesh is drawn at least once before the next one is built, however fast edits come.
    bool is_seen = false;
    for (;;) {
        std::vector<const SpringEdit*> edits;
        {
            std::unique_lock lock(mutex_);
            const auto has_work = [&] { return is_full_ || (is_seen && !edits_.empty()); };
            if (!changed_.wait(lock, stop, has_work) || stop.stop_requested()) return;
            if (!is_full_) edits.swap(edits_);
        }
        if (edits.empty()) {
            is_seen = draw_picture(painter, orbit) || is_seen;
        } else {
            for (const SpringEdit* edit : edits) apply(problem, *edit);
            painter.set_mesh(mesh_of(problem));
            publish(painter.mesh(), context.shares());
            is_seen = false;
        }
    }
}

void LiveDrawing::publish(const BodyMesh& mesh, bool shares) {
    {
        const std::lock_guard lock(mutex_);
        ++mesh_;
        particles_ = mesh.particles;
        shares_ = shares;
    }
    changed_.notify_all();
}

bool LiveDrawing::draw_picture(BodyPainter& painter, const Orbit& orbit) {
    const auto begin = Clock::now();
    bool is_of_this_mesh = false;
    {
        const std::lock_guard lock(mutex_);
        is_of_this_mesh = mesh_of_full_ == mesh_;
    }
    if (is_of_this_mesh) {
        if (feed_) {
            // Binding the buffer makes the writes of the other context visible in this one.
            glBindBuffer(GL_COPY_READ_BUFFER, handed_over_.get());
            glBindBuffer(GL_COPY_WRITE_BUFFER, painter.displacements());
            glCopyBufferSubData(GL_COPY_READ_BUFFER, GL_COPY_WRITE_BUFFER, 0, 0,
                                GLsizeiptr(handed_over_.bytes()));
        } else if (host_feed_) {
            painter.put_displacements(brought_);
        } else {
            painter.put_displacements(downloaded_);
        }
        painter.draw(orbit.view(size), {});
        glFinish();
    }
    const double seconds = seconds_since(begin);
    const std::lock_guard lock(mutex_);
    is_full_ = false;
    if (is_of_this_mesh) pictures_.push_back(seconds);
    return is_of_this_mesh;
}

}  // namespace voxspring
