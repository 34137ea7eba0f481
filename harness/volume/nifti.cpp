// Reads NIfTI-1 and NIfTI-2, as one file or as a pair of header and image. libnifti provides the structs of
// the headers and swaps their bytes. The rest is read here, because libnifti repairs wrong headers and
// allocates what they ask for.
#include <fmt/format.h>
#include <nifti/nifti2_io.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <glm/vec3.hpp>
#include <map>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "harness/base/bad_input.h"
#include "harness/volume/byte_stream.h"
#include "harness/volume/readers.h"
#include "harness/volume/text_header.h"
#include "harness/volume/volume.h"

namespace voxspring {
namespace {

const std::map<int, ScalarType>& scalar_types() {
    static const std::map<int, ScalarType> types = {
        {NIFTI_TYPE_INT8, ScalarType::int8},       {NIFTI_TYPE_UINT8, ScalarType::uint8},
        {NIFTI_TYPE_INT16, ScalarType::int16},     {NIFTI_TYPE_UINT16, ScalarType::uint16},
        {NIFTI_TYPE_INT32, ScalarType::int32},     {NIFTI_TYPE_UINT32, ScalarType::uint32},
        {NIFTI_TYPE_INT64, ScalarType::int64},     {NIFTI_TYPE_UINT64, ScalarType::uint64},
        {NIFTI_TYPE_FLOAT32, ScalarType::float32}, {NIFTI_TYPE_FLOAT64, ScalarType::float64},
    };
    return types;
}

/// The needed fields of a header of either version, in this machine's byte order.
struct Header {
    int version = 1;
    std::uint64_t bytes = 0;  ///< size of the header itself
    bool big_endian = false;
    bool pair = false;  ///< whether the voxels are in a separate file
    std::array<std::int64_t, 8> dim{};
    std::array<double, 8> pixdim{};
    int datatype = 0;
    double vox_offset = 0;
    double slope = 0;
    double intercept = 0;
    int intent = 0, units = 0;
    int qform = 0, sform = 0;
    std::array<double, 3> quaternion{}, qoffset{};
    std::array<std::array<double, 4>, 3> srow{};
};

template <class Raw>
Header header_of(const Raw& raw, int version, const std::string& file) {
    Header header;
    header.version = version;
    header.bytes = sizeof raw;
    const std::string magic(raw.magic, strnlen(raw.magic, 4));
    const char digit = char('0' + version);
    header.pair = magic == std::string("ni") + digit;
    if (!header.pair && magic != std::string("n+") + digit) {
        throw BadInput(file, "magic", magic,
                       std::string("\"n+") + digit + "\", header and data in one file, or \"ni" + digit +
                           "\", a pair of .hdr and .img");
    }
    std::copy(std::begin(raw.dim), std::end(raw.dim), header.dim.begin());
    std::copy(std::begin(raw.pixdim), std::end(raw.pixdim), header.pixdim.begin());
    header.datatype = raw.datatype;
    header.vox_offset = double(raw.vox_offset);
    const auto finite_or_0 = [](double number) { return std::isfinite(number) ? number : 0; };
    header.slope = finite_or_0(raw.scl_slope);
    header.intercept = finite_or_0(raw.scl_inter);
    header.intent = raw.intent_code;
    header.units = raw.xyzt_units;
    header.qform = raw.qform_code;
    header.sform = raw.sform_code;
    header.quaternion = {double(raw.quatern_b), double(raw.quatern_c), double(raw.quatern_d)};
    header.qoffset = {double(raw.qoffset_x), double(raw.qoffset_y), double(raw.qoffset_z)};
    std::size_t row = 0;
    for (const auto* srow : {raw.srow_x, raw.srow_y, raw.srow_z})
        std::copy_n(srow, 4, header.srow[row++].begin());
    return header;
}

/// Reads the rest of a `Raw` header after its first four bytes. These are `size`, still in the byte order of
/// the header.
template <class Raw>
Header read_header_as(ByteStream& bytes, int size, bool reversed, int version, const std::string& file) {
    Raw raw{};
    std::memcpy(&raw, &size, sizeof size);
    const std::size_t held = bytes.read(std::as_writable_bytes(std::span(&raw, 1)).subspan(sizeof size));
    if (held + sizeof size < sizeof raw) {
        throw BadInput(
            file, "header", std::to_string(held + sizeof size) + " bytes",
            "the " + std::to_string(sizeof raw) + " bytes of a NIfTI-" + std::to_string(version) + " header");
    }
    if (reversed) swap_nifti_header(&raw, version);
    Header header = header_of(raw, version, file);
    header.big_endian = reversed == (std::endian::native == std::endian::little);
    return header;
}

Header read_header(ByteStream& bytes, const std::string& file) {
    static_assert(sizeof(nifti_1_header) == 348 && sizeof(nifti_2_header) == 540);
    int size = 0;
    const std::size_t held = bytes.read(std::as_writable_bytes(std::span(&size, 1)));
    if (held < sizeof size)
        throw BadInput(file, "header", std::to_string(held) + " bytes", "the 348 bytes of a NIfTI-1 header");
    int other = size;
    nifti_swap_4bytes(1, &other);
    for (const bool reversed : {false, true}) {
        const int said = reversed ? other : size;
        if (said == int(sizeof(nifti_1_header)))
            return read_header_as<nifti_1_header>(bytes, size, reversed, 1, file);
        if (said == int(sizeof(nifti_2_header)))
            return read_header_as<nifti_2_header>(bytes, size, reversed, 2, file);
    }
    throw BadInput(file, "sizeof_hdr", std::to_string(size),
                   "348, the mark of a NIfTI-1 file, or 540, that of NIfTI-2");
}

/// Whatever their sizes, dim[1] to dim[3] are space, dim[4] is time, and later ones are values of one voxel.
std::vector<AxisClaim> axes_of(const Header& header, VolumeClaims& claims) {
    const std::int64_t count = header.dim[0];
    if (count < 3 || count > 7) {
        throw BadInput(claims.file, "dim[0]", std::to_string(count),
                       "3 dimensions, or up to 7 of which the further ones are time and values of a voxel");
    }
    std::vector<AxisClaim> axes;
    for (std::size_t a = 1; a <= std::size_t(count); ++a) {
        AxisClaim axis;
        axis.size = header.dim[a];
        axis.name = "dim[" + std::to_string(a) + "]" +
                    (a == 4  ? ", which is time,"
                     : a > 4 ? ", values of a voxel,"
                             : "");
        axis.kind = a <= 3 ? AxisKind::space : AxisKind::other;
        axis.distance = header.pixdim[a];
        axis.distance_key = "pixdim[" + std::to_string(a) + "]";
        axis.distance_text = fmt::format("{}", header.pixdim[a]);
        // Programs that write three dimensions leave the later sizes at 0.
        if (axis.size == 0 && a > 3) {
            axis.size = 1;
            claims.notes.push_back(axis.name.substr(0, 6) + " is 0 and is taken for 1");
        }
        axes.push_back(std::move(axis));
    }
    return axes;
}

/// The unit of the three axes of space.
std::string unit_of(const Header& header) {
    switch (XYZT_TO_SPACE(header.units)) {
        case NIFTI_UNITS_METER:
            return "m";
        case NIFTI_UNITS_MM:
            return "mm";
        case NIFTI_UNITS_MICRON:
            return "um";
        default:
            return {};
    }
}

/// Sets the directions of the axes and the origin: from the sform if there is one, otherwise from the qform,
/// as other readers do. A file with neither has no orientation.
void place_axes(const Header& header, VolumeClaims& claims) {
    if (header.sform <= 0 && header.qform <= 0) return;
    claims.space = "RAS";
    claims.directions_have_lengths = header.sform > 0;
    claims.directions_key = header.sform > 0 ? "sform" : "qform";
    std::array<std::array<double, 4>, 3> rows = header.srow;
    if (header.sform <= 0) {
        const auto& [b, c, d] = header.quaternion;
        const auto& [x, y, z] = header.qoffset;
        const nifti_dmat44 matrix =
            nifti_quatern_to_dmat44(b, c, d, x, y, z, 1, 1, 1, header.pixdim[0] < 0 ? -1 : 1);
        for (std::size_t row = 0; row < 3; ++row) std::copy_n(matrix.m[row], 4, rows[row].begin());
    }
    for (std::size_t axis = 0; axis < 3; ++axis)
        claims.axes[axis].direction = glm::dvec3(rows[0][axis], rows[1][axis], rows[2][axis]);
    claims.origin = glm::dvec3(rows[0][3], rows[1][3], rows[2][3]);
}

/// Refuses files of this format that hold no voxels.
void check_intent(const Header& header, const std::string& file) {
    constexpr int first_of_cifti = 3000, last_of_cifti = 3099;
    const int code = header.intent;
    const bool is_cifti = code >= first_of_cifti && code <= last_of_cifti;
    const bool is_surface = code == NIFTI_INTENT_POINTSET || code == NIFTI_INTENT_TRIANGLE ||
                            code == NIFTI_INTENT_NODE_INDEX || code == NIFTI_INTENT_SHAPE;
    if (is_cifti || is_surface) {
        throw BadInput(
            file, "intent_code", std::to_string(code),
            std::string("that of a volume of voxels: this one is for ") +
                (is_cifti ? "connectivity between parts of a brain (CIFTI)" : "points of a surface"));
    }
}

ScalarType scalar_type(const Header& header, const std::string& file) {
    const auto type = scalar_types().find(header.datatype);
    if (type != scalar_types().end()) return type->second;
    std::string accepted;
    for (const auto& [code, scalar] : scalar_types())
        accepted += (accepted.empty() ? "" : ", ") + std::to_string(code);
    throw BadInput(file, "datatype", std::to_string(header.datatype), "one of the scalar types " + accepted);
}

/// The offset of the voxels in their file.
std::int64_t data_offset(const Header& header, ByteStream& bytes, VolumeClaims& claims) {
    // In one file, four bytes after the header say whether there are extensions.
    const std::uint64_t min = header.pair ? 0 : header.bytes + 4;
    constexpr std::uint64_t max = 1 << 24;  // beyond it NIfTI-1's float skips whole numbers
    if (header.vox_offset == 0 && !header.pair) {
        std::array<std::byte, 4> extensions{};
        if (bytes.read(extensions) == extensions.size() && extensions[0] == std::byte{0}) {
            claims.notes.push_back(fmt::format(
                "vox_offset is 0: voxels are taken to begin right behind the header, at {}", min));
            return std::int64_t(min);
        }
    }
    if (!(header.vox_offset >= double(min) && header.vox_offset <= double(max))) {
        throw BadInput(claims.file, "vox_offset", std::to_string(header.vox_offset),
                       "an offset from " + std::to_string(min) + " to " + std::to_string(max) +
                           (header.pair ? "" : ", behind the header"));
    }
    return std::int64_t(header.vox_offset);
}

DataPlace data_place(const Header& header, ByteStream& bytes, const std::filesystem::path& image,
                     VolumeClaims& claims) {
    DataPlace place;
    place.begin = 0;
    place.bytes_key = "vox_offset";
    place.skipped_bytes = data_offset(header, bytes, claims);
    if (!header.pair) return place;
    const std::string name = lower_case(claims.file);
    if (name.ends_with(".nii") || name.ends_with(".nii.gz")) {
        throw BadInput(
            claims.file, "magic", fmt::format("ni{}", header.version),
            fmt::format("\"n+{}\" in a .nii: this is the magic of a header whose voxels are in another "
                        "file, of a pair of .hdr and .img",
                        header.version));
    }
    place.files_key = "image";
    place.files = {image.empty() ? partner_of(claims.file) : image};
    if (place.files[0].empty()) {
        std::filesystem::path missing = claims.file;
        if (lower_case(missing.extension().string()) == ".gz") missing.replace_extension();
        missing.replace_extension(".img");
        throw BadInput(claims.file, "", "a header without its image",
                       "the file " + missing.string() + " beside it");
    }
    return place;
}

}  // namespace

VolumeClaims read_nifti_header(std::istream& stream, const std::string& file,
                               const std::filesystem::path& image) {
    ByteStream bytes(stream, encoding_at(stream), file);
    const Header header = read_header(bytes, file);
    check_intent(header, file);
    VolumeClaims claims;
    claims.file = file;
    claims.sizes_key = claims.kinds_key = "dim";
    claims.axes = axes_of(header, claims);
    for (std::size_t axis = 0; axis < 3; ++axis) claims.axes[axis].unit = unit_of(header);
    place_axes(header, claims);
    claims.type = scalar_type(header, file);
    claims.type_text = "datatype " + std::to_string(header.datatype);
    claims.data_key = "voxels";
    claims.big_endian = header.big_endian;
    if (header.slope != 0) {  // 0: the file holds the values themselves
        claims.slope = header.slope;
        claims.intercept = header.intercept;
    }
    claims.place = data_place(header, bytes, image, claims);
    return claims;
}

}  // namespace voxspring
