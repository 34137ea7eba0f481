#include "harness/export/image.h"

#include <png.h>

#include <array>
#include <cmath>
#include <csetjmp>
#include <cstdio>
#include <exception>
#include <stdexcept>
#include <utility>

namespace voxspring {
namespace {

/// All that writing one file needs. libpng reports errors by longjmp out of its C functions, so objects with
/// destructors live here, outside the functions that a jump leaves.
struct Writing {
    Writing(const Image& to_write, std::vector<png_text> to_add) : image(to_write), text(std::move(to_add)) {}
    ~Writing() { png_destroy_write_struct(&png, &info); }
    Writing(const Writing&) = delete;
    Writing& operator=(const Writing&) = delete;

    const Image& image;
    std::vector<png_text> text;
    std::string file;
    png_structp png = nullptr;
    png_infop info = nullptr;
    std::array<char, 200> error{};
};

[[noreturn]] void fail(png_structp png, png_const_charp message) {
    auto& error = static_cast<Writing*>(png_get_error_ptr(png))->error;
    std::snprintf(error.data(), error.size(), "%s", message);
    png_longjmp(png, 1);
}
void pass_over(png_structp, png_const_charp) {}

bool try_to_append(std::string& file, png_bytep bytes, std::size_t count) {
    try {
        file.append(reinterpret_cast<const char*>(bytes), count);
        return true;
    } catch (const std::exception&) {
        return false;
    }
}

void append(png_structp png, png_bytep bytes, std::size_t count) {
    if (!try_to_append(static_cast<Writing*>(png_get_io_ptr(png))->file, bytes, count))
        png_error(png, "no memory is left for the file");
}

void write(Writing& writing) {
    png_structp png = writing.png;
    png_set_write_fn(png, &writing, append, nullptr);
    png_set_IHDR(png, writing.info, png_uint_32(writing.image.width), png_uint_32(writing.image.height), 8,
                 PNG_COLOR_TYPE_RGB_ALPHA, PNG_INTERLACE_NONE, PNG_COMPRESSION_TYPE_DEFAULT,
                 PNG_FILTER_TYPE_DEFAULT);
    // Level 9 takes six times as long for a file that is 6% smaller.
    png_set_compression_level(png, 7);
    png_set_text(png, writing.info, writing.text.data(), int(writing.text.size()));
    png_write_info(png, writing.info);
    for (int y = 0; y < writing.image.height; ++y) png_write_row(png, writing.image.at(0, y));
    png_write_end(png, nullptr);
}

/// Returns false if libpng failed. No object with a destructor may live here or in write().
bool try_to_write(Writing& writing) {
    if (setjmp(png_jmpbuf(writing.png)) != 0) return false;
    write(writing);
    return true;
}

}  // namespace

void Image::blend(int x, int y, const Colour& colour, double coverage) {
    if (x < 0 || y < 0 || x >= width || y >= height) return;
    const double over = colour[3] * coverage;
    if (!(over > 0)) return;
    std::uint8_t* pixel = at(x, y);
    const double under = pixel[3] / 255.0 * (1 - over);
    for (std::size_t c = 0; c < 3; ++c) {
        pixel[c] = std::uint8_t(std::lround((255 * colour[c] * over + pixel[c] * under) / (over + under)));
    }
    pixel[3] = std::uint8_t(std::lround(255 * (over + under)));
}

std::string encode_png(const Image& image, const std::map<std::string, std::string>& text) {
    std::vector<png_text> chunks;
    auto own = text;  // a copy: libpng asks for non-const pointers, though it does not write
    for (auto& [keyword, words] : own) {
        png_text chunk{};
        chunk.compression = PNG_TEXT_COMPRESSION_NONE;
        chunk.key = const_cast<char*>(keyword.c_str());
        chunk.text = words.data();
        chunk.text_length = words.size();
        chunks.push_back(chunk);
    }
    Writing writing(image, std::move(chunks));
    // The result is null if memory runs out or if the library's version is not that of its header.
    writing.png = png_create_write_struct(PNG_LIBPNG_VER_STRING, &writing, fail, pass_over);
    if (writing.png != nullptr) writing.info = png_create_info_struct(writing.png);
    if (writing.info == nullptr) throw std::runtime_error("PNG: libpng cannot be used");
    if (!try_to_write(writing)) throw std::runtime_error(std::string("PNG: ") + writing.error.data());
    return std::move(writing.file);
}

}  // namespace voxspring
