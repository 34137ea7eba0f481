// NRRD: a text header, an empty line, then the data in the same file, raw or gzipped.
// Format: https://teem.sourceforge.net/nrrd/format.html
#include <algorithm>
#include <array>
#include <bit>
#include <charconv>
#include <cmath>
#include <glm/geometric.hpp>
#include <map>
#include <optional>
#include <sstream>

#include "harness/base/bad_input.h"
#include "harness/volume/byte_stream.h"
#include "harness/volume/volume.h"

namespace voxspring {
namespace {

constexpr std::size_t longest_header = std::size_t{1} << 20;
constexpr int most_dimensions = 16;  // as in the reference implementation

std::string trimmed(std::string_view text) {
    constexpr std::string_view blanks = " \t";
    const auto from = text.find_first_not_of(blanks);
    if (from == std::string_view::npos) return {};
    return std::string(text.substr(from, text.find_last_not_of(blanks) - from + 1));
}

std::string lower_case(std::string text) {
    for (char& c : text) {
        if (c >= 'A' && c <= 'Z') c = char(c - 'A' + 'a');
    }
    return text;
}

std::vector<std::string> words(const std::string& text) {
    std::istringstream stream(text);
    std::vector<std::string> list;
    for (std::string word; stream >> word;) list.push_back(word);
    return list;
}

/// The number that all of `text` is.
template <class Number>
std::optional<Number> parse_number(const std::string& text) {
    const std::string plain = trimmed(text);
    Number number{};
    const char* end = plain.data() + plain.size();
    const auto [stop, error] = std::from_chars(plain.data(), end, number);
    if (error != std::errc() || stop != end) return std::nullopt;
    return number;
}

/// The fields of a header by name, in lower case and without blanks ("Space Directions" is
/// "spacedirections"). Leaves `stream` at the data.
class Header {
public:
    Header(std::istream& stream, std::string file) : file_(std::move(file)) {
        const std::string magic = line(stream, false).value_or("");
        if (magic.size() != 8 || magic.compare(0, 7, "NRRD000") != 0 || magic[7] < '1' || magic[7] > '6')
            throw BadInput(file_, "magic", magic, "NRRD0001 to NRRD0006");
        while (const auto text = line(stream, true)) {
            // Comments and key/value pairs say nothing that is needed here.
            if (text->front() == '#' || text->find(":=") != std::string::npos) continue;
            const auto colon = text->find(':');
            if (colon == std::string::npos)
                throw BadInput(file_, "header", *text, "lines of the form FIELD: VALUE");
            std::string name = lower_case(text->substr(0, colon));
            name.erase(std::remove(name.begin(), name.end(), ' '), name.end());
            if (!fields_.emplace(name, trimmed(text->substr(colon + 1))).second)
                throw BadInput(file_, name, "a second value", "each field once");
        }
    }

    const std::string* find(const std::string& name) const {
        const auto found = fields_.find(name);
        return found == fields_.end() ? nullptr : &found->second;
    }

    const std::string& require(const std::string& name) const {
        const std::string* value = find(name);
        if (value == nullptr) throw BadInput(file_, name, "nothing", "a value");
        return *value;
    }

    [[noreturn]] void refuse(const std::string& name, std::string_view accepted) const {
        throw BadInput(file_, name, require(name), accepted);
    }

private:
    /// The next line; nothing at the empty line that ends the header or, unless it is `required`, at the end
    /// of the file.
    std::optional<std::string> line(std::istream& stream, bool required) {
        std::string text;
        for (int c = stream.get(); c != '\n'; c = stream.get()) {
            if (c == std::istream::traits_type::eof()) {
                if (!required) return text;
                throw BadInput(file_, "header", "a file that ends within it",
                               "an empty line before the data");
            }
            if (++length_ > longest_header) {
                throw BadInput(file_, "header", "more than " + std::to_string(longest_header) + " bytes",
                               "an empty line before the data");
            }
            text += char(c);
        }
        if (!text.empty() && text.back() == '\r') text.pop_back();
        if (text.empty()) return std::nullopt;
        return text;
    }

    std::string file_;
    std::map<std::string, std::string> fields_;
    std::size_t length_ = 0;
};

ScalarType scalar_type(const Header& header) {
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

Encoding encoding(const Header& header) {
    const std::string name = lower_case(header.require("encoding"));
    if (name == "raw") return Encoding::raw;
    if (name == "gzip" || name == "gz") return Encoding::gzip;
    header.refuse("encoding", "raw or gzip");
}

int dimension(const Header& header) {
    const auto number = parse_number<int>(header.require("dimension"));
    if (!number || *number < 3 || *number > most_dimensions)
        header.refuse("dimension", "3, or more where all further sizes are 1");
    return *number;
}

glm::ivec3 sizes(const Header& header, int dimensions) {
    const std::vector<std::string> list = words(header.require("sizes"));
    const std::string accepted = std::to_string(dimensions) +
                                 " whole numbers, 3 of them sides and all further ones 1: a volume has one "
                                 "value a voxel";
    if (list.size() != std::size_t(dimensions)) header.refuse("sizes", accepted);
    glm::ivec3 dims{0};
    for (int axis = 0; axis < dimensions; ++axis) {
        const auto size = parse_number<int>(list[std::size_t(axis)]);
        if (!size || (axis >= 3 && *size != 1)) header.refuse("sizes", accepted);
        if (axis < 3) dims[axis] = *size;
    }
    return dims;
}

/// "(1,0,0) (0,1,0) none": one vector an axis.
std::vector<std::optional<glm::dvec3>> space_directions(const Header& header) {
    const std::string accepted = "a vector (x,y,z) for each axis of space";
    const std::string& text = header.require("spacedirections");
    std::vector<std::optional<glm::dvec3>> directions;
    for (std::size_t at = text.find_first_not_of(" \t"); at != std::string::npos;
         at = text.find_first_not_of(" \t", at)) {
        if (text.compare(at, 4, "none") == 0) {
            directions.emplace_back();
            at += 4;
            continue;
        }
        const auto end = text.find(')', at);
        if (text[at] != '(' || end == std::string::npos) header.refuse("spacedirections", accepted);
        std::string vector = text.substr(at + 1, end - at - 1);
        glm::dvec3 direction{0};
        for (int component = 0; component < 3; ++component) {
            const auto comma = component < 2 ? vector.find(',') : vector.size();
            const auto number =
                comma == std::string::npos ? std::nullopt : parse_number<double>(vector.substr(0, comma));
            if (!number) header.refuse("spacedirections", accepted);
            direction[component] = *number;
            vector.erase(0, comma + 1);
        }
        directions.emplace_back(direction);
        at = end + 1;
    }
    return directions;
}

glm::dvec3 checked_spacing(const Header& header, const std::string& field, glm::dvec3 spacing) {
    for (int axis = 0; axis < 3; ++axis) {
        if (!(spacing[axis] >= smallest_quantity && spacing[axis] <= largest_quantity))
            header.refuse(field, "a positive distance between voxels along each axis");
    }
    return spacing;
}

glm::dvec3 spacing(const Header& header, int dimensions) {
    if (header.find("spacedirections") != nullptr) {
        const auto directions = space_directions(header);
        if (directions.size() != std::size_t(dimensions) || !directions[0] || !directions[1] ||
            !directions[2]) {
            header.refuse("spacedirections", "a vector (x,y,z) for each axis of space");
        }
        const glm::dvec3 lengths{glm::length(*directions[0]), glm::length(*directions[1]),
                                 glm::length(*directions[2])};
        checked_spacing(header, "spacedirections", lengths);
        for (int axis = 0; axis < 3; ++axis) {
            const int next = (axis + 1) % 3;
            const double cosine = glm::dot(*directions[std::size_t(axis)], *directions[std::size_t(next)]) /
                                  (lengths[axis] * lengths[next]);
            // What is left of a right angle in a header written with a few digits.
            if (!(std::abs(cosine) < 1e-3)) header.refuse("spacedirections", "axes at right angles");
        }
        return lengths;
    }
    if (header.find("spacings") != nullptr) {
        const std::vector<std::string> list = words(header.require("spacings"));
        glm::dvec3 lengths{0};
        for (int axis = 0; axis < 3 && list.size() == std::size_t(dimensions); ++axis)
            lengths[axis] = parse_number<double>(list[std::size_t(axis)]).value_or(0);
        return checked_spacing(header, "spacings", lengths);
    }
    return glm::dvec3(1);
}

/// Whether the data is in the byte order that this machine does not have.
bool reversed(const Header& header, ScalarType type) {
    if (bytes_of(type) == 1) return false;
    const std::string order = lower_case(header.require("endian"));
    if (order != "little" && order != "big") header.refuse("endian", "little or big");
    return (order == "little") != (std::endian::native == std::endian::little);
}

void reverse_bytes(std::vector<std::byte>& data, std::size_t each) {
    for (auto scalar = data.begin(); scalar != data.end(); scalar += std::ptrdiff_t(each))
        std::reverse(scalar, scalar + std::ptrdiff_t(each));
}

}  // namespace

Volume read_nrrd(std::istream& stream, const std::string& file, const SceneSizeLimits& limits) {
    const Header header(stream, file);
    for (const std::string name : {"datafile", "lineskip", "byteskip"}) {
        if (header.find(name) != nullptr && header.require(name) != "0")
            header.refuse(name, "data that follows the header in the same file");
    }
    Volume volume;
    volume.file = file;
    const int dimensions = dimension(header);
    volume.dims = sizes(header, dimensions);
    const std::uint64_t voxels = checked_voxel_count(volume.dims, limits, file, "sizes");
    volume.type = scalar_type(header);
    volume.spacing = spacing(header, dimensions);
    const bool other_order = reversed(header, volume.type);

    ByteStream bytes(stream, encoding(header), file);
    volume.data = bytes.read_rest(
        voxels * bytes_of(volume.type), "data",
        std::to_string(voxels) + " voxels of type " + header.require("type") + " as the header says");
    if (other_order) reverse_bytes(volume.data, bytes_of(volume.type));
    return volume;
}

}  // namespace voxspring
