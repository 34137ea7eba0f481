// NIfTI-1 and NIfTI-2, as one file or as a pair of header and image. libnifti knows the headers and their
// byte orders; the rest is read here, since libnifti mends headers that lie and allocates what they ask for.
#include <nifti/nifti2_io.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <map>
#include <span>

#include "harness/base/bad_input.h"
#include "harness/volume/byte_stream.h"
#include "harness/volume/readers.h"
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

/// Gzip streams begin with these two bytes; a NIfTI header with its size.
Encoding encoding_of(std::istream& stream) {
    const bool gzip = stream.get() == 0x1F && stream.get() == 0x8B;
    stream.clear();
    stream.seekg(0);
    return gzip ? Encoding::gzip : Encoding::raw;
}

/// What is needed of a header of either version, in this machine's byte order.
struct Header {
    int version = 1;
    std::uint64_t bytes = 0;  ///< of the header itself
    bool big_endian = false;
    bool pair = false;  ///< the voxels are in a file of their own
    std::array<std::int64_t, 8> dim{};
    std::array<double, 8> pixdim{};
    int datatype = 0;
    double vox_offset = 0;
    double slope = 0;
    double intercept = 0;
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
    return header;
}

/// Reads what of `Raw` follows its first four bytes, which are `size` and in the byte order that the header
/// is in.
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

/// Which of dim[1] to dim[7] are the sides of the grid.
std::array<std::size_t, 3> grid_axes(const Header& header, const std::string& file) {
    const std::int64_t count = header.dim[0];
    if (count < 3 || count > 7) {
        throw BadInput(file, "dim[0]", std::to_string(count),
                       "3 dimensions, or up to 7 of which all further ones are 1");
    }
    const std::vector<std::int64_t> sizes(header.dim.begin() + 1, header.dim.begin() + 1 + count);
    if (const auto axes = axes_of_space(sizes)) return {(*axes)[0] + 1, (*axes)[1] + 1, (*axes)[2] + 1};
    auto last = std::size_t(count);
    while (sizes[last - 1] == 1) --last;
    throw BadInput(file, "dim[" + std::to_string(last) + "]", std::to_string(sizes[last - 1]),
                   "1: a volume has 3 dimensions and one value a voxel");
}

/// A negative distance says that the axis runs the other way, which the grid does not need to know.
double spacing(const Header& header, std::size_t axis, const std::string& file) {
    const double distance = std::abs(header.pixdim[axis]);
    if (!is_spacing(distance)) {
        throw BadInput(file, "pixdim[" + std::to_string(axis) + "]", std::to_string(header.pixdim[axis]),
                       "a distance between voxels other than 0");
    }
    return distance;
}

ScalarType scalar_type(const Header& header, const std::string& file) {
    const auto type = scalar_types().find(header.datatype);
    if (type != scalar_types().end()) return type->second;
    std::string accepted;
    for (const auto& [code, scalar] : scalar_types())
        accepted += (accepted.empty() ? "" : ", ") + std::to_string(code);
    throw BadInput(file, "datatype", std::to_string(header.datatype), "one of the scalar types " + accepted);
}

/// Where the voxels begin in their file.
std::uint64_t data_offset(const Header& header, const std::string& file) {
    // Of one file, four bytes after the header say whether there are extensions.
    const std::uint64_t min = header.pair ? 0 : header.bytes + 4;
    constexpr std::uint64_t max = 1 << 24;  // beyond it NIfTI-1's float skips whole numbers
    if (!(header.vox_offset >= double(min) && header.vox_offset <= double(max))) {
        throw BadInput(file, "vox_offset", std::to_string(header.vox_offset),
                       "an offset from " + std::to_string(min) + " to " + std::to_string(max) +
                           (header.pair ? "" : ", behind the header"));
    }
    return std::uint64_t(header.vox_offset);
}

/// The image that belongs to a header file: its name with .img, or with .img.gz where only that is there.
std::filesystem::path image_of(const std::filesystem::path& file) {
    std::filesystem::path image = file;
    if (image.extension() == ".gz") image.replace_extension();
    image.replace_extension(".img");
    std::error_code error;
    if (std::filesystem::is_regular_file(image, error)) return image;
    const std::filesystem::path packed = image.string() + ".gz";
    return std::filesystem::is_regular_file(packed, error) ? packed : image;
}

}  // namespace

Volume read_nifti(std::istream& stream, const std::string& file, const SceneSizeLimits& limits) {
    ByteStream bytes(stream, encoding_of(stream), file);
    const Header header = read_header(bytes, file);
    const std::array<std::size_t, 3> axes = grid_axes(header, file);
    const GridSides sides(header.dim[axes[0]], header.dim[axes[1]], header.dim[axes[2]]);
    const std::uint64_t voxels = checked_voxel_count(sides, limits, file, "dim");
    Volume volume;
    volume.file = file;
    volume.dims = glm::ivec3(sides);
    volume.type = scalar_type(header, file);
    const std::uint64_t offset = data_offset(header, file);
    for (int a = 0; a < 3; ++a) volume.spacing[a] = spacing(header, axes[std::size_t(a)], file);
    if (header.slope != 0) {  // 0: the file holds the values themselves
        volume.slope = header.slope;
        volume.intercept = header.intercept;
    }

    const auto read_voxels = [&](ByteStream& data, std::uint64_t before) {
        if (!data.skip(before))
            throw BadInput(file, "vox_offset", std::to_string(offset), "an offset within the file");
        data.read_rest(volume.data, voxels * bytes_of(volume.type), "voxels",
                       std::to_string(voxels) + " voxels of datatype " + std::to_string(header.datatype) +
                           " as the header says");
    };
    if (header.pair) {
        const std::filesystem::path image = image_of(file);
        std::error_code error;
        if (!std::filesystem::is_regular_file(image, error))
            throw BadInput(file, "", "a header without its image",
                           "the file " + image.string() + " beside it");
        std::ifstream image_stream(image, std::ios::binary);
        ByteStream data(image_stream, encoding_of(image_stream), image.string());
        read_voxels(data, offset);
    } else {
        read_voxels(bytes, offset - header.bytes);
    }
    to_native_order(volume.data, volume.type, header.big_endian);
    return volume;
}

}  // namespace voxspring
