// Draws a body, without a window, in a second thread beside the thread that steps it. So the cost of a live
// view is measured.
#pragma once

#include <condition_variable>
#include <cstdint>
#include <glm/vec2.hpp>
#include <glm/vec3.hpp>
#include <glm/vec4.hpp>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <stop_token>
#include <string>
#include <thread>
#include <vector>

#include "backends/backend.h"
#include "backends/gl/context.h"
#include "backends/gl/storage_buffer.h"
#include "harness/base/clock.h"
#include "harness/drawing/body_painter.h"
#include "harness/drawing/orbit.h"

namespace voxspring {

/// Draws in a second thread, which has an OpenGL context for itself and waits for the card. The stepping
/// thread calls all public functions. It passes displacements to the drawing thread through a separate buffer
/// (on the card, or in the host's memory if the backend brings them there). It cannot write to the buffer
/// from which a picture is being drawn, and a context is current in one thread only. The drawing thread
/// returns the separate buffer once the picture is finished. To return it earlier, right after copying it,
/// would take one more switch of contexts per picture and slow the steps on the card.
class LiveDrawing {
public:
    static constexpr int pictures_per_second = 60;
    static constexpr glm::ivec2 size{1280, 800};

    /// Draws `problem`, which `backend` has uploaded; no further upload may follow. `own` is a context of the
    /// calling thread, and a gl::Sharing must share it. An OpenGL backend that was made while that Sharing
    /// existed writes displacements directly into the drawing's separate buffer on the card. All references
    /// must outlive this object. Throws Unavailable if there is no OpenGL or the body has no surface, and
    /// DeviceError.
    LiveDrawing(const gl::Context& own, Backend& backend, const Problem& problem);
    /// Waits until the current picture is finished.
    ~LiveDrawing();

    /// Hands over the displacements if the next picture is due (pictures_per_second), the buffer is free
    /// again and the backend is connected to the latest mesh. Throws DeviceError if the backend fails or
    /// drawing has failed.
    void hand_over_if_due();
    /// To be called after the backend has been given `edit`, which must outlive this drawing. The drawing
    /// thread then rebuilds the mesh.
    void follow(const SpringEdit& edit);
    /// Connects the backend to the latest mesh, if there is a new one and the mutex is free. To be called
    /// again and again, between ticks (a tick: one batch of steps and the tool's force), since connecting
    /// takes longer than a tick may. Until the backend is connected to a new mesh, no displacements are
    /// handed over. Throws DeviceError.
    void follow_mesh();

    /// The number of finished pictures.
    std::int64_t pictures() const;
    /// Median durations: of handing displacements over, in the stepping thread, and of a picture, from taking
    /// the displacements until the card has drawn the picture. Absent if nothing was handed over or drawn.
    std::optional<double> hand_over_seconds() const;
    std::optional<double> picture_seconds() const;
    /// How the backend provides displacements, by the name of its function: "host_feed", "feed" or
    /// "download".
    std::string displacements_by() const;

private:
    void feed_mesh(std::unique_lock<std::mutex> lock);
    void run(const std::stop_token& stop, Problem& problem);
    void draw(const std::stop_token& stop, Problem& problem);
    void publish(const BodyMesh& mesh, bool shares);
    /// Draws the displacements that were handed over, and gives the buffer back to the stepping thread.
    /// Returns false, without a picture, if the displacements were those of an earlier mesh.
    bool draw_picture(BodyPainter& painter, const Orbit& orbit);

    const gl::Context& own_;
    Backend& backend_;
    /// Displacements on the card. is_full_ tells which thread may use this buffer and the next two members.
    gl::StorageBuffer handed_over_;
    std::vector<glm::dvec3> downloaded_;
    std::span<const glm::vec4> brought_;  ///< displacements that host_feed_ brought to the host
    // At most one of the next two is set. If neither is, displacements come from Backend::download().
    std::unique_ptr<HostFeed> host_feed_;
    std::unique_ptr<Feed> feed_;
    int fed_mesh_ = 0;
    Clock::time_point due_;
    std::vector<double> hand_overs_;

    /// Guards all members below except thread_. The stepping thread may be real-time while the drawing thread
    /// is not, so the stepping thread rarely waits for this mutex: if it is taken, hand_over_if_due() and
    /// follow_mesh() return, and their next call tries again.
    mutable std::mutex mutex_;
    std::condition_variable_any changed_;
    bool is_full_ = false;  ///< true: the drawing thread may use handed_over_; false: the stepping thread may
    int mesh_of_full_ = 0;
    int mesh_ = 0;  ///< number of the latest mesh; 0: none yet
    /// Particles of the latest mesh, until the stepping thread takes them.
    std::vector<std::uint32_t> particles_;
    bool shares_ = false;
    std::vector<const SpringEdit*> edits_;  ///< edits that the mesh does not have yet
    std::optional<std::string> absent_, failure_;
    std::vector<double> pictures_;  ///< duration of each picture in seconds

    std::jthread thread_;  ///< declared last, so that it ends before anything that it uses is destroyed
};

}  // namespace voxspring
