#include "harness/drawing/image.h"

#include <png.h>
#include <zlib.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace voxspring {
namespace {

void append_big_endian(std::string& bytes, std::size_t number) {
    for (const int shift : {24, 16, 8, 0}) bytes += char(number >> shift & 255);
}

/// A chunk of a PNG file that holds a keyword and its text.
std::string text_chunk(const std::string& keyword, const std::string& text) {
    const std::string content = "tEXt" + keyword + '\0' + text;
    std::string chunk;
    append_big_endian(chunk, content.size() - 4);
    chunk += content;
    append_big_endian(chunk, crc32(0, reinterpret_cast<const Bytef*>(content.data()), uInt(content.size())));
    return chunk;
}

}  // namespace

void Image::fill(int left, int top, int right, int bottom, const Colour& colour) {
    for (int y = std::max(top, 0); y < std::min(bottom, height); ++y) {
        for (int x = std::max(left, 0); x < std::min(right, width); ++x) {
            for (std::size_t c = 0; c < 4; ++c) {
                const double part = c < 3 ? colour[c] : 1;
                at(x, y)[c] = std::uint8_t(std::lround(255 * part));
            }
        }
    }
}

std::string encode_png(const Image& image, const std::string& about) {
    png_image png{};
    png.version = PNG_IMAGE_VERSION;
    png.width = png_uint_32(image.width);
    png.height = png_uint_32(image.height);
    png.format = PNG_FORMAT_RGBA;
    png_alloc_size_t size = PNG_IMAGE_PNG_SIZE_MAX(png);
    std::string file(size, '\0');
    if (png_image_write_to_memory(&png, file.data(), &size, 0, image.pixels.data(), 0, nullptr) == 0)
        throw std::runtime_error(std::string("PNG: ") + png.message);
    file.resize(size);
    constexpr std::size_t size_of_header = 33;  // the signature and the first chunk
    return file.insert(size_of_header, text_chunk("voxspring", about));
}

}  // namespace voxspring
