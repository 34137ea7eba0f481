// Reads and writes rows as JSON. A type of row lists its keys once, in `fields`, for both:
//
//     struct OverheadRow : Row {
//         std::string handed_over = {};
//         static void fields(auto& row, auto& of) { of.required("handed_over", row.handed_over); }
//     };
#pragma once

#include <cmath>
#include <concepts>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <type_traits>
#include <vector>

#include "harness/results/row.h"

namespace voxspring {

/// Writes the fields that a function `fields` lists to a JSON object.
class RowWriter {
public:
    explicit RowWriter(nlohmann::json& json) : json_(json) {}

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
    /// Each counter is written under its name. The key `counters` lists names, units and directions.
    void counters(const Counters& counters) {
        for (const Counter& one : counters) {
            nullable(one.name.c_str(), one.value);
            json_["counters"].push_back(
                {{"name", one.name}, {"unit", to_string(one.unit)}, {"better", to_string(one.better)}});
        }
    }
    /// The value of the key is an object with the fields that `visit` lists.
    template <class Visit>
    void object(const char* key, const Visit& visit) {
        RowWriter inner(json_[key]);
        visit(inner);
    }

    /// The key is absent if there is no value. Otherwise its value is an object with the fields of T.
    template <class T>
    void optional_object(const char* key, const std::optional<T>& value) {
        if (value) object(key, [&](RowWriter& inner) { T::fields(*value, inner); });
    }

private:
    nlohmann::json& json_;
};

/// Reads the fields that a function `fields` lists. If a key is missing or null, the member is unchanged.
class RowReader {
public:
    explicit RowReader(const nlohmann::json& json) : json_(json) {}

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
    void counters(Counters& counters) {
        if (!has("counters")) return;
        for (const auto& of : json_.at("counters")) {
            const std::string name = of.at("name");
            std::optional<double> value;
            nullable(name.c_str(), value);
            counters.add(name, value, unit_of(of.at("unit")), better_of(of.at("better")));
        }
    }
    template <class Visit>
    void object(const char* key, const Visit& visit) {
        if (!has(key)) return;
        RowReader inner(json_.at(key));
        visit(inner);
    }
    template <class T>
    void optional_object(const char* key, std::optional<T>& value) {
        if (has(key)) object(key, [&](RowReader& inner) { T::fields(value.emplace(), inner); });
    }

private:
    bool has(const char* key) const { return json_.contains(key) && !json_.at(key).is_null(); }
    const nlohmann::json& json_;
};

/// Convert a row of type T to JSON and back. T is nlohmann::json for rows that have no C++ type.
template <class T>
nlohmann::json json_of(const T& row) {
    if constexpr (std::same_as<T, nlohmann::json>) {
        return row;
    } else {
        nlohmann::json json = to_json(static_cast<const Row&>(row));
        if constexpr (!std::same_as<T, Row>) {
            RowWriter writer(json);
            T::fields(row, writer);
        }
        return json;
    }
}
template <class T>
T row_of_json(const nlohmann::json& json) {
    if constexpr (std::same_as<T, nlohmann::json>) {
        return json;
    } else {
        T row{row_from_json(json)};
        if constexpr (!std::same_as<T, Row>) {
            RowReader reader(json);
            T::fields(row, reader);
        }
        return row;
    }
}

}  // namespace voxspring
