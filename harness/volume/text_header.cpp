#include "harness/volume/text_header.h"

#include <algorithm>
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

}  // namespace voxspring
