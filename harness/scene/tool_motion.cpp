#include "harness/scene/tool_motion.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <sstream>

#include "harness/base/bad_input.h"
#include "harness/volume/dataset.h"
#include "harness/volume/text_header.h"

namespace voxspring {
namespace {

constexpr std::string_view header = "time,x,y,z";
constexpr std::array<std::string_view, 4> columns = {"time", "x", "y", "z"};
constexpr std::uintmax_t max_file_bytes = std::uintmax_t(64) << 20;
/// An interval longer than this multiple of the median interval is a gap.
constexpr double max_gap = 10;

/// Removes the text up to and including `end` from `text`, and returns what stands before `end`, without
/// blanks, tabs and carriage returns around it.
std::string_view cut(std::string_view& text, char end) {
    const std::size_t at = text.find(end);
    std::string_view before = text.substr(0, at);
    text.remove_prefix(at == std::string_view::npos ? text.size() : at + 1);
    constexpr std::string_view blanks = " \t\r";
    before.remove_prefix(std::min(before.find_first_not_of(blanks), before.size()));
    return before.substr(0, before.find_last_not_of(blanks) + 1);
}

/// The four fields of a line; empty if the line has fewer or more.
std::vector<std::string_view> fields_of(std::string_view line) {
    if (std::count(line.begin(), line.end(), ',') != 3) return {};
    std::vector<std::string_view> fields;
    for (std::size_t c = 0; c < columns.size(); ++c) fields.push_back(cut(line, ','));
    return fields;
}

/// Parses four finite numbers of magnitude at most max_quantity.
std::array<double, 4> parse_sample(std::string_view line, const std::string& file, const std::string& where) {
    std::array<double, 4> sample{};
    const std::vector<std::string_view> fields = fields_of(line);
    if (fields.empty()) throw BadInput(file, where, line, fmt::format("four numbers: {}", header));
    for (std::size_t c = 0; c < sample.size(); ++c) {
        const auto number = parse_number<double>(std::string(fields[c]));
        // Written so that NaN, which fails every comparison, is refused.
        if (!number || !(std::abs(*number) <= max_quantity))
            throw BadInput(file, fmt::format("{}, {}", where, columns[c]), fields[c],
                           "a number from -1e12 to 1e12");
        sample[c] = *number;
    }
    return sample;
}

/// Throws BadInput if `time`, as the file has it, has a gap (max_gap). The first time is on line 2.
void check_gaps(const std::vector<double>& time, const std::string& file) {
    std::vector<double> interval;
    for (std::size_t n = 1; n < time.size(); ++n) interval.push_back(time[n] - time[n - 1]);
    std::vector<double> sorted = interval;
    const auto middle = sorted.begin() + std::ptrdiff_t(sorted.size() / 2);
    std::nth_element(sorted.begin(), middle, sorted.end());
    const auto longest = std::max_element(interval.begin(), interval.end());
    if (*longest <= max_gap * *middle) return;
    throw BadInput(
        file, fmt::format("line {}, time", longest - interval.begin() + 3),
        fmt::format("a gap of {:g}", *longest),
        fmt::format("intervals of at most {} times their median, which is {:g}", max_gap, *middle));
}

}  // namespace

glm::dvec3 ToolMotion::at(double when) const {
    if (time.empty()) return glm::dvec3(0);
    const auto next = std::upper_bound(time.begin(), time.end(), when);
    if (next == time.begin()) return displacement.front();
    if (next == time.end()) return displacement.back();
    const auto n = std::size_t(next - time.begin());
    const double part = (when - time[n - 1]) / (time[n] - time[n - 1]);
    return displacement[n - 1] + part * (displacement[n] - displacement[n - 1]);
}

ToolMotion parse_tool_motion(std::string_view text, const std::string& file, double time_scale,
                             double length_scale) {
    // Spreadsheets and scripts add a byte order mark and empty lines at the end; both are ignored.
    if (constexpr std::string_view mark = "\xEF\xBB\xBF"; text.starts_with(mark))
        text.remove_prefix(mark.size());
    const std::size_t last = text.find_last_not_of(" \t\r\n");
    text = text.substr(0, last == std::string_view::npos ? 0 : last + 1);
    const std::string_view first = cut(text, '\n');
    const std::vector<std::string_view> named = fields_of(first);
    if (!std::equal(named.begin(), named.end(), columns.begin(), columns.end()))
        throw BadInput(file, "line 1", first, header);
    ToolMotion motion;
    std::vector<double> time;
    std::array<double, 4> start{}, before{};
    for (int line = 2; !text.empty(); ++line) {
        const std::string where = "line " + std::to_string(line);
        const std::array<double, 4> sample = parse_sample(cut(text, '\n'), file, where);
        if (motion.empty()) start = sample;
        if (!motion.empty() && !(sample[0] > before[0])) {
            // All digits, since a time may be the seconds since 1970.
            throw BadInput(file, where + ", time", fmt::format("{}", sample[0]),
                           fmt::format("a time after {}, the time of the line before", before[0]));
        }
        before = sample;
        time.push_back(sample[0]);
        motion.time.push_back(time_scale * (sample[0] - start[0]));
        motion.displacement.push_back(
            length_scale * glm::dvec3(sample[1] - start[1], sample[2] - start[2], sample[3] - start[3]));
    }
    if (motion.time.size() < 2)
        throw BadInput(file, "", std::to_string(motion.time.size()) + " samples", "two samples at least");
    check_gaps(time, file);
    return motion;
}

ToolMotion read_tool_motion(const std::string& file, double time_scale, double length_scale) {
    require_regular_file(file, "a file of a tool's motion (CSV)");
    std::error_code error;
    const auto size = std::filesystem::file_size(file, error);
    if (error) throw BadInput(file, "", "an unreadable file", "a file that can be read");
    if (size > max_file_bytes)
        throw BadInput(file, "", std::to_string(size) + " bytes",
                       "a file of at most " + std::to_string(max_file_bytes) + " bytes");
    std::ostringstream text;
    text << std::ifstream(file, std::ios::binary).rdbuf();
    if (!text) throw BadInput(file, "", "an unreadable or empty file", "a file that can be read");
    return parse_tool_motion(text.str(), file, time_scale, length_scale);
}

}  // namespace voxspring
