// An image in memory, and its encoding as a PNG file.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <map>
#include <string>
#include <vector>

namespace voxspring {

/// Red, green, blue and opacity, each from 0 to 1. Colours are sRGB and not multiplied by the opacity.
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

    /// Blends `colour`, with `coverage` (0 to 1) times its opacity, over a pixel. Pixels outside the image
    /// are ignored.
    void blend(int x, int y, const Colour& colour, double coverage);
};

/// Encodes a PNG file. The same image and `text` give the same bytes. `text` becomes the tEXt chunks and maps
/// keywords (1 to 79 Latin characters) to texts. Throws std::runtime_error.
std::string encode_png(const Image& image, const std::map<std::string, std::string>& text);

}  // namespace voxspring
