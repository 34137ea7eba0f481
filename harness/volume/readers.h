// One reader a format, which reports what a header says, and what they share.
#pragma once

#include <cstddef>
#include <filesystem>
#include <istream>
#include <string>
#include <vector>

#include "harness/volume/claims.h"
#include "harness/volume/dataset.h"
#include "harness/volume/volume.h"

namespace voxspring {

/// `stream` has the header; `file` is what messages name and what the names of data files in the header are
/// relative to. Throw BadInput.
VolumeClaims read_nrrd_header(std::istream& stream, const std::string& file);
VolumeClaims read_metaimage_header(std::istream& stream, const std::string& file);
/// `image` has the voxels of a pair; empty: the one that belongs to the header's name.
VolumeClaims read_nifti_header(std::istream& stream, const std::string& file,
                               const std::filesystem::path& image = {});

/// Decides what the claims mean and reads the voxels. `stream` has the header and stands behind it.
Volume read_voxels(std::istream& stream, const VolumeClaims& claims, const VolumeChoice& choice,
                   const SceneSizeLimits& limits);

/// All of it.
Volume read_nifti(std::istream& stream, const std::string& file, const SceneSizeLimits& limits,
                  const VolumeChoice& choice = {});
Volume read_nrrd(std::istream& stream, const std::string& file, const SceneSizeLimits& limits,
                 const VolumeChoice& choice = {});
Volume read_metaimage(std::istream& stream, const std::string& file, const SceneSizeLimits& limits,
                      const VolumeChoice& choice = {});

/// Makes scalars of the other byte order those of this machine.
void to_native_order(std::vector<std::byte>& data, ScalarType type, bool big_endian);

/// The file that belongs to one of a pair: x.img for x.hdr, and so on. One that is compressed alike goes
/// first; the other kind is taken only where it does not have a partner that it would be parted from. Empty
/// where there is none. In capitals where `file` is.
std::filesystem::path partner_of(const std::filesystem::path& file);

}  // namespace voxspring
