#include "harness/volume/byte_stream.h"

#include <bzlib.h>
#include <zlib.h>

#include <algorithm>
#include <fstream>
#include <limits>
#include <new>
#include <optional>

#include "harness/base/bad_input.h"

namespace voxspring {

/// One way to compress.
class ByteStream::Decoder {
public:
    virtual ~Decoder() = default;
    virtual std::string name() const = 0;
    /// Decodes what fits from `from` to `to` and shortens both by what it took and gave. True at the end of a
    /// member. Throws what is wrong with the data as a string.
    virtual bool decode(std::span<char>& from, std::span<std::byte>& to) = 0;
    /// Prepares for another member.
    virtual void restart() = 0;

protected:
    /// zlib's and bzip2's streams have the same fields. Not all of a large span is offered to them at once:
    /// they count in 32 bits.
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
        // 16: a gzip header and its checksum are expected.
        if (inflateInit2(&z_, (gzip ? 16 : 0) + MAX_WBITS) != Z_OK) throw std::bad_alloc();
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

/// Passes over lines of `stream`.
void skip_lines(std::istream& stream, const std::string& file, std::int64_t lines) {
    for (std::int64_t line = 0; line < lines; ++line) {
        if (!stream.ignore(std::numeric_limits<std::streamsize>::max(), '\n') || stream.eof())
            throw BadInput(file, "line skip", std::to_string(lines), "no more lines than the file has");
    }
}

/// Moves to the last `count` bytes of `stream`, which are not before where it stands.
void seek_last(std::istream& stream, const std::string& file, std::uint64_t count, std::string_view key,
               const std::string& accepted) {
    const auto first = stream.tellg();
    stream.seekg(0, std::ios::end);
    const auto held = std::uint64_t(std::max<std::streamoff>(stream.tellg() - first, 0));
    if (held < count) throw BadInput(file, key, std::to_string(held) + " bytes of data", accepted);
    stream.seekg(-std::streamoff(count), std::ios::end);
}

}  // namespace

ByteStream::ByteStream(std::istream& stream, Encoding encoding, std::string file)
    : stream_(stream), file_(std::move(file)), decoder_(decoder_of(encoding)) {}

ByteStream::~ByteStream() = default;

std::size_t ByteStream::read_raw(std::span<std::byte> bytes) {
    stream_.read(reinterpret_cast<char*>(bytes.data()), std::streamsize(bytes.size()));
    return std::size_t(stream_.gcount());
}

std::size_t ByteStream::read(std::span<std::byte> bytes) {
    if (!decoder_) return read_raw(bytes);
    std::span<std::byte> left = bytes;
    while (!left.empty()) {
        if (encoded_.empty())
            encoded_ = std::span(buffer_).first(read_raw(std::as_writable_bytes(std::span(buffer_))));
        const std::string key = decoder_->name() + " data";
        const std::string accepted = "a whole " + decoder_->name() + " stream";
        if (encoded_.empty()) {
            if (at_member_end_) break;
            throw BadInput(file_, key, "a stream that ends early", accepted);
        }
        if (at_member_end_) decoder_->restart();
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

void ByteStream::read_rest(std::vector<std::byte>& bytes, std::uint64_t count, std::string_view key,
                           const std::string& count_means) {
    const std::string accepted = std::to_string(count) + " bytes, " + count_means;
    const std::size_t before = bytes.size();
    while (bytes.size() - before < count) {
        const std::size_t held = bytes.size() - before;
        const std::size_t chunk =
            std::min<std::uint64_t>(count - held, std::max(before + held, std::size_t{1} << 16));
        bytes.resize(before + held + chunk);
        const std::size_t got = read(std::span(bytes).subspan(before + held));
        if (got < chunk) throw BadInput(file_, key, std::to_string(held + got) + " bytes of data", accepted);
    }
    std::byte beyond{};
    if (read({&beyond, 1}) != 0)
        throw BadInput(file_, key, "more than " + std::to_string(count) + " bytes of data", accepted);
}

std::vector<std::byte> read_data(std::istream& behind_header, const std::string& file, const DataPlace& place,
                                 std::uint64_t count, std::string_view key, const std::string& count_means) {
    std::vector<std::byte> bytes;
    const auto read_part = [&](std::istream& stream, const std::string& name, std::uint64_t part) {
        skip_lines(stream, name, place.skipped_lines);
        if (place.skipped_bytes == DataPlace::at_end)
            seek_last(stream, name, part, key, std::to_string(part) + " bytes, " + count_means);
        ByteStream decoded(stream, place.encoding, name);
        if (place.skipped_bytes > 0 && !decoded.skip(std::uint64_t(place.skipped_bytes)))
            throw BadInput(name, place.bytes_key, std::to_string(place.skipped_bytes),
                           "a place within the data");
        decoded.read_rest(bytes, part, key, count_means);
    };
    if (place.files.empty()) {
        read_part(behind_header, file, count);
        return bytes;
    }
    if (count % place.files.size() != 0) {
        throw BadInput(file, place.files_key, std::to_string(place.files.size()) + " files",
                       "files with an equal part of " + std::to_string(count) + " bytes, " + count_means);
    }
    for (const std::filesystem::path& data : place.files) {
        std::error_code error;
        // A device or a pipe might never end.
        if (!std::filesystem::is_regular_file(data, error)) {
            throw BadInput(file, place.files_key, data.filename().string(),
                           "a file with the data, " + data.string() + ", that exists");
        }
        std::ifstream stream(data, std::ios::binary);
        if (!stream) throw BadInput(data.string(), "", "an unreadable file", "a file that can be read");
        read_part(stream, data.string(), count / place.files.size());
    }
    return bytes;
}

}  // namespace voxspring
