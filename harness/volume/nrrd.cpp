// Reads NRRD headers. They are text, and the data follows behind an empty line or is in files that the header
// names. Format: https://teem.sourceforge.net/nrrd/format.html
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <glm/geometric.hpp>
#include <glm/vec3.hpp>
#include <limits>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

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
    std::vector<std::string> listed_files;    ///< files of "data file: LIST"
    std::map<std::string, std::string> said;  ///< keys and values, "key:=value"
};

bool is_list(const std::string& data_file) { return words(data_file + " .")[0] == "LIST"; }

/// Reads the header and leaves `stream` at the data.
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
        if (line->front() == '#') continue;
        if (const auto assigned = line->find(":="); assigned != std::string::npos) {
            header.said.emplace(trimmed(line->substr(0, assigned)), trimmed(line->substr(assigned + 2)));
            continue;
        }
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

/// Parses "(1,0,0) (0,1,0) none": one vector per axis, or none.
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
        // Some programs write "none" as a vector of NaN.
        const bool is_none = std::isnan(direction.x) && std::isnan(direction.y) && std::isnan(direction.z);
        directions.push_back(is_none ? std::nullopt : std::optional(direction));
        at = end + 1;
    }
    return directions;
}

/// Sets the kind of `axis` from the file's text for it. Domains and axes of unknown kind may be of space.
void apply_kind(AxisClaim& axis, const std::string& kind) {
    if (kind == "domain" || kind == "???" || kind == "none") return;
    axis.kind = kind == "space" ? AxisKind::space : AxisKind::other;
    if (axis.kind == AxisKind::other) axis.name += " (" + kind + ")";
}

/// Parses `"mm" "mm" "um"`, one text per axis.
std::vector<std::string> quoted_texts(const std::string& text) {
    std::vector<std::string> list;
    for (auto from = text.find('"'); from != std::string::npos;) {
        const auto to = text.find('"', from + 1);
        if (to == std::string::npos) break;
        list.push_back(trimmed(text.substr(from + 1, to - from - 1)));
        from = text.find('"', to + 1);
    }
    return list;
}

void read_distances(const TextHeader& header, std::vector<AxisClaim>& axes) {
    const std::string* text = header.find("spacings");
    if (header.find(directions_key) != nullptr || text == nullptr) return;
    const std::vector<std::string> list = words(*text);
    for (std::size_t a = 0; a < axes.size(); ++a) {
        const auto distance =
            list.size() == axes.size() ? parse_number<double>(list[a]) : std::optional<double>();
        axes[a].distance = distance.value_or(std::numeric_limits<double>::quiet_NaN());
        axes[a].distance_key = "spacings";
        axes[a].distance_text = *text;
    }
}

/// Reads directions. Axes with a vector are of space, those without are not.
void read_directions(const TextHeader& header, std::vector<AxisClaim>& axes) {
    const std::string* text = header.find(directions_key);
    if (text == nullptr) return;
    const auto directions = space_directions(header);
    if (directions.size() != axes.size())
        header.refuse(directions_key, "a vector (x,y,z) for each axis of space");
    for (std::size_t a = 0; a < axes.size(); ++a) {
        if (axes[a].kind == AxisKind::other) continue;
        axes[a].kind = directions[a] ? AxisKind::space : AxisKind::other;
        if (!directions[a]) continue;
        axes[a].direction = directions[a];
        axes[a].distance = glm::length(*directions[a]);
        axes[a].distance_key = directions_key;
        axes[a].distance_text = *text;
    }
}

/// Reads units. "space units" has one per axis of the space, "units" one per axis of the file.
void read_units(const TextHeader& header, std::vector<AxisClaim>& axes) {
    if (const std::string* text = header.find("units")) {
        const auto list = quoted_texts(*text);
        if (list.size() == axes.size()) {
            for (std::size_t a = 0; a < axes.size(); ++a) axes[a].unit = list[a];
        }
    }
    if (const std::string* text = header.find("space units")) {
        const auto list = quoted_texts(*text);
        // A direction mixes the axes of the space, so that a unit can be used only if all of them have the
        // same.
        const bool same =
            !list.empty() && std::count(list.begin(), list.end(), list[0]) == std::ptrdiff_t(list.size());
        std::size_t next = 0;
        for (AxisClaim& axis : axes) {
            if (axis.direction && !list.empty())
                axis.unit = same ? list[0] : list[std::min(next++, list.size() - 1)];
        }
    }
}

std::vector<AxisClaim> read_axes(const TextHeader& header, VolumeClaims& claims) {
    const auto dimension = parse_number<int>(header.require("dimension"));
    if (!dimension || *dimension < 3 || *dimension > max_dimensions)
        header.refuse("dimension", fmt::format("3 to {}", max_dimensions));
    std::vector<AxisClaim> axes(static_cast<std::size_t>(*dimension));
    const std::vector<std::string> sizes = words(header.require("sizes"));
    for (std::size_t a = 0; a < axes.size(); ++a) {
        const auto size = sizes.size() == axes.size() ? parse_number<std::int64_t>(sizes[a]) : std::nullopt;
        if (!size) header.refuse("sizes", std::to_string(*dimension) + " whole numbers");
        axes[a].name = "axis " + std::to_string(a + 1);
        axes[a].size = *size;
    }
    claims.kinds_key = "sizes";
    claims.kinds_text = header.require("sizes");
    if (const std::string* kinds = header.find("kinds")) {
        const std::vector<std::string> list = words(*kinds);
        if (list.size() != axes.size())
            header.refuse("kinds", std::to_string(*dimension) + " words, one for each axis");
        for (std::size_t a = 0; a < axes.size(); ++a) apply_kind(axes[a], lower_case(list[a]));
        claims.kinds_key = "kinds";
        claims.kinds_text = *kinds;
    }
    read_distances(header, axes);
    read_directions(header, axes);
    if (header.find(directions_key) != nullptr) {
        claims.kinds_key = directions_key;
        claims.kinds_text = header.require(directions_key);
    }
    read_units(header, axes);
    return axes;
}

/// The sides towards which the coordinates of the file's space grow; empty for a space without anatomy.
std::string space_of(const TextHeader& header) {
    const std::string* text = header.find("space");
    if (text == nullptr) return {};
    std::string name = lower_case(*text);
    for (const std::string time : {"-time", "t"}) {
        if (name.size() > 3 && name.ends_with(time)) name.resize(name.size() - time.size());
    }
    static const std::map<std::string, std::string> spaces = {
        {"right-anterior-superior", "RAS"}, {"ras", "RAS"}, {"left-anterior-superior", "LAS"}, {"las", "LAS"},
        {"left-posterior-superior", "LPS"}, {"lps", "LPS"}};
    const auto found = spaces.find(name);
    return found == spaces.end() ? std::string() : found->second;
}

/// Parses a vector such as "(1,2,3)".
std::optional<glm::dvec3> vector_of(const std::string& text) {
    std::string numbers = trimmed(text);
    if (numbers.size() < 2 || numbers.front() != '(' || numbers.back() != ')') return {};
    std::replace(numbers.begin(), numbers.end(), ',', ' ');
    const std::vector<std::string> list = words(numbers.substr(1, numbers.size() - 2));
    if (list.size() != 3) return {};
    glm::dvec3 vector{0};
    for (int c = 0; c < 3; ++c) {
        const auto number = parse_number<double>(list[std::size_t(c)]);
        if (!number || !std::isfinite(*number)) return {};
        vector[c] = *number;
    }
    return vector;
}

/// The segments of 3D Slicer: Segment0_ID, Segment0_Name and so on, numbered without a gap.
std::vector<Segment> segments_of(const Header& header) {
    std::vector<Segment> segments;
    const auto find = [&](const std::string& key) -> const std::string* {
        const auto found = header.said.find("Segment" + std::to_string(segments.size()) + "_" + key);
        return found == header.said.end() ? nullptr : &found->second;
    };
    const auto number = [&](const std::string& key, std::int64_t otherwise, std::int64_t min) {
        const std::string* text = find(key);
        if (text == nullptr) return otherwise;
        const auto value = parse_number<std::int64_t>(*text);
        if (!value || *value < min || *value > max_label) {
            throw BadInput(header.file(), fmt::format("Segment{}_{}", segments.size(), key), *text,
                           fmt::format("a whole number of at least {}", min));
        }
        return *value;
    };
    while (true) {
        const std::string* id = find("ID");
        const std::string* name = find("Name");
        if (id == nullptr && name == nullptr) return segments;
        // Older files, in which segments could not share a layer, have a layer of zeros and ones per segment.
        Segment segment;
        segment.id = id != nullptr ? *id : *name;
        segment.name = name != nullptr ? *name : *id;
        segment.value = number("LabelValue", 1, -max_label);
        segment.layer = std::size_t(number("Layer", std::int64_t(segments.size()), 0));
        segments.push_back(std::move(segment));
    }
}

/// Whether the most significant byte of a scalar comes first.
bool is_big_endian(const TextHeader& header, ScalarType type) {
    if (bytes_of(type) == 1) return false;
    const std::string order = lower_case(header.require("endian"));
    if (order != "little" && order != "big") header.refuse("endian", "little or big");
    return order == "big";
}

}  // namespace

VolumeClaims read_nrrd_header(std::istream& stream, const std::string& file) {
    const Header header = read_header(stream, file);
    VolumeClaims claims;
    claims.file = file;
    claims.sizes_key = "sizes";
    claims.axes = read_axes(header, claims);
    claims.directions_key = directions_key;
    claims.directions_have_lengths = header.find(directions_key) != nullptr;
    claims.space = space_of(header);
    if (const std::string* origin = header.find("space origin")) {
        claims.origin = vector_of(*origin);
        if (!claims.origin) claims.notes.push_back("space origin is no vector of three numbers: 0 is taken");
    }
    claims.type = scalar_type(header);
    claims.type_text = "type " + header.require("type");
    claims.big_endian = is_big_endian(header, claims.type);
    claims.place = data_place(header);
    claims.segments = segments_of(header);
    return claims;
}

}  // namespace voxspring
