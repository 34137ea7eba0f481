// The bytes behind a volume's header, plain or deflated, without trusting what the header says about them.
#pragma once

#include <cstddef>
#include <cstdint>
#include <istream>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace voxspring {

enum class Encoding : std::uint8_t { raw, gzip };

/// Reads a stream from its current place to its end. Messages name `file`.
class ByteStream {
public:
    ByteStream(std::istream& stream, Encoding encoding, std::string file);
    ~ByteStream();
    ByteStream(const ByteStream&) = delete;
    ByteStream& operator=(const ByteStream&) = delete;

    /// Fills `bytes` and returns how many there were: fewer only at the end of the data. Throws BadInput if
    /// a gzip stream is damaged or cut short.
    std::size_t read(std::span<std::byte> bytes);

    /// The rest of the stream, which must be `count` bytes long. The vector grows with what was really
    /// read, at most to twice that. Throws BadInput naming `key` and `count_means`, what the header says that
    /// makes it `count` bytes.
    std::vector<std::byte> read_rest(std::uint64_t count, std::string_view key,
                                     const std::string& count_means);

private:
    struct Inflater;

    std::istream& stream_;
    std::string file_;
    std::unique_ptr<Inflater> inflater_;  ///< of a gzip stream
};

}  // namespace voxspring
