// The bytes behind a volume's header, plain or compressed, without trusting what the header says about them.
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

enum class Encoding : std::uint8_t { raw, gzip, zlib, bzip2 };  ///< zlib's data may also be gzip's

/// Reads a stream from its current place to its end. Messages name `file`.
class ByteStream {
public:
    ByteStream(std::istream& stream, Encoding encoding, std::string file);
    ~ByteStream();
    ByteStream(const ByteStream&) = delete;
    ByteStream& operator=(const ByteStream&) = delete;

    /// Fills `bytes` and returns how many there were: fewer only at the end of the data. Throws BadInput if
    /// a compressed stream is damaged or cut short.
    std::size_t read(std::span<std::byte> bytes);

    /// Passes over `count` bytes; false if there are not that many.
    bool skip(std::uint64_t count);

    /// How many bytes there are until the end of the data.
    std::uint64_t skip_rest();

    /// Bytes behind compressed data that are none, once the end of the data was read.
    std::uint64_t ignored() const { return ignored_; }

    class Decoder;

private:
    std::size_t read_raw(std::span<std::byte> bytes);
    bool next_member();

    std::istream& stream_;
    std::string file_;
    std::unique_ptr<Decoder> decoder_;  ///< null where the bytes are plain
    std::array<char, 1 << 16> buffer_;
    std::span<char> encoded_;     ///< what of the buffer is still to be decoded
    bool at_member_end_ = false;  ///< a compressed file is one member or several, one after another
    bool at_end_ = false;
    std::uint64_t ignored_ = 0;
};

/// Where a header says that its data lies.
struct DataPlace {
    /// In this order, each with an equal part of the data; empty: in the header's own file.
    std::vector<std::filesystem::path> files{};
    std::string files_key{};             ///< of the header, which names the files
    std::optional<Encoding> encoding{};  ///< absent: gzip if it begins as gzip does, otherwise raw
    std::int64_t skipped_lines = 0;      ///< of each file, before it is decoded
    /// Where the encoded data begins, from the start of its file; absent: behind the header, or at the start
    /// of another file.
    std::optional<std::int64_t> begin{};
    std::string bytes_key{"byte skip"};  ///< of the header, which says the next
    std::int64_t skipped_bytes = 0;      ///< of what is decoded; at_end: the data is what that ends with
    static constexpr std::int64_t at_end = -1;
};

/// Of each `period` bytes those from `first` on, `length` of them.
struct KeptBytes {
    std::uint64_t period = 1, first = 0, length = 1;
};

/// What is kept of the `count` bytes at `place`, which must be all that is there. `behind_header` stands
/// behind the header of `file`. Allocates in proportion to what was really read. Throws BadInput naming `key`
/// and `count_means`, what the header says that makes it `count` bytes. Adds to `notes` what was ignored.
std::vector<std::byte> read_data(std::istream& behind_header, const std::string& file, const DataPlace& place,
                                 std::uint64_t count, const KeptBytes& kept, std::string_view key,
                                 const std::string& count_means, std::vector<std::string>& notes);

/// Gzip if `stream` goes on as gzip does, otherwise raw; leaves it where it is.
Encoding encoding_at(std::istream& stream);

}  // namespace voxspring
