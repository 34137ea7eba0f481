// Reads NIfTI-1 and NIfTI-2, as one file or as a pair of header and image. libnifti provides the structs of
// the headers and swaps their bytes. The rest is read here, because libnifti repairs wrong headers and
// allocates what they ask for.
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <nifti/nifti2_io.h>

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
#include "harness/volume/claims.h"
#include "harness/volume/text_header.h"

namespace voxspring {
namespace {

/// The header of a file, in this machine's byte order. `Raw` is nifti_1_header or nifti_2_header, whose
/// fields have the same names.
template <class Raw>
class Header {
public:
    /// Reads the rest of the header after its first four bytes. These are `size`, still in the byte order of
    /// the header.
    Header(ByteStream& bytes, int size, bool reversed, const std::string& file) : bytes_(bytes) {
        claims_.file = file;
        std::memcpy(&raw_, &size, sizeof size);
        const auto rest = std::as_writable_bytes(std::span(&raw_, 1)).subspan(sizeof size);
        if (const std::size_t held = bytes.read(rest); held < rest.size()) {
            refuse("header", fmt::format("{} bytes", held + sizeof size),
                   fmt::format("the {} bytes of a NIfTI-{} header", sizeof raw_, version));
        }
        if (reversed) swap_nifti_header(&raw_, version);
        claims_.big_endian = reversed == (std::endian::native == std::endian::little);
    }

    VolumeClaims claims(const std::filesystem::path& image) {
        const std::string magic(raw_.magic, strnlen(raw_.magic, 4));
        is_pair_ = magic == fmt::format("ni{}", version);
        if (!is_pair_ && magic != fmt::format("n+{}", version)) {
            refuse("magic", magic,
                   fmt::format(R"("n+{0}", header and data in one file, or "ni{0}", a pair of .hdr and .img)",
                               version));
        }
        check_intent();
        claims_.sizes_key = claims_.kinds_key = "dim";
        read_axes();
        place_axes();
        read_type();
        read_place(image);
        return std::move(claims_);
    }

private:
    static constexpr int version = sizeof(Raw) == sizeof(nifti_1_header) ? 1 : 2;

    [[noreturn]] void refuse(std::string_view key, const std::string& value,
                             const std::string& accepted) const {
        throw BadInput(claims_.file, key, value, accepted);
    }

    /// Refuses files of this format that hold no voxels.
    void check_intent() const {
        constexpr int first_of_cifti = 3000, last_of_cifti = 3099;
        const int code = raw_.intent_code;
        const bool is_cifti = code >= first_of_cifti && code <= last_of_cifti;
        const bool is_surface = code == NIFTI_INTENT_POINTSET || code == NIFTI_INTENT_TRIANGLE ||
                                code == NIFTI_INTENT_NODE_INDEX || code == NIFTI_INTENT_SHAPE;
        if (is_cifti || is_surface) {
            refuse("intent_code", std::to_string(code),
                   std::string("that of a volume of voxels: this one is for ") +
                       (is_cifti ? "connectivity between parts of a brain (CIFTI)" : "points of a surface"));
        }
    }

    /// Whatever their sizes, dim[1] to dim[3] are space, dim[4] is time, and later ones are values of one
    /// voxel.
    void read_axes() {
        static const std::map<int, std::string> units = {
            {NIFTI_UNITS_METER, "m"}, {NIFTI_UNITS_MM, "mm"}, {NIFTI_UNITS_MICRON, "um"}};
        const auto unit = units.find(XYZT_TO_SPACE(raw_.xyzt_units));
        const std::int64_t count = raw_.dim[0];
        if (count < 3 || count > 7) {
            refuse("dim[0]", std::to_string(count),
                   "from 3 to 7 dimensions: three of space, then time, then values of a voxel");
        }
        for (int a = 1; a <= count; ++a) {
            AxisClaim& axis = claims_.axes.emplace_back();
            axis.size = raw_.dim[a];
            axis.name = fmt::format("dim[{}]", a);
            // Programs that write three dimensions leave the later sizes at 0.
            if (axis.size == 0 && a > 3) {
                axis.size = 1;
                claims_.notes.push_back(axis.name + " is 0 and is taken for 1");
            }
            if (a > 3) axis.name += a == 4 ? ", which is time," : ", values of a voxel,";
            axis.kind = a <= 3 ? AxisKind::space : AxisKind::other;
            if (a <= 3 && unit != units.end()) axis.unit = unit->second;
            axis.distance = double(raw_.pixdim[a]);
            axis.distance_key = fmt::format("pixdim[{}]", a);
            axis.distance_text = fmt::format("{}", *axis.distance);
        }
    }

    /// Sets the directions of the axes and the origin: from the sform if there is one, otherwise from the
    /// qform, as other readers do. A file with neither has no orientation.
    void place_axes() {
        if (raw_.sform_code <= 0 && raw_.qform_code <= 0) return;
        claims_.space = "RAS";
        claims_.directions_have_lengths = raw_.sform_code > 0;
        claims_.directions_key = raw_.sform_code > 0 ? "sform" : "qform";
        const nifti_dmat44 qform = nifti_quatern_to_dmat44(
            double(raw_.quatern_b), double(raw_.quatern_c), double(raw_.quatern_d), double(raw_.qoffset_x),
            double(raw_.qoffset_y), double(raw_.qoffset_z), 1, 1, 1, raw_.pixdim[0] < 0 ? -1 : 1);
        const auto column = [&](int c) {
            if (raw_.sform_code <= 0) return glm::dvec3(qform.m[0][c], qform.m[1][c], qform.m[2][c]);
            return glm::dvec3(raw_.srow_x[c], raw_.srow_y[c], raw_.srow_z[c]);
        };
        for (int axis = 0; axis < 3; ++axis) claims_.axes[std::size_t(axis)].direction = column(axis);
        claims_.origin = column(3);
    }

    void read_type() {
        static const std::map<int, ScalarType> types = {
            {NIFTI_TYPE_INT8, ScalarType::int8},       {NIFTI_TYPE_UINT8, ScalarType::uint8},
            {NIFTI_TYPE_INT16, ScalarType::int16},     {NIFTI_TYPE_UINT16, ScalarType::uint16},
            {NIFTI_TYPE_INT32, ScalarType::int32},     {NIFTI_TYPE_UINT32, ScalarType::uint32},
            {NIFTI_TYPE_INT64, ScalarType::int64},     {NIFTI_TYPE_UINT64, ScalarType::uint64},
            {NIFTI_TYPE_FLOAT32, ScalarType::float32}, {NIFTI_TYPE_FLOAT64, ScalarType::float64},
        };
        const int code = raw_.datatype;
        const auto type = types.find(code);
        if (type == types.end()) {
            std::vector<int> codes;
            for (const auto& known : types) codes.push_back(known.first);
            refuse("datatype", std::to_string(code),
                   fmt::format("one of the scalar types {}", fmt::join(codes, ", ")));
        }
        claims_.type = type->second;
        claims_.type_text = "datatype " + std::to_string(code);
        claims_.data_key = "voxels";
        const double slope = double(raw_.scl_slope), intercept = double(raw_.scl_inter);
        if (slope == 0 || !std::isfinite(slope)) return;  // the file holds unscaled values
        claims_.slope = slope;
        claims_.intercept = std::isfinite(intercept) ? intercept : 0;
    }

    /// The offset of the voxels in their file.
    std::int64_t data_offset() {
        // If header and voxels are in one file, four bytes after the header say whether extensions follow.
        const std::uint64_t min = is_pair_ ? 0 : sizeof raw_ + 4;
        constexpr std::uint64_t max = 1 << 24;  // NIfTI-1's float cannot hold every larger whole number
        const double offset = double(raw_.vox_offset);
        if (offset == 0 && !is_pair_) {
            std::array<std::byte, 4> extensions{};
            if (bytes_.read(extensions) == extensions.size() && extensions[0] == std::byte{0}) {
                claims_.notes.push_back(fmt::format(
                    "vox_offset is 0: voxels are taken to begin right behind the header, at {}", min));
                return std::int64_t(min);
            }
        }
        if (!(offset >= double(min) && offset <= double(max)) || offset != std::trunc(offset)) {
            refuse("vox_offset", fmt::format("{}", offset),
                   fmt::format("a whole byte offset from {} to {}{}", min, max,
                               is_pair_ ? "" : ", behind the header"));
        }
        return std::int64_t(offset);
    }

    void read_place(const std::filesystem::path& image) {
        DataPlace& place = claims_.place;
        place.begin = 0;
        place.bytes_key = "vox_offset";
        place.skipped_bytes = data_offset();
        if (!is_pair_) return;
        const std::string name = lower_case(claims_.file);
        if (name.ends_with(".nii") || name.ends_with(".nii.gz")) {
            refuse("magic", fmt::format("ni{}", version),
                   fmt::format("\"n+{}\" in a .nii: the mark that was found is that of a header whose "
                               "voxels are in another file, a pair of .hdr and .img",
                               version));
        }
        place.files_key = "image";
        place.files = {image.empty() ? partner_of(claims_.file) : image};
        if (!place.files[0].empty()) return;
        std::filesystem::path wanted = claims_.file;
        if (lower_case(wanted.extension().string()) == ".gz") wanted.replace_extension();
        wanted.replace_extension(".img");
        refuse("", "a header without its image", "the file " + wanted.string() + " beside it");
    }

    Raw raw_{};
    ByteStream& bytes_;
    bool is_pair_ = false;  ///< whether the voxels are in a separate file
    VolumeClaims claims_;
};

}  // namespace

VolumeClaims read_nifti(std::istream& stream, const std::string& file, const std::filesystem::path& image) {
    static_assert(sizeof(nifti_1_header) == 348 && sizeof(nifti_2_header) == 540);
    ByteStream bytes(stream, encoding_at(stream), file);
    int size = 0;
    const std::size_t held = bytes.read(std::as_writable_bytes(std::span(&size, 1)));
    if (held < sizeof size)
        throw BadInput(file, "header", std::to_string(held) + " bytes", "the 348 bytes of a NIfTI-1 header");
    int other = size;
    nifti_swap_4bytes(1, &other);
    for (const bool reversed : {false, true}) {
        const std::size_t said = std::size_t(reversed ? other : size);
        if (said == sizeof(nifti_1_header))
            return Header<nifti_1_header>(bytes, size, reversed, file).claims(image);
        if (said == sizeof(nifti_2_header))
            return Header<nifti_2_header>(bytes, size, reversed, file).claims(image);
    }
    throw BadInput(file, "sizeof_hdr", std::to_string(size),
                   "348, the mark of a NIfTI-1 file, or 540, that of NIfTI-2");
}

}  // namespace voxspring
