// Volume files with one scalar for each voxel: NIfTI, NRRD and MetaImage.
//
// A header is a claim. Nothing is allocated because of it alone: data is read piece by piece, and there must
// be exactly as much of it as the header says. Orientation is dropped: the grid's axes are the scene's.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <glm/vec3.hpp>
#include <optional>
#include <string>
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

/// A grid of scalars as a file holds it.
struct Volume {
    std::string file;  ///< what messages name
    glm::ivec3 dims{0};
    glm::dvec3 spacing{1};  ///< in the file's unit of length; 1 where it gives none
    ScalarType type = ScalarType::uint8;
    std::vector<std::byte> data;  ///< x fastest, in this machine's byte order
    double slope = 1;             ///< a voxel's value is slope * scalar + intercept
    double intercept = 0;
};

/// Reads a volume file; its format follows from its name. Throws BadInput.
Volume read_volume(const std::filesystem::path& file, const SceneSizeLimits& limits);
/// Whether read_volume() takes a file of this name.
bool is_volume_name(const std::string& name);
/// The endings of such names, for people: ".nii, .nii.gz, ... or .mhd".
std::string volume_endings();

/// A grid whose material m stands for the label labels[m] of the volume.
struct LabelledGrid {
    VoxelGrid grid;
    std::vector<std::int64_t> labels;  ///< ascending
};

/// Active where the value exceeds `threshold` (NaN does not), all with label 1. Throws BadInput if nothing
/// is.
LabelledGrid above_threshold(const Volume& volume, double threshold);

/// Active where the value is one of `labels`, or, without them, not zero; each label is a material. Throws
/// BadInput if nothing is active, if one of `labels` does not occur, if there are more than 255 and, without
/// `labels`, if a value is not a whole number.
LabelledGrid with_labels(const Volume& volume, const std::optional<std::vector<std::int64_t>>& labels);

}  // namespace voxspring
