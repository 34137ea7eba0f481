// Describes arrays for writers of files: their bytes as they lie in memory (little endian), and the type and
// number of elements.
#pragma once

#include <bit>
#include <cstddef>
#include <glm/vec3.hpp>
#include <string>
#include <string_view>
#include <type_traits>
#include <vector>

namespace voxspring {

static_assert(std::endian::native == std::endian::little, "arrays are written as they lie in memory");

/// `count` elements of `components` numbers each.
struct ArrayBytes {
    char kind = 'f';        ///< numpy's code: 'f' floating point, 'i' signed, 'u' unsigned integer
    std::size_t width = 0;  ///< bytes per number
    std::size_t components = 1;
    std::size_t count = 0;
    std::string_view bytes;
};

/// The element type as numpy names it: "<f8".
inline std::string numpy_type(const ArrayBytes& array) {
    return (array.width == 1 ? '|' : '<') + (array.kind + std::to_string(array.width));
}
/// The shape of rows of numbers as numpy writes it: "(3, 2)", or "(3,)" if a row is one number.
inline std::string numpy_shape(std::size_t rows, std::size_t columns) {
    return "(" + std::to_string(rows) + "," + (columns > 1 ? " " + std::to_string(columns) : "") + ")";
}

/// The bytes of a vector whose elements are numbers or triples of numbers. `values` must outlive the view.
template <class Value>
ArrayBytes bytes_of(const std::vector<Value>& values) {
    const auto described = [&](auto number, std::size_t components) -> ArrayBytes {
        using Number = decltype(number);
        static_assert(std::is_arithmetic_v<Number>);
        char kind = 'f';
        if (std::is_integral_v<Number>) kind = std::is_signed_v<Number> ? 'i' : 'u';
        return {kind,
                sizeof(Number),
                components,
                values.size(),
                {reinterpret_cast<const char*>(values.data()), values.size() * sizeof(Value)}};
    };
    if constexpr (std::is_arithmetic_v<Value>) {
        return described(Value{}, 1);
    } else {
        using Number = typename Value::value_type;
        static_assert(sizeof(Value) == 3 * sizeof(Number));
        return described(Number{}, 3);
    }
}

}  // namespace voxspring
