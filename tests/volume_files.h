// Small NIfTI-1 and NRRD files, made byte by byte so that they can also be wrong in any way.
#pragma once

#include <nifti/nifti1.h>
#include <zlib.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <glm/vec3.hpp>
#include <string>
#include <vector>

namespace voxspring::testing {

/// The bytes of `values` as scalars of type T, in this machine's order or reversed.
template <class T>
std::string bytes_of_values(const std::vector<double>& values, bool reversed = false) {
    std::string bytes;
    for (const double value : values) {
        const T scalar = static_cast<T>(value);
        std::array<char, sizeof(T)> raw{};
        std::memcpy(raw.data(), &scalar, sizeof(T));
        if (reversed) std::reverse(raw.begin(), raw.end());
        bytes.append(raw.data(), raw.size());
    }
    return bytes;
}

inline std::string gzipped(const std::string& plain) {
    z_stream z{};
    deflateInit2(&z, Z_DEFAULT_COMPRESSION, Z_DEFLATED, 16 + MAX_WBITS, 8, Z_DEFAULT_STRATEGY);
    std::string packed(deflateBound(&z, plain.size()) + 32, '\0');
    z.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(plain.data()));
    z.avail_in = uInt(plain.size());
    z.next_out = reinterpret_cast<Bytef*>(packed.data());
    z.avail_out = uInt(packed.size());
    deflate(&z, Z_FINISH);
    packed.resize(z.total_out);
    deflateEnd(&z);
    return packed;
}

inline nifti_1_header nifti_header(glm::ivec3 dims, int datatype, glm::vec3 spacing = glm::vec3(1)) {
    nifti_1_header header{};
    header.sizeof_hdr = 348;
    header.dim[0] = 3;
    for (int axis = 0; axis < 3; ++axis) header.dim[axis + 1] = short(dims[axis]);
    for (int axis = 4; axis < 8; ++axis) header.dim[axis] = 1;
    header.datatype = short(datatype);
    header.pixdim[0] = 1;
    for (int axis = 0; axis < 3; ++axis) header.pixdim[axis + 1] = spacing[axis];
    header.vox_offset = 352;
    std::memcpy(header.magic, "n+1", 4);
    return header;
}

/// Header, four bytes that announce no extension, data.
inline std::string nifti_file(const nifti_1_header& header, const std::string& data) {
    return std::string(reinterpret_cast<const char*>(&header), sizeof header) + std::string(4, '\0') + data;
}

/// "NRRD0004" and the lines of `fields`, then the data.
inline std::string nrrd_file(const std::string& fields, const std::string& data) {
    return "NRRD0004\n" + fields + "\n" + data;
}

/// A folder of its own that goes away with it.
class TemporaryFolder {
public:
    TemporaryFolder() {
        std::string name = (std::filesystem::temp_directory_path() / "voxspring-XXXXXX").string();
        if (mkdtemp(name.data()) == nullptr) throw std::runtime_error("no temporary folder");
        path_ = name;
    }
    ~TemporaryFolder() {
        std::error_code ignored;
        std::filesystem::remove_all(path_, ignored);
    }
    TemporaryFolder(const TemporaryFolder&) = delete;
    TemporaryFolder& operator=(const TemporaryFolder&) = delete;

    std::string write(const std::string& name, const std::string& bytes) const {
        const std::filesystem::path file = path_ / name;
        std::ofstream(file, std::ios::binary) << bytes;
        return file.string();
    }
    const std::filesystem::path& path() const { return path_; }

private:
    std::filesystem::path path_;
};

}  // namespace voxspring::testing
