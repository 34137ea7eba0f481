// What the header of a volume file says, before anything is decided: the readers only report.
#pragma once

#include <cstdint>
#include <glm/vec3.hpp>
#include <optional>
#include <string>
#include <vector>

#include "harness/volume/byte_stream.h"
#include "harness/volume/volume.h"

namespace voxspring {

enum class AxisKind : std::uint8_t {
    unknown,  ///< the file does not say
    space,
    other,  ///< time, colours, layers
};

struct AxisClaim {
    std::int64_t size = 0;
    AxisKind kind = AxisKind::unknown;
    std::string name{};                           ///< in messages: "dim[4]", "axis 4 (time)"
    std::optional<double> distance{};             ///< between voxels: of any sign, 0 or NaN
    std::string distance_key{}, distance_text{};  ///< the field that says so, as it is written
    std::optional<glm::dvec3> direction{};        ///< of any length
    std::string unit{};
};

struct VolumeClaims {
    std::string file{};
    std::vector<AxisClaim> axes{};          ///< fastest first
    std::string sizes_key{};                ///< of the header, in messages
    std::string kinds_key{}, kinds_text{};  ///< the field by which axes are of space or not
    std::string directions_key{};           ///< the field with the directions
    /// The directions' lengths are distances too (NRRD's space directions, NIfTI's sform): then the sign of a
    /// distance has no say in them.
    bool directions_have_lengths = false;
    std::string space{};  ///< as Placement::space
    std::optional<glm::dvec3> origin{};
    ScalarType type = ScalarType::uint8;
    std::string type_text{};  ///< as the header has it, in messages: "type uint16"
    bool big_endian = false;
    double slope = 1, intercept = 0;
    DataPlace place{};
    std::string data_key{"data"};  ///< in messages
    std::vector<Segment> segments{};
    std::vector<std::string> notes{};
};

/// A volume without its data, and which scalars of the file it is.
struct DecidedVolume {
    Volume volume;
    std::uint64_t scalars = 0;  ///< of the whole file
    /// Of each `period` scalars those from `first` on, `length` of them, are the volume's.
    std::uint64_t period = 1, first = 0, length = 1;
};

/// The rules of docs/volumes.md, the same for all formats. Throws BadInput.
DecidedVolume decide(const VolumeClaims& claims, const VolumeChoice& choice, const SceneSizeLimits& limits);

}  // namespace voxspring
