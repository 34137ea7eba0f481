// Determines which voxels of a volume are active, and their labels.
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <iterator>
#include <limits>
#include <map>
#include <numeric>
#include <optional>
#include <set>
#include <string>
#include <unordered_map>
#include <utility>
#include <vector>

#include "harness/base/bad_input.h"
#include "harness/volume/claims.h"
#include "harness/volume/text_header.h"

namespace voxspring {
namespace {

/// Calls `use(voxel, value)` for every voxel of a layer, in order.
template <class Use>
void for_each_value(const Volume& volume, std::size_t layer, const Use& use) {
    const std::size_t count = volume.voxel_count(), inner = volume.inner;
    with_scalar(volume.type, [&](auto zero) {
        // The cast is safe because operator new aligns for every scalar type.
        const auto* const scalar = reinterpret_cast<const decltype(zero)*>(volume.data.data());
        for (std::size_t voxel = 0; voxel < count; ++voxel) {
            const std::size_t at =
                volume.layers == 1 ? voxel : (voxel / inner * volume.layers + layer) * inner + voxel % inner;
            use(voxel, volume.slope * double(scalar[at]) + volume.intercept);
        }
    });
}

VoxelGrid inactive_grid(const Volume& volume) {
    return {volume.dims, volume.spacing, std::vector<std::uint8_t>(volume.voxel_count())};
}

bool is_integer(ScalarType type) { return type != ScalarType::float32 && type != ScalarType::float64; }

/// Converts values to labels. In a file with scaled integers a label is stored as the nearest multiple of the
/// slope, and slope and intercept are rounded to 24 bits: so a value may differ from its label.
class Rounding {
public:
    explicit Rounding(const Volume& volume)
        : scaled_(volume.slope != 1 || volume.intercept != 0),
          intercept_(std::abs(volume.intercept)),
          step_(scaled_ && is_integer(volume.type) ? std::abs(volume.slope) / 2 : 0) {}

    /// The largest error of `value` that comes from rounding slope and intercept to 24 bits. Infinity has
    /// none.
    double error(double value) const {
        return scaled_ && std::isfinite(value) ? std::ldexp(std::abs(value) + 2 * intercept_, -23) : 0;
    }

    /// The label for which `value` was stored, if any. It is the nearest whole number, which a value may miss
    /// by the rounding of the scaling plus 2 to 4 units in the last place of a 32-bit float (resampled label
    /// maps are off by that), but never by more than 0.05.
    std::optional<std::int64_t> label(double value) {
        if (!(std::abs(value) <= double(max_label))) return {};
        const double whole = std::round(value), off = std::abs(value - whole);
        constexpr double furthest = 0.05;
        if (off > std::min(furthest, step_ + error(value) + std::ldexp(std::abs(value), -22))) return {};
        furthest_ = std::max(furthest_, off);
        return std::int64_t(whole);
    }

    void say(std::vector<std::string>& notes) const {
        if (furthest_ > 0)
            notes.push_back(
                fmt::format("values within {:.1g} of a whole number are taken for that label", furthest_));
    }

private:
    bool scaled_;
    double intercept_, step_, furthest_ = 0;
};

/// Throws BadInput if there are more labels than max_labels.
void check_count(const Volume& volume, std::size_t labels) {
    if (labels <= max_labels) return;
    throw BadInput(volume.file, "labels", "more than " + std::to_string(max_labels) + " labels",
                   "a list of those to use, at most " + std::to_string(max_labels));
}

/// The distinct values other than zero and NaN, ascending. They must be whole numbers, at most 255 of them.
std::set<std::int64_t> occurring_labels(const Volume& volume) {
    Rounding rounding(volume);
    std::set<std::int64_t> labels;
    double latest = 0;  // neighbouring voxels mostly carry the same label
    for_each_value(volume, 0, [&](std::size_t voxel, double value) {
        if (value == latest || std::isnan(value)) return;
        const auto label = rounding.label(value);
        if (!label) {
            throw BadInput(volume.file, "voxel " + std::to_string(voxel), fmt::format("{:g}", value),
                           "whole numbers where materials are given per label");
        }
        latest = value;
        if (*label != 0 && labels.insert(*label).second) check_count(volume, labels.size());
    });
    return labels;
}

/// The label that `word` spells, if it is written as std::to_string() writes it and within ±max_label.
std::optional<std::int64_t> number_of(const std::string& word) {
    const auto number = parse_number<std::int64_t>(word);
    const bool is_label =
        number && std::to_string(*number) == word && *number >= -max_label && *number <= max_label;
    return is_label ? number : std::nullopt;
}

/// Throws BadInput because no voxel carries `label`. `present` has the names of the labels that voxels carry.
[[noreturn]] void refuse_absent(const Volume& volume, const std::string& label, const std::string& present) {
    throw BadInput(volume.file, "labels", label, "labels that some voxel carries: " + present);
}

/// The lowest labels other than 0 that voxels carry. Values that are no labels, of which a volume may have
/// many, are passed over.
std::string first_labels(const Volume& volume) {
    constexpr std::size_t listed = 10;
    Rounding rounding(volume);
    std::set<std::int64_t> lowest;  // holds one more than `listed`, to know whether there are more
    double latest = 0;
    for_each_value(volume, 0, [&](std::size_t, double value) {
        if (value == latest) return;
        latest = value;
        const auto label = rounding.label(value);
        if (!label || *label == 0) return;
        lowest.insert(*label);
        if (lowest.size() > listed + 1) lowest.erase(std::prev(lowest.end()));
    });
    if (lowest.empty()) return "no value but 0 is a whole number";
    const bool more = lowest.size() > listed;
    if (more) lowest.erase(std::prev(lowest.end()));
    return fmt::format("{}{}", fmt::join(lowest, ", "), more ? " and higher ones" : "");
}

LabelledGrid with_numbers(const Volume& volume, const std::optional<std::vector<std::string>>& words) {
    std::set<std::int64_t> numbers;
    if (!words) numbers = occurring_labels(volume);
    for (const std::string& word : words.value_or(std::vector<std::string>())) {
        const auto number = number_of(word);
        if (!number) {
            throw BadInput(volume.file, "labels", word,
                           "whole numbers: the file has no segments that could be named");
        }
        if (!numbers.insert(*number).second) throw BadInput(volume.file, "labels", word, "each label once");
    }
    check_count(volume, numbers.size());
    if (numbers.empty())
        throw BadInput(volume.file, "labels", "a volume of zeros", "a label that some voxel carries");

    LabelledGrid result{inactive_grid(volume), {}};
    std::map<std::int64_t, std::uint8_t> material;  // label to material; materials count from 1
    for (const std::int64_t number : numbers) {
        result.labels.push_back(numbered_label(number));
        material.emplace(number, std::uint8_t(material.size() + 1));
    }
    std::vector<std::uint64_t> voxels(numbers.size() + 1);
    Rounding rounding(volume);
    double latest = std::numeric_limits<double>::quiet_NaN();
    std::uint8_t latest_material = 0;
    for_each_value(volume, 0, [&](std::size_t voxel, double value) {
        if (value != latest) {
            latest = value;
            latest_material = 0;
            // Only values that may be one of the labels are passed to label(), which records how far they are
            // from whole numbers.
            const auto found = material.find(std::abs(value) <= double(max_label) ? std::llround(value) : 0);
            if (found != material.end() && rounding.label(value)) latest_material = found->second;
        }
        ++voxels[latest_material];
        result.grid.label[voxel] = latest_material;
    });
    for (std::size_t m = 0; m < numbers.size(); ++m) {
        if (voxels[m + 1] == 0) refuse_absent(volume, result.labels[m].name, first_labels(volume));
        result.counts.emplace_back(result.labels[m].name, voxels[m + 1]);
    }
    rounding.say(result.notes);
    return result;
}

/// The label of every segment, with the words that identify it and no other segment.
std::vector<Label> labels_of(const std::vector<Segment>& segments) {
    const auto words_of = [](const Segment& segment) {
        return std::vector<std::string>{segment.name, segment.id, std::to_string(segment.value)};
    };
    std::map<std::string, std::set<const Segment*>> owners;
    for (const Segment& segment : segments) {
        for (const std::string& word : words_of(segment)) owners[word].insert(&segment);
    }
    std::vector<Label> labels;
    for (const Segment& segment : segments) {
        Label label{segment.name, {}};
        for (const std::string& word : words_of(segment)) {
            const bool known = std::find(label.words.begin(), label.words.end(), word) != label.words.end();
            if (!known && owners[word].size() == 1) label.words.push_back(word);
        }
        labels.push_back(std::move(label));
    }
    return labels;
}

/// The segments that `words` name, in that order.
std::vector<std::size_t> chosen_segments(const Volume& volume, const std::vector<Label>& labels,
                                         const std::vector<std::string>& words) {
    std::vector<std::size_t> chosen;
    for (const std::string& word : words) {
        const auto found = std::find_if(labels.begin(), labels.end(), [&](const Label& label) {
            return std::find(label.words.begin(), label.words.end(), word) != label.words.end();
        });
        if (found == labels.end()) {
            throw BadInput(volume.file, "labels", word,
                           "a name, an ID or a value that exactly one segment has: " + names_of(labels));
        }
        chosen.push_back(std::size_t(found - labels.begin()));
        if (std::count(chosen.begin(), chosen.end(), chosen.back()) > 1)
            throw BadInput(volume.file, "labels", word, "each segment once");
    }
    return chosen;
}

LabelledGrid with_segments(const Volume& volume, const std::optional<std::vector<std::string>>& words) {
    const std::vector<Segment>& segments = volume.segments;
    const std::vector<Label> all = labels_of(segments);
    LabelledGrid result{inactive_grid(volume), {}};
    std::vector<std::uint64_t> voxels(segments.size());
    std::vector<std::size_t> chosen(segments.size());
    std::iota(chosen.begin(), chosen.end(), std::size_t{0});
    if (words) chosen = chosen_segments(volume, all, *words);
    check_count(volume, chosen.size());
    std::vector<std::uint8_t> rank(segments.size());  // place among chosen segments, from 1; 0: not chosen
    for (std::size_t c = 0; c < chosen.size(); ++c) rank[chosen[c]] = std::uint8_t(c + 1);

    std::vector<bool> shared(volume.voxel_count());
    std::uint64_t overlap = 0, without = 0;
    for (std::size_t layer = 0; layer < volume.layers; ++layer) {
        std::unordered_map<double, std::vector<std::size_t>> of_value;
        for (std::size_t s = 0; s < segments.size(); ++s) {
            if (segments[s].layer == layer) of_value[double(segments[s].value)].push_back(s);
        }
        for_each_value(volume, layer, [&](std::size_t voxel, double value) {
            if (value == 0 || std::isnan(value)) return;
            const auto found = of_value.find(value);
            if (found == of_value.end()) {
                ++without;
                return;
            }
            std::uint8_t& label = result.grid.label[voxel];
            for (const std::size_t s : found->second) {
                ++voxels[s];
                if (rank[s] == 0) continue;
                if (label != 0 && !shared[voxel]) {
                    shared[voxel] = true;
                    ++overlap;
                }
                label = std::max(label, rank[s]);
            }
        });
    }
    for (std::size_t s = 0; s < segments.size(); ++s) {
        if (rank[s] == 0) continue;
        result.counts.emplace_back(segments[s].name, voxels[s]);
        if (voxels[s] > 0) continue;
        if (words) {
            std::vector<Label> present;
            for (std::size_t other = 0; other < segments.size(); ++other) {
                if (voxels[other] > 0) present.push_back(all[other]);
            }
            refuse_absent(volume, segments[s].name, names_of(present));
        }
        result.notes.push_back("segment " + segments[s].name + " has no voxel");
    }
    // Only segments that have voxels become materials.
    std::vector<std::uint8_t> material(chosen.size() + 1);
    for (std::size_t c = 0; c < chosen.size(); ++c) {
        if (voxels[chosen[c]] == 0) continue;
        result.labels.push_back(all[chosen[c]]);
        material[c + 1] = std::uint8_t(result.labels.size());
    }
    if (result.labels.empty())
        throw BadInput(volume.file, "labels", "segments without voxels", "a label that some voxel carries");
    for (std::uint8_t& label : result.grid.label) label = material[label];
    if (overlap > 0) {
        result.notes.push_back(
            fmt::format("{} {} in several segments: each is part of the one that comes last in {}", overlap,
                        overlap == 1 ? "voxel is" : "voxels are", words ? "the list of labels" : "the file"));
    }
    if (without > 0) {
        result.notes.push_back(fmt::format("{} {} that no segment has, and {} left out", without,
                                           without == 1 ? "voxel has a value" : "voxels have values",
                                           without == 1 ? "is" : "are"));
    }
    return result;
}

}  // namespace

std::string names_of(const std::vector<Label>& labels) {
    std::vector<std::string> names;
    for (const Label& label : labels) names.push_back(label.name);
    return fmt::format("{}", fmt::join(names, ", "));
}

Label numbered_label(std::int64_t number) { return {std::to_string(number), {std::to_string(number)}}; }

LabelledGrid above_threshold(const Volume& volume, double threshold) {
    if (volume.layers > 1) {
        throw BadInput(
            volume.file, "threshold", fmt::format("{:g}", threshold),
            fmt::format("labels, by the names of segments: the file has {} layers", volume.layers));
    }
    LabelledGrid result{inactive_grid(volume), {numbered_label(1)}};
    const Rounding rounding(volume);
    double largest = -std::numeric_limits<double>::infinity();
    bool any = false;
    for_each_value(volume, 0, [&](std::size_t voxel, double value) {
        if (value > threshold + rounding.error(value)) {
            result.grid.label[voxel] = 1;
            any = true;
        } else if (value > largest) {
            largest = value;
        }
    });
    if (!any) {
        throw BadInput(volume.file, "threshold", fmt::format("{:g}", threshold),
                       "a number below the largest value in the volume, " + fmt::format("{:g}", largest) +
                           ", so that some voxel is active");
    }
    return result;
}

LabelledGrid with_labels(const Volume& volume, const std::optional<std::vector<std::string>>& labels) {
    return volume.segments.empty() ? with_numbers(volume, labels) : with_segments(volume, labels);
}

}  // namespace voxspring
