#include "harness/volume/byte_stream.h"

#include <bzlib.h>
#include <zlib.h>

#include <algorithm>
#include <fstream>
#include <limits>
#include <new>
#include <optional>
#include <utility>

#include "harness/base/bad_input.h"

namespace voxspring {

/// A decoder for one method of compression.
class ByteStream::Decoder {
public:
    virtual ~Decoder() = default;
    virtual std::string name() const = 0;
    /// Decodes as much as fits from `from` to `to`, and shortens both by what it consumed and produced.
    /// Returns true at the end of a member. Throws a string that says what is wrong with the data.
    virtual bool decode(std::span<char>& from, std::span<std::byte>& to) = 0;
    /// The bytes with which every member begins; empty: there is never a second member.
    virtual std::string_view magic() const = 0;
    /// Prepares for another member.
    virtual void restart() = 0;

protected:
    /// zlib's and bzip2's streams have the same fields. A large span is passed to them in parts, because they
    /// count in 32 bits.
    template <class Z, class Step>
    static auto advance(Z& z, std::span<char>& from, std::span<std::byte>& to, const Step& step) {
        const std::size_t room = std::min(to.size(), std::size_t{1} << 30);
        z.next_in = reinterpret_cast<decltype(z.next_in)>(from.data());
        z.avail_in = unsigned(from.size());
        z.next_out = reinterpret_cast<decltype(z.next_out)>(to.data());
        z.avail_out = unsigned(room);
        const int status = step();
        from = from.last(z.avail_in);
        to = to.subspan(room - z.avail_out);
        return status;
    }
};

namespace {

class Inflater final : public ByteStream::Decoder {
public:
    explicit Inflater(bool gzip) : gzip_(gzip) {
        // 16: a gzip header and its checksum are expected; 32: either a gzip or a zlib header.
        if (inflateInit2(&z_, (gzip ? 16 : 32) + MAX_WBITS) != Z_OK) throw std::bad_alloc();
    }
    ~Inflater() override { inflateEnd(&z_); }
    Inflater(const Inflater&) = delete;
    Inflater& operator=(const Inflater&) = delete;

    std::string name() const override { return gzip_ ? "gzip" : "zlib"; }
    bool decode(std::span<char>& from, std::span<std::byte>& to) override {
        const int status = advance(z_, from, to, [this] { return inflate(&z_, Z_NO_FLUSH); });
        if (status == Z_MEM_ERROR) throw std::bad_alloc();
        if (status != Z_OK && status != Z_BUF_ERROR && status != Z_STREAM_END)
            throw std::string(z_.msg != nullptr ? z_.msg : "a damaged stream");
        return status == Z_STREAM_END;
    }
    std::string_view magic() const override { return gzip_ ? "\x1f\x8b" : ""; }
    void restart() override { inflateReset(&z_); }

private:
    bool gzip_;
    z_stream z_{};
};

class Bunzipper final : public ByteStream::Decoder {
public:
    Bunzipper() { start(); }
    ~Bunzipper() override { BZ2_bzDecompressEnd(&z_); }
    Bunzipper(const Bunzipper&) = delete;
    Bunzipper& operator=(const Bunzipper&) = delete;

    std::string name() const override { return "bzip2"; }
    bool decode(std::span<char>& from, std::span<std::byte>& to) override {
        const int status = advance(z_, from, to, [this] { return BZ2_bzDecompress(&z_); });
        if (status == BZ_MEM_ERROR) throw std::bad_alloc();
        if (status != BZ_OK && status != BZ_STREAM_END) throw std::string("a damaged stream");
        return status == BZ_STREAM_END;
    }
    std::string_view magic() const override { return "BZh"; }
    void restart() override {
        BZ2_bzDecompressEnd(&z_);
        start();
    }

private:
    void start() {
        z_ = {};
        if (BZ2_bzDecompressInit(&z_, 0, 0) != BZ_OK) throw std::bad_alloc();
    }
    bz_stream z_{};
};

std::unique_ptr<ByteStream::Decoder> decoder_of(Encoding encoding) {
    if (encoding == Encoding::raw) return nullptr;
    if (encoding == Encoding::bzip2) return std::make_unique<Bunzipper>();
    return std::make_unique<Inflater>(encoding == Encoding::gzip);
}

/// Skips lines of `stream`.
void skip_lines(std::istream& stream, const std::string& file, std::int64_t lines) {
    for (std::int64_t line = 0; line < lines; ++line) {
        if (!stream.ignore(std::numeric_limits<std::streamsize>::max(), '\n') || stream.eof())
            throw BadInput(file, "line skip", std::to_string(lines), "no more lines than the file has");
    }
}

}  // namespace

ByteStream::ByteStream(std::istream& stream, Encoding encoding, std::string file)
    : stream_(stream), file_(std::move(file)), decoder_(decoder_of(encoding)) {}

ByteStream::~ByteStream() = default;

std::size_t ByteStream::read_raw(std::span<std::byte> bytes) {
    stream_.read(reinterpret_cast<char*>(bytes.data()), std::streamsize(bytes.size()));
    return std::size_t(stream_.gcount());
}

/// Returns whether another member begins here. If not, skips the remaining bytes, which are no data.
bool ByteStream::next_member() {
    if (at_end_) return false;
    const std::string_view magic = decoder_->magic();
    if (encoded_.size() < magic.size()) {  // moves the remaining bytes to the front
        std::copy(encoded_.begin(), encoded_.end(), buffer_.begin());
        const auto room = std::span(buffer_).subspan(encoded_.size());
        encoded_ = std::span(buffer_).first(encoded_.size() + read_raw(std::as_writable_bytes(room)));
    }
    if (!magic.empty() && encoded_.size() >= magic.size() &&
        std::equal(magic.begin(), magic.end(), encoded_.begin())) {
        decoder_->restart();
        at_member_end_ = false;
        return true;
    }
    at_end_ = true;
    while (!encoded_.empty()) {
        ignored_ += encoded_.size();
        encoded_ = std::span(buffer_).first(read_raw(std::as_writable_bytes(std::span(buffer_))));
    }
    return false;
}

std::size_t ByteStream::read(std::span<std::byte> bytes) {
    if (!decoder_) return read_raw(bytes);
    std::span<std::byte> left = bytes;
    while (!left.empty()) {
        if (encoded_.empty())
            encoded_ = std::span(buffer_).first(read_raw(std::as_writable_bytes(std::span(buffer_))));
        const std::string key = decoder_->name() + " data";
        const std::string accepted = "a whole " + decoder_->name() + " stream";
        if (at_member_end_ && !next_member()) break;
        if (encoded_.empty()) throw BadInput(file_, key, "a stream that ends early", accepted);
        try {
            at_member_end_ = decoder_->decode(encoded_, left);
        } catch (const std::string& why) {
            throw BadInput(file_, key, why, accepted);
        }
    }
    return bytes.size() - left.size();
}

bool ByteStream::skip(std::uint64_t count) {
    std::array<std::byte, 4096> scratch{};
    while (count > 0) {
        const std::size_t chunk = std::min<std::uint64_t>(count, scratch.size());
        if (read(std::span(scratch).first(chunk)) < chunk) return false;
        count -= chunk;
    }
    return true;
}

std::uint64_t ByteStream::skip_rest() {
    std::array<std::byte, 4096> scratch{};
    std::uint64_t count = 0;
    for (std::size_t got = read(scratch); got > 0; got = read(scratch)) count += got;
    return count;
}

namespace {

/// Receives data piece by piece and appends the bytes that are kept.
class Keeper {
public:
    Keeper(const KeptBytes& kept, std::uint64_t count)
        : kept_(kept), wanted_(count / kept.period * kept.length) {}

    void take(std::span<const std::byte> piece) {
        // The vector grows with the data that was really read, to at most twice its size.
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
    const KeptBytes kept_;
    const std::uint64_t wanted_;
    std::uint64_t at_ = 0;  ///< position within the current period
};

/// Passes the rest of `stream`, which must be `count` bytes, to `keeper`.
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

/// The number of decoded bytes before the last `count` ones.
std::uint64_t before_last(std::istream& stream, Encoding encoding, const std::string& file,
                          std::uint64_t count, std::string_view key, const std::string& accepted) {
    const auto first = stream.tellg();
    std::uint64_t held = 0;
    if (encoding == Encoding::raw) {
        stream.seekg(0, std::ios::end);
        held = std::uint64_t(std::max<std::streamoff>(stream.tellg() - first, 0));
    } else {
        held = ByteStream(stream, encoding, file).skip_rest();
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

std::vector<std::byte> read_data(std::istream& behind_header, const std::string& file, const DataPlace& place,
                                 std::uint64_t count, const KeptBytes& kept, std::string_view key,
                                 const std::string& count_means, std::vector<std::string>& notes) {
    Keeper keeper(kept, count);
    std::uint64_t ignored = 0;
    const auto read_part = [&](std::istream& stream, const std::string& name, std::uint64_t part) {
        const std::string accepted = std::to_string(part) + " bytes, " + count_means;
        if (place.begin) {
            stream.clear();
            stream.seekg(0, std::ios::end);
            if (stream.tellg() < *place.begin)
                throw BadInput(name, place.bytes_key, std::to_string(*place.begin),
                               "a place within the file");
            stream.seekg(*place.begin);
        }
        skip_lines(stream, name, place.skipped_lines);
        const Encoding encoding = place.encoding ? *place.encoding : encoding_at(stream);
        const std::uint64_t skipped = place.skipped_bytes != DataPlace::at_end
                                          ? std::uint64_t(place.skipped_bytes)
                                          : before_last(stream, encoding, name, part, key, accepted);
        ByteStream decoded(stream, encoding, name);
        if (!decoded.skip(skipped))
            throw BadInput(name, place.bytes_key, std::to_string(skipped), "a place within the data");
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
                           "a file with the data, " + data.string() + ", that exists");
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
