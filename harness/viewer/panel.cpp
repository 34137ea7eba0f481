#include "harness/viewer/panel.h"

#include <fmt/format.h>
#include <imgui.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "harness/drawing/legend.h"
#include "harness/viewer/window.h"

namespace voxspring {
namespace {

/// A number that is typed into a slider (Ctrl and click) stays within the slider's range.
constexpr ImGuiSliderFlags in_range = ImGuiSliderFlags_AlwaysClamp;

constexpr float width = 330;

template <class Value>
void choose(const char* label, Value& value, Value choice) {
    if (ImGui::RadioButton(label, value == choice)) value = choice;
}

void plot(const char* name, const History& history, const char* format) {
    const auto& values = history.values();
    const std::string latest = fmt::format(fmt::runtime(format), history.latest());
    ImGui::TextUnformatted(name);
    ImGui::SameLine(140);
    ImGui::TextUnformatted(latest.c_str());
    ImGui::PlotLines(fmt::format("##{}", name).c_str(), values.data(), int(values.size()), 0, nullptr, 0,
                     float(std::max(history.largest(), 1e-12)), ImVec2(ImGui::GetContentRegionAvail().x, 36));
}

/// Draws the colour bar of the body, with the values at both ends.
void draw_colours(Colouring colouring, const std::array<double, 2>& range) {
    const auto& knots = colours_of(colouring);
    const ImVec2 from = ImGui::GetCursorScreenPos();
    const ImVec2 size(ImGui::GetContentRegionAvail().x, 14);
    const auto packed = [](const Colour& colour) {
        return ImGui::ColorConvertFloat4ToU32(
            ImVec4(float(colour[0]), float(colour[1]), float(colour[2]), 1));
    };
    for (std::size_t n = 0; n + 1 < knots.size(); ++n) {
        const float a = from.x + size.x * float(n) / float(knots.size() - 1);
        const float b = from.x + size.x * float(n + 1) / float(knots.size() - 1);
        ImGui::GetWindowDrawList()->AddRectFilledMultiColor(ImVec2(a, from.y), ImVec2(b, from.y + size.y),
                                                            packed(knots[n]), packed(knots[n + 1]),
                                                            packed(knots[n + 1]), packed(knots[n]));
    }
    ImGui::Dummy(size);
    const std::string high = fmt::format("{:.3g}", range[1]);
    ImGui::TextUnformatted(fmt::format("{:.3g}", range[0]).c_str());
    ImGui::SameLine(ImGui::GetContentRegionMax().x - ImGui::CalcTextSize(high.c_str()).x);
    ImGui::TextUnformatted(high.c_str());
}

void draw_run(const Figures& figures, const std::vector<std::string>& backends, Controls& controls,
              Requests& requests) {
    if (ImGui::BeginCombo("backend", figures.backend.substr(0, figures.backend.find('/')).c_str())) {
        for (const std::string& backend : backends) {
            if (ImGui::Selectable(backend.c_str(), figures.backend.starts_with(backend + "/")))
                requests.backend = backend;
        }
        ImGui::EndCombo();
    }
    ImGui::TextWrapped("%s", figures.device.c_str());
    ImGui::TextWrapped("%s", figures.from_device ? "displacements stay on the device"
                                                 : "displacements pass through the host's memory");
    ImGui::Separator();
    ImGui::Checkbox("pause (space)", &controls.paused);
    ImGui::SameLine();
    requests.step |= ImGui::Button("step (n)");
    ImGui::SameLine();
    requests.reset |= ImGui::Button("reset (r)");
    ImGui::Checkbox("as many steps as fit", &controls.as_many_as_fit);
    if (!controls.as_many_as_fit)
        ImGui::SliderInt("steps per frame", &controls.steps_per_frame, 1, 1000, "%d",
                         in_range | ImGuiSliderFlags_Logarithmic);
    ImGui::Text("step %lld, time %.4g", static_cast<long long>(figures.steps), figures.time);
}

void draw_tools(Controls& controls) {
    ImGui::Separator();
    choose("grab (g)", controls.tool, HandTool::grab);
    ImGui::SameLine();
    choose("blade (b)", controls.tool, HandTool::blade);
    choose("needle (s)", controls.tool, HandTool::needle);
    ImGui::SameLine();
    choose("turn (t)", controls.tool, HandTool::turn);
    if (controls.tool == HandTool::grab || controls.tool == HandTool::needle)
        ImGui::SliderFloat("radius", &controls.radius, controls.largest[0] / 100, controls.largest[0], "%.3g",
                           in_range);
    if (controls.tool == HandTool::grab)
        ImGui::SliderFloat("stiffness", &controls.stiffness, controls.largest[1] / 1e4F, controls.largest[1],
                           "%.3g", in_range | ImGuiSliderFlags_Logarithmic);
    if (controls.tool == HandTool::blade)
        ImGui::SliderFloat("depth", &controls.depth, controls.largest[2] / 100, controls.largest[2], "%.3g",
                           in_range);
}

void draw_colouring(const Figures& figures, Controls& controls, Requests& requests) {
    ImGui::Separator();
    const Shown before = controls.shown;
    choose("displacement", controls.shown, Shown::displacement);
    ImGui::SameLine();
    choose("tension", controls.shown, Shown::tension);
    ImGui::SameLine();
    choose("error", controls.shown, Shown::error);
    requests.shown_changed = controls.shown != before;
    draw_colours(controls.shown == Shown::error ? Colouring::error : Colouring::displacement, figures.range);
}

void take_keys(const std::u32string& typed, Controls& controls, Requests& requests) {
    if (ImGui::GetIO().WantTextInput) return;
    constexpr std::pair<char32_t, HandTool> tools[] = {
        {U'g', HandTool::grab}, {U'b', HandTool::blade}, {U's', HandTool::needle}, {U't', HandTool::turn}};
    for (const char32_t key : typed) {
        if (key == U' ') controls.paused = !controls.paused;
        requests.step |= key == U'n';
        requests.reset |= key == U'r';
        requests.save |= key == U'w';
        requests.close |= key == U'q' || key == escape_key;
        for (const auto& [letter, tool] : tools) {
            if (key == letter) controls.tool = tool;
        }
    }
}

}  // namespace

void History::add(double value) {
    if (values_.size() == length_) values_.erase(values_.begin());
    values_.push_back(float(value));
}

double History::largest() const {
    return values_.empty() ? 0 : double(*std::max_element(values_.begin(), values_.end()));
}

Requests draw_panel(const Figures& figures, const std::vector<std::string>& backends,
                    const std::u32string& typed, Controls& controls) {
    Requests requests;
    take_keys(typed, controls, requests);
    ImGui::SetNextWindowPos(ImVec2(8, 8), ImGuiCond_FirstUseEver);
    ImGui::SetNextWindowSize(ImVec2(width, 0), ImGuiCond_Always);
    ImGui::Begin(fmt::format("{}###panel", figures.scene).c_str(), nullptr, ImGuiWindowFlags_NoResize);
    ImGui::PushItemWidth(170);
    draw_run(figures, backends, controls, requests);
    draw_tools(controls);
    draw_colouring(figures, controls, requests);
    ImGui::Separator();
    plot("steps per second", figures.steps_per_second, "{:.0f}");
    plot("frame", figures.frame_milliseconds, "{:.1f} ms");
    plot("step and force", figures.tick_microseconds, "{:.0f} us");
    plot("force", figures.force, "{:.4g}");
    requests.save |= ImGui::Button("save the state (w)");
    if (!figures.message.empty()) {
        ImGui::PushStyleColor(ImGuiCol_Text,
                              figures.is_bad ? ImVec4(1, 0.5F, 0.4F, 1) : ImVec4(0.8F, 0.9F, 0.8F, 1));
        ImGui::TextWrapped("%s", figures.message.c_str());
        ImGui::PopStyleColor();
    }
    ImGui::PopItemWidth();
    ImGui::End();
    return requests;
}

}  // namespace voxspring
