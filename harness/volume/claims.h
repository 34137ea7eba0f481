// The claims of a volume file's header. Readers, one per format, only report them; decide() interprets them.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <glm/vec3.hpp>
#include <istream>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "harness/volume/byte_stream.h"
#include "harness/volume/volume.h"

namespace voxspring {

/// Calls `use` with a zero of the C++ type that `type` stands for.
template <class Use>
auto with_scalar(ScalarType type, const Use& use) {
    using Scalar = std::variant<std::int8_t, std::uint8_t, std::int16_t, std::uint16_t, std::int32_t,
                                std::uint32_t, std::int64_t, std::uint64_t, float, double>;
    static const std::array<Scalar, std::variant_size_v<Scalar>> zeros = {
        std::int8_t{},   std::uint8_t{}, std::int16_t{},  std::uint16_t{}, std::int32_t{},
        std::uint32_t{}, std::int64_t{}, std::uint64_t{}, float{},         double{}};
    return std::visit(use, zeros[std::size_t(type)]);
}

enum class AxisKind : std::uint8_t {
    unknown,  ///< the file does not say what the axis is
    space,
    other,  ///< time, colours, layers
};

struct AxisClaim {
    std::int64_t size = 0;
    AxisKind kind = AxisKind::unknown;
    std::string name{};                           ///< name in messages: "dim[4]", "axis 4 (time)"
    std::optional<double> distance{};             ///< distance between voxels: may be negative, 0 or NaN
    std::string distance_key{}, distance_text{};  ///< the header's field for `distance`, and its text
    std::optional<glm::dvec3> direction{};        ///< a vector of any length
    std::string unit{};
};

struct VolumeClaims {
    std::string file{};
    std::vector<AxisClaim> axes{};          ///< fastest axis first
    std::string sizes_key{};                ///< the header's key for sizes, in messages
    std::string kinds_key{}, kinds_text{};  ///< the header's field for the kinds of axes, and its text
    std::string directions_key{};           ///< the header's field for directions
    /// Whether lengths of directions are distances too (NRRD's space directions, NIfTI's sform). Then a
    /// negative distance does not reverse the direction of its axis.
    bool directions_have_lengths = false;
    std::string space{};  ///< sides towards which coordinates grow, as in Placement::space
    std::optional<glm::dvec3> origin{};
    ScalarType type = ScalarType::uint8;
    std::string type_text{};  ///< the header's text, in messages: "type uint16"
    bool big_endian = false;
    double slope = 1, intercept = 0;
    DataPlace place{};
    std::string data_key{"data"};  ///< name of the data in messages
    std::vector<Segment> segments{};
    std::vector<std::string> notes{};
};

/// Read a header from `stream`. Messages name `file`, and names of data files in the header are relative to
/// its folder. Throw BadInput.
VolumeClaims read_nrrd(std::istream& stream, const std::string& file);
VolumeClaims read_metaimage(std::istream& stream, const std::string& file);
/// If the header is one of a pair, the voxels are in `image`. If `image` is empty, that file is found by the
/// header's name.
VolumeClaims read_nifti(std::istream& stream, const std::string& file,
                        const std::filesystem::path& image = {});

/// The partner of a file of a NIfTI pair: x.img for x.hdr, and so on; empty if there is none. A partner that
/// is compressed like `file` comes first. Without one, x.hdr gets x.img.gz, unless there is an x.hdr.gz, the
/// better partner of that image. An ending in capitals is tried first if that of `file` is in capitals.
std::filesystem::path partner_of(const std::filesystem::path& file);

/// A volume without its data, and which scalars of the file belong to it.
struct DecidedVolume {
    Volume volume;
    std::uint64_t scalars = 0;  ///< number of scalars in the whole file
    /// The scalars of the file that belong to the volume: in every `period` scalars, the `length` scalars
    /// from number `first` on.
    std::uint64_t period = 1, first = 0, length = 1;
};

/// Applies the rules of docs/volumes.md, the same for all formats, to the claims. Throws BadInput.
DecidedVolume decide(const VolumeClaims& claims, const VolumeChoice& choice, const SceneSizeLimits& limits);

/// Interprets the claims and reads the voxels. The position of `stream` is behind the header. Throws
/// BadInput.
Volume read_voxels(std::istream& stream, const VolumeClaims& claims, const VolumeChoice& choice,
                   const SceneSizeLimits& limits);

}  // namespace voxspring
