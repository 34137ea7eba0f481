// Small volume files, made byte by byte so that they can also be wrong in any respect.
#pragma once

#include <bzlib.h>
#include <nifti/nifti1.h>
#include <nifti/nifti2.h>
#include <zlib.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <glm/vec3.hpp>
#include <string>
#include <vector>

#include "tests/surroundings.h"

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

/// A compressed stream as in MetaImage: without the header of gzip.
inline std::string zlib_packed(const std::string& plain) {
    uLongf size = compressBound(uLong(plain.size()));
    std::string packed(size, '\0');
    compress(reinterpret_cast<Bytef*>(packed.data()), &size, reinterpret_cast<const Bytef*>(plain.data()),
             uLong(plain.size()));
    packed.resize(size);
    return packed;
}

inline std::string bzip2ed(const std::string& plain) {
    auto size = unsigned(plain.size() + plain.size() / 100 + 600);
    std::string packed(size, '\0');
    BZ2_bzBuffToBuffCompress(packed.data(), &size, const_cast<char*>(plain.data()), unsigned(plain.size()), 9,
                             0, 0);
    packed.resize(size);
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

inline nifti_2_header nifti_2_header_of(const nifti_1_header& first) {
    nifti_2_header header{};
    header.sizeof_hdr = 540;
    std::memcpy(header.magic, "n+2\0\r\n\032\n", 8);
    std::copy(std::begin(first.dim), std::end(first.dim), std::begin(header.dim));
    std::copy(std::begin(first.pixdim), std::end(first.pixdim), std::begin(header.pixdim));
    header.datatype = first.datatype;
    header.vox_offset = 544;
    header.scl_slope = double(first.scl_slope);
    header.scl_inter = double(first.scl_inter);
    return header;
}

/// Only the header: the .hdr of a pair whose .img has nothing but voxels.
template <class Header>
std::string nifti_pair_header(Header header) {
    header.magic[1] = 'i';
    header.vox_offset = 0;
    return std::string(reinterpret_cast<const char*>(&header), sizeof header);
}

/// Header, four bytes that announce no extension, data.
template <class Header>
std::string nifti_file(const Header& header, const std::string& data) {
    return std::string(reinterpret_cast<const char*>(&header), sizeof header) + std::string(4, '\0') + data;
}

/// "NRRD0004" and the lines of `fields`, then the data.
inline std::string nrrd_file(const std::string& fields, const std::string& data) {
    return "NRRD0004\n" + fields + "\n" + data;
}

/// "ObjectType = Image", `fields` and "ElementDataFile = LOCAL", then the data.
inline std::string metaimage_file(const std::string& fields, const std::string& data) {
    return "ObjectType = Image\n" + fields + "ElementDataFile = LOCAL\n" + data;
}

}  // namespace voxspring::testing
