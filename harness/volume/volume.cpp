#include "harness/volume/volume.h"

#include <algorithm>
#include <fstream>

#include "harness/base/bad_input.h"
#include "harness/volume/readers.h"
#include "harness/volume/text_header.h"

namespace voxspring {
namespace {

VolumeClaims read_nifti_alone(std::istream& stream, const std::string& file) {
    return read_nifti_header(stream, file);
}

struct Format {
    std::string_view ending;
    VolumeClaims (*read)(std::istream&, const std::string&) = nullptr;  ///< null: part of a NIfTI pair
    bool is_image = false;  ///< whether it is the image of a pair, whose header is read first
};

const std::vector<Format>& formats() {
    static const std::vector<Format> all = {
        {".nii", read_nifti_alone},
        {".nii.gz", read_nifti_alone},
        {".hdr"},
        {".hdr.gz"},
        {".img", nullptr, true},
        {".img.gz", nullptr, true},
        {".nrrd", read_nrrd_header},
        {".nhdr", read_nrrd_header},
        {".mha", read_metaimage_header},
        {".mhd", read_metaimage_header},
    };
    return all;
}

/// The format of a file with this name; null if it is no volume file.
const Format* format_of(const std::string& name) {
    const std::string lower = lower_case(name);
    const auto found = std::find_if(formats().begin(), formats().end(),
                                    [&](const Format& format) { return lower.ends_with(format.ending); });
    return found == formats().end() ? nullptr : &*found;
}

std::ifstream opened(const std::string& file, const std::string& as) {
    require_regular_file(file, as);
    std::ifstream stream(file, std::ios::binary);
    if (!stream) throw BadInput(file, "", "an unreadable file", "a file that can be read");
    return stream;
}

/// Describes to the user which header belongs to an image.
std::string header_of(const std::filesystem::path& image) {
    const std::string name = image.filename().string();
    const std::string plain = name.substr(0, lower_case(name).rfind(".img")) + ".hdr";
    const bool gzipped = lower_case(name).ends_with(".gz");
    return (gzipped ? plain + ".gz beside it, or " + plain : plain + " beside it, or " + plain + ".gz") +
           " if that has no other image";
}

/// Reads the pair to which `file` belongs. Messages about the header name the header's file.
Volume read_pair(const std::filesystem::path& file, bool is_image, const VolumeChoice& choice,
                 const SceneSizeLimits& limits) {
    const std::filesystem::path partner = partner_of(file);
    if (partner.empty() && is_image)
        throw BadInput(file.string(), "", "an image without its header", header_of(file));
    const std::string header = (is_image ? partner : file).string();
    std::ifstream stream = opened(header, is_image ? "the header of " + file.string() : "a volume file");
    const VolumeClaims claims = read_nifti_header(stream, header, is_image ? file : partner);
    if (is_image && claims.place.files.empty()) {
        throw BadInput(header, "magic", "of a file that has its voxels itself",
                       "that of a pair, of which " + file.string() + " is the image");
    }
    return read_voxels(stream, claims, choice, limits);
}

}  // namespace

std::size_t bytes_of(ScalarType type) {
    switch (type) {
        case ScalarType::int8:
        case ScalarType::uint8:
            return 1;
        case ScalarType::int16:
        case ScalarType::uint16:
            return 2;
        case ScalarType::int32:
        case ScalarType::uint32:
        case ScalarType::float32:
            return 4;
        case ScalarType::int64:
        case ScalarType::uint64:
        case ScalarType::float64:
            return 8;
    }
    return 0;
}

bool is_volume_name(const std::string& name) { return format_of(name) != nullptr; }

std::string volume_endings() {
    std::string text;
    for (const Format& format : formats()) {
        text += text.empty() ? "" : &format == &formats().back() ? " or " : ", ";
        text += format.ending;
    }
    return text;
}

Volume read_volume(const std::filesystem::path& file, const VolumeChoice& choice,
                   const SceneSizeLimits& limits) {
    const std::string name = file.string();
    const Format* format = format_of(name);
    if (format == nullptr) {
        throw BadInput(name, "file name", file.filename().string(),
                       "a volume file, whose name ends in " + volume_endings());
    }
    if (format->read == nullptr) return read_pair(file, format->is_image, choice, limits);
    std::ifstream stream = opened(name, "a volume file");
    return read_voxels(stream, format->read(stream, name), choice, limits);
}

Volume read_voxels(std::istream& stream, const VolumeClaims& claims, const VolumeChoice& choice,
                   const SceneSizeLimits& limits) {
    DecidedVolume decided = decide(claims, choice, limits);
    Volume& volume = decided.volume;
    const std::uint64_t each = bytes_of(volume.type);
    const KeptBytes kept{each * decided.period, each * decided.first, each * decided.length};
    volume.data = read_data(stream, claims.file, claims.place, each * decided.scalars, kept, claims.data_key,
                            std::to_string(decided.scalars) +
                                (decided.scalars > decided.length ? " values of " : " voxels of ") +
                                claims.type_text + " as the header says",
                            volume.notes);
    to_native_order(volume.data, volume.type, claims.big_endian);
    return std::move(volume);
}

Volume read_nifti(std::istream& stream, const std::string& file, const SceneSizeLimits& limits,
                  const VolumeChoice& choice) {
    return read_voxels(stream, read_nifti_header(stream, file), choice, limits);
}

Volume read_nrrd(std::istream& stream, const std::string& file, const SceneSizeLimits& limits,
                 const VolumeChoice& choice) {
    return read_voxels(stream, read_nrrd_header(stream, file), choice, limits);
}

Volume read_metaimage(std::istream& stream, const std::string& file, const SceneSizeLimits& limits,
                      const VolumeChoice& choice) {
    return read_voxels(stream, read_metaimage_header(stream, file), choice, limits);
}

}  // namespace voxspring
