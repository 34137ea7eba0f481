// The readers, one per format, which report what a header says, and what they share.
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

/// Read a header from `stream`. Messages name `file`, and names of data files in the header are relative to
/// its folder. Throw BadInput.
VolumeClaims read_nrrd_header(std::istream& stream, const std::string& file);
VolumeClaims read_metaimage_header(std::istream& stream, const std::string& file);
/// `image` is the file with the voxels of a pair; empty: the one that belongs to the header's name.
VolumeClaims read_nifti_header(std::istream& stream, const std::string& file,
                               const std::filesystem::path& image = {});

/// Interprets the claims and reads the voxels. The position of `stream` is behind the header.
Volume read_voxels(std::istream& stream, const VolumeClaims& claims, const VolumeChoice& choice,
                   const SceneSizeLimits& limits);

/// Read header and voxels.
Volume read_nifti(std::istream& stream, const std::string& file, const SceneSizeLimits& limits,
                  const VolumeChoice& choice = {});
Volume read_nrrd(std::istream& stream, const std::string& file, const SceneSizeLimits& limits,
                 const VolumeChoice& choice = {});
Volume read_metaimage(std::istream& stream, const std::string& file, const SceneSizeLimits& limits,
                      const VolumeChoice& choice = {});

/// Converts scalars to the byte order of this machine.
void to_native_order(std::vector<std::byte>& data, ScalarType type, bool big_endian);

/// The partner of a file of a pair: x.img for x.hdr, and so on. A partner that is compressed in the same way
/// is preferred. One that is compressed differently is taken only if it has no such partner itself. An ending
/// in capitals is tried first if that of `file` is in capitals. The result is empty if there is no partner.
std::filesystem::path partner_of(const std::filesystem::path& file);

}  // namespace voxspring
