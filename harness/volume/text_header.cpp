#include "harness/volume/text_header.h"

#include <fmt/format.h>

#include <algorithm>
#include <limits>
#include <sstream>

#include "harness/base/bad_input.h"

namespace voxspring {
namespace {

constexpr std::size_t max_header_bytes = std::size_t{1} << 20;

std::string key_of(const std::string& name) {
    std::string key = lower_case(name);
    std::erase_if(key, [](char c) { return c == ' ' || c == '\t'; });
    return key;
}

}  // namespace

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

std::string upper_case(std::string text) {
    for (char& c : text) {
        if (c >= 'a' && c <= 'z') c = char(c - 'a' + 'A');
    }
    return text;
}

std::vector<std::string> words(const std::string& text) {
    std::istringstream stream(text);
    std::vector<std::string> list;
    for (std::string word; stream >> word;) list.push_back(word);
    return list;
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

std::optional<std::string> HeaderLines::next() {
    std::string text;
    for (int c = stream_.get(); c != '\n'; c = stream_.get()) {
        if (c == std::istream::traits_type::eof()) {
            if (text.empty()) return std::nullopt;
            break;
        }
        if (++read_ > max_header_bytes) {
            throw BadInput(file_, "header", "more than " + std::to_string(max_header_bytes) + " bytes",
                           "a shorter header");
        }
        text += char(c);
    }
    if (!text.empty() && text.back() == '\r') text.pop_back();
    return text;
}

void TextHeader::add(const std::string& name, const std::string& value) {
    const auto [field, is_new] = fields_.emplace(key_of(name), value);
    if (!is_new && field->second != value) ambiguous_.insert(field->first);
}

const std::string* TextHeader::find(const std::string& name) const {
    const std::string key = key_of(name);
    if (ambiguous_.contains(key)) throw BadInput(file_, name, "two values", "one value");
    const auto found = fields_.find(key);
    return found == fields_.end() ? nullptr : &found->second;
}

const std::string& TextHeader::require(const std::string& name) const {
    const std::string* value = find(name);
    if (value == nullptr) throw BadInput(file_, name, missing, "a value");
    return *value;
}

void TextHeader::refuse(const std::string& name, std::string_view accepted) const {
    throw BadInput(file_, name, require(name), accepted);
}

std::int64_t TextHeader::whole_number(const std::string& name, std::int64_t min) const {
    const std::string* text = find(name);
    if (text == nullptr) return 0;
    const auto number = parse_number<std::int64_t>(*text);
    if (!number || *number < min) refuse(name, "a whole number of at least " + std::to_string(min));
    return *number;
}

std::vector<AxisClaim> TextHeader::axes(const std::string& count, int max, const std::string& sizes) const {
    const auto dimensions = parse_number<int>(require(count));
    if (!dimensions || *dimensions < 3 || *dimensions > max) refuse(count, fmt::format("3 to {}", max));
    const std::vector<std::string> list = words(require(sizes));
    std::vector<AxisClaim> axes(static_cast<std::size_t>(*dimensions));
    for (std::size_t a = 0; a < axes.size(); ++a) {
        const auto size = list.size() == axes.size() ? parse_number<std::int64_t>(list[a]) : std::nullopt;
        if (!size) refuse(sizes, fmt::format("{} whole numbers", axes.size()));
        axes[a].name = fmt::format("axis {}", a + 1);
        axes[a].size = *size;
    }
    return axes;
}

void TextHeader::set_distances(const std::string& name, std::vector<AxisClaim>& axes) const {
    const std::string* text = find(name);
    if (text == nullptr) return;
    const std::vector<std::string> list = words(*text);
    for (std::size_t a = 0; a < axes.size(); ++a) {
        const auto distance = list.size() == axes.size() ? parse_number<double>(list[a]) : std::nullopt;
        axes[a].distance = distance.value_or(std::numeric_limits<double>::quiet_NaN());
        axes[a].distance_key = name;
        axes[a].distance_text = *text;
    }
}

bool TextHeader::is_list(const std::string& name) const {
    const std::string* text = find(name);
    return text != nullptr && words(*text + " .")[0] == "LIST";
}

void TextHeader::set_files(const std::string& name, const std::vector<std::string>& listed,
                           const std::string& accepted, DataPlace& place) const {
    const std::string& value = require(name);
    if (is_list(name) && listed.empty()) refuse(name, "LIST with names of files below it");
    if (value.empty() || value.find('%') != std::string::npos) refuse(name, accepted);
    place.files_key = name;
    for (const std::string& file : is_list(name) ? listed : std::vector{value})
        place.files.push_back(std::filesystem::path(file_).parent_path() / file);
}

}  // namespace voxspring
