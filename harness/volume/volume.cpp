#include "harness/volume/volume.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <limits>
#include <map>

#include "harness/base/bad_input.h"
#include "harness/volume/readers.h"

namespace voxspring {
namespace {

/// Calls `use(first)` with a pointer to the scalars of `volume`, whatever their type.
template <class Use>
void visit_scalars(const Volume& volume, const Use& use) {
    // operator new aligns for every scalar type.
    const void* first = volume.data.data();
    switch (volume.type) {
        case ScalarType::int8:
            return use(static_cast<const std::int8_t*>(first));
        case ScalarType::uint8:
            return use(static_cast<const std::uint8_t*>(first));
        case ScalarType::int16:
            return use(static_cast<const std::int16_t*>(first));
        case ScalarType::uint16:
            return use(static_cast<const std::uint16_t*>(first));
        case ScalarType::int32:
            return use(static_cast<const std::int32_t*>(first));
        case ScalarType::uint32:
            return use(static_cast<const std::uint32_t*>(first));
        case ScalarType::int64:
            return use(static_cast<const std::int64_t*>(first));
        case ScalarType::uint64:
            return use(static_cast<const std::uint64_t*>(first));
        case ScalarType::float32:
            return use(static_cast<const float*>(first));
        case ScalarType::float64:
            return use(static_cast<const double*>(first));
    }
}

/// Calls `use(voxel, value)` for every voxel in order.
template <class Use>
void for_each_value(const Volume& volume, const Use& use) {
    const std::size_t count = volume.data.size() / bytes_of(volume.type);
    visit_scalars(volume, [&](const auto* scalar) {
        for (std::size_t voxel = 0; voxel < count; ++voxel)
            use(voxel, volume.slope * double(scalar[voxel]) + volume.intercept);
    });
}

VoxelGrid inactive_grid(const Volume& volume) {
    return {volume.dims, volume.spacing,
            std::vector<std::uint8_t>(volume.data.size() / bytes_of(volume.type))};
}

/// The distinct values other than zero, which must be at most 255 whole numbers.
std::vector<std::int64_t> occurring_labels(const Volume& volume) {
    std::vector<std::int64_t> labels;
    double latest = 0;  // neighbouring voxels mostly carry the same label
    for_each_value(volume, [&](std::size_t voxel, double value) {
        if (value == latest || value == 0) return;
        if (!(std::abs(value) <= double(max_label)) || std::floor(value) != value) {
            throw BadInput(volume.file, "voxel " + std::to_string(voxel), fmt::format("{:g}", value),
                           "whole numbers where materials are given per label");
        }
        latest = value;
        const auto label = static_cast<std::int64_t>(value);
        const auto place = std::lower_bound(labels.begin(), labels.end(), label);
        if (place != labels.end() && *place == label) return;
        labels.insert(place, label);
        if (labels.size() > max_labels) {
            throw BadInput(volume.file, "labels", "more than " + std::to_string(max_labels) + " labels",
                           "a list of those to use");
        }
    });
    return labels;
}

struct Format {
    std::string_view ending;
    Volume (*read)(std::istream&, const std::string&, const SceneSizeLimits&) = nullptr;
    bool is_image = false;  ///< of a pair, whose header is read first
};

const std::vector<Format>& formats() {
    static const std::vector<Format> all = {
        {".nii", read_nifti},     {".nii.gz", read_nifti},    {".hdr", read_nifti},
        {".hdr.gz", read_nifti},  {".img", read_nifti, true}, {".img.gz", read_nifti, true},
        {".nrrd", read_nrrd},     {".nhdr", read_nrrd},       {".mha", read_metaimage},
        {".mhd", read_metaimage},
    };
    return all;
}

/// Null for a name that is no volume's.
const Format* format_of(const std::string& name) {
    const auto found = std::find_if(formats().begin(), formats().end(),
                                    [&](const Format& format) { return name.ends_with(format.ending); });
    return found == formats().end() ? nullptr : &*found;
}

/// The header that belongs to x.img or x.img.gz: x.hdr, or x.hdr.gz where only that is there.
std::string header_of_image(const std::string& image) {
    const std::string plain = image.substr(0, image.rfind(".img")) + ".hdr";
    std::error_code error;
    const bool packed = !std::filesystem::is_regular_file(plain, error) &&
                        std::filesystem::is_regular_file(plain + ".gz", error);
    return packed ? plain + ".gz" : plain;
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

Volume read_volume(const std::filesystem::path& file, const SceneSizeLimits& limits) {
    const std::string name = file.string();
    const Format* format = format_of(name);
    if (format == nullptr) {
        throw BadInput(name, "file name", file.filename().string(),
                       "a volume file, whose name ends in " + volume_endings());
    }
    const std::string header = format->is_image ? header_of_image(name) : name;
    require_regular_file(header, format->is_image ? "the header of " + name : "a volume file");
    std::ifstream stream(header, std::ios::binary);
    if (!stream) throw BadInput(header, "", "an unreadable file", "a file that can be read");
    return format->read(stream, header, limits);
}

LabelledGrid above_threshold(const Volume& volume, double threshold) {
    LabelledGrid result{inactive_grid(volume), {1}};
    double largest = -std::numeric_limits<double>::infinity();
    bool any = false;
    for_each_value(volume, [&](std::size_t voxel, double value) {
        if (value > threshold) {
            result.grid.label[voxel] = 1;
            any = true;
        } else if (value > largest) {
            largest = value;
        }
    });
    if (!any) {
        throw BadInput(volume.file, "threshold", fmt::format("{:g}", threshold),
                       "one below the largest value in the volume, " + fmt::format("{:g}", largest) +
                           ", so that some voxel is active");
    }
    return result;
}

LabelledGrid with_labels(const Volume& volume, const std::optional<std::vector<std::int64_t>>& labels) {
    LabelledGrid result{inactive_grid(volume), labels ? *labels : occurring_labels(volume)};
    if (result.labels.empty())
        throw BadInput(volume.file, "labels", "a volume of zeros", "a label that some voxel carries");
    std::sort(result.labels.begin(), result.labels.end());

    std::map<double, std::uint8_t> material;  // counted from 1
    for (const std::int64_t label : result.labels)
        material.emplace(double(label), std::uint8_t(material.size() + 1));
    std::vector<bool> occurs(material.size() + 1);
    double latest = std::numeric_limits<double>::quiet_NaN();
    std::uint8_t latest_material = 0;
    for_each_value(volume, [&](std::size_t voxel, double value) {
        if (value != latest) {
            const auto found = std::isnan(value) ? material.end() : material.find(value);
            latest_material = found == material.end() ? std::uint8_t{0} : found->second;
            occurs[latest_material] = true;
            latest = value;
        }
        result.grid.label[voxel] = latest_material;
    });
    for (std::size_t m = 0; m < result.labels.size(); ++m) {
        if (!occurs[m + 1]) {
            throw BadInput(volume.file, "labels", std::to_string(result.labels[m]),
                           "labels that some voxel carries");
        }
    }
    return result;
}

}  // namespace voxspring
