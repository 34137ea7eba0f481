// Values of a shader's uniforms by name, for any API.
#pragma once

#include <cstddef>
#include <glm/vec3.hpp>
#include <map>
#include <span>
#include <string>
#include <type_traits>
#include <vector>

namespace voxspring::glsl {

/// The value of a uniform: whole or real numbers, vectors of them, or an array of either.
class UniformValue {
public:
    template <class T, std::size_t extent>
    explicit UniformValue(std::span<const T, extent> elements)
        : UniformValue(std::as_bytes(elements), sizeof(T), Kind<T>::components, Kind<T>::whole) {}

    std::span<const std::byte> bytes() const { return bytes_; }
    std::size_t element_bytes() const { return element_bytes_; }
    std::size_t count() const { return bytes_.size() / element_bytes_; }
    int components() const { return components_; }  ///< numbers per element
    bool is_whole() const { return whole_; }

private:
    template <class T>
    struct Kind {
        static constexpr int components = 1;
        static constexpr bool whole = std::is_integral_v<T>;
    };
    template <glm::length_t length, class T, glm::qualifier qualifier>
    struct Kind<glm::vec<length, T, qualifier>> {
        static constexpr int components = length;
        static constexpr bool whole = std::is_integral_v<T>;
    };
    UniformValue(std::span<const std::byte> bytes, std::size_t element_bytes, int components, bool whole)
        : bytes_(bytes.begin(), bytes.end()),
          element_bytes_(element_bytes),
          components_(components),
          whole_(whole) {}

    std::vector<std::byte> bytes_;
    std::size_t element_bytes_;
    int components_;
    bool whole_;
};

/// `value`: a number, a vector of numbers, or an array of either.
template <class T>
UniformValue uniform_value(const T& value) {
    if constexpr (requires { std::span(value); }) {
        return UniformValue(std::span(value));
    } else {
        return UniformValue(std::span(&value, 1));
    }
}

/// Values of a shader's uniforms. Values for which the shader has no uniform are ignored.
class Uniforms {
public:
    template <class T>
    void set(const std::string& name, const T& value) {
        values_.insert_or_assign(name, uniform_value(value));
    }
    const std::map<std::string, UniformValue>& values() const { return values_; }

private:
    std::map<std::string, UniformValue> values_;
};

}  // namespace voxspring::glsl
