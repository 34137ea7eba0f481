// Code that the readers of mesh files share: it reads the words, numbers and bytes of a file, and adds
// polygons to the mesh.
#pragma once

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <charconv>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <string>
#include <string_view>

#include "harness/base/bad_input.h"
#include "harness/mesh/mesh.h"

namespace voxspring {

enum class NumberLayout : std::uint8_t { text, little, big };

/// The bytes of a mesh file, read from the front.
class MeshBytes {
public:
    MeshBytes(std::string_view bytes, std::string_view file) : bytes_(bytes), file_(file) {}

    std::string_view file() const { return file_; }
    std::size_t left() const { return bytes_.size() - at_; }
    /// The next line without its end; empty at the end of the file.
    std::string_view line();
    /// The next word; empty at the end of the file.
    std::string_view word();
    /// Skips `count` bytes. Throws BadInput if there are fewer.
    void skip(std::size_t count);

    /// The next number: a word, or the bytes of a `Number`. In messages `what` says what was expected.
    template <class Number>
    Number number(NumberLayout layout, std::string_view what) {
        Number value{};
        if (layout == NumberLayout::text) {
            const std::string_view text = word();
            if (!parse(text, value)) refuse(text.empty() ? "the end of the file" : text, what);
            return value;
        }
        if (left() < sizeof value) refuse("the end of the file", what);
        std::memcpy(&value, bytes_.data() + at_, sizeof value);
        at_ += sizeof value;
        if ((layout == NumberLayout::big) != (std::endian::native == std::endian::big)) {
            auto* first = reinterpret_cast<std::byte*>(&value);
            std::reverse(first, first + sizeof value);
        }
        return value;
    }

    /// Whether all of `text` is a number. If so, sets `value` to it.
    template <class Number>
    static bool parse(std::string_view text, Number& value) {
        if (text.starts_with('+')) text.remove_prefix(1);
        const auto [stop, error] = std::from_chars(text.data(), text.data() + text.size(), value);
        return error == std::errc() && stop == text.data() + text.size();
    }

    /// Throws BadInput for `value`, which was read last. The message says at which line and byte reading
    /// stopped.
    [[noreturn]] void refuse(std::string_view value, std::string_view accepted) const;

private:
    std::string_view bytes_, file_;
    std::size_t at_ = 0;
};

/// Returns `value`, which was read last, as a whole number. Throws BadInput if it is not one from 0 on.
inline std::int64_t whole(const MeshBytes& bytes, double value) {
    constexpr double most = 1e15;
    if (!(value >= 0 && value <= most && value == double(std::int64_t(value))))
        bytes.refuse(fmt::format("{:g}", value), "a whole number from 0 on");
    return std::int64_t(value);
}

/// Adds the triangles of a polygon, a fan around its first corner. Fewer than three corners add nothing.
template <class Corners>
void add_polygon(Mesh& mesh, const Corners& corners) {
    for (std::size_t n = 2; n < corners.size(); ++n)
        mesh.triangles.push_back({corners[0], corners[n - 1], corners[n]});
}

/// Readers, one per format. parse_mesh() checks indices and coordinates; of the readers only read_stl()
/// refuses a coordinate that is NaN.
Mesh read_stl(MeshBytes& bytes);
Mesh read_obj(MeshBytes& bytes);
Mesh read_ply(MeshBytes& bytes);
Mesh read_vtk(MeshBytes& bytes);
Mesh read_gmsh(MeshBytes& bytes);

/// Returns `index` as a vertex index. A negative or too large one becomes an index that no mesh has.
inline std::uint32_t vertex_index(std::int64_t index) {
    constexpr std::int64_t none = 0xFFFFFFFF;
    return std::uint32_t(index < 0 || index > none ? none : index);
}

}  // namespace voxspring
