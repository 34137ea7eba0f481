// An image in memory, and its encoding as a PNG file.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
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

    /// Gives pixels with left <= x < right and top <= y < bottom an opaque colour. Pixels outside the image
    /// are ignored.
    void fill(int left, int top, int right, int bottom, const Colour& colour);
};

/// Encodes a PNG file, with `about` as the text of the keyword "voxspring". The same arguments give the same
/// bytes. Throws std::runtime_error.
std::string encode_png(const Image& image, const std::string& about);

}  // namespace voxspring
