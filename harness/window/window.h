// A window with an OpenGL context, and Dear ImGui in it.
#pragma once

#include <array>
#include <glm/vec2.hpp>
#include <memory>
#include <string>

#include "backends/gl/context.h"

struct GLFWwindow;

namespace voxspring {

/// What Window::typed() has for the escape key.
inline constexpr char32_t escape_key = 0x1B;

/// One a process, on the process's first thread.
class Window {
public:
    /// `size` in the window system's units. Throws Unavailable where there is no display or no OpenGL 4.5 on
    /// it.
    Window(const std::string& title, glm::ivec2 size, bool resizable);
    ~Window();
    Window(const Window&) = delete;
    Window& operator=(const Window&) = delete;

    /// While it lives backends' contexts share its buffers.
    const gl::Context& context() const { return *context_; }
    /// Of what it shows, in pixels; 0 while it is an icon.
    glm::ivec2 pixels() const;
    /// Pixels of a unit in which ImGui draws.
    glm::dvec2 pixels_a_unit() const;
    /// Where the pointer is, in pixels from the upper left corner, and which of its buttons are down: left,
    /// right and middle. One that went down and up between two frames is down in one.
    glm::dvec2 pointer() const;
    std::array<bool, 3> buttons() const;

    bool is_closed() const;
    void close();
    /// What was typed since the frame before.
    const std::u32string& typed() const { return typed_; }
    /// Waits for input, no longer than so many seconds, and takes what has come. Begins ImGui's frame.
    void begin_frame(double seconds);
    /// Draws ImGui's windows over what the framebuffer shows.
    void draw_panels();
    void swap();

private:
    struct Glfw {
        Glfw();
        ~Glfw();
    };
    struct Destroy {
        void operator()(GLFWwindow* window) const noexcept;
    };

    Glfw glfw_;
    std::unique_ptr<GLFWwindow, Destroy> window_;
    std::unique_ptr<gl::Context> context_;
    std::unique_ptr<gl::Sharing> sharing_;
    std::u32string typed_;
};

}  // namespace voxspring
