// MetaImage (.mha, .mhd): a text header whose last field says where the data is, behind it or in other files.
// Format: https://itk.org/Wiki/MetaIO/Documentation
#include <array>
#include <filesystem>
#include <map>

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
    std::vector<std::string> listed_files;  ///< of "ElementDataFile = LIST"
};

bool is_list(const std::string& data_file) { return words(data_file + " .")[0] == "LIST"; }

/// Leaves `stream` at the data.
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

/// False where there is no such field.
bool flag(const TextHeader& header, const std::string& name) {
    const std::string* text = header.find(name);
    if (text == nullptr) return false;
    const std::string word = lower_case(*text);
    if (word != "true" && word != "false") header.refuse(name, "True or False");
    return word == "true";
}

ScalarType scalar_type(const TextHeader& header) {
    // A MET_LONG has 4 bytes, whatever a long has where it was written.
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
    if (flag(header, "CompressedData")) place.encoding = Encoding::zlib;
    place.bytes_key = "HeaderSize";
    place.skipped_bytes = header.whole_number("HeaderSize", DataPlace::at_end);
    if (place.skipped_bytes == DataPlace::at_end && place.encoding != Encoding::raw)
        header.refuse("HeaderSize", "0 or more: -1 is for raw data");
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

/// Refuses what would have to be understood for the voxels to be right.
void check_kind(const TextHeader& header) {
    const auto expect = [&](const std::string& name, const std::string& value, const std::string& why) {
        const std::string* text = header.find(name);
        if (text != nullptr && lower_case(*text) != lower_case(value)) header.refuse(name, value + why);
    };
    expect("ObjectType", "Image", "");
    expect("BinaryData", "True", ": voxels as bytes, not as text");
    expect("ElementNumberOfChannels", "1", ": a volume has one value a voxel");
    expect("ElementToIntensityFunctionSlope", "1", ": voxels are taken as they are");
    expect("ElementToIntensityFunctionOffset", "0", ": voxels are taken as they are");
}

struct Grid {
    GridSides sides{1};
    glm::dvec3 spacing{1};
};

Grid read_grid(const TextHeader& header) {
    const auto dimensions = parse_number<int>(header.require("NDims"));
    if (!dimensions || *dimensions < 3 || *dimensions > max_dimensions)
        header.refuse("NDims", "3, or more where all further sizes are 1");
    const std::vector<std::string> list = words(header.require("DimSize"));
    std::vector<std::int64_t> sizes;
    for (const std::string& word : list) {
        const auto size = parse_number<std::int64_t>(word);
        if (!size) break;
        sizes.push_back(*size);
    }
    std::optional<std::array<std::size_t, 3>> axes;
    if (list.size() == std::size_t(*dimensions) && sizes.size() == list.size()) axes = axes_of_space(sizes);
    if (!axes) header.refuse("DimSize", sizes_accepted(*dimensions));

    const std::string field = header.find("ElementSpacing") != nullptr ? "ElementSpacing" : "ElementSize";
    std::vector<std::string> distances;
    if (header.find(field) != nullptr) {
        distances = words(header.require(field));
        if (distances.size() != sizes.size())
            header.refuse(field, std::to_string(*dimensions) + " distances between voxels");
    }
    Grid grid;
    for (int a = 0; a < 3; ++a) {
        const std::size_t axis = (*axes)[std::size_t(a)];
        grid.sides[a] = sizes[axis];
        if (distances.empty()) continue;
        grid.spacing[a] = parse_number<double>(distances[axis]).value_or(0);
        if (!is_spacing(grid.spacing[a]))
            header.refuse(field, "a positive distance between voxels along each axis");
    }
    return grid;
}

}  // namespace

Volume read_metaimage(std::istream& stream, const std::string& file, const SceneSizeLimits& limits) {
    const Header header = read_header(stream, file);
    check_kind(header);
    Volume volume;
    volume.file = file;
    const Grid grid = read_grid(header);
    const std::uint64_t voxels = checked_voxel_count(grid.sides, limits, file, "DimSize");
    volume.dims = glm::ivec3(grid.sides);
    volume.spacing = grid.spacing;
    volume.type = scalar_type(header);
    const bool big_endian = flag(header, "BinaryDataByteOrderMSB") || flag(header, "ElementByteOrderMSB");
    volume.data = read_data(
        stream, file, data_place(header), voxels * bytes_of(volume.type), "data",
        std::to_string(voxels) + " voxels of " + header.require("ElementType") + " as the header says");
    to_native_order(volume.data, volume.type, big_endian);
    return volume;
}

}  // namespace voxspring
