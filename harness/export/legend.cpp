#include "harness/export/legend.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <glm/vec2.hpp>
#include <map>
#include <string_view>
#include <vector>

namespace voxspring {
namespace {

constexpr double decades = 3;
/// Its contrast by WCAG is 5.1 on white and 3.5 on a nearly black page (#15181c).
constexpr Colour ink = {0.431, 0.431, 0.431, 1};

Colour from_hex(unsigned rgb) {
    return {(rgb >> 16 & 255) / 255.0, (rgb >> 8 & 255) / 255.0, (rgb & 255) / 255.0, 1};
}

std::array<Colour, colour_knots> from_hex(const std::array<unsigned, colour_knots>& knots) {
    std::array<Colour, colour_knots> colours{};
    std::transform(knots.begin(), knots.end(), colours.begin(), [](unsigned rgb) { return from_hex(rgb); });
    return colours;
}

Colour colour_at(Colouring colouring, double place) {
    const auto& knots = colours_of(colouring);
    const double scaled = place * (colour_knots - 1);
    const auto below = std::size_t(std::clamp(std::floor(scaled), 0.0, double(colour_knots - 2)));
    const double part = scaled - double(below);
    Colour colour{};
    for (std::size_t c = 0; c < 4; ++c) colour[c] = (1 - part) * knots[below][c] + part * knots[below + 1][c];
    return colour;
}

// --- Letters ------------------------------------------------------------------------------------------
// Strokes of a pen: points "xy" on a grid, joined by lines. A blank lifts the pen, and a single point is a
// dot. Letters stand on y = 2 and reach to 7, tall ones to 9. Only letters that a legend needs are here.
const std::map<char, std::string_view> strokes = {
    {'0', "190803123243483919"},
    {'1', "072922"},
    {'2', "0708193948470242"},
    {'3', "08193948473616 364543321203"},
    {'4', "32390444"},
    {'5', "490906364543321203"},
    {'6', "483919080312324345361605"},
    {'7', "094922"},
    {'8', "190807163647483919 160503123243453616"},
    {'9', "031232434839190806153546"},
    {'.', "02"},
    {'-', "0535"},
    {'a', "4742 4637170603123243"},
    {'c', "4637170603123243"},
    {'d', "4942 4637170603123243"},
    {'e', "05454637170603123243"},
    {'f', "39291812 0737"},
    {'g', "4741301001 4637170603123243"},
    {'i', "0702 09"},
    {'l', "0902"},
    {'m', "0702 0617273632 3647576662"},
    {'n', "0702 0617374642"},
    {'o', "170603123243463717"},
    {'p', "0700 0617374643321203"},
    {'r', "0702 05162737"},
    {'s', "46371706153443321203"},
    {'t', "19132232 0737"},
};
constexpr double line_height = 9;  // in units of the grid
constexpr double blank = 3;        // width of a blank
constexpr double gap = 2.2;        // from one letter to the next
constexpr double half_pen = 0.5;

class Pen {
public:
    /// `unit` is the size of a grid unit in pixels.
    Pen(Image& image, double unit) : image_(image), unit_(unit) {}

    static double width(std::string_view text) {
        double sum = 0;
        for (const char letter : text) sum += width(letter) + gap;
        return text.empty() ? 0 : sum - gap;
    }
    double pixels(std::string_view text) const { return width(text) * unit_; }

    /// Letters stand on the pixel row `baseline`, and the left side of the first one is at `left`.
    void write(std::string_view text, double left, double baseline) const {
        for (const char letter : text) {
            const auto found = strokes.find(letter);
            if (found != strokes.end()) draw(found->second, {left, baseline});
            left += (width(letter) + gap) * unit_;
        }
    }

private:
    static double width(char letter) {
        const auto found = strokes.find(letter);
        if (found == strokes.end()) return blank;
        int widest = 0;
        for (std::size_t n = 0; n < found->second.size(); ++n) {
            if (found->second[n] == ' ') continue;
            widest = std::max(widest, found->second[n] - '0');
            ++n;  // skips its y
        }
        return widest;
    }

    void draw(std::string_view letter, glm::dvec2 origin) const {
        std::vector<std::array<glm::dvec2, 2>> lines;
        glm::dvec2 last(0);
        bool down = false;
        for (std::size_t n = 0; n < letter.size(); ++n) {
            if (letter[n] == ' ') {
                down = false;
                continue;
            }
            const glm::dvec2 point(letter[n] - '0', letter[n + 1] - '0');
            lines.push_back({down ? last : point, point});
            last = point;
            down = true;
            ++n;
        }
        // The box of all pixels that the pen can reach, from the lowest stroke to the highest and to both
        // sides.
        const int left = int(std::floor(origin.x - unit_));
        const int right = int(std::ceil(origin.x + 8 * unit_));
        const int top = int(std::floor(origin.y - 8 * unit_));
        const int bottom = int(std::ceil(origin.y + 3 * unit_));
        for (int y = top; y <= bottom; ++y) {
            for (int x = left; x <= right; ++x) {
                const glm::dvec2 here((x + 0.5 - origin.x) / unit_, (origin.y - y - 0.5) / unit_ + 2);
                double nearest = 8;
                for (const auto& [from, to] : lines) nearest = std::min(nearest, distance(here, from, to));
                // The edge fades from full to none within one pixel.
                image_.blend(x, y, ink, std::clamp((half_pen - nearest) * unit_ + 0.5, 0.0, 1.0));
            }
        }
    }

    static double distance(glm::dvec2 point, glm::dvec2 from, glm::dvec2 to) {
        const glm::dvec2 line = to - from;
        const double squared = glm::dot(line, line);
        const double part = squared > 0 ? std::clamp(glm::dot(point - from, line) / squared, 0.0, 1.0) : 0;
        return glm::length(point - from - part * line);
    }

    Image& image_;
    double unit_;
};

/// "0.25", "1e-5": without the padding that printf adds to exponents.
std::string short_text(double value, int digits) {
    std::string text = fmt::format("{:.{}g}", value, digits);
    const std::size_t e = text.find('e');
    if (e == std::string::npos) return text;
    return text.substr(0, e + 1) + std::to_string(std::stoi(text.substr(e + 1)));
}

}  // namespace

std::string to_string(Colouring colouring) {
    return colouring == Colouring::displacement ? "displacement" : "error";
}

std::optional<Colouring> colouring_called(const std::string& text) {
    for (const Colouring colouring : {Colouring::displacement, Colouring::error}) {
        if (text == to_string(colouring)) return colouring;
    }
    return std::nullopt;
}

const std::array<Colour, colour_knots>& colours_of(Colouring colouring) {
    static const auto viridis =
        from_hex({0x440154, 0x481a6c, 0x472f7d, 0x414487, 0x39568c, 0x31688e, 0x2a788e, 0x23888e, 0x1f988b,
                  0x22a884, 0x35b779, 0x54c568, 0x7ad151, 0xa5db36, 0xd2e21b, 0xfde725});
    static const auto plasma =
        from_hex({0x0d0887, 0x330597, 0x5002a2, 0x6a00a8, 0x8405a7, 0x9c179e, 0xb12a90, 0xc33d80, 0xd35171,
                  0xe16462, 0xed7953, 0xf68f44, 0xfca636, 0xfec029, 0xf9dc24, 0xf0f921});
    return colouring == Colouring::displacement ? viridis : plasma;
}

double Scale::place(double value) const {
    if (!(max_ > 0) || !(value > 0)) return 0;
    if (colouring_ == Colouring::displacement) return std::min(value / max_, 1.0);
    return std::clamp(1 + std::log10(value / max_) / decades, 0.0, 1.0);
}

std::vector<Scale::Tick> Scale::ticks() const {
    if (!(max_ > 0)) return {{0, "0"}};
    std::vector<Tick> ticks;
    if (colouring_ == Colouring::error) {
        const double highest = std::floor(std::log10(max_));
        for (double power = highest - decades; power <= highest; ++power) {
            const double value = std::pow(10, power);
            if (value >= max_ * std::pow(10, -decades)) ticks.push_back({value, short_text(value, 1)});
        }
        return ticks;
    }
    // The step is 1, 2 or 5 times a power of ten, such that at most five steps fit.
    const double power = std::pow(10, std::floor(std::log10(max_)) - 1);
    double step = 10 * power;
    for (const double factor : {20, 10, 5, 2}) {
        if (max_ / (factor * power) <= 5.5) step = factor * power;
    }
    for (int n = 0; n * step <= max_ * (1 + 1e-9); ++n) ticks.push_back({n * step, short_text(n * step, 3)});
    return ticks;
}

void draw_legend(Image& image, const Scale& scale) {
    const double height = image.height * legend_share;
    const double unit = height / 50;
    const Pen pen(image, unit);
    const double letter = unit * line_height;
    const auto left = int(image.width * 0.14);
    const auto right = int(image.width * 0.86);
    const auto top = int(image.height - height * 0.62);
    const auto bottom = int(image.height - height * 0.42);

    const bool error = scale.colouring() == Colouring::error;
    const std::string largest = "largest " + short_text(scale.largest(), 3);
    pen.write(error ? "error against float64" : "displacement", left, top - letter * 0.55);
    pen.write(largest, right - pen.pixels(largest), top - letter * 0.55);
    for (int x = left; x < right; ++x) {
        const double place = scale.max() > 0 ? (x + 0.5 - left) / (right - left) : 0;
        for (int y = top; y < bottom; ++y) image.blend(x, y, colour_at(scale.colouring(), place), 1);
    }
    for (const auto& [value, label] : scale.ticks()) {
        const double x = left + scale.place(value) * (right - left);
        const auto thickness = std::max(1, int(std::lround(height / 90)));
        for (int y = bottom; y < bottom + int(height * 0.08); ++y) {
            for (int n = 0; n < thickness; ++n) {
                image.blend(std::clamp(int(std::lround(x)) + n, left, right - 1), y, ink, 1);
            }
        }
        const double width = pen.pixels(label);
        pen.write(label, std::clamp(x - width / 2, 0.0, image.width - width),
                  bottom + height * 0.14 + letter * 0.8);
    }
}

}  // namespace voxspring
