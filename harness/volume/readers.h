// What the readers of volume files share.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <istream>
#include <optional>
#include <string>
#include <vector>

#include "harness/volume/dataset.h"
#include "harness/volume/volume.h"

namespace voxspring {

/// One reader a format. `stream` has the header; `file` is what messages name and what the names of data
/// files in the header are relative to. Throw BadInput.
Volume read_nifti(std::istream& stream, const std::string& file, const SceneSizeLimits& limits);
Volume read_nrrd(std::istream& stream, const std::string& file, const SceneSizeLimits& limits);
Volume read_metaimage(std::istream& stream, const std::string& file, const SceneSizeLimits& limits);

/// Which of a file's axes are x, y and z of the grid, where it has three or more: axes of size 1 are left out
/// until there are three, first those that are not of space, then the last ones, then the first ones. Nothing
/// if there are more than three without them. `is_of_space` is empty or has a word about each axis.
std::optional<std::array<std::size_t, 3>> axes_of_space(const std::vector<std::int64_t>& sizes,
                                                        const std::vector<bool>& is_of_space = {});
/// What messages say of `dimensions` sizes.
std::string sizes_accepted(int dimensions);

/// Whether a scene takes it for the distance between neighbouring voxels.
bool is_spacing(double distance);

/// Makes scalars of the other byte order those of this machine.
void to_native_order(std::vector<std::byte>& data, ScalarType type, bool big_endian);

}  // namespace voxspring
