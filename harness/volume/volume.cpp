#include "harness/volume/volume.h"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <fstream>
#include <system_error>

#include "harness/base/bad_input.h"
#include "harness/volume/claims.h"
#include "harness/volume/text_header.h"

namespace voxspring {
namespace {

VolumeClaims read_nifti_alone(std::istream& stream, const std::string& file) {
    return read_nifti(stream, file);
}

struct Format {
    std::string ending;
    /// Null: the file is part of a NIfTI pair.
    VolumeClaims (*read)(std::istream&, const std::string&) = nullptr;
    bool is_image = false;  ///< whether the file is the image of a pair
};

const std::vector<Format>& formats() {
    static const std::vector<Format> all = {
        {".nii", read_nifti_alone},
        {".nii.gz", read_nifti_alone},
        {".hdr"},
        {".hdr.gz"},
        {".img", nullptr, true},
        {".img.gz", nullptr, true},
        {".nrrd", read_nrrd},
        {".nhdr", read_nrrd},
        {".mha", read_metaimage},
        {".mhd", read_metaimage},
    };
    return all;
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
    return fmt::format("the header {0}{1} beside it, or {0}{2} if that is not the header of another image",
                       plain, gzipped ? ".gz" : "", gzipped ? "" : ".gz");
}

/// Reads the pair to which `file` belongs. Messages about the header name the header's file.
Volume read_pair(const std::filesystem::path& file, bool is_image, const VolumeChoice& choice,
                 const SceneSizeLimits& limits) {
    const std::filesystem::path partner = partner_of(file);
    if (partner.empty() && is_image)
        throw BadInput(file.string(), "", "an image without its header", header_of(file));
    const std::string header = (is_image ? partner : file).string();
    std::ifstream stream = opened(header, is_image ? "the header of " + file.string() : "a volume file");
    const VolumeClaims claims = read_nifti(stream, header, is_image ? file : partner);
    if (is_image && claims.place.files.empty()) {
        throw BadInput(header, "magic", "the mark of a file that holds its voxels itself",
                       "the mark of a header whose voxels are in another file: in " + file.string());
    }
    return read_voxels(stream, claims, choice, limits);
}

}  // namespace

std::size_t bytes_of(ScalarType type) {
    return with_scalar(type, [](auto scalar) { return sizeof scalar; });
}

bool is_volume_name(const std::string& name) { return format_of(name, formats()) != nullptr; }

std::string volume_endings() { return endings_of(formats()); }

Volume read_volume(const std::filesystem::path& file, const VolumeChoice& choice,
                   const SceneSizeLimits& limits) {
    const std::string name = file.string();
    const Format* format = format_of(name, formats());
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
    const Kept kept{each * decided.kept.period, each * decided.kept.first, each * decided.kept.length};
    const std::string count_means =
        fmt::format("{} {} of {} as the header says", decided.scalars,
                    decided.scalars > decided.kept.length ? "values" : "voxels", claims.type_text);
    volume.data = read_data(stream, claims, each * decided.scalars, kept, count_means, volume.notes);
    if (claims.big_endian != (std::endian::native == std::endian::big)) {
        const auto size = std::ptrdiff_t(each);
        for (auto scalar = volume.data.begin(); scalar != volume.data.end(); scalar += size)
            std::reverse(scalar, scalar + size);
    }
    return std::move(volume);
}

std::filesystem::path partner_of(const std::filesystem::path& file) {
    const std::string name = file.string();
    const std::string lower = lower_case(name);
    const bool gzipped = lower.ends_with(".gz");
    const std::size_t dot = lower.rfind('.', lower.size() - (gzipped ? 4 : 1));
    if (dot == std::string::npos) return {};
    const std::string ending = lower.substr(dot, lower.size() - dot - (gzipped ? 3 : 0));
    const bool is_header = ending == ".hdr";
    if (!is_header && ending != ".img") return {};
    // The ending is first tried in capitals if the named file has capitals; a pair may also be x.IMG beside
    // x.hdr.
    const bool capitals = name[dot + 1] < 'a';
    // Finds x.hdr, x.img, x.hdr.gz or x.img.gz; empty if it does not exist.
    const auto found = [&](bool header, bool packed) -> std::filesystem::path {
        const std::string wanted = std::string(header ? ".hdr" : ".img") + (packed ? ".gz" : "");
        for (const bool in_capitals : {capitals, !capitals}) {
            const std::string path = name.substr(0, dot) + (in_capitals ? upper_case(wanted) : wanted);
            std::error_code error;
            if (std::filesystem::is_regular_file(path, error)) return path;
        }
        return {};
    };
    if (auto alike = found(!is_header, gzipped); !alike.empty()) return alike;
    // x.hdr gets x.img.gz only if there is no x.hdr.gz, the better partner of that image.
    return found(is_header, !gzipped).empty() ? found(!is_header, !gzipped) : std::filesystem::path{};
}

}  // namespace voxspring
