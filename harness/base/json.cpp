#include "harness/base/json.h"

#include <fmt/format.h>
#include <zlib.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <nlohmann/json.hpp>
#include <set>

#include "harness/base/bad_input.h"
#include "harness/base/text.h"

namespace voxspring {
namespace {

using nlohmann::json;

constexpr std::size_t max_depth = 32;
constexpr std::size_t max_file_bytes = std::size_t{16} << 20;

std::string range(double low, double high) { return fmt::format(" from {:g} to {:g}", low, high); }

std::string compact(const json& value) { return value.dump(-1, ' ', true, json::error_handler_t::replace); }

std::string child_path(const std::string& parent, const std::string& key) {
    return parent.empty() ? key : parent + "." + key;
}

/// Parses `text`. Also refuses some text that JSON's grammar allows: a key given twice, too deep nesting, or
/// a number that overflows a double.
json parsed(std::string_view text, const std::string& file) {
    std::vector<std::set<std::string>> keys(max_depth + 1);  // the keys of the open object at each depth
    const auto check = [&](int depth, json::parse_event_t event, const json& value) {
        const auto level = std::size_t(depth);
        if (event == json::parse_event_t::key && !keys[level].insert(value.get<std::string>()).second)
            throw BadInput(file, value.get<std::string>(), "a second value", "each key once");
        if (event == json::parse_event_t::object_start || event == json::parse_event_t::array_start) {
            if (level == max_depth)
                throw BadInput(file, "", "deeper nesting",
                               fmt::format("at most {} objects and arrays inside one another", max_depth));
            keys[level + 1].clear();
        }
        return true;
    };
    try {
        return json::parse(text, check);
    } catch (const json::parse_error& error) {
        // Line and column are counted here, since the parser reports column 0 just after the end of a line.
        const std::string_view read = text.substr(0, std::min(error.byte, text.size()));
        const auto line = 1 + std::count(read.begin(), read.end(), '\n');
        const auto column = std::max<std::size_t>(read.size() - (read.rfind('\n') + 1), 1);
        // The parser's message is "[...] parse error at line 3, column 7: syntax error while parsing ... -
        // WHAT; expected EXPECTED". Only WHAT and EXPECTED are passed on.
        const std::string message = error.what();
        const auto expected = message.find("; expected "), dash = message.find(" - ");
        const auto what = dash == std::string::npos ? message.find(": ") + 2 : dash + 3;
        throw BadInput(file, fmt::format("line {}, column {}", line, column),
                       message.substr(what, expected == std::string::npos ? expected : expected - what),
                       expected == std::string::npos ? "JSON" : message.substr(expected + 11));
    } catch (const json::out_of_range& error) {
        const std::string message = error.what();
        throw BadInput(file, "", message.substr(message.find("] ") + 2),
                       "numbers that a 64-bit float can hold");
    }
}

}  // namespace

struct JsonValue::Document {
    std::string file;
    json root;
};

JsonValue::JsonValue(std::shared_ptr<const Document> document, const json* value, std::string path)
    : document_(std::move(document)), value_(value), path_(std::move(path)) {}

bool JsonValue::is_number() const { return value_->is_number(); }
bool JsonValue::is_string() const { return value_->is_string(); }
bool JsonValue::is_array() const { return value_->is_array(); }
bool JsonValue::is_object() const { return value_->is_object(); }

double JsonValue::number() const {
    if (!is_number()) refuse("a number");
    return value_->get<double>();
}

double JsonValue::number(double low, double high) const {
    const std::string accepted = "a number" + range(low, high);
    if (!is_number()) refuse(accepted);
    const auto number = value_->get<double>();
    if (!(number >= low && number <= high)) refuse(accepted);
    return number;
}

std::int64_t JsonValue::integer(std::int64_t low, std::int64_t high) const {
    const std::string accepted = "a whole number from " + std::to_string(low) + " to " + std::to_string(high);
    if (!is_number()) refuse(accepted);
    // Comparing doubles is exact here: `low` and `high` are within +-(2^53 - 1), so conversion to double
    // rounds no integer outside [low, high] to one of the bounds.
    const auto number = value_->get<double>();
    if (!(number >= double(low) && number <= double(high)) || std::floor(number) != number) refuse(accepted);
    return static_cast<std::int64_t>(number);
}

bool JsonValue::boolean() const {
    if (!value_->is_boolean()) refuse("true or false");
    return value_->get<bool>();
}

std::string JsonValue::string() const {
    if (!is_string() || value_->get_ref<const std::string&>().empty()) refuse("a string that is not empty");
    return value_->get<std::string>();
}

std::string JsonValue::one_of(const std::vector<std::string>& accepted) const {
    if (is_string()) {
        const auto& text = value_->get_ref<const std::string&>();
        if (std::find(accepted.begin(), accepted.end(), text) != accepted.end()) return text;
    }
    refuse("one of " + joined(accepted));
}

glm::dvec3 JsonValue::vec3(double limit) const {
    if (!is_array() || value_->size() != 3) refuse("an array of 3 numbers");
    const std::vector<JsonValue> component = array();
    return {component[0].number(-limit, limit), component[1].number(-limit, limit),
            component[2].number(-limit, limit)};
}

std::vector<JsonValue> JsonValue::array(std::size_t shortest, std::size_t longest) const {
    std::string accepted = "an array";
    if (shortest == longest) {
        accepted += " of " + std::to_string(shortest) + " elements";
    } else if (longest < ~std::size_t{0}) {
        accepted += " of " + std::to_string(shortest) + " to " + std::to_string(longest) + " elements";
    } else if (shortest > 0) {
        accepted += " of " + std::to_string(shortest) + " elements or more";
    }
    if (!is_array() || value_->size() < shortest || value_->size() > longest) refuse(accepted);
    std::vector<JsonValue> elements;
    elements.reserve(value_->size());
    for (const json& element : *value_) {
        elements.push_back(
            JsonValue(document_, &element, path_ + "[" + std::to_string(elements.size()) + "]"));
    }
    return elements;
}

JsonObject JsonValue::object() const { return JsonObject(*this); }

void JsonValue::refuse(std::string_view accepted) const { throw BadInput(file(), path_, text(), accepted); }

const std::string& JsonValue::file() const { return document_->file; }

std::string JsonValue::text() const { return compact(*value_); }

JsonObject::JsonObject(JsonValue value) : value_(std::move(value)) {
    if (!value_.is_object()) value_.refuse("an object");
}

JsonValue JsonObject::member(const std::string& key) const {
    return {value_.document_, &value_.value_->at(key), child_path(value_.path_, key)};
}

bool JsonObject::contains(const std::string& key) const { return value_.value_->contains(key); }

std::optional<JsonValue> JsonObject::find(const std::string& key) {
    accepted_.push_back(key);
    if (!contains(key)) return std::nullopt;
    return member(key);
}

JsonValue JsonObject::require(const std::string& key, std::string_view accepted) {
    accepted_.push_back(key);
    if (!contains(key)) throw BadInput(value_.file(), child_path(value_.path_, key), missing, accepted);
    return member(key);
}

std::vector<std::pair<std::string, JsonValue>> JsonObject::items() {
    std::vector<std::pair<std::string, JsonValue>> members;
    for (const auto& item : value_.value_->items()) {
        accepted_.push_back(item.key());
        members.emplace_back(item.key(), member(item.key()));
    }
    return members;
}

void JsonObject::finish() const {
    for (const auto& item : value_.value_->items()) {
        if (std::find(accepted_.begin(), accepted_.end(), item.key()) != accepted_.end()) continue;
        const std::string where = value_.path_.empty() ? "" : " of " + value_.path_;
        throw BadInput(value_.file(), child_path(value_.path_, item.key()), compact(item.value()),
                       "the keys" + where + ": " + joined(accepted_));
    }
}

JsonObject parse_json(std::string_view text, const std::string& file) {
    auto document = std::make_shared<JsonValue::Document>(JsonValue::Document{file, parsed(text, file)});
    const json* root = &document->root;
    return JsonObject(JsonValue(std::move(document), root, ""));
}

json parsed_json(std::string_view text) { return json::parse(text); }
std::vector<std::uint8_t> cbor_of(const json& message) { return json::to_cbor(message); }
json message_of(const std::vector<std::uint8_t>& cbor) { return json::from_cbor(cbor); }

std::string json_text(const json& value, int indent) {
    return value.dump(indent, ' ', false, json::error_handler_t::replace);
}

std::string utf8_text(const std::string& text) { return json::parse(json_text(text)).get<std::string>(); }

void check_schema_version(JsonObject& document, int newest) {
    const auto version = document.find("schema_version");
    if (!version) return;
    const double number = version->is_number() ? version->number() : 0;
    if (number < 1 || number > newest || std::floor(number) != number)
        version->refuse(newest > 1
                            ? "1 to " + std::to_string(newest) + ", the versions that this program reads"
                            : "1, the only version that this program reads");
}

JsonObject read_json(const std::filesystem::path& file) {
    const auto refuse = [&](const std::string& value, const std::string& accepted) {
        throw BadInput(file.string(), "", value, accepted);
    };
    require_regular_file(file, "a JSON file");
    const std::string small_enough = "a file of at most " + std::to_string(max_file_bytes) + " bytes";
    std::error_code error;
    const auto size = std::filesystem::file_size(file, error);
    if (error) refuse("an unreadable file", "a file that can be read");
    if (size > max_file_bytes) refuse(std::to_string(size) + " bytes", small_enough);
    // gzread() also reads files that are not compressed.
    const std::unique_ptr<gzFile_s, int (*)(gzFile)> stream(gzopen(file.c_str(), "rb"), gzclose);
    if (!stream) refuse("an unreadable file", "a file that can be read");
    std::string text;
    int count = 0;
    for (char buffer[1 << 16]; (count = gzread(stream.get(), buffer, sizeof buffer)) > 0;) {
        text.append(buffer, std::size_t(count));
        if (text.size() > max_file_bytes) refuse("more bytes when unpacked", small_enough);
    }
    int status = Z_OK;
    gzerror(stream.get(), &status);
    if (status != Z_OK)
        refuse(status == Z_ERRNO ? "an unreadable file" : "a damaged gzip file", "a file that can be read");
    return parse_json(text, file.string());
}

}  // namespace voxspring
