// Reads MetaImage headers (.mha, .mhd): text whose last field says whether the data is behind the header or
// in other files. Format: https://itk.org/Wiki/MetaIO/Documentation
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <glm/gtc/type_ptr.hpp>
#include <glm/vec3.hpp>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "harness/base/bad_input.h"
#include "harness/volume/claims.h"
#include "harness/volume/text_header.h"

namespace voxspring {
namespace {

constexpr int max_dimensions = 10;  // the limit of the reference implementation

const std::string data_file = "ElementDataFile";
const std::string accepted_files = "LOCAL, the name of a file, or LIST with names of files below it";

/// The value of the field, or `otherwise` if there is no such field.
bool flag(const TextHeader& header, const std::string& name, bool otherwise = false) {
    const std::string* text = header.find(name);
    if (text == nullptr) return otherwise;
    return header.choose<bool>(
        name, lower_case(*text),
        {{"true", true}, {"t", true}, {"1", true}, {"false", false}, {"f", false}, {"0", false}},
        "True or False");
}

/// Reads the header, leaves `stream` behind it, and sets `place` to where the data is.
TextHeader read_header(std::istream& stream, const std::string& file, DataPlace& place) {
    TextHeader header(file);
    HeaderLines lines(stream, file);
    while (header.find(data_file) == nullptr) {
        const auto line = lines.next();
        if (!line) throw BadInput(file, data_file, missing, accepted_files);
        if (trimmed(*line).empty()) continue;
        const auto equals = line->find_first_of("=:");
        if (equals == std::string::npos)
            throw BadInput(file, "header", *line, "lines of the form NAME = VALUE");
        header.add(trimmed(line->substr(0, equals)), trimmed(line->substr(equals + 1)));
    }
    place.encoding = flag(header, "CompressedData") ? Encoding::zlib : Encoding::raw;
    place.bytes_key = "HeaderSize";
    // HeaderSize counts from the start of the file, before decoding.
    const std::int64_t before = header.whole_number("HeaderSize", DataPlace::at_end);
    if (before == DataPlace::at_end) place.skipped_bytes = DataPlace::at_end;
    if (before > 0) place.begin = before;
    const std::string& name = header.require(data_file);
    if (name == "LOCAL" || name == "Local" || name == "local") return header;
    std::vector<std::string> listed;
    while (header.is_list(data_file)) {
        const auto line = lines.next();
        if (!line) break;
        if (!trimmed(*line).empty()) listed.push_back(trimmed(*line));
    }
    header.set_files(data_file, listed, accepted_files, place);
    return header;
}

ScalarType scalar_type(const TextHeader& header) {
    // A MET_LONG has 4 bytes, whatever the size of a long on the machine that wrote it.
    return header.choose<ScalarType>(
        "ElementType", header.require("ElementType"),
        {{"MET_CHAR", ScalarType::int8},
         {"MET_UCHAR", ScalarType::uint8},
         {"MET_SHORT", ScalarType::int16},
         {"MET_USHORT", ScalarType::uint16},
         {"MET_INT", ScalarType::int32},
         {"MET_UINT", ScalarType::uint32},
         {"MET_LONG", ScalarType::int32},
         {"MET_ULONG", ScalarType::uint32},
         {"MET_LONG_LONG", ScalarType::int64},
         {"MET_ULONG_LONG", ScalarType::uint64},
         {"MET_FLOAT", ScalarType::float32},
         {"MET_DOUBLE", ScalarType::float64}},
        "MET_CHAR, MET_UCHAR, MET_SHORT, MET_USHORT, MET_INT, MET_UINT, MET_LONG, MET_ULONG, "
        "MET_LONG_LONG, MET_ULONG_LONG, MET_FLOAT or MET_DOUBLE");
}

/// Refuses kinds of files whose voxels this reader would misunderstand.
void check_kind(const TextHeader& header) {
    const std::string* type = header.find("ObjectType");
    if (type != nullptr && lower_case(*type) != "image") header.refuse("ObjectType", "Image");
    if (!flag(header, "BinaryData", true)) header.refuse("BinaryData", "True: voxels as bytes, not as text");
}

/// The value of the field, or `otherwise` if there is no such field.
double number(const TextHeader& header, const std::string& name, double otherwise) {
    const std::string* text = header.find(name);
    if (text == nullptr) return otherwise;
    const auto value = parse_number<double>(*text);
    if (!value || !std::isfinite(*value)) header.refuse(name, "a number");
    return *value;
}

/// The first of `names` that the header has a field for; empty if there is none.
std::string first_of(const TextHeader& header, const std::vector<std::string>& names) {
    const auto found = std::find_if(names.begin(), names.end(),
                                    [&](const std::string& name) { return header.find(name) != nullptr; });
    return found == names.end() ? std::string() : *found;
}

/// The direction, in the space LPS, of an axis that begins at the side with this letter; nullopt for other
/// letters.
std::optional<glm::dvec3> direction_from(char letter) {
    static const std::map<char, glm::dvec3> directions = {{'R', {1, 0, 0}}, {'L', {-1, 0, 0}},
                                                          {'A', {0, 1, 0}}, {'P', {0, -1, 0}},
                                                          {'I', {0, 0, 1}}, {'S', {0, 0, -1}}};
    const auto found = directions.find(letter);
    return found == directions.end() ? std::nullopt : std::optional(found->second);
}

/// Sets the directions of the axes and the origin. The header's matrix has a row for each axis of the file,
/// in LPS, as ITK reads it. Without a matrix the field AnatomicalOrientation gives the directions.
void place_axes(const TextHeader& header, VolumeClaims& claims) {
    const std::size_t count = claims.axes.size();
    claims.directions_key = first_of(header, {"TransformMatrix", "Rotation", "Orientation"});
    if (!claims.directions_key.empty()) {
        const auto matrix = numbers_of(header.require(claims.directions_key), count * count);
        if (!matrix) header.refuse(claims.directions_key, fmt::format("{} x {} numbers", count, count));
        for (std::size_t a = 0; a < count; ++a)
            claims.axes[a].direction = glm::make_vec3(&(*matrix)[a * count]);
        claims.space = "LPS";
    }
    const std::string* letters = header.find("AnatomicalOrientation");
    if (letters != nullptr && letters->size() >= 3) {
        bool differs = false;
        for (std::size_t a = 0; a < 3; ++a) {
            const auto direction = direction_from(upper_case(*letters)[a]);
            if (!direction) continue;
            if (claims.directions_key.empty() || claims.directions_key == "AnatomicalOrientation") {
                claims.axes[a].direction = direction;
                claims.directions_key = "AnatomicalOrientation";
                claims.space = "LPS";
            } else {
                differs = differs || glm::dot(*direction, *claims.axes[a].direction) <= 0;
            }
        }
        if (differs) {
            claims.notes.push_back(fmt::format("AnatomicalOrientation {} contradicts {}, which is followed",
                                               *letters, claims.directions_key));
        }
    }
    if (const std::string field = first_of(header, {"Offset", "Position", "Origin"}); !field.empty()) {
        const auto offset = numbers_of(header.require(field), count);
        if (!offset) header.refuse(field, std::to_string(count) + " numbers");
        claims.origin = glm::make_vec3(offset->data());
    }
}

}  // namespace

VolumeClaims read_metaimage(std::istream& stream, const std::string& file) {
    VolumeClaims claims;
    const TextHeader header = read_header(stream, file, claims.place);
    check_kind(header);
    claims.file = file;
    claims.sizes_key = claims.kinds_key = "DimSize";
    claims.kinds_text = header.require("DimSize");
    claims.axes = header.axes("NDims", max_dimensions, "DimSize");
    header.set_distances(first_of(header, {"ElementSpacing", "ElementSize"}), claims.axes);
    if (const std::string* unit = header.find("DistanceUnits"); unit != nullptr && *unit != "?") {
        for (AxisClaim& axis : claims.axes) axis.unit = *unit;
    }
    place_axes(header, claims);
    // The values of one voxel follow each other, so they form an axis that is faster than all others.
    const std::string channels = "ElementNumberOfChannels";
    if (const std::int64_t count = header.whole_number(channels, 1); count > 1)
        claims.axes.insert(claims.axes.begin(), {count, AxisKind::other, channels});
    claims.type = scalar_type(header);
    claims.type_text = header.require("ElementType");
    claims.big_endian = flag(header, "BinaryDataByteOrderMSB") || flag(header, "ElementByteOrderMSB");
    claims.slope = number(header, "ElementToIntensityFunctionSlope", 1);
    claims.intercept = number(header, "ElementToIntensityFunctionOffset", 0);
    if (claims.slope == 0) header.refuse("ElementToIntensityFunctionSlope", "a number other than 0");
    return claims;
}

}  // namespace voxspring
