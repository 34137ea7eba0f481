// The claims of a volume file's header (what it says of sizes, types and places, not yet checked), and the
// data behind it. The reader of each format only reports claims; decide() checks and interprets them. The
// data is read, plain or compressed, without trusting what the header says about it.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <glm/vec3.hpp>
#include <istream>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "harness/volume/volume.h"

namespace voxspring {

enum class Encoding : std::uint8_t { raw, gzip, zlib, bzip2 };  ///< data called zlib may also be gzip

/// Reads a stream from its current place to its end, and decodes it. Messages name `file`.
class ByteStream {
public:
    ByteStream(std::istream& stream, Encoding encoding, std::string file);
    ~ByteStream();
    ByteStream(const ByteStream&) = delete;
    ByteStream& operator=(const ByteStream&) = delete;

    /// Fills `bytes` and returns the number of bytes read, which is less than their size only at the end of
    /// the data. Throws BadInput if a compressed stream is damaged or cut short.
    std::size_t read(std::span<std::byte> bytes);

    /// Skips `count` bytes and returns how many it skipped: fewer only at the end of the data.
    std::uint64_t skip(std::uint64_t count);

    /// The number of bytes behind the compressed data; valid once the end of the data was read.
    std::uint64_t ignored() const { return ignored_; }

private:
    class Decoder;

    std::size_t read_raw(std::span<std::byte> bytes);
    void refill();
    bool next_member();

    std::istream& stream_;
    const Encoding encoding_;
    const std::string file_;
    std::unique_ptr<Decoder> decoder_;  ///< null if the bytes are not compressed
    std::array<char, 1 << 16> buffer_;
    std::span<char> encoded_;     ///< the part of the buffer that is still to be decoded
    bool at_member_end_ = false;  ///< whether a member (a complete stream) has just ended
    bool at_end_ = false;
    std::uint64_t ignored_ = 0;
};

/// The location of the data according to a header.
struct DataPlace {
    /// The files that hold the data, in this order, each with an equal part. Empty: the data is in the
    /// header's file.
    std::vector<std::filesystem::path> files{};
    std::string files_key{};             ///< key in the header that names the files
    std::optional<Encoding> encoding{};  ///< absent: gzip if the data begins like gzip, otherwise raw
    std::int64_t skipped_lines = 0;      ///< lines to skip in each file before it is decoded
    /// Offset of the encoded data from the start of its file. Absent: the data begins behind the header, or
    /// at the start of another file that the header names.
    std::optional<std::int64_t> begin{};
    std::string bytes_key{"byte skip"};  ///< key in the header that gives `begin` or skipped_bytes
    /// The number of decoded bytes before the data, which are skipped. at_end: the data is the last part of
    /// the decoded bytes.
    std::int64_t skipped_bytes = 0;
    static constexpr std::int64_t at_end = -1;
};

/// Selects items of a sequence: in every `period` items, the `length` items from number `first` on.
struct Kept {
    std::uint64_t period = 1, first = 0, length = 1;
};

/// Returns gzip if the next bytes of `stream` are those of a gzip header, otherwise raw. Does not move the
/// stream.
Encoding encoding_at(std::istream& stream);

/// Calls `use` with a zero of the C++ type that `type` stands for, so that `use` learns the type.
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

/// The other file of a NIfTI pair: the image x.img for the header x.hdr, and the reverse; empty if there is
/// none. A partner that is compressed like `file` is preferred. Otherwise x.hdr gets x.img.gz, unless there
/// is an x.hdr.gz, which is the better partner of that image. If the ending of `file` is in capitals, an
/// ending in capitals is tried first.
std::filesystem::path partner_of(const std::filesystem::path& file);

/// A volume without its data, and which scalars of the file belong to it.
struct DecidedVolume {
    Volume volume;
    std::uint64_t scalars = 0;  ///< number of scalars in the whole file
    Kept kept;                  ///< selects the scalars that belong to the volume
};

/// Applies the rules of docs/volumes.md, the same for all formats, to the claims. Throws BadInput.
DecidedVolume decide(const VolumeClaims& claims, const VolumeChoice& choice, const SceneSizeLimits& limits);

/// Returns the bytes that `kept` selects of the `count` bytes at claims.place. There must be exactly `count`
/// bytes: otherwise throws BadInput, which names claims.data_key and `count_means`, the reason why the header
/// requires them. `behind_header` is the stream of claims.file and stands behind its header. Memory is
/// allocated in proportion to what was really read. Adds notes on ignored data to `notes`.
std::vector<std::byte> read_data(std::istream& behind_header, const VolumeClaims& claims, std::uint64_t count,
                                 const Kept& kept, const std::string& count_means,
                                 std::vector<std::string>& notes);

/// Interprets the claims and reads the voxels. The position of `stream` is behind the header. Throws
/// BadInput.
Volume read_voxels(std::istream& stream, const VolumeClaims& claims, const VolumeChoice& choice,
                   const SceneSizeLimits& limits);

}  // namespace voxspring
