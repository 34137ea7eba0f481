// Volume files: NIfTI, NRRD and MetaImage.
//
// A header is a claim. Nothing is allocated because of it alone: data is read piece by piece, and there must
// be exactly as much of it as the header says. The readers report claims (claims.h); decide.cpp decides what
// they mean, by one rule for each question, which docs/volumes.md states.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <glm/vec3.hpp>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "backends/physics/problem.h"
#include "harness/volume/dataset.h"

namespace voxspring {

enum class ScalarType : std::uint8_t {
    int8,
    uint8,
    int16,
    uint16,
    int32,
    uint32,
    int64,
    uint64,
    float32,
    float64
};
std::size_t bytes_of(ScalarType type);

/// Directions in a body, each beside its opposite.
enum class AnatomicalSide : std::uint8_t { right, left, anterior, posterior, superior, inferior };
/// By their names, in the order of the enumeration.
inline constexpr std::array<const char*, 6> anatomical_sides = {"right",     "left",     "anterior",
                                                                "posterior", "superior", "inferior"};

/// Where a file puts its grid.
struct Placement {
    glm::dvec3 origin{0};                   ///< of the centre of voxel (0, 0, 0), in the file's coordinates
    std::array<glm::dvec3, 3> direction{};  ///< of the grid's x, y and z there, of length 1
    /// The sides that the three coordinates grow towards: "RAS", "LPS" or "LAS". Empty where the file does
    /// not say.
    std::string space{};

    /// The unit vector towards `side` along the grid's axes. `space` must not be empty.
    glm::dvec3 towards(AnatomicalSide side) const;
    /// A vector along the grid's axes in the file's coordinates.
    glm::dvec3 to_file(const glm::dvec3& v) const;
};

/// The side that is nearest to the direction of the grid's `axis`, and how many degrees it is off.
std::pair<AnatomicalSide, double> nearest_side(const Placement& placement, int axis);
/// The axis of the grid that is nearest to `side`, whether its upper end is the one, and how many degrees it
/// is off.
struct GridSide {
    int axis = 0;
    bool upper = false;
    double degrees = 0;
};
GridSide nearest_grid_side(const Placement& placement, AnatomicalSide side);

/// What a user chooses in the place of what the file says, or where it leaves a choice.
struct VolumeChoice {
    std::optional<glm::dvec3> spacing{};
    std::optional<std::int64_t> frame{};  ///< of a file with several values per voxel, from 0 on
};

/// A part of a body in a file of 3D Slicer: the voxels that have `value` in `layer`.
struct Segment {
    std::string name, id;
    std::int64_t value = 1;
    std::size_t layer = 0;
};

/// What was read of a file besides its voxels.
struct VolumeFacts {
    std::string unit{};           ///< of the spacing; empty where the file names none, or it was chosen
    bool spacing_chosen = false;  ///< by the user
    std::optional<Placement> placement{};
    std::int64_t frame = 0, frames = 1;  ///< which of how many values per voxel
    /// Name and voxels of each segment of the file, or of each label that was asked for.
    std::vector<std::pair<std::string, std::uint64_t>> labels{};
};

/// A grid of scalars as a file holds it.
struct Volume {
    std::string file{};  ///< what messages name
    glm::ivec3 dims{0};
    glm::dvec3 spacing{1};  ///< in the file's unit of length
    ScalarType type = ScalarType::uint8;
    std::vector<std::byte> data{};  ///< x fastest, in this machine's byte order
    double slope = 1;               ///< a voxel's value is slope * scalar + intercept
    double intercept = 0;
    /// Values per voxel, of which `inner` voxels follow each other in a layer before the next layer has as
    /// many. More than one in segmentations alone.
    std::size_t layers = 1, inner = 1;
    std::vector<Segment> segments{};
    VolumeFacts facts{};
    std::vector<std::string> notes{};  ///< as Scene::notes

    std::size_t voxel_count() const { return data.size() / bytes_of(type) / layers; }
};

/// Reads a volume file; its format follows from its name. Throws BadInput.
Volume read_volume(const std::filesystem::path& file, const VolumeChoice& choice,
                   const SceneSizeLimits& limits);
inline Volume read_volume(const std::filesystem::path& file, const SceneSizeLimits& limits) {
    return read_volume(file, VolumeChoice{}, limits);
}
/// Whether read_volume() takes a file of this name.
bool is_volume_name(const std::string& name);
/// The endings of such names, for people: ".nii, .nii.gz, ... or .mhd".
std::string volume_endings();

/// What the voxels of one material have in common.
struct Label {
    std::string name;                ///< a segment's, or the digits of a whole number
    std::vector<std::string> words;  ///< any of which a scene may call it by; the name is one
};

/// A grid whose material m stands for labels[m].
struct LabelledGrid {
    VoxelGrid grid;
    std::vector<Label> labels;
    /// Of each label that was asked for or, in a segmentation, of each segment: its name and its voxels.
    std::vector<std::pair<std::string, std::uint64_t>> counts{};
    std::vector<std::string> notes{};  ///< as Scene::notes
};

/// A label whose only word is its number.
Label numbered_label(std::int64_t number);

/// Active where the value exceeds `threshold` (NaN does not), all with label 1. Throws BadInput if nothing
/// is, and for a segmentation of several layers.
LabelledGrid above_threshold(const Volume& volume, double threshold);

/// Active where the value is one of `labels`, or, without them, neither zero nor NaN; each label is a
/// material, by number. In a segmentation a label is a segment, by its name, ID or value, and without
/// `labels` all are taken; a voxel in several of them belongs to the one that comes last. Throws BadInput if
/// nothing is active, if one of `labels` does not occur, if there are more than 255 and, without `labels`, if
/// a value is not a whole number.
LabelledGrid with_labels(const Volume& volume, const std::optional<std::vector<std::string>>& labels);

}  // namespace voxspring
