// The bytes behind a volume's header, plain or compressed, without trusting what the header says about them.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <istream>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace voxspring {

enum class Encoding : std::uint8_t { raw, gzip, zlib, bzip2 };

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

    /// The rest of the stream, which must be `count` bytes long, is appended to `bytes`. The vector grows
    /// with what was really read, at most to twice that. Throws BadInput naming `key` and `count_means`, what
    /// the header says that makes it `count` bytes.
    void read_rest(std::vector<std::byte>& bytes, std::uint64_t count, std::string_view key,
                   const std::string& count_means);

    class Decoder;

private:
    std::size_t read_raw(std::span<std::byte> bytes);

    std::istream& stream_;
    std::string file_;
    std::unique_ptr<Decoder> decoder_;  ///< null where the bytes are plain
    std::array<char, 1 << 16> buffer_;
    std::span<char> encoded_;     ///< what of the buffer is still to be decoded
    bool at_member_end_ = false;  ///< a compressed file is one member or several, one after another
};

/// Where a header says that its data lies.
struct DataPlace {
    /// In this order, each with an equal part of the data; empty: behind the header, in its own file.
    std::vector<std::filesystem::path> files{};
    std::string files_key{};  ///< of the header, which names the files
    Encoding encoding = Encoding::raw;
    std::int64_t skipped_lines = 0;      ///< of each file, before it is decoded
    std::string bytes_key{"byte skip"};  ///< of the header, which says the next
    std::int64_t skipped_bytes = 0;  ///< of what is decoded; at_end: the data is what a plain file ends with
    static constexpr std::int64_t at_end = -1;
};

/// The `count` bytes at `place`, which must be all that is there. `behind_header` stands behind the header of
/// `file`. Throws BadInput, as read_rest() does.
std::vector<std::byte> read_data(std::istream& behind_header, const std::string& file, const DataPlace& place,
                                 std::uint64_t count, std::string_view key, const std::string& count_means);

}  // namespace voxspring
