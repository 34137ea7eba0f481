// Reads and writes rows as JSON, field by field.
#pragma once

#include <cmath>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <type_traits>
#include <vector>

#include "harness/results/row.h"

namespace voxspring {

/// Writes the fields that a function visits. A kind of study names the keys of its rows in one function,
/// which is called with a RowWriter or a RowReader.
class RowWriter {
public:
    explicit RowWriter(nlohmann::json& json) : json_(json) {}

    static constexpr bool reads = false;
    template <class T>
    void required(const char* key, const T& value) {
        json_[key] = value;
    }
    /// The key is null if there is no value, or if it is not a finite number.
    template <class T>
    void nullable(const char* key, const std::optional<T>& value) {
        json_[key] = nullptr;
        if constexpr (std::is_floating_point_v<T>) {
            if (value && !std::isfinite(*value)) return;
        }
        if (value) json_[key] = *value;
    }
    /// The key is absent if there is no value.
    template <class T>
    void optional(const char* key, const std::optional<T>& value) {
        if (value) json_[key] = *value;
    }
    /// The key is absent if the list is empty.
    void list(const char* key, const std::vector<std::string>& values) {
        if (!values.empty()) json_[key] = values;
    }

private:
    nlohmann::json& json_;
};

/// Reads the fields that a function visits. A key that is missing or null leaves its value unchanged.
class RowReader {
public:
    explicit RowReader(const nlohmann::json& json) : json_(json) {}

    static constexpr bool reads = true;
    template <class T>
    void required(const char* key, T& value) {
        if (has(key)) value = json_.at(key).get<T>();
    }
    template <class T>
    void nullable(const char* key, std::optional<T>& value) {
        if (has(key)) value = json_.at(key).get<T>();
    }
    template <class T>
    void optional(const char* key, std::optional<T>& value) {
        nullable(key, value);
    }
    void list(const char* key, std::vector<std::string>& values) { required(key, values); }

private:
    bool has(const char* key) const { return json_.contains(key) && !json_.at(key).is_null(); }
    const nlohmann::json& json_;
};

}  // namespace voxspring
