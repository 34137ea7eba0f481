// Reads MetaImage headers (.mha, .mhd): text whose last field says where the data is, behind it or in other
// files. Format: https://itk.org/Wiki/MetaIO/Documentation
#include <fmt/format.h>

#include <cmath>
#include <filesystem>
#include <glm/geometric.hpp>
#include <glm/vec3.hpp>
#include <limits>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "harness/base/bad_input.h"
#include "harness/volume/byte_stream.h"
#include "harness/volume/readers.h"
#include "harness/volume/text_header.h"
#include "harness/volume/volume.h"

namespace voxspring {
namespace {

constexpr int max_dimensions = 10;  // as in the reference implementation

struct Header : TextHeader {
    using TextHeader::TextHeader;
    std::vector<std::string> listed_files;  ///< files of "ElementDataFile = LIST"
};

bool is_list(const std::string& data_file) { return words(data_file + " .")[0] == "LIST"; }

/// Reads the header and leaves `stream` at the data.
Header read_header(std::istream& stream, const std::string& file) {
    Header header(file);
    HeaderLines lines(stream, file);
    while (header.find("ElementDataFile") == nullptr) {
        const auto line = lines.next();
        if (!line) {
            throw BadInput(file, "ElementDataFile", missing,
                           "LOCAL, the name of a file, or LIST with names of files below it");
        }
        if (trimmed(*line).empty()) continue;
        const auto equals = line->find_first_of("=:");
        if (equals == std::string::npos)
            throw BadInput(file, "header", *line, "lines of the form NAME = VALUE");
        header.add(trimmed(line->substr(0, equals)), trimmed(line->substr(equals + 1)));
    }
    if (is_list(header.require("ElementDataFile"))) {
        while (const auto line = lines.next()) {
            if (!trimmed(*line).empty()) header.listed_files.push_back(trimmed(*line));
        }
    }
    return header;
}

/// The value of the field, or `otherwise` if there is no such field.
bool flag(const TextHeader& header, const std::string& name, bool otherwise = false) {
    const std::string* text = header.find(name);
    if (text == nullptr) return otherwise;
    const std::string word = lower_case(*text);
    for (const std::string yes : {"true", "t", "1"}) {
        if (word == yes) return true;
    }
    for (const std::string no : {"false", "f", "0"}) {
        if (word == no) return false;
    }
    header.refuse(name, "True or False");
}

ScalarType scalar_type(const TextHeader& header) {
    // A MET_LONG has 4 bytes, whatever the size of a long on the machine that wrote it.
    static const std::map<std::string, ScalarType> types = {
        {"MET_CHAR", ScalarType::int8},       {"MET_UCHAR", ScalarType::uint8},
        {"MET_SHORT", ScalarType::int16},     {"MET_USHORT", ScalarType::uint16},
        {"MET_INT", ScalarType::int32},       {"MET_UINT", ScalarType::uint32},
        {"MET_LONG", ScalarType::int32},      {"MET_ULONG", ScalarType::uint32},
        {"MET_LONG_LONG", ScalarType::int64}, {"MET_ULONG_LONG", ScalarType::uint64},
        {"MET_FLOAT", ScalarType::float32},   {"MET_DOUBLE", ScalarType::float64},
    };
    const auto found = types.find(header.require("ElementType"));
    if (found == types.end()) {
        header.refuse("ElementType",
                      "MET_CHAR, MET_UCHAR, MET_SHORT, MET_USHORT, MET_INT, MET_UINT, MET_LONG, MET_ULONG, "
                      "MET_LONG_LONG, MET_ULONG_LONG, MET_FLOAT or MET_DOUBLE");
    }
    return found->second;
}

DataPlace data_place(const Header& header) {
    DataPlace place;
    place.encoding = flag(header, "CompressedData") ? Encoding::zlib : Encoding::raw;
    place.bytes_key = "HeaderSize";
    // HeaderSize counts from the start of the file, before decoding.
    const std::int64_t before = header.whole_number("HeaderSize", DataPlace::at_end);
    if (before == DataPlace::at_end) place.skipped_bytes = DataPlace::at_end;
    if (before > 0) place.begin = before;
    const std::string& data_file = header.require("ElementDataFile");
    if (data_file == "LOCAL" || data_file == "Local" || data_file == "local") return place;
    place.files_key = "ElementDataFile";
    const std::filesystem::path folder = std::filesystem::path(header.file()).parent_path();
    if (is_list(data_file)) {
        if (header.listed_files.empty())
            header.refuse("ElementDataFile", "LIST with names of files below it");
        for (const std::string& name : header.listed_files) place.files.push_back(folder / name);
    } else {
        if (data_file.empty() || data_file.find('%') != std::string::npos)
            header.refuse("ElementDataFile",
                          "LOCAL, the name of a file, or LIST with names of files below it");
        place.files.push_back(folder / data_file);
    }
    return place;
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

/// The value of the first of `names` that the header has; `found` is set to that name.
std::optional<std::string> first_of(const TextHeader& header, const std::vector<std::string>& names,
                                    std::string& found) {
    for (const std::string& name : names) {
        if (const std::string* text = header.find(name)) {
            found = name;
            return *text;
        }
    }
    return {};
}

std::optional<std::vector<double>> numbers_of(const std::string& text, std::size_t count) {
    std::vector<double> numbers;
    for (const std::string& word : words(text)) {
        const auto number = parse_number<double>(word);
        if (!number) return {};
        numbers.push_back(*number);
    }
    return numbers.size() == count ? std::optional(numbers) : std::nullopt;
}

/// Reads the axes of DimSize. Values of one voxel are not among them: the format gives them by a number of
/// channels.
std::vector<AxisClaim> read_axes(const TextHeader& header) {
    const auto dimensions = parse_number<int>(header.require("NDims"));
    if (!dimensions || *dimensions < 3 || *dimensions > max_dimensions)
        header.refuse("NDims", fmt::format("3 to {}", max_dimensions));
    const std::vector<std::string> list = words(header.require("DimSize"));
    std::vector<AxisClaim> axes(static_cast<std::size_t>(*dimensions));
    for (std::size_t a = 0; a < axes.size(); ++a) {
        const auto size = list.size() == axes.size() ? parse_number<std::int64_t>(list[a]) : std::nullopt;
        if (!size) header.refuse("DimSize", std::to_string(*dimensions) + " whole numbers");
        axes[a].name = "axis " + std::to_string(a + 1);
        axes[a].size = *size;
    }
    std::string field;
    if (const auto text = first_of(header, {"ElementSpacing", "ElementSize"}, field)) {
        const std::vector<std::string> distances = words(*text);
        for (std::size_t a = 0; a < axes.size(); ++a) {
            const auto distance = distances.size() == axes.size() ? parse_number<double>(distances[a])
                                                                  : std::optional<double>();
            axes[a].distance = distance.value_or(std::numeric_limits<double>::quiet_NaN());
            axes[a].distance_key = field;
            axes[a].distance_text = *text;
        }
    }
    if (const std::string* unit = header.find("DistanceUnits"); unit != nullptr && *unit != "?") {
        for (AxisClaim& axis : axes) axis.unit = *unit;
    }
    return axes;
}

/// The direction of an axis in the space LPS, from the letter of the side from which it comes.
std::optional<glm::dvec3> direction_from(char letter) {
    switch (letter) {
        case 'R':
            return glm::dvec3(1, 0, 0);
        case 'L':
            return glm::dvec3(-1, 0, 0);
        case 'A':
            return glm::dvec3(0, 1, 0);
        case 'P':
            return glm::dvec3(0, -1, 0);
        case 'I':
            return glm::dvec3(0, 0, 1);
        case 'S':
            return glm::dvec3(0, 0, -1);
        default:
            return {};
    }
}

/// Sets directions. The matrix has a row for each axis of the file, in LPS, as ITK reads it. Without a matrix
/// AnatomicalOrientation is used.
void place_axes(const TextHeader& header, VolumeClaims& claims) {
    std::string field;
    const std::size_t count = claims.axes.size();
    if (const auto text = first_of(header, {"TransformMatrix", "Rotation", "Orientation"}, field)) {
        const auto matrix = numbers_of(*text, count * count);
        if (!matrix) header.refuse(field, fmt::format("{} x {} numbers", count, count));
        for (std::size_t a = 0; a < count; ++a) {
            const auto row = matrix->begin() + std::ptrdiff_t(a * count);
            claims.axes[a].direction = glm::dvec3(row[0], row[1], row[2]);
        }
        claims.directions_key = field;
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
    if (const auto text = first_of(header, {"Offset", "Position", "Origin"}, field)) {
        const auto offset = numbers_of(*text, count);
        if (!offset) header.refuse(field, std::to_string(count) + " numbers");
        claims.origin = glm::dvec3((*offset)[0], (*offset)[1], (*offset)[2]);
    }
}

/// Adds the channels, whose values follow each other, as an axis before the others.
void add_channels(const TextHeader& header, VolumeClaims& claims) {
    const std::string* text = header.find("ElementNumberOfChannels");
    if (text == nullptr) return;
    const auto channels = parse_number<std::int64_t>(*text);
    if (!channels || *channels < 1) header.refuse("ElementNumberOfChannels", "a whole number of at least 1");
    if (*channels == 1) return;
    AxisClaim axis;
    axis.size = *channels;
    axis.kind = AxisKind::other;
    axis.name = "ElementNumberOfChannels";
    claims.axes.insert(claims.axes.begin(), axis);
}

}  // namespace

VolumeClaims read_metaimage_header(std::istream& stream, const std::string& file) {
    const Header header = read_header(stream, file);
    check_kind(header);
    VolumeClaims claims;
    claims.file = file;
    claims.sizes_key = claims.kinds_key = "DimSize";
    claims.kinds_text = header.require("DimSize");
    claims.axes = read_axes(header);
    place_axes(header, claims);
    add_channels(header, claims);
    claims.type = scalar_type(header);
    claims.type_text = header.require("ElementType");
    claims.big_endian = flag(header, "BinaryDataByteOrderMSB") || flag(header, "ElementByteOrderMSB");
    claims.slope = number(header, "ElementToIntensityFunctionSlope", 1);
    claims.intercept = number(header, "ElementToIntensityFunctionOffset", 0);
    if (claims.slope == 0) header.refuse("ElementToIntensityFunctionSlope", "a number other than 0");
    claims.place = data_place(header);
    return claims;
}

}  // namespace voxspring
