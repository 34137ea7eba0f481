#include "harness/volume/byte_stream.h"

#include <zlib.h>

#include <algorithm>
#include <array>
#include <new>

#include "harness/base/bad_input.h"

namespace voxspring {

struct ByteStream::Inflater {
    Inflater() {
        // 16: a gzip header and its checksum are expected.
        if (inflateInit2(&z, 16 + MAX_WBITS) != Z_OK) throw std::bad_alloc();
    }
    ~Inflater() { inflateEnd(&z); }
    Inflater(const Inflater&) = delete;
    Inflater& operator=(const Inflater&) = delete;

    z_stream z{};
    std::array<char, 1 << 16> input{};
    bool at_member_end = false;
};

ByteStream::ByteStream(std::istream& stream, Encoding encoding, std::string file)
    : stream_(stream), file_(std::move(file)) {
    if (encoding == Encoding::gzip) inflater_ = std::make_unique<Inflater>();
}

ByteStream::~ByteStream() = default;

std::size_t ByteStream::read(std::span<std::byte> bytes) {
    if (!inflater_) {
        stream_.read(reinterpret_cast<char*>(bytes.data()), std::streamsize(bytes.size()));
        return std::size_t(stream_.gcount());
    }
    z_stream& z = inflater_->z;
    std::size_t done = 0;
    while (done < bytes.size()) {
        if (z.avail_in == 0) {
            stream_.read(inflater_->input.data(), std::streamsize(inflater_->input.size()));
            z.next_in = reinterpret_cast<Bytef*>(inflater_->input.data());
            z.avail_in = uInt(stream_.gcount());
        }
        if (z.avail_in == 0) {
            if (inflater_->at_member_end) break;
            throw BadInput(file_, "gzip data", "a stream that ends early", "a whole gzip stream");
        }
        if (inflater_->at_member_end) {
            // A gzip file is one member or several, one after another.
            inflateReset(&z);
            inflater_->at_member_end = false;
        }
        const std::size_t room = std::min(bytes.size() - done, std::size_t{1} << 30);
        z.next_out = reinterpret_cast<Bytef*>(bytes.data() + done);
        z.avail_out = uInt(room);
        const int status = inflate(&z, Z_NO_FLUSH);
        done += room - z.avail_out;
        if (status == Z_STREAM_END) {
            inflater_->at_member_end = true;
        } else if (status == Z_MEM_ERROR) {
            throw std::bad_alloc();
        } else if (status != Z_OK && status != Z_BUF_ERROR) {
            throw BadInput(file_, "gzip data", z.msg != nullptr ? z.msg : "a damaged stream",
                           "a whole gzip stream");
        }
    }
    return done;
}

std::vector<std::byte> ByteStream::read_rest(std::uint64_t count, std::string_view key,
                                             const std::string& count_means) {
    const std::string accepted = std::to_string(count) + " bytes, " + count_means;
    std::vector<std::byte> bytes;
    while (bytes.size() < count) {
        const std::size_t held = bytes.size();
        const std::size_t chunk = std::min<std::uint64_t>(count - held, std::max(held, std::size_t{1} << 16));
        bytes.resize(held + chunk);
        const std::size_t got = read(std::span(bytes).subspan(held));
        if (got < chunk) throw BadInput(file_, key, std::to_string(held + got) + " bytes of data", accepted);
    }
    std::byte beyond{};
    if (read({&beyond, 1}) != 0)
        throw BadInput(file_, key, "more than " + std::to_string(count) + " bytes of data", accepted);
    return bytes;
}

}  // namespace voxspring
