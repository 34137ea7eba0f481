#include "harness/viewer/window.h"

// These come before GLFW's headers, which then use the EGL of libepoxy.
#include <epoxy/egl.h>
#include <epoxy/gl.h>
// clang-format off: the native functions need the first header's types.
#define GLFW_INCLUDE_NONE
#include <GLFW/glfw3.h>
#define GLFW_EXPOSE_NATIVE_EGL
#include <GLFW/glfw3native.h>
// clang-format on
#include <backends/imgui_impl_glfw.h>
#include <backends/imgui_impl_opengl3.h>
#include <imgui.h>

#include <glm/common.hpp>

namespace voxspring {
namespace {

std::string glfw_error() {
    const char* description = nullptr;
    glfwGetError(&description);
    return description == nullptr ? "no reason was given" : description;
}

}  // namespace

Window::Glfw::Glfw() {
    if (glfwInit() == GLFW_FALSE) throw NoWindow("no window: " + glfw_error());
}

Window::Glfw::~Glfw() { glfwTerminate(); }

void Window::Destroy::operator()(GLFWwindow* window) const noexcept { glfwDestroyWindow(window); }

Window::Window(const std::string& title, glm::ivec2 size) {
    glfwWindowHint(GLFW_CLIENT_API, GLFW_OPENGL_API);
    // The window's context is made through EGL, as the backends' contexts are, so that these contexts can
    // share buffers.
    glfwWindowHint(GLFW_CONTEXT_CREATION_API, GLFW_EGL_CONTEXT_API);
    glfwWindowHint(GLFW_CONTEXT_VERSION_MAJOR, 4);
    glfwWindowHint(GLFW_CONTEXT_VERSION_MINOR, 5);
    glfwWindowHint(GLFW_OPENGL_PROFILE, GLFW_OPENGL_CORE_PROFILE);
    window_.reset(glfwCreateWindow(size.x, size.y, title.c_str(), nullptr, nullptr));
    if (!window_) throw NoWindow("no window with OpenGL 4.5 by EGL: " + glfw_error());
    glfwMakeContextCurrent(window_.get());
    context_ = std::make_unique<gl::Context>(gl::SurfaceContext{
        glfwGetEGLDisplay(), glfwGetEGLSurface(window_.get()), glfwGetEGLContext(window_.get())});
    sharing_ = std::make_unique<gl::Sharing>(*context_);
    glfwSwapInterval(1);

    // We collect characters ourselves: ImGui misses a key that goes down and up between two frames. ImGui's
    // callback also calls this one.
    glfwSetWindowUserPointer(window_.get(), &typed_);
    glfwSetCharCallback(window_.get(), [](GLFWwindow* window, unsigned character) {
        static_cast<std::u32string*>(glfwGetWindowUserPointer(window))->push_back(char32_t(character));
    });
    // The escape key produces no character, so it needs a key callback.
    glfwSetKeyCallback(window_.get(), [](GLFWwindow* window, int key, int, int action, int) {
        if (key == GLFW_KEY_ESCAPE && action == GLFW_PRESS)
            static_cast<std::u32string*>(glfwGetWindowUserPointer(window))->push_back(escape_key);
    });
    IMGUI_CHECKVERSION();
    ImGui::CreateContext();
    ImGui::GetIO().IniFilename = nullptr;  // ImGui writes no settings file
    ImGui::StyleColorsDark();
    glfwSetInputMode(window_.get(), GLFW_STICKY_MOUSE_BUTTONS, GLFW_TRUE);
    ImGui_ImplGlfw_InitForOpenGL(window_.get(), true);
    // A window that opens under the pointer is not always told that the pointer is inside.
    ImGui_ImplGlfw_CursorEnterCallback(window_.get(), GLFW_TRUE);
    ImGui_ImplOpenGL3_Init("#version 450");
}

Window::~Window() {
    if (!context_->try_make_current()) return;
    ImGui_ImplOpenGL3_Shutdown();
    ImGui_ImplGlfw_Shutdown();
    ImGui::DestroyContext();
}

glm::ivec2 Window::pixels() const {
    glm::ivec2 size(0);
    glfwGetFramebufferSize(window_.get(), &size.x, &size.y);
    return size;
}

glm::dvec2 Window::pixels_per_unit() const {
    glm::ivec2 size(0);
    glfwGetWindowSize(window_.get(), &size.x, &size.y);
    return glm::dvec2(pixels()) / glm::dvec2(glm::max(size, glm::ivec2(1)));
}

glm::dvec2 Window::pointer() const {
    glm::dvec2 at(0);
    glfwGetCursorPos(window_.get(), &at.x, &at.y);
    return at * pixels_per_unit();
}

std::array<bool, 3> Window::buttons() const {
    const auto is_down = [&](int button) { return glfwGetMouseButton(window_.get(), button) == GLFW_PRESS; };
    return {is_down(GLFW_MOUSE_BUTTON_LEFT), is_down(GLFW_MOUSE_BUTTON_RIGHT),
            is_down(GLFW_MOUSE_BUTTON_MIDDLE)};
}

bool Window::is_closed() const { return glfwWindowShouldClose(window_.get()) == GLFW_TRUE; }

void Window::close() { glfwSetWindowShouldClose(window_.get(), GLFW_TRUE); }

void Window::begin_frame(double seconds) {
    typed_.clear();
    if (seconds > 0) {
        glfwWaitEventsTimeout(seconds);
    } else {
        glfwPollEvents();
    }
    context_->make_current();
    ImGui_ImplOpenGL3_NewFrame();
    ImGui_ImplGlfw_NewFrame();
    ImGui::NewFrame();
}

void Window::draw_panels() {
    ImGui::Render();
    context_->make_current();
    ImGui_ImplOpenGL3_RenderDrawData(ImGui::GetDrawData());
    context_->check("drawing panels");
}

void Window::swap() {
    context_->make_current();
    glfwSwapBuffers(window_.get());
}

}  // namespace voxspring
