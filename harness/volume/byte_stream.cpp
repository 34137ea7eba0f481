// Reads the data of a volume file, which lies behind its header or in other files, plain or compressed.
#include <bzlib.h>
#include <zlib.h>

#include <algorithm>
#include <fstream>
#include <limits>
#include <new>
#include <utility>

#include "harness/base/bad_input.h"
#include "harness/volume/claims.h"

namespace voxspring {

/// Decodes one member (a complete compressed stream) of a file by zlib or bzip2. A file of gzip or bzip2 may
/// have several members.
class ByteStream::Decoder {
public:
    /// `encoding` must not be raw.
    explicit Decoder(Encoding encoding) : is_bzip2_(encoding == Encoding::bzip2) {
        // zlib wants MAX_WBITS plus 16 for data with a gzip header.
        const int bits = (encoding == Encoding::gzip ? 16 : 0) + MAX_WBITS;
        if (is_bzip2_ ? BZ2_bzDecompressInit(&bzip2_, 0, 0) != BZ_OK : inflateInit2(&zlib_, bits) != Z_OK)
            throw std::bad_alloc();
    }
    ~Decoder() {
        if (is_bzip2_) {
            BZ2_bzDecompressEnd(&bzip2_);
        } else {
            inflateEnd(&zlib_);
        }
    }
    Decoder(const Decoder&) = delete;
    Decoder& operator=(const Decoder&) = delete;

    /// Decodes as much as fits from `from` to `to`, and removes what was consumed and filled from the front
    /// of both. Returns true at the end of the member. Throws a string that says what is wrong with the data.
    bool decode(std::span<char>& from, std::span<std::byte>& to) {
        const int status = is_bzip2_
                               ? advance(bzip2_, from, to, BZ2_bzDecompress)
                               : advance(zlib_, from, to, [](z_stream* z) { return inflate(z, Z_NO_FLUSH); });
        if (status == (is_bzip2_ ? BZ_MEM_ERROR : Z_MEM_ERROR)) throw std::bad_alloc();
        if (status == (is_bzip2_ ? BZ_STREAM_END : Z_STREAM_END)) return true;
        if (is_bzip2_ ? status != BZ_OK : status != Z_OK && status != Z_BUF_ERROR)
            throw std::string(zlib_.msg != nullptr ? zlib_.msg : "a damaged stream");
        return false;
    }

private:
    /// Calls `step` once on `z`, a stream of zlib or bzip2, which have the same fields. Both libraries count
    /// bytes in 32 bits, so at most 1 GiB is decoded per call.
    template <class Z, class Step>
    static int advance(Z& z, std::span<char>& from, std::span<std::byte>& to, const Step& step) {
        const std::size_t room = std::min(to.size(), std::size_t{1} << 30);
        z.next_in = reinterpret_cast<decltype(z.next_in)>(from.data());
        z.avail_in = unsigned(from.size());
        z.next_out = reinterpret_cast<decltype(z.next_out)>(to.data());
        z.avail_out = unsigned(room);
        const int status = step(&z);
        from = from.last(z.avail_in);
        to = to.subspan(room - z.avail_out);
        return status;
    }

    const bool is_bzip2_;
    z_stream zlib_{};
    bz_stream bzip2_{};
};

ByteStream::ByteStream(std::istream& stream, Encoding encoding, std::string file)
    : stream_(stream),
      // A gzip stream may have several members, one of zlib's format has one. So the name must be right here.
      encoding_(encoding == Encoding::zlib && encoding_at(stream) == Encoding::gzip ? Encoding::gzip
                                                                                    : encoding),
      file_(std::move(file)),
      decoder_(encoding_ == Encoding::raw ? nullptr : std::make_unique<Decoder>(encoding_)) {}

ByteStream::~ByteStream() = default;

std::size_t ByteStream::read_raw(std::span<std::byte> bytes) {
    stream_.read(reinterpret_cast<char*>(bytes.data()), std::streamsize(bytes.size()));
    return std::size_t(stream_.gcount());
}

/// Moves the bytes still to be decoded to the front of the buffer, and fills the rest of the buffer from the
/// file.
void ByteStream::refill() {
    std::copy(encoded_.begin(), encoded_.end(), buffer_.begin());
    const auto room = std::span(buffer_).subspan(encoded_.size());
    encoded_ = std::span(buffer_).first(encoded_.size() + read_raw(std::as_writable_bytes(room)));
}

/// Returns whether another member begins here, and if so prepares to decode it. Otherwise skips the remaining
/// bytes, which are no data, and counts them as ignored.
bool ByteStream::next_member() {
    if (at_end_) return false;
    // The bytes with which a member begins; none for zlib's format, which has a single member.
    const std::string_view magic = encoding_ == Encoding::gzip    ? "\x1f\x8b"
                                   : encoding_ == Encoding::bzip2 ? "BZh"
                                                                  : "";
    if (encoded_.size() < magic.size()) refill();
    if (!magic.empty() && std::string_view(encoded_.data(), encoded_.size()).starts_with(magic)) {
        decoder_ = std::make_unique<Decoder>(encoding_);
        at_member_end_ = false;
        return true;
    }
    at_end_ = true;
    for (; !encoded_.empty(); refill()) {
        ignored_ += encoded_.size();
        encoded_ = {};
    }
    return false;
}

std::size_t ByteStream::read(std::span<std::byte> bytes) {
    if (!decoder_) return read_raw(bytes);
    const auto refuse = [&](const std::string& why) {
        const std::string name = encoding_ == Encoding::gzip    ? "gzip"
                                 : encoding_ == Encoding::bzip2 ? "bzip2"
                                                                : "zlib";
        throw BadInput(file_, name + " data", why, "a whole " + name + " stream");
    };
    std::span<std::byte> left = bytes;
    while (!left.empty()) {
        if (encoded_.empty()) refill();
        if (at_member_end_ && !next_member()) break;
        if (encoded_.empty()) refuse("a stream that ends early");
        try {
            at_member_end_ = decoder_->decode(encoded_, left);
        } catch (const std::string& why) {
            refuse(why);
        }
    }
    return bytes.size() - left.size();
}

std::uint64_t ByteStream::skip(std::uint64_t count) {
    std::array<std::byte, 4096> scratch{};
    for (std::uint64_t skipped = 0;;) {
        const std::size_t chunk = std::min<std::uint64_t>(count - skipped, scratch.size());
        const std::size_t got = read(std::span(scratch).first(chunk));
        skipped += got;
        if (got < chunk || skipped == count) return skipped;
    }
}

namespace {

/// Receives data piece by piece and keeps the bytes that `kept` selects. `count` is the number of all bytes.
class Keeper {
public:
    Keeper(const Kept& kept, std::uint64_t count) : kept_(kept), wanted_(count / kept.period * kept.length) {}

    void take(std::span<const std::byte> piece) {
        // The vector grows with the data that was really read: it takes at most twice the memory of that
        // data.
        const std::uint64_t needed = bytes.size() + piece.size();
        if (needed > bytes.capacity())
            bytes.reserve(std::min(wanted_, std::max<std::uint64_t>(needed, 2 * bytes.size())));
        while (!piece.empty()) {
            const bool keeps = at_ >= kept_.first && at_ < kept_.first + kept_.length;
            const std::uint64_t end = at_ < kept_.first ? kept_.first
                                      : keeps           ? kept_.first + kept_.length
                                                        : kept_.period;
            const auto step = std::size_t(std::min<std::uint64_t>(end - at_, piece.size()));
            if (keeps) bytes.insert(bytes.end(), piece.begin(), piece.begin() + std::ptrdiff_t(step));
            piece = piece.subspan(step);
            at_ = (at_ + step) % kept_.period;
        }
    }

    std::vector<std::byte> bytes{};

private:
    const Kept kept_;
    const std::uint64_t wanted_;
    std::uint64_t at_ = 0;  ///< position within the current period
};

/// Passes the rest of `stream` to `keeper`. Throws BadInput unless the rest has exactly `count` bytes.
void read_rest(ByteStream& stream, const std::string& file, std::uint64_t count, Keeper& keeper,
               std::string_view key, const std::string& accepted) {
    constexpr std::size_t piece = std::size_t{1} << 16;
    std::vector<std::byte> buffer(std::size_t(std::min<std::uint64_t>(count, piece)));
    for (std::uint64_t held = 0; held < count;) {
        const auto chunk = std::size_t(std::min<std::uint64_t>(count - held, buffer.size()));
        const std::size_t got = stream.read(std::span(buffer).first(chunk));
        if (got < chunk) throw BadInput(file, key, std::to_string(held + got) + " bytes of data", accepted);
        keeper.take(std::span(buffer).first(chunk));
        held += chunk;
    }
    std::byte beyond{};
    if (stream.read({&beyond, 1}) != 0)
        throw BadInput(file, key, "more than " + std::to_string(count) + " bytes of data", accepted);
}

/// The number of decoded bytes before the data, which is the last `count` bytes. Throws BadInput if there are
/// fewer than `count` decoded bytes.
std::uint64_t before_last(std::istream& stream, Encoding encoding, const std::string& file,
                          std::uint64_t count, std::string_view key, const std::string& accepted) {
    const auto first = stream.tellg();
    std::uint64_t held = 0;
    if (encoding == Encoding::raw) {
        stream.seekg(0, std::ios::end);
        held = std::uint64_t(std::max<std::streamoff>(stream.tellg() - first, 0));
    } else {
        held = ByteStream(stream, encoding, file).skip(std::numeric_limits<std::uint64_t>::max());
    }
    stream.clear();
    stream.seekg(first);
    if (held < count) throw BadInput(file, key, std::to_string(held) + " bytes of data", accepted);
    return held - count;
}

}  // namespace

Encoding encoding_at(std::istream& stream) {
    const auto place = stream.tellg();
    const bool gzip = stream.get() == 0x1F && stream.get() == 0x8B;
    stream.clear();
    stream.seekg(place);
    return gzip ? Encoding::gzip : Encoding::raw;
}

std::vector<std::byte> read_data(std::istream& behind_header, const VolumeClaims& claims, std::uint64_t count,
                                 const Kept& kept, const std::string& count_means,
                                 std::vector<std::string>& notes) {
    const DataPlace& place = claims.place;
    const std::string &file = claims.file, &key = claims.data_key;
    Keeper keeper(kept, count);
    std::uint64_t ignored = 0;
    const auto read_part = [&](std::istream& stream, const std::string& name, std::uint64_t part) {
        const std::string accepted = std::to_string(part) + " bytes, " + count_means;
        if (place.begin) {
            stream.clear();
            stream.seekg(0, std::ios::end);
            if (stream.tellg() < *place.begin)
                throw BadInput(name, place.bytes_key, std::to_string(*place.begin),
                               "a number of bytes within the file");
            stream.seekg(*place.begin);
        }
        for (std::int64_t line = 0; line < place.skipped_lines; ++line) {
            if (!stream.ignore(std::numeric_limits<std::streamsize>::max(), '\n') || stream.eof())
                throw BadInput(name, "line skip", std::to_string(place.skipped_lines),
                               "at most as many lines as the file has");
        }
        const Encoding encoding = place.encoding ? *place.encoding : encoding_at(stream);
        const std::uint64_t skipped = place.skipped_bytes != DataPlace::at_end
                                          ? std::uint64_t(place.skipped_bytes)
                                          : before_last(stream, encoding, name, part, key, accepted);
        ByteStream decoded(stream, encoding, name);
        if (decoded.skip(skipped) < skipped)
            throw BadInput(name, place.bytes_key, std::to_string(skipped),
                           "at most as many bytes as the decoded data has");
        read_rest(decoded, name, part, keeper, key, accepted);
        ignored += decoded.ignored();
    };
    if (place.files.empty()) {
        read_part(behind_header, file, count);
    } else if (count % place.files.size() != 0) {
        throw BadInput(file, place.files_key, std::to_string(place.files.size()) + " files",
                       "files with an equal part of " + std::to_string(count) + " bytes, " + count_means);
    }
    for (const std::filesystem::path& data : place.files) {
        std::error_code error;
        // Only regular files are read: a device or a pipe might never end.
        if (!std::filesystem::is_regular_file(data, error)) {
            throw BadInput(file, place.files_key, data.filename().string(),
                           "the name of an existing data file, which " + data.string() + " is not");
        }
        std::ifstream stream(data, std::ios::binary);
        if (!stream) throw BadInput(data.string(), "", "an unreadable file", "a file that can be read");
        read_part(stream, data.string(), count / place.files.size());
    }
    if (ignored > 0) {
        notes.push_back(std::to_string(ignored) + (ignored == 1 ? " byte" : " bytes") +
                        " behind the compressed data ignored");
    }
    return std::move(keeper.bytes);
}

}  // namespace voxspring
