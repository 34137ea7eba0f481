#include "harness/drawing/legend.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <string_view>
#include <vector>

namespace voxspring {
namespace {

constexpr double decades = 3;
/// The grey of text and ticks. Its contrast by WCAG is 5.1 on white and 3.5 on a nearly black page (#15181c).
constexpr Colour ink = {0.431, 0.431, 0.431, 1};

std::array<Colour, colour_knots> from_hex(const std::array<unsigned, colour_knots>& knots) {
    std::array<Colour, colour_knots> colours{};
    std::transform(knots.begin(), knots.end(), colours.begin(), [](unsigned rgb) {
        return Colour{(rgb >> 16 & 255) / 255.0, (rgb >> 8 & 255) / 255.0, (rgb & 255) / 255.0, 1};
    });
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
/// The letters that a legend needs, in rows from the top. The lowest bit is the dot on the right.
const std::map<char, std::array<unsigned, 7>> letters = {
    {'0', {0x0E, 0x11, 0x13, 0x15, 0x19, 0x11, 0x0E}}, {'1', {0x04, 0x0C, 0x04, 0x04, 0x04, 0x04, 0x0E}},
    {'2', {0x0E, 0x11, 0x01, 0x02, 0x04, 0x08, 0x1F}}, {'3', {0x1F, 0x02, 0x04, 0x02, 0x01, 0x11, 0x0E}},
    {'4', {0x02, 0x06, 0x0A, 0x12, 0x1F, 0x02, 0x02}}, {'5', {0x1F, 0x10, 0x1E, 0x01, 0x01, 0x11, 0x0E}},
    {'6', {0x06, 0x08, 0x10, 0x1E, 0x11, 0x11, 0x0E}}, {'7', {0x1F, 0x01, 0x02, 0x04, 0x08, 0x08, 0x08}},
    {'8', {0x0E, 0x11, 0x11, 0x0E, 0x11, 0x11, 0x0E}}, {'9', {0x0E, 0x11, 0x11, 0x0F, 0x01, 0x02, 0x0C}},
    {'.', {0x00, 0x00, 0x00, 0x00, 0x00, 0x0C, 0x0C}}, {'-', {0x00, 0x00, 0x00, 0x1F, 0x00, 0x00, 0x00}},
    {'a', {0x00, 0x00, 0x0E, 0x01, 0x0F, 0x11, 0x0F}}, {'c', {0x00, 0x00, 0x0E, 0x10, 0x10, 0x11, 0x0E}},
    {'d', {0x01, 0x01, 0x0D, 0x13, 0x11, 0x11, 0x0F}}, {'e', {0x00, 0x00, 0x0E, 0x11, 0x1F, 0x10, 0x0E}},
    {'f', {0x06, 0x09, 0x08, 0x1C, 0x08, 0x08, 0x08}}, {'g', {0x00, 0x0F, 0x11, 0x11, 0x0F, 0x01, 0x0E}},
    {'i', {0x04, 0x00, 0x0C, 0x04, 0x04, 0x04, 0x0E}}, {'l', {0x0C, 0x04, 0x04, 0x04, 0x04, 0x04, 0x0E}},
    {'m', {0x00, 0x00, 0x1A, 0x15, 0x15, 0x11, 0x11}}, {'n', {0x00, 0x00, 0x16, 0x19, 0x11, 0x11, 0x11}},
    {'o', {0x00, 0x00, 0x0E, 0x11, 0x11, 0x11, 0x0E}}, {'p', {0x00, 0x00, 0x1E, 0x11, 0x1E, 0x10, 0x10}},
    {'r', {0x00, 0x00, 0x16, 0x19, 0x10, 0x10, 0x10}}, {'s', {0x00, 0x00, 0x0E, 0x10, 0x0E, 0x01, 0x1E}},
    {'t', {0x08, 0x08, 0x1C, 0x08, 0x08, 0x09, 0x06}},
};
constexpr int letter_width = 5, letter_height = 7, advance = letter_width + 1;  // in dots

int text_width(std::string_view text, int dot) { return int(text.size()) * advance * dot; }

/// Writes a text whose upper left corner is at (left, top), in dots `dot` pixels wide.
void write(Image& image, std::string_view text, int left, int top, int dot) {
    for (const char letter : text) {
        const auto found = letters.find(letter);
        for (int n = 0; found != letters.end() && n < letter_width * letter_height; ++n) {
            if ((found->second[std::size_t(n / letter_width)] >> (letter_width - 1 - n % letter_width) & 1) ==
                0)
                continue;
            const int x = left + n % letter_width * dot, y = top + n / letter_width * dot;
            image.fill(x, y, x + dot, y + dot, ink);
        }
        left += advance * dot;
    }
}

/// `value` with `digits` significant digits, like "0.25" or "1e-5". Unlike printf, it does not pad the
/// exponent with zeros.
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
    const auto left = int(image.width * 0.14), right = int(image.width * 0.86);
    const auto top = int(image.height - height * 0.62), bottom = int(image.height - height * 0.42);
    // The width of the bar must hold this many letters, so that both texts above it fit beside each other.
    constexpr int most_letters = 40;
    const int dot =
        std::max(1, std::min(int(height * 0.18 / letter_height), (right - left) / (most_letters * advance)));
    const int share = image.height - int(height);  // the legend's uppermost row of pixels
    const int above =
        std::min(top - (letter_height + 1) * dot, std::max(share, top - (letter_height + 3) * dot));

    const bool error = scale.colouring() == Colouring::error;
    const std::string largest = "largest " + short_text(scale.largest(), 3);
    write(image, error ? "error against float64" : "displacement", left, above, dot);
    write(image, largest, right - text_width(largest, dot), above, dot);
    for (int x = left; x < right; ++x) {
        const double place = scale.max() > 0 ? (x + 0.5 - left) / (right - left) : 0;
        image.fill(x, top, x + 1, bottom, colour_at(scale.colouring(), place));
    }
    const auto below = bottom + int(height * 0.08);
    for (const auto& [value, label] : scale.ticks()) {
        const int x = left + int(std::lround(scale.place(value) * (right - left)));
        image.fill(std::min(x, right - 1), bottom, std::min(x, right - 1) + std::max(1, dot / 2), below, ink);
        const int width = text_width(label, dot);
        write(image, label, std::clamp(x - width / 2, 0, std::max(0, image.width - width)), below + 2 * dot,
              dot);
    }
}

}  // namespace voxspring
