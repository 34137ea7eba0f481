// Reads NRRD headers. They are text, and the data follows behind an empty line or is in files that the header
// names. Format: https://teem.sourceforge.net/nrrd/format.html
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <glm/gtc/type_ptr.hpp>
#include <glm/vec3.hpp>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "harness/base/bad_input.h"
#include "harness/volume/claims.h"
#include "harness/volume/text_header.h"

namespace voxspring {
namespace {

constexpr int max_dimensions = 16;  // the limit of the reference implementation
const std::string directions_key = "space directions";

struct Header : TextHeader {
    using TextHeader::TextHeader;
    std::vector<std::string> listed_files;    ///< files of "data file: LIST"
    std::map<std::string, std::string> said;  ///< keys and values, "key:=value"
};

/// Reads the header and leaves `stream` at the data.
Header read_header(std::istream& stream, const std::string& file) {
    Header header(file);
    HeaderLines lines(stream, file);
    const std::string magic = lines.next().value_or("");
    if (magic.size() != 8 || magic.compare(0, 7, "NRRD000") != 0 || magic[7] < '1' || magic[7] > '6')
        throw BadInput(file, "magic", magic, "NRRD0001 to NRRD0006");
    for (auto line = lines.next(); !line || !line->empty(); line = lines.next()) {
        if (!line) {
            if (header.find("data file") != nullptr) break;
            throw BadInput(file, "header", "the end of the file", "an empty line before the data");
        }
        const auto assigned = line->find(":="), colon = line->find(':');
        if (header.is_list("data file")) {
            header.listed_files.push_back(trimmed(*line));
        } else if (line->front() == '#') {
            continue;
        } else if (assigned != std::string::npos) {
            header.said.emplace(trimmed(line->substr(0, assigned)), trimmed(line->substr(assigned + 2)));
        } else if (colon == std::string::npos) {
            throw BadInput(file, "header", *line, "lines of the form FIELD: VALUE");
        } else {
            header.add(line->substr(0, colon), trimmed(line->substr(colon + 1)));
        }
    }
    return header;
}

ScalarType scalar_type(const TextHeader& header) {
    static const std::map<ScalarType, std::vector<std::string>> names = {
        {ScalarType::int8, {"signed char", "int8", "int8_t"}},
        {ScalarType::uint8, {"uchar", "unsigned char", "uint8", "uint8_t"}},
        {ScalarType::int16, {"short", "short int", "signed short", "signed short int", "int16", "int16_t"}},
        {ScalarType::uint16, {"ushort", "unsigned short", "unsigned short int", "uint16", "uint16_t"}},
        {ScalarType::int32, {"int", "signed int", "int32", "int32_t"}},
        {ScalarType::uint32, {"uint", "unsigned int", "uint32", "uint32_t"}},
        {ScalarType::int64,
         {"longlong", "long long", "long long int", "signed long long", "signed long long int", "int64",
          "int64_t"}},
        {ScalarType::uint64,
         {"ulonglong", "unsigned long long", "unsigned long long int", "uint64", "uint64_t"}},
        {ScalarType::float32, {"float"}},
        {ScalarType::float64, {"double"}},
    };
    const std::string word = lower_case(header.require("type"));
    for (const auto& [type, words] : names) {
        if (std::find(words.begin(), words.end(), word) != words.end()) return type;
    }
    header.refuse("type", "int8, uint8, int16, uint16, int32, uint32, int64, uint64, float or double");
}

DataPlace data_place(const Header& header) {
    DataPlace place;
    place.encoding = header.choose<Encoding>("encoding", lower_case(header.require("encoding")),
                                             {{"raw", Encoding::raw},
                                              {"gzip", Encoding::gzip},
                                              {"gz", Encoding::gzip},
                                              {"bzip2", Encoding::bzip2},
                                              {"bz2", Encoding::bzip2}},
                                             "raw, gzip or bzip2");
    place.skipped_lines = header.whole_number("line skip", 0);
    place.skipped_bytes = header.whole_number("byte skip", DataPlace::at_end);
    if (header.find("data file") != nullptr) {
        header.set_files("data file", header.listed_files,
                         "the name of a file, or LIST with names of files below it", place);
    }
    return place;
}

using MaybeVector = std::optional<glm::dvec3>;

/// Parses vectors such as "(1,0,0)", with nullopt for "none". Returns nothing if `text` is anything else.
std::optional<std::vector<MaybeVector>> vectors_of(const std::string& text) {
    std::vector<MaybeVector> vectors;
    for (std::size_t at = text.find_first_not_of(" \t"); at != std::string::npos;
         at = text.find_first_not_of(" \t", at)) {
        if (text.compare(at, 4, "none") == 0) {
            vectors.emplace_back();
            at += 4;
            continue;
        }
        const auto end = text.find(')', at);
        if (text[at] != '(' || end == std::string::npos) return {};
        std::string list = text.substr(at + 1, end - at - 1);
        if (const auto commas = std::count(list.begin(), list.end(), ','); commas != 0 && commas != 2)
            return {};
        std::replace(list.begin(), list.end(), ',', ' ');
        const auto v = numbers_of(list, 3);
        if (!v) return {};
        // Some programs write "none" as a vector of NaN.
        const bool is_none = std::isnan((*v)[0]) && std::isnan((*v)[1]) && std::isnan((*v)[2]);
        vectors.push_back(is_none ? MaybeVector() : glm::make_vec3(v->data()));
        at = end + 1;
    }
    return vectors;
}

/// Sets the kind of `axis` from the file's text for it. An axis of the kind "domain" or without a kind stays
/// unknown: it may be spatial.
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

/// Reads the directions of axes. An axis with a direction is spatial, unless its kind says otherwise. An axis
/// without a direction is not spatial.
void read_directions(const TextHeader& header, std::vector<AxisClaim>& axes) {
    const std::string& text = header.require(directions_key);
    const auto directions = vectors_of(text);
    if (!directions || directions->size() != axes.size())
        header.refuse(directions_key, "a vector (x,y,z) for each axis of space");
    for (std::size_t a = 0; a < axes.size(); ++a) {
        const MaybeVector& direction = (*directions)[a];
        if (axes[a].kind == AxisKind::other) continue;
        axes[a].kind = direction ? AxisKind::space : AxisKind::other;
        if (!direction) continue;
        axes[a].direction = direction;
        axes[a].distance = glm::length(*direction);
        axes[a].distance_key = directions_key;
        axes[a].distance_text = text;
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
        // A direction mixes the axes of the space, so a unit holds for it only if all of them have the same.
        // If they differ, so do the axes' units here, and decide() refuses them unless the user chose the
        // spacing.
        const bool same =
            !list.empty() && std::count(list.begin(), list.end(), list[0]) == std::ptrdiff_t(list.size());
        std::size_t next = 0;
        for (AxisClaim& axis : axes) {
            if (axis.direction && !list.empty())
                axis.unit = same ? list[0] : list[std::min(next++, list.size() - 1)];
        }
    }
}

void read_axes(const TextHeader& header, VolumeClaims& claims) {
    std::vector<AxisClaim>& axes = claims.axes = header.axes("dimension", max_dimensions, "sizes");
    claims.kinds_key = "sizes";
    if (const std::string* kinds = header.find("kinds")) {
        const std::vector<std::string> list = words(*kinds);
        if (list.size() != axes.size())
            header.refuse("kinds", fmt::format("{} words, one for each axis", axes.size()));
        for (std::size_t a = 0; a < axes.size(); ++a) apply_kind(axes[a], lower_case(list[a]));
        claims.kinds_key = "kinds";
    }
    claims.directions_key = directions_key;
    claims.directions_have_lengths = header.find(directions_key) != nullptr;
    if (claims.directions_have_lengths) {
        read_directions(header, axes);
        claims.kinds_key = directions_key;
    } else {
        header.set_distances("spacings", axes);
    }
    claims.kinds_text = header.require(claims.kinds_key);
    read_units(header, axes);
}

/// The sides towards which the coordinates of the file's space grow; empty for a space without anatomy.
std::string space_of(const TextHeader& header) {
    const std::string* text = header.find("space");
    if (text == nullptr) return {};
    std::string name = lower_case(*text);
    for (const std::string time : {"-time", "t"}) {
        if (name.size() > 3 && name.ends_with(time)) name.resize(name.size() - time.size());
    }
    if (name == "right-anterior-superior" || name == "ras") return "RAS";
    if (name == "left-anterior-superior" || name == "las") return "LAS";
    return name == "left-posterior-superior" || name == "lps" ? "LPS" : "";
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

}  // namespace

VolumeClaims read_nrrd(std::istream& stream, const std::string& file) {
    const Header header = read_header(stream, file);
    VolumeClaims claims;
    claims.file = file;
    claims.sizes_key = "sizes";
    read_axes(header, claims);
    claims.space = space_of(header);
    if (const std::string* origin = header.find("space origin")) {
        const auto list = vectors_of(*origin);
        if (list && list->size() == 1) claims.origin = (*list)[0];
        if (!claims.origin) claims.notes.push_back("space origin is no vector of three numbers: 0 is taken");
    }
    claims.type = scalar_type(header);
    claims.type_text = "type " + header.require("type");
    if (bytes_of(claims.type) > 1) {
        claims.big_endian = header.choose<bool>("endian", lower_case(header.require("endian")),
                                                {{"little", false}, {"big", true}}, "little or big");
    }
    claims.place = data_place(header);
    claims.segments = segments_of(header);
    return claims;
}

}  // namespace voxspring
