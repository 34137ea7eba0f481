// A strict reader for JSON files: scenes and studies, which users write, and results.
//
// Every refusal is a BadInput. The message about a value names the file, the path of the key
// ("dataset.dims[1]"), the value of that key, and what would be accepted.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <glm/vec3.hpp>
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace voxspring {

class JsonObject;

/// One value of a JSON document. Shares the ownership of that document. The functions number() to object()
/// throw BadInput if the value is not of the kind that they return.
class JsonValue {
public:
    bool is_number() const;
    bool is_string() const;
    bool is_array() const;
    bool is_object() const;

    /// A finite number: JSON has no NaN or infinity, and parse_json() has refused numbers that overflow a
    /// double.
    double number() const;
    /// A number within [low, high].
    double number(double low, double high) const;
    /// A whole number within [low, high]; 3.0 counts as whole. Both bounds must be within +-(2^53 - 1).
    std::int64_t integer(std::int64_t low, std::int64_t high) const;
    bool boolean() const;
    /// A string that is not empty.
    std::string string() const;
    /// One of the strings `accepted`.
    std::string one_of(const std::vector<std::string>& accepted) const;
    /// Three numbers within [-limit, limit].
    glm::dvec3 vec3(double limit) const;
    /// The elements of an array that has at least `shortest` and at most `longest` elements.
    std::vector<JsonValue> array(std::size_t shortest = 0, std::size_t longest = ~std::size_t{0}) const;
    JsonObject object() const;

    /// Throws BadInput, which says that `accepted` was expected instead of this value.
    [[noreturn]] void refuse(std::string_view accepted) const;

    /// The place of the value in the document, such as "dataset.dims[1]"; empty for the root.
    const std::string& path() const { return path_; }
    const std::string& file() const;
    /// The value as compact JSON.
    std::string text() const;
    const nlohmann::json& raw() const { return *value_; }

private:
    friend class JsonObject;
    friend JsonObject parse_json(std::string_view text, const std::string& file);
    struct Document;
    JsonValue(std::shared_ptr<const Document> document, const nlohmann::json* value, std::string path);

    std::shared_ptr<const Document> document_;
    const nlohmann::json* value_;
    std::string path_;
};

/// A JSON object whose keys are asked for by name. finish() refuses every key that was not asked for, such as
/// a misspelt one.
class JsonObject {
public:
    explicit JsonObject(JsonValue value);

    /// The value of `key`; nullopt if the object has no such key.
    std::optional<JsonValue> find(const std::string& key);
    /// The value of `key`. If the object has no such key, throws BadInput, which says that `accepted` was
    /// expected.
    JsonValue require(const std::string& key, std::string_view accepted = "a value");
    /// All keys and values. After this call finish() accepts every key.
    std::vector<std::pair<std::string, JsonValue>> items();
    /// Throws BadInput if the object has a key that was never asked for. The message names this key, and the
    /// keys that were asked for as those that are accepted.
    void finish() const;

    bool contains(const std::string& key) const;
    /// The object as a JsonValue, which has path() and refuse().
    const JsonValue& value() const { return value_; }

private:
    JsonValue member(const std::string& key) const;

    JsonValue value_;
    std::vector<std::string> accepted_;
};

/// Parses `text`, which must be a JSON object. Messages about syntax errors name `file`, line and column.
/// Repeated keys in an object, nesting beyond 32 levels and numbers that overflow a double are refused.
JsonObject parse_json(std::string_view text, const std::string& file);

// Each source that parses JSON or CBOR by itself compiles the parser again, which takes 3 s of up to 18. So
// only json.cpp does.

/// The value of `text`, which this program wrote or which is built into it. Throws
/// nlohmann::json::parse_error.
nlohmann::json parsed_json(std::string_view text);

/// A message between processes, as CBOR bytes.
std::vector<std::uint8_t> cbor_of(const nlohmann::json& message);
/// The message of CBOR bytes. Throws nlohmann::json::parse_error.
nlohmann::json message_of(const std::vector<std::uint8_t>& cbor);

/// `value` as JSON text: in one line if `indent` is -1, otherwise with `indent` blanks per level. Names of
/// files or devices may have bytes that are not UTF-8: these become U+FFFD, whereas nlohmann::json::dump()
/// throws by default.
std::string json_text(const nlohmann::json& value, int indent = -1);

/// `text` with U+FFFD (the replacement character) in place of bytes that are not UTF-8.
std::string utf8_text(const std::string& text);

/// The versions of the formats of scenes, studies and results, which results/*schema.json describe. A version
/// is raised if an older reader would misread a newer file; results/README.md says when that is the case.
inline constexpr int scene_schema_version = 1;
inline constexpr int study_schema_version = 1;
inline constexpr int result_schema_version = 1;

/// Throws BadInput unless the key `schema_version` is a whole number from 1 to `newest`, or is missing: a
/// document without the key has version 1.
void check_schema_version(JsonObject& document, int newest);

/// Reads a JSON object from a file, which may be compressed by gzip. The text may have at most 16 MiB. Throws
/// BadInput.
JsonObject read_json(const std::filesystem::path& file);

}  // namespace voxspring
