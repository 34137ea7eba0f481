// Reads volume files: NIfTI, NRRD and MetaImage.
//
// Headers are not trusted. No memory is allocated because of a header alone: data is read piece by piece, and
// there must be exactly as much of it as the header claims. The readers report claims (claims.h). decide.cpp
// interprets them by the rules of docs/volumes.md.
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

/// Directions in a patient's body, each next to its opposite.
enum class AnatomicalSide : std::uint8_t { right, left, anterior, posterior, superior, inferior };
/// Names of the sides, in the order of the enumeration.
inline constexpr std::array<const char*, 6> anatomical_sides = {"right",     "left",     "anterior",
                                                                "posterior", "superior", "inferior"};

/// The placement of a grid in the coordinates of its file.
struct Placement {
    glm::dvec3 origin{0};                   ///< centre of voxel (0, 0, 0), in the file's coordinates
    std::array<glm::dvec3, 3> direction{};  ///< unit vectors of the grid's x, y and z in these coordinates
    /// The sides towards which the three coordinates grow: "RAS", "LPS" or "LAS". Empty if the file does not
    /// say.
    std::string space{};

    /// The unit vector towards `side`, in components along the grid's axes. `space` must not be empty.
    glm::dvec3 towards(AnatomicalSide side) const;
    /// Converts a vector from components along the grid's axes to the file's coordinates.
    glm::dvec3 to_file(const glm::dvec3& v) const;
};

/// The anatomical side that is nearest to the direction of the grid's `axis`, and the angle between both in
/// degrees.
std::pair<AnatomicalSide, double> nearest_side(const Placement& placement, int axis);
/// The axis of a grid that is nearest to the direction of an anatomical side, whether the upper end of that
/// axis points to that side, and the angle in degrees between the axis and the direction.
struct GridSide {
    int axis = 0;
    bool upper = false;
    double degrees = 0;
};
GridSide nearest_grid_side(const Placement& placement, AnatomicalSide side);

/// The user's choices. Each replaces what the file says, or decides what the file leaves open.
struct VolumeChoice {
    std::optional<glm::dvec3> spacing{};
    std::optional<std::int64_t> frame{};  ///< index of the value to use of several values per voxel
};

/// A segment in a file of 3D Slicer: the voxels that have `value` in `layer`.
struct Segment {
    std::string name, id;
    std::int64_t value = 1;
    std::size_t layer = 0;
};

/// The facts that were read from a file besides its voxels.
struct VolumeFacts {
    std::string unit{};  ///< unit of the spacing; empty if the file names none or the user chose the spacing
    bool spacing_chosen = false;  ///< whether the user chose the spacing
    std::optional<Placement> placement{};
    std::int64_t frame = 0, frames = 1;  ///< index of the value used, and number of values per voxel
    /// Name and number of voxels of each label that is in use; in a file with segments, of each segment in
    /// use, including those without voxels. Empty if a threshold chooses the voxels.
    std::vector<std::pair<std::string, std::uint64_t>> labels{};
};

/// A grid of scalars as it is stored in a file.
struct Volume {
    std::string file{};  ///< the name in messages
    glm::ivec3 dims{0};
    glm::dvec3 spacing{1};  ///< in the file's unit of length
    ScalarType type = ScalarType::uint8;
    std::vector<std::byte> data{};  ///< x fastest, in this machine's byte order
    double slope = 1;               ///< a voxel's value is slope * scalar + intercept
    double intercept = 0;
    /// The number of values per voxel, and their order: `inner` voxels of the first layer are followed by the
    /// same voxels of the next layer, and so on. Only segmentations have more than one layer.
    std::size_t layers = 1, inner = 1;
    std::vector<Segment> segments{};
    VolumeFacts facts{};
    std::vector<std::string> notes{};  ///< for the user, like Scene::notes

    std::size_t voxel_count() const { return data.size() / bytes_of(type) / layers; }
};

/// Reads a volume file; its format follows from its name. Throws BadInput.
Volume read_volume(const std::filesystem::path& file, const VolumeChoice& choice,
                   const SceneSizeLimits& limits);
inline Volume read_volume(const std::filesystem::path& file, const SceneSizeLimits& limits) {
    return read_volume(file, VolumeChoice{}, limits);
}
/// Whether read_volume() accepts a file with this name.
bool is_volume_name(const std::string& name);
/// The endings of the names that is_volume_name() accepts, for messages: ".nii, .nii.gz, ... or .mhd".
std::string volume_endings();

/// A label of a volume. The voxels that have it are of one material.
struct Label {
    std::string name;  ///< name of a segment, or the digits of a whole number
    /// Names by which a scene may refer to the label. `name` is among them unless several segments have it.
    std::vector<std::string> words;
};

/// A grid of voxels and its labels. A voxel with grid.label[v] = n belongs to labels[n - 1], or is inactive
/// if n is 0.
struct LabelledGrid {
    VoxelGrid grid;
    std::vector<Label> labels;
    /// Name and number of voxels of each label that is in use, as in VolumeFacts::labels.
    std::vector<std::pair<std::string, std::uint64_t>> counts{};
    std::vector<std::string> notes{};  ///< for the user, like Scene::notes
};

/// A label whose only word is its number.
Label numbered_label(std::int64_t number);
/// The names of the labels, with commas between them.
std::string names_of(const std::vector<Label>& labels);

/// Makes the voxels active whose value exceeds `threshold` (NaN does not). A scaled value has to exceed it by
/// more than the rounding of slope and intercept. All these voxels have label 1. Throws BadInput if no voxel
/// is active, and for a segmentation with several layers.
LabelledGrid above_threshold(const Volume& volume, double threshold);

/// Makes the voxels active whose value is one of `labels` or, without `labels`, neither zero nor NaN. Each
/// label is a material, in ascending order of the numbers. In a segmentation a label is a segment, given by
/// its name, ID or value, and without `labels` all segments are used. A voxel in several segments belongs to
/// the one that comes last. Throws BadInput if no voxel is active, if one of `labels` is repeated, names no
/// label or does not occur, if there are more than 255 labels and, without `labels` and segments, if a value
/// is not a whole number.
LabelledGrid with_labels(const Volume& volume, const std::optional<std::vector<std::string>>& labels);

/// Replaces the grid of `labelled` by a grid of cubes of edge `pitch` with the same middle. A new voxel is
/// active if at least the share `fill` of it, in (0, 1], lies in active voxels of the old grid. Its label is
/// the one that fills most of it; if two fill the same share, the smaller one. Adds notes. Returns the
/// offset from the centre of the old voxel (0, 0, 0) to that of the new one. Throws BadInput, which names
/// `file` and --pitch, if the grid is too large for `limits` or no voxel is active.
glm::dvec3 resample(LabelledGrid& labelled, double pitch, double fill, const std::string& file,
                    const SceneSizeLimits& limits);

}  // namespace voxspring
