// What colours mean: scales, the maps from them to colours, and the bar that shows both.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "harness/export/image.h"

namespace voxspring {

/// What a body is coloured by.
enum class Colouring : std::uint8_t {
    displacement,  ///< distance from rest
    error,         ///< distance from float64 after the same steps
};

/// "displacement" or "error".
std::string to_string(Colouring colouring);
/// The other way; nothing for another text.
std::optional<Colouring> colouring_called(const std::string& text);

/// From a colouring's values to 0 to 1: displacements from 0 evenly, errors by their logarithm, over three
/// decades at most.
class Scale {
public:
    /// `max`: the end of the scale, finite and not negative. `largest`: the largest value of the picture that
    /// it stands under; nothing: max.
    Scale(Colouring colouring, double max, std::optional<double> largest = {})
        : colouring_(colouring), max_(max), largest_(largest.value_or(max)) {}

    Colouring colouring() const { return colouring_; }
    double max() const { return max_; }
    double largest() const { return largest_; }
    /// 0 to 1; all is 0 where max() is.
    double place(double value) const;

    struct Tick {
        double value;
        std::string label;
    };
    /// A few round values on the scale, ascending.
    std::vector<Tick> ticks() const;

private:
    Colouring colouring_;
    double max_, largest_;
};

/// Knots of a map from 0 to 1 to colours, evenly spaced, linear between: viridis for displacements and plasma
/// for errors, of matplotlib (Smith, van der Walt and Firing, CC0), at every 17th of their 256 entries.
/// Perceptually uniform, and told apart by every colour vision; within 7/255 of the tables.
inline constexpr int colour_knots = 16;
const std::array<Colour, colour_knots>& colours_of(Colouring colouring);

/// Part of an image's height that the legend takes, from below.
inline constexpr double legend_share = 0.18;

/// The bar with its ticks and what it shows, at the bottom of the image, in a grey that is read on light and
/// on dark.
void draw_legend(Image& image, const Scale& scale);

}  // namespace voxspring
