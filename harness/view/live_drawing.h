// Draws a body beside whoever steps it, as the live view does but without a window: for those who measure
// what that costs.
#pragma once

#include <chrono>
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
#include "harness/view/body_painter.h"
#include "harness/view/orbit.h"

namespace voxspring {

/// A thread with a context of its own draws and waits for the card. All functions are for the thread that
/// steps. It hands displacements over by a buffer that is neither's: what a picture is drawn from cannot be
/// written meanwhile, and a context is current in one thread alone. The drawing thread gives that buffer back
/// when the picture is finished, and not once it has copied it: a card that has to come back to another
/// context once more a picture steps less meanwhile.
class LiveDrawing {
public:
    static constexpr int pictures_a_second = 60;
    static constexpr glm::ivec2 size{1280, 800};

    /// Of `problem`, which `backend` has uploaded; no upload may follow. `own` is a context of the calling
    /// thread, which a gl::Sharing shares: an OpenGL backend that was made meanwhile puts displacements into
    /// the drawing's buffer. All references must outlive this. Throws Unavailable where there is no OpenGL or
    /// the body has no surface, DeviceError.
    LiveDrawing(const gl::Context& own, Backend& backend, const Problem& problem);
    LiveDrawing(const LiveDrawing&) = delete;
    LiveDrawing& operator=(const LiveDrawing&) = delete;
    /// Waits for the picture that is being drawn.
    ~LiveDrawing();

    /// Hands over where the particles are, if a sixtieth of a second has passed and the picture before has
    /// been taken. Throws DeviceError if the backend fails, or drawing has.
    void hand_over_if_due();
    /// The backend has been given `edit`, which must outlive this. The drawing thread makes the mesh anew.
    void follow(const SpringEdit& edit);
    /// Has the backend feed the mesh that there is now, if it is another one. Takes longer than a tick may:
    /// for the time between two of them. Until then nothing is handed over. Throws DeviceError.
    void follow_mesh();

    /// That are finished.
    std::int64_t pictures() const;
    /// Medians: of handing displacements over, in the thread that steps, and of a picture, from taking them
    /// until the card has drawn it. Of none nothing.
    std::optional<double> hand_over_seconds() const;
    std::optional<double> picture_seconds() const;
    /// "host_feed", "feed" or "download": the function of Backend that displacements come from.
    std::string displacements_by() const;

private:
    using Clock = std::chrono::steady_clock;

    void feed_mesh(std::unique_lock<std::mutex> lock);
    void run(const std::stop_token& stop, Problem& problem);
    void draw(const std::stop_token& stop, Problem& problem);
    void publish(const BodyMesh& mesh, bool shares);
    /// Draws what was handed over, and gives it back; false if that was of another mesh.
    bool draw_picture(BodyPainter& painter, const Orbit& orbit);

    const gl::Context& own_;
    Backend& backend_;
    gl::StorageBuffer handed_over_;  ///< on the card; the thread's that is_full_ says, as the next one
    std::vector<glm::dvec3> downloaded_;
    std::span<const glm::vec4> brought_;  ///< to the host, by host_feed_
    // One of them, or none: download().
    std::unique_ptr<HostFeed> host_feed_;
    std::unique_ptr<Feed> feed_;
    int fed_mesh_ = 0;
    Clock::time_point due_;
    std::vector<double> hand_overs_;

    /// Of all that follows. Whoever steps may be real-time and the other one not: he waits for it as seldom
    /// as he can, and else asks again in the next tick.
    mutable std::mutex mutex_;
    std::condition_variable_any changed_;
    bool is_full_ = false;  ///< the drawing thread's turn
    int mesh_of_full_ = 0;
    int mesh_ = 0;                          ///< its number; 0: none yet
    std::vector<std::uint32_t> particles_;  ///< of the mesh, until the other thread has taken them
    bool shares_ = false;
    std::vector<const SpringEdit*> edits_;  ///< that the mesh is without
    std::optional<std::string> absent_, failure_;
    std::vector<double> pictures_;  ///< seconds

    std::jthread thread_;  ///< the last one: ends before anything that it uses
};

}  // namespace voxspring
