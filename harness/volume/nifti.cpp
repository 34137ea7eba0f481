// NIfTI-1 through libnifti, which turns the header into an image description; the data is read here, since
// libnifti allocates what the header asks for.
#include <nifti/nifti1_io.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <map>
#include <memory>

#include "harness/base/bad_input.h"
#include "harness/volume/byte_stream.h"
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

/// Gzip streams begin with these two bytes; a NIfTI header with 348 or its reverse.
Encoding encoding_of(std::istream& stream) {
    const bool gzip = stream.get() == 0x1F && stream.get() == 0x8B;
    stream.clear();
    stream.seekg(0);
    return gzip ? Encoding::gzip : Encoding::raw;
}

/// Passes over `count` bytes; false if there are not that many.
bool skip(ByteStream& bytes, std::uint64_t count) {
    std::array<std::byte, 4096> scratch{};
    while (count > 0) {
        const std::size_t chunk = std::min<std::uint64_t>(count, scratch.size());
        if (bytes.read(std::span(scratch).first(chunk)) < chunk) return false;
        count -= chunk;
    }
    return true;
}

}  // namespace

Volume read_nifti(std::istream& stream, const std::string& file, const SceneSizeLimits& limits) {
    ByteStream bytes(stream, encoding_of(stream), file);
    nifti_1_header header{};
    static_assert(sizeof header == 348);
    const std::size_t held = bytes.read(std::as_writable_bytes(std::span(&header, 1)));
    if (held < sizeof header)
        throw BadInput(file, "header", std::to_string(held) + " bytes", "the 348 bytes of a NIfTI-1 header");

    int reversed_size = header.sizeof_hdr;
    nifti_swap_4bytes(1, &reversed_size);
    const bool reversed = reversed_size == int(sizeof header);
    if (!reversed && header.sizeof_hdr != int(sizeof header)) {
        const bool nifti_2 = header.sizeof_hdr == 540 || reversed_size == 540;
        throw BadInput(file, "sizeof_hdr", std::to_string(header.sizeof_hdr) + (nifti_2 ? " (NIfTI-2)" : ""),
                       "348, the mark of a NIfTI-1 file");
    }
    if (std::memcmp(header.magic, "n+1", 4) != 0) {
        throw BadInput(file, "magic", std::string(header.magic, strnlen(header.magic, 4)),
                       "\"n+1\", header and data in one file");
    }
    if (reversed) swap_nifti_header(&header, 1);

    // libnifti mends what is wrong with dims; a file that lies is refused instead.
    if (header.dim[0] < 3 || header.dim[0] > 7) {
        throw BadInput(file, "dim[0]", std::to_string(header.dim[0]),
                       "3 dimensions, or up to 7 of which all further ones are 1");
    }
    for (int axis = 4; axis <= header.dim[0]; ++axis) {
        if (header.dim[axis] != 1) {
            throw BadInput(file, "dim[" + std::to_string(axis) + "]", std::to_string(header.dim[axis]),
                           "1: a volume has 3 dimensions and one value a voxel");
        }
    }
    Volume volume;
    volume.file = file;
    volume.dims = {header.dim[1], header.dim[2], header.dim[3]};
    const std::uint64_t voxels = checked_voxel_count(volume.dims, limits, file, "dim");

    const auto type = scalar_types().find(header.datatype);
    if (type == scalar_types().end()) {
        std::string accepted;
        for (const auto& [code, scalar] : scalar_types())
            accepted += (accepted.empty() ? "" : ", ") + std::to_string(code);
        throw BadInput(file, "datatype", std::to_string(header.datatype),
                       "one of the scalar types " + accepted);
    }
    volume.type = type->second;

    constexpr float last_exact_offset = 1 << 24;  // beyond it a float skips whole numbers
    if (!(header.vox_offset >= 352 && header.vox_offset <= last_exact_offset)) {
        throw BadInput(file, "vox_offset", std::to_string(header.vox_offset),
                       "an offset from 352 to 16777216, behind the header");
    }

    const std::unique_ptr<nifti_image, decltype(&nifti_image_free)> image(
        nifti_convert_nhdr2nim(header, nullptr), nifti_image_free);
    if (!image) throw BadInput(file, "header", "what libnifti refuses", "a NIfTI-1 header");
    volume.spacing = {image->dx, image->dy, image->dz};
    for (int axis = 0; axis < 3; ++axis) {
        if (!(volume.spacing[axis] >= smallest_quantity && volume.spacing[axis] <= largest_quantity)) {
            throw BadInput(file, "pixdim[" + std::to_string(axis + 1) + "]",
                           std::to_string(header.pixdim[axis + 1]), "a positive distance between voxels");
        }
    }
    if (image->scl_slope != 0) {  // 0: the file holds the values themselves
        volume.slope = double(image->scl_slope);
        volume.intercept = double(image->scl_inter);
    }

    if (!skip(bytes, std::uint64_t(image->iname_offset) - sizeof header)) {
        throw BadInput(file, "vox_offset", std::to_string(image->iname_offset), "an offset within the file");
    }
    volume.data = bytes.read_rest(voxels * bytes_of(volume.type), "voxels",
                                  std::to_string(voxels) + " voxels of datatype " +
                                      std::to_string(header.datatype) + " as the header says");
    if (reversed && image->swapsize > 0) nifti_swap_Nbytes(voxels, image->swapsize, volume.data.data());
    return volume;
}

}  // namespace voxspring
