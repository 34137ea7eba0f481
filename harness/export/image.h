// Pixels, and the PNG files they are written to.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <map>
#include <string>
#include <vector>

namespace voxspring {

/// Red, green, blue and opacity, each 0 to 1, colours as in sRGB and not multiplied by the opacity.
using Colour = std::array<double, 4>;

struct Image {
    Image(int columns, int rows)
        : width(columns), height(rows), pixels(4 * std::size_t(columns) * std::size_t(rows)) {}

    int width;
    int height;
    std::vector<std::uint8_t> pixels;  ///< red, green, blue, opacity; rows from the top

    std::uint8_t* at(int x, int y) {
        return &pixels[4 * (std::size_t(y) * std::size_t(width) + std::size_t(x))];
    }
    const std::uint8_t* at(int x, int y) const { return const_cast<Image*>(this)->at(x, y); }

    /// Lays `colour`, with `coverage` (0 to 1) times its opacity, over a pixel; beside the image nothing
    /// happens.
    void blend(int x, int y, const Colour& colour, double coverage);
};

/// A PNG file, the same bytes for the same image and `text`, which are its tEXt chunks: keyword (1 to 79
/// Latin characters) to text. Throws std::runtime_error.
std::string encode_png(const Image& image, const std::map<std::string, std::string>& text);

}  // namespace voxspring
