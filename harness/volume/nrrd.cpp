// NRRD: a text header, then the data: behind an empty line in the same file, or in files that it names.
// Format: https://teem.sourceforge.net/nrrd/format.html
#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <glm/geometric.hpp>
#include <map>
#include <optional>

#include "harness/base/bad_input.h"
#include "harness/volume/byte_stream.h"
#include "harness/volume/readers.h"
#include "harness/volume/text_header.h"
#include "harness/volume/volume.h"

namespace voxspring {
namespace {

constexpr int max_dimensions = 16;  // as in the reference implementation
const std::string directions_key = "space directions";

struct Header : TextHeader {
    using TextHeader::TextHeader;
    std::vector<std::string> listed_files;  ///< of "data file: LIST"
};

bool is_list(const std::string& data_file) { return words(data_file + " .")[0] == "LIST"; }

/// Leaves `stream` at the data.
Header read_header(std::istream& stream, const std::string& file) {
    Header header(file);
    HeaderLines lines(stream, file);
    const std::string magic = lines.next().value_or("");
    if (magic.size() != 8 || magic.compare(0, 7, "NRRD000") != 0 || magic[7] < '1' || magic[7] > '6')
        throw BadInput(file, "magic", magic, "NRRD0001 to NRRD0006");
    for (auto line = lines.next(); !line || !line->empty(); line = lines.next()) {
        const std::string* data_file = header.find("data file");
        if (!line) {
            if (data_file != nullptr) break;
            throw BadInput(file, "header", "a file that ends within it", "an empty line before the data");
        }
        if (data_file != nullptr && is_list(*data_file)) {
            header.listed_files.push_back(trimmed(*line));
            continue;
        }
        // Comments and key/value pairs say nothing that is needed here.
        if (line->front() == '#' || line->find(":=") != std::string::npos) continue;
        const auto colon = line->find(':');
        if (colon == std::string::npos)
            throw BadInput(file, "header", *line, "lines of the form FIELD: VALUE");
        const std::string name = lower_case(line->substr(0, colon));
        header.add(name == "datafile" ? "data file" : name, trimmed(line->substr(colon + 1)));
    }
    return header;
}

ScalarType scalar_type(const TextHeader& header) {
    static const std::map<std::string, ScalarType> types = {
        {"signed char", ScalarType::int8},
        {"int8", ScalarType::int8},
        {"int8_t", ScalarType::int8},
        {"uchar", ScalarType::uint8},
        {"unsigned char", ScalarType::uint8},
        {"uint8", ScalarType::uint8},
        {"uint8_t", ScalarType::uint8},
        {"short", ScalarType::int16},
        {"short int", ScalarType::int16},
        {"signed short", ScalarType::int16},
        {"signed short int", ScalarType::int16},
        {"int16", ScalarType::int16},
        {"int16_t", ScalarType::int16},
        {"ushort", ScalarType::uint16},
        {"unsigned short", ScalarType::uint16},
        {"unsigned short int", ScalarType::uint16},
        {"uint16", ScalarType::uint16},
        {"uint16_t", ScalarType::uint16},
        {"int", ScalarType::int32},
        {"signed int", ScalarType::int32},
        {"int32", ScalarType::int32},
        {"int32_t", ScalarType::int32},
        {"uint", ScalarType::uint32},
        {"unsigned int", ScalarType::uint32},
        {"uint32", ScalarType::uint32},
        {"uint32_t", ScalarType::uint32},
        {"longlong", ScalarType::int64},
        {"long long", ScalarType::int64},
        {"long long int", ScalarType::int64},
        {"signed long long", ScalarType::int64},
        {"signed long long int", ScalarType::int64},
        {"int64", ScalarType::int64},
        {"int64_t", ScalarType::int64},
        {"ulonglong", ScalarType::uint64},
        {"unsigned long long", ScalarType::uint64},
        {"unsigned long long int", ScalarType::uint64},
        {"uint64", ScalarType::uint64},
        {"uint64_t", ScalarType::uint64},
        {"float", ScalarType::float32},
        {"double", ScalarType::float64},
    };
    const auto found = types.find(lower_case(header.require("type")));
    if (found == types.end()) {
        header.refuse("type", "int8, uint8, int16, uint16, int32, uint32, int64, uint64, float or double");
    }
    return found->second;
}

Encoding encoding(const TextHeader& header) {
    const std::string name = lower_case(header.require("encoding"));
    if (name == "raw") return Encoding::raw;
    if (name == "gzip" || name == "gz") return Encoding::gzip;
    if (name == "bzip2" || name == "bz2") return Encoding::bzip2;
    header.refuse("encoding", "raw, gzip or bzip2");
}

DataPlace data_place(const Header& header) {
    DataPlace place;
    place.encoding = encoding(header);
    place.skipped_lines = header.whole_number("line skip", 0);
    place.skipped_bytes = header.whole_number("byte skip", DataPlace::at_end);
    if (place.skipped_bytes == DataPlace::at_end && place.encoding != Encoding::raw)
        header.refuse("byte skip", "0 or more: -1 is for raw data");
    const std::string* data_file = header.find("data file");
    if (data_file == nullptr) return place;
    place.files_key = "data file";
    const std::filesystem::path folder = std::filesystem::path(header.file()).parent_path();
    if (is_list(*data_file)) {
        if (header.listed_files.empty()) header.refuse("data file", "LIST with names of files below it");
        for (const std::string& name : header.listed_files) place.files.push_back(folder / name);
    } else {
        if (data_file->empty() || data_file->find('%') != std::string::npos)
            header.refuse("data file", "the name of a file, or LIST with names of files below it");
        place.files.push_back(folder / *data_file);
    }
    return place;
}

/// "(1,0,0) (0,1,0) none": one vector an axis.
std::vector<std::optional<glm::dvec3>> space_directions(const TextHeader& header) {
    const std::string accepted = "a vector (x,y,z) for each axis of space";
    const std::string& text = header.require(directions_key);
    std::vector<std::optional<glm::dvec3>> directions;
    for (std::size_t at = text.find_first_not_of(" \t"); at != std::string::npos;
         at = text.find_first_not_of(" \t", at)) {
        if (text.compare(at, 4, "none") == 0) {
            directions.emplace_back();
            at += 4;
            continue;
        }
        const auto end = text.find(')', at);
        if (text[at] != '(' || end == std::string::npos) header.refuse(directions_key, accepted);
        std::string vector = text.substr(at + 1, end - at - 1);
        glm::dvec3 direction{0};
        for (int component = 0; component < 3; ++component) {
            const auto comma = component < 2 ? vector.find(',') : vector.size();
            const auto number =
                comma == std::string::npos ? std::nullopt : parse_number<double>(vector.substr(0, comma));
            if (!number) header.refuse(directions_key, accepted);
            direction[component] = *number;
            vector.erase(0, comma + 1);
        }
        directions.emplace_back(direction);
        at = end + 1;
    }
    return directions;
}

/// An axis of the file.
struct Axis {
    std::size_t index = 0;  ///< in the file
    std::int64_t size = 0;
    std::optional<glm::dvec3> direction{};
    bool is_of_space = true;
    std::string why_not{};  ///< of space: the field that says so
};

/// What `kinds` calls an axis along which voxels lie; "???" and "none" are axes of an unknown kind.
bool is_kind_of_space(const std::string& kind) {
    return kind == "domain" || kind == "space" || kind == "???" || kind == "none";
}

std::vector<Axis> read_axes(const TextHeader& header) {
    const auto dimension = parse_number<int>(header.require("dimension"));
    if (!dimension || *dimension < 3 || *dimension > max_dimensions)
        header.refuse("dimension", "3, or more where all further sizes are 1");
    std::vector<Axis> axes(static_cast<std::size_t>(*dimension));
    const std::vector<std::string> sizes = words(header.require("sizes"));
    for (std::size_t a = 0; a < axes.size(); ++a) {
        const auto size = sizes.size() == axes.size() ? parse_number<std::int64_t>(sizes[a]) : std::nullopt;
        if (!size) header.refuse("sizes", sizes_accepted(*dimension));
        axes[a].index = a;
        axes[a].size = *size;
    }
    if (const std::string* kinds = header.find("kinds")) {
        const std::vector<std::string> list = words(*kinds);
        if (list.size() != axes.size())
            header.refuse("kinds", std::to_string(*dimension) + " words, one for each axis");
        for (std::size_t a = 0; a < axes.size(); ++a) {
            if (is_kind_of_space(lower_case(list[a]))) continue;
            axes[a].is_of_space = false;
            axes[a].why_not = "kinds";
        }
    }
    if (header.find(directions_key) != nullptr) {
        const auto directions = space_directions(header);
        if (directions.size() != axes.size())
            header.refuse(directions_key, "a vector (x,y,z) for each axis of space");
        for (std::size_t a = 0; a < axes.size(); ++a) {
            axes[a].direction = directions[a];
            if (directions[a]) continue;
            axes[a].is_of_space = false;
            axes[a].why_not = directions_key;
        }
    }
    return axes;
}

/// Those of the axes that are x, y and z of the grid.
std::array<Axis, 3> grid_axes(const TextHeader& header, const std::vector<Axis>& axes) {
    std::vector<std::int64_t> sizes;
    std::vector<bool> is_of_space;
    for (const Axis& axis : axes) {
        if (!axis.is_of_space && axis.size != 1) {
            header.refuse(axis.why_not, axis.why_not == directions_key
                                            ? "a vector (x,y,z) for each axis of space"
                                            : "domain or space for the 3 axes of a volume, and a size of 1 "
                                              "along any other: it has one value a voxel");
        }
        sizes.push_back(axis.size);
        is_of_space.push_back(axis.is_of_space);
    }
    const auto chosen = axes_of_space(sizes, is_of_space);
    if (!chosen) header.refuse("sizes", sizes_accepted(int(axes.size())));
    return {axes[(*chosen)[0]], axes[(*chosen)[1]], axes[(*chosen)[2]]};
}

void check_right_angles(const TextHeader& header, const std::array<Axis, 3>& axes) {
    for (std::size_t a = 0; a < 3; ++a) {
        const auto& one = axes[a].direction;
        const auto& other = axes[(a + 1) % 3].direction;
        if (!one || !other) continue;
        const double cosine = glm::dot(*one, *other) / (glm::length(*one) * glm::length(*other));
        // What is left of a right angle in a header written with a few digits.
        if (!(std::abs(cosine) < 1e-3)) header.refuse(directions_key, "axes at right angles");
    }
}

glm::dvec3 spacing(const TextHeader& header, const std::vector<Axis>& all, const std::array<Axis, 3>& axes) {
    glm::dvec3 lengths(1);
    const bool by_directions = header.find(directions_key) != nullptr;
    if (!by_directions && header.find("spacings") == nullptr) return lengths;
    const std::string& field = by_directions ? directions_key : "spacings";
    std::vector<std::string> list;
    if (!by_directions) list = words(header.require("spacings"));
    const bool complete = by_directions || list.size() == all.size();
    for (int a = 0; a < 3; ++a) {
        const Axis& axis = axes[std::size_t(a)];
        if (!axis.is_of_space) continue;
        if (by_directions) {
            lengths[a] = glm::length(*axis.direction);
        } else {
            lengths[a] = complete ? parse_number<double>(list[axis.index]).value_or(0) : 0;
        }
        if (!is_spacing(lengths[a]))
            header.refuse(field, "a positive distance between voxels along each axis");
    }
    if (by_directions) check_right_angles(header, axes);
    return lengths;
}

/// Whether the most significant byte of a scalar comes first.
bool is_big_endian(const TextHeader& header, ScalarType type) {
    if (bytes_of(type) == 1) return false;
    const std::string order = lower_case(header.require("endian"));
    if (order != "little" && order != "big") header.refuse("endian", "little or big");
    return order == "big";
}

}  // namespace

Volume read_nrrd(std::istream& stream, const std::string& file, const SceneSizeLimits& limits) {
    const Header header = read_header(stream, file);
    Volume volume;
    volume.file = file;
    const std::vector<Axis> all = read_axes(header);
    const std::array<Axis, 3> axes = grid_axes(header, all);
    const GridSides sides(axes[0].size, axes[1].size, axes[2].size);
    const std::uint64_t voxels = checked_voxel_count(sides, limits, file, "sizes");
    volume.dims = glm::ivec3(sides);
    volume.type = scalar_type(header);
    volume.spacing = spacing(header, all, axes);
    const bool big_endian = is_big_endian(header, volume.type);
    volume.data = read_data(
        stream, file, data_place(header), voxels * bytes_of(volume.type), "data",
        std::to_string(voxels) + " voxels of type " + header.require("type") + " as the header says");
    to_native_order(volume.data, volume.type, big_endian);
    return volume;
}

}  // namespace voxspring
