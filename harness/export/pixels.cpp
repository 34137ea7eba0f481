#include "harness/export/pixels.h"

#include <epoxy/gl.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace voxspring {

Image read_pixels(glm::ivec2 size) {
    std::vector<std::uint8_t> rows(4 * std::size_t(size.x) * std::size_t(size.y));
    glPixelStorei(GL_PACK_ALIGNMENT, 4);
    glReadPixels(0, 0, size.x, size.y, GL_RGBA, GL_UNSIGNED_BYTE, rows.data());
    Image image(size.x, size.y);
    for (int y = 0; y < size.y; ++y) {
        const std::uint8_t* row = &rows[4 * std::size_t(size.y - 1 - y) * std::size_t(size.x)];
        std::copy(row, row + 4 * std::ptrdiff_t(size.x), image.at(0, y));
    }
    return image;
}

}  // namespace voxspring
