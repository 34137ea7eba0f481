// Reads the bytes behind a volume's header, plain or compressed, without trusting what the header says about
// them.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <istream>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace voxspring {

enum class Encoding : std::uint8_t { raw, gzip, zlib, bzip2 };  ///< data called zlib may also be gzip

/// Reads a stream from its current place to its end, and decodes it. Messages name `file`.
class ByteStream {
public:
    ByteStream(std::istream& stream, Encoding encoding, std::string file);
    ~ByteStream();
    ByteStream(const ByteStream&) = delete;
    ByteStream& operator=(const ByteStream&) = delete;

    /// Fills `bytes` and returns the number of bytes read, which is smaller only at the end of the data.
    /// Throws BadInput if a compressed stream is damaged or cut short.
    std::size_t read(std::span<std::byte> bytes);

    /// Skips up to `count` bytes and returns their number, which is smaller only at the end of the data.
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
    bool at_member_end_ = false;  ///< whether a member ended; a compressed file has one or more members
    bool at_end_ = false;
    std::uint64_t ignored_ = 0;
};

/// The location of the data according to a header.
struct DataPlace {
    /// Files of the data in this order, each with an equal part. Empty: the data is in the file of the
    /// header.
    std::vector<std::filesystem::path> files{};
    std::string files_key{};             ///< key in the header that names the files
    std::optional<Encoding> encoding{};  ///< absent: gzip if the data begins like gzip, otherwise raw
    std::int64_t skipped_lines = 0;      ///< lines to skip in each file before it is decoded
    /// Offset of the encoded data from the start of its file. Absent: it begins behind the header, or at the
    /// start of another file.
    std::optional<std::int64_t> begin{};
    std::string bytes_key{"byte skip"};  ///< key in the header that gives skipped_bytes
    /// The number of decoded bytes to skip. at_end: all but the last ones, which are the data.
    std::int64_t skipped_bytes = 0;
    static constexpr std::int64_t at_end = -1;
};

/// Selects bytes: in every `period` bytes, the `length` bytes from number `first` on.
struct KeptBytes {
    std::uint64_t period = 1, first = 0, length = 1;
};

/// Returns the bytes that `kept` selects of the `count` bytes at `place`. There must be exactly `count`
/// bytes: otherwise throws BadInput, which names `key` and `count_means`, the reason why the header requires
/// them. `behind_header` is the stream of `file` and stands behind its header. Memory is allocated in
/// proportion to what was really read. Adds notes on ignored data to `notes`.
std::vector<std::byte> read_data(std::istream& behind_header, const std::string& file, const DataPlace& place,
                                 std::uint64_t count, const KeptBytes& kept, std::string_view key,
                                 const std::string& count_means, std::vector<std::string>& notes);

/// Returns gzip if the next bytes of `stream` are those of a gzip header, otherwise raw. Does not move the
/// stream.
Encoding encoding_at(std::istream& stream);

}  // namespace voxspring
