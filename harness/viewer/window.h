// A window with an OpenGL context, and Dear ImGui in it.
#pragma once

#include <array>
#include <glm/vec2.hpp>
#include <memory>
#include <string>

#include "backends/gl/context.h"

struct GLFWwindow;

namespace voxspring {

/// The character that Window::typed() holds for the escape key.
inline constexpr char32_t escape_key = 0x1B;

/// Thrown where no window can be opened.
class NoWindow : public Unavailable {
    using Unavailable::Unavailable;
};

/// A process may have one window at a time, on its first thread.
class Window {
public:
    /// `size` is in the window system's units. Throws NoWindow if there is no display, or no OpenGL 4.5 on
    /// it.
    Window(const std::string& title, glm::ivec2 size);
    ~Window();
    Window(const Window&) = delete;
    Window& operator=(const Window&) = delete;

    /// The window's context. While the window lives, contexts of backends share its buffers.
    const gl::Context& context() const { return *context_; }
    /// Size of the framebuffer in pixels; 0 while the window is minimised.
    glm::ivec2 pixels() const;
    /// Pixels per unit of ImGui's coordinates.
    glm::dvec2 pixels_per_unit() const;
    /// The pointer's position in pixels from the upper left corner, and whether its left, right and middle
    /// buttons are down. A button that went down and up between two frames counts as down in one frame.
    glm::dvec2 pointer() const;
    std::array<bool, 3> buttons() const;

    bool is_closed() const;
    void close();
    /// The characters typed since the previous frame.
    const std::u32string& typed() const { return typed_; }
    /// Waits at most `seconds` for input, handles it, and begins ImGui's frame.
    void begin_frame(double seconds);
    /// Draws ImGui's windows over the contents of the framebuffer.
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
