// What the colours of pictures mean: scales, colour maps, and the bar that shows a scale and its colours.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "harness/drawing/image.h"

namespace voxspring {

/// The quantity that colours a body.
enum class Colouring : std::uint8_t {
    displacement,  ///< distance from rest
    error,         ///< distance from the float64 reference after the same steps
};

std::string to_string(Colouring colouring);
/// The colouring called "displacement" or "error"; nullopt for any other text.
std::optional<Colouring> colouring_called(const std::string& text);

/// Maps a colouring's values to 0 to 1: displacements linearly from 0, errors by their logarithm over the
/// three decades below the upper end.
class Scale {
public:
    /// `max` is the upper end of the scale, finite and not negative. `largest`, which the legend prints, is
    /// the largest value in its picture; absent: max.
    Scale(Colouring colouring, double max, std::optional<double> largest = {})
        : colouring_(colouring), max_(max), largest_(largest.value_or(max)) {}

    Colouring colouring() const { return colouring_; }
    double max() const { return max_; }
    double largest() const { return largest_; }
    /// The position of a value on the colour bar, from 0 to 1; always 0 if max() is 0.
    double place(double value) const;

    struct Tick {
        double value;
        std::string label;
    };
    /// A few round values on the scale, in ascending order.
    std::vector<Tick> ticks() const;

private:
    Colouring colouring_;
    double max_, largest_;
};

/// The number of evenly spaced knots of each colour map, which is linear between them. The maps are
/// matplotlib's viridis for displacements and plasma for errors (Smith, van der Walt and Firing, CC0), at
/// every 17th of their 256 entries. Both are perceptually uniform and readable with every kind of colour
/// vision. Interpolation stays within 7/255 of the full tables.
inline constexpr int colour_knots = 16;
const std::array<Colour, colour_knots>& colours_of(Colouring colouring);

/// The share of an image's height that the legend takes, at the bottom.
inline constexpr double legend_share = 0.18;

/// Draws the colour bar, its ticks and its title at the bottom of the image, in a grey that is legible on
/// light and dark backgrounds.
void draw_legend(Image& image, const Scale& scale);

}  // namespace voxspring
