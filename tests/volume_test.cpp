// Volume files: every format, scalar type, byte order and encoding, and files that are truncated or
// inconsistent.
#include "harness/volume/volume.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <new>
#include <numbers>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include "harness/base/bad_input.h"
#include "harness/volume/readers.h"
#include "tests/volume_files.h"

namespace {
std::atomic<std::size_t> largest_allocation{0};
}

// Replaced for the whole program, so that tests can tell how much memory a header made the reader allocate.
// Not inlined: GCC would report a mismatch of malloc and free.
[[gnu::noinline]] void* operator new(std::size_t size) {
    std::size_t largest = largest_allocation;
    while (size > largest && !largest_allocation.compare_exchange_weak(largest, size)) {
    }
    if (void* memory = std::malloc(size)) return memory;
    throw std::bad_alloc();
}
[[gnu::noinline]] void operator delete(void* memory) noexcept { std::free(memory); }
[[gnu::noinline]] void operator delete(void* memory, std::size_t) noexcept { std::free(memory); }

namespace voxspring::testing {
namespace {

constexpr SceneSizeLimits large{1000000, 1000000};

enum class Format : std::uint8_t { nifti, nrrd, metaimage };

Volume read(Format format, const std::string& bytes, const SceneSizeLimits& limits = large,
            const VolumeChoice& choice = {}) {
    std::istringstream stream(bytes);
    switch (format) {
        case Format::nifti:
            return read_nifti(stream, "f", limits, choice);
        case Format::nrrd:
            return read_nrrd(stream, "f", limits, choice);
        default:
            return read_metaimage(stream, "f", limits, choice);
    }
}

std::string refusal(Format format, const std::string& bytes, const SceneSizeLimits& limits = large,
                    const VolumeChoice& choice = {}) {
    try {
        read(format, bytes, limits, choice);
    } catch (const BadInput& refused) {
        return refused.what();
    }
    return "accepted";
}

std::string nrrd_fields(const std::string& type, const std::string& encoding = "raw",
                        const std::string& more = "") {
    return "type: " + type + "\ndimension: 3\nsizes: 2 3 2\nencoding: " + encoding + "\nendian: little\n" +
           more;
}

std::string metaimage_fields(const std::string& type, const std::string& more = "") {
    return "NDims = 3\nDimSize = 2 3 2\nElementType = " + type + "\n" + more;
}

using Words = std::vector<std::string>;
using Counts = std::vector<std::pair<std::string, std::uint64_t>>;

Words names(const LabelledGrid& labelled) {
    Words list;
    for (const Label& label : labelled.labels) list.push_back(label.name);
    return list;
}

/// Twelve values that every scalar type can hold.
const std::vector<double> values = {0, 1, 2, 3, 0, 0, 7, 100, 0, 0, 0, 5};

const std::string a_distance =
    "a distance between voxels along each axis, other than 0; --spacing or \"spacing\" in a scene takes its "
    "place";

/// The values of a volume as its labels see them.
std::vector<double> values_of(const Volume& volume) {
    std::vector<double> out(volume.data.size() / bytes_of(volume.type));
    const LabelledGrid labelled = with_labels(volume, std::nullopt);
    for (std::size_t v = 0; v < out.size(); ++v) {
        const int material = labelled.grid.label[v];
        out[v] = material == 0 ? 0 : std::stod(labelled.labels[std::size_t(material - 1)].name);
    }
    return out;
}

struct Scalar {
    std::string name;  ///< as NRRD calls it
    std::string met;   ///< as MetaImage does
    int datatype;      ///< as NIfTI does
    ScalarType type;
    std::string (*encode)(const std::vector<double>&, bool);
};

const std::vector<Scalar> scalars = {
    {"int8", "MET_CHAR", 256, ScalarType::int8, bytes_of_values<std::int8_t>},
    {"uint8", "MET_UCHAR", 2, ScalarType::uint8, bytes_of_values<std::uint8_t>},
    {"short", "MET_SHORT", 4, ScalarType::int16, bytes_of_values<std::int16_t>},
    {"unsigned short", "MET_USHORT", 512, ScalarType::uint16, bytes_of_values<std::uint16_t>},
    {"int", "MET_LONG", 8, ScalarType::int32, bytes_of_values<std::int32_t>},
    {"uint32_t", "MET_UINT", 768, ScalarType::uint32, bytes_of_values<std::uint32_t>},
    {"long long", "MET_LONG_LONG", 1024, ScalarType::int64, bytes_of_values<std::int64_t>},
    {"unsigned long long int", "MET_ULONG_LONG", 1280, ScalarType::uint64, bytes_of_values<std::uint64_t>},
    {"float", "MET_FLOAT", 16, ScalarType::float32, bytes_of_values<float>},
    {"double", "MET_DOUBLE", 64, ScalarType::float64, bytes_of_values<double>},
};

template <class Header>
Header swapped(Header header) {
    const auto swap = [](auto& field) {
        auto* bytes = reinterpret_cast<char*>(&field);
        std::reverse(bytes, bytes + sizeof field);
    };
    swap(header.sizeof_hdr);
    for (auto& side : header.dim) swap(side);
    for (auto& distance : header.pixdim) swap(distance);
    swap(header.datatype);
    swap(header.vox_offset);
    swap(header.scl_slope);
    swap(header.scl_inter);
    return header;
}

TEST(Volume, EveryScalarTypeOrderAndEncoding) {
    for (const Scalar& scalar : scalars) {
        SCOPED_TRACE(scalar.name);
        const nifti_1_header header = nifti_header({2, 3, 2}, scalar.datatype, {0.5F, 1, 2});
        const std::string little = scalar.encode(values, false);
        const std::string big = scalar.encode(values, true);
        const std::string big_fields = "type: " + scalar.name +
                                       "\ndimension: 3\nsizes: 2 3 2\nencoding: gzip\nendian: big\n"
                                       "spacings: 0.5 1 2\n";
        for (const Volume& volume :
             {read(Format::nifti, nifti_file(header, little)),
              read(Format::nifti, gzipped(nifti_file(header, little))),
              read(Format::nifti, nifti_file(swapped(header), big)),
              read(Format::nrrd, nrrd_file(nrrd_fields(scalar.name, "raw", "spacings: 0.5 1 2\n"), little)),
              read(Format::nifti, nifti_file(nifti_2_header_of(header), little)),
              read(Format::nifti, gzipped(nifti_file(swapped(nifti_2_header_of(header)), big))),
              read(Format::nrrd, nrrd_file(big_fields, gzipped(big))),
              read(Format::nrrd,
                   nrrd_file(nrrd_fields(scalar.name, "bzip2", "spacings: 0.5 1 2\n"), bzip2ed(little))),
              read(Format::metaimage,
                   metaimage_file(metaimage_fields(scalar.met, "ElementSpacing = 0.5 1 2\n"), little)),
              read(Format::metaimage,
                   metaimage_file(metaimage_fields(scalar.met,
                                                   "BinaryDataByteOrderMSB = True\nCompressedData = True\n"
                                                   "ElementSize = 0.5 1 2\n"),
                                  zlib_packed(big)))}) {
            EXPECT_EQ(volume.dims, glm::ivec3(2, 3, 2));
            EXPECT_EQ(volume.spacing, glm::dvec3(0.5, 1, 2));
            EXPECT_EQ(volume.type, scalar.type);
            EXPECT_EQ(values_of(volume), values);
        }
    }
}

TEST(Volume, ThresholdAndLabels) {
    const std::vector<double> signed_values = {
        -3, -0.5, 0, 0.5, 1, 2, std::numeric_limits<double>::quiet_NaN(), 2, -3, 7, 0, 0};
    const Volume volume =
        read(Format::nrrd, nrrd_file(nrrd_fields("double"), bytes_of_values<double>(signed_values)));
    EXPECT_EQ(above_threshold(volume, 0.5).grid.label,
              (std::vector<std::uint8_t>{0, 0, 0, 0, 1, 1, 0, 1, 0, 1, 0, 0}));
    EXPECT_EQ(names(above_threshold(volume, 0.5)), Words{"1"});
    const LabelledGrid labelled = with_labels(volume, Words{"7", "-3", "2"});
    EXPECT_EQ(names(labelled), (Words{"-3", "2", "7"}));
    EXPECT_EQ(labelled.counts, (Counts{{"-3", 2}, {"2", 2}, {"7", 1}}));
    EXPECT_EQ(labelled.grid.label, (std::vector<std::uint8_t>{1, 0, 0, 0, 0, 2, 0, 2, 1, 3, 0, 0}));

    const auto refused = [&](const auto& use) {
        try {
            use();
        } catch (const BadInput& bad) {
            return std::string(bad.what());
        }
        return std::string("accepted");
    };
    EXPECT_EQ(refused([&] { above_threshold(volume, 7); }),
              "f: threshold: 7 is not accepted; expected one below the largest value in the volume, 7, so "
              "that some voxel is active");
    EXPECT_EQ(refused([&] {
                  with_labels(volume, Words{"7", "4"});
              }),
              "f: labels: 4 is not accepted; expected labels that some voxel carries");
    EXPECT_EQ(refused([&] { with_labels(volume, std::nullopt); }),
              "f: voxel 1: -0.5 is not accepted; expected whole numbers where materials are given per label");

    const Volume zeros = read(Format::nrrd, nrrd_file(nrrd_fields("uint8"), std::string(12, '\0')));
    EXPECT_EQ(refused([&] { with_labels(zeros, std::nullopt); }),
              "f: labels: a volume of zeros is not accepted; expected a label that some voxel carries");
    EXPECT_EQ(refused([&] { above_threshold(zeros, 0); }),
              "f: threshold: 0 is not accepted; expected one below the largest value in the volume, 0, so "
              "that some voxel is active");
}

TEST(Volume, AtMost255Labels) {
    std::vector<double> many(256);
    for (std::size_t v = 0; v < many.size(); ++v) many[v] = double(v);
    const std::string fields = "type: short\ndimension: 3\nsizes: 256 1 1\nencoding: raw\nendian: little\n";
    EXPECT_EQ(
        with_labels(read(Format::nrrd, nrrd_file(fields, bytes_of_values<std::int16_t>(many))), std::nullopt)
            .grid.label.back(),
        255);
    many[0] = 256;
    const Volume volume = read(Format::nrrd, nrrd_file(fields, bytes_of_values<std::int16_t>(many)));
    EXPECT_THROW(with_labels(volume, std::nullopt), BadInput);
}

TEST(Volume, NiftiScalingIsApplied) {
    nifti_1_header header = nifti_header({2, 3, 2}, 2);
    header.scl_slope = 2;
    header.scl_inter = -4;
    const std::string file = nifti_file(header, bytes_of_values<std::uint8_t>(values));
    const Volume volume = read(Format::nifti, file);
    // 2 v - 4 > 0
    EXPECT_EQ(above_threshold(volume, 0).grid.label,
              (std::vector<std::uint8_t>{0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 0, 1}));
    header.scl_slope = 0;  // no scaling at all
    const std::string plain = nifti_file(header, bytes_of_values<std::uint8_t>(values));
    EXPECT_EQ(values_of(read(Format::nifti, plain)), values);
}

TEST(Volume, NiftiExtensionsAreSkipped) {
    nifti_1_header header = nifti_header({2, 3, 2}, 2);
    header.vox_offset = 352 + 32;
    const std::string data = std::string(32, 'e') + bytes_of_values<std::uint8_t>(values);
    EXPECT_EQ(values_of(read(Format::nifti, nifti_file(header, data))), values);
    header.vox_offset = 352 + 5000;
    EXPECT_EQ(refusal(Format::nifti, nifti_file(header, data)),
              "f: vox_offset: 5352 is not accepted; expected a place within the data");
}

TEST(Volume, TrailingDimensionsOfOneAreAccepted) {
    nifti_1_header header = nifti_header({2, 3, 2}, 2);
    header.dim[0] = 5;
    EXPECT_EQ(values_of(read(Format::nifti, nifti_file(header, bytes_of_values<std::uint8_t>(values)))),
              values);
    const std::string fields =
        "type: uchar\ndimension: 4\nsizes: 2 3 2 1\nencoding: raw\nspacings: 1 2 3 NaN\n";
    const Volume volume = read(Format::nrrd, nrrd_file(fields, bytes_of_values<std::uint8_t>(values)));
    EXPECT_EQ(volume.spacing, glm::dvec3(1, 2, 3));
}

TEST(Volume, MissingSpacingIsOne) {
    const std::string data = bytes_of_values<std::uint8_t>(values);
    EXPECT_EQ(read(Format::metaimage, metaimage_file(metaimage_fields("MET_UCHAR"), data)).spacing,
              glm::dvec3(1));
    EXPECT_EQ(read(Format::nrrd, nrrd_file(nrrd_fields("uchar"), data)).spacing, glm::dvec3(1));
}

TEST(Volume, NrrdAsSlicerWritesIt) {
    const std::string fields =
        "# Complete NRRD file format specification at:\r\n# http://teem.sourceforge.net/nrrd/format.html\r\n"
        "type: unsigned char\r\ndimension: 3\r\nspace: left-posterior-superior\r\nsizes: 2 3 2\r\n"
        "space directions: (0,0.5,0) (-0.8, 0, 0.6) (0.6e1,0,8)\r\nkinds: domain domain domain\r\n"
        "Encoding: gzip\r\nspace origin: (1,2,3)\r\ncontent:=wall: left\r\n\r\n";
    const Volume volume =
        read(Format::nrrd, "NRRD0005\r\n" + fields + gzipped(bytes_of_values<std::uint8_t>(values)));
    EXPECT_EQ(volume.dims, glm::ivec3(2, 3, 2));
    EXPECT_NEAR(volume.spacing.x, 0.5, 1e-15);
    EXPECT_NEAR(volume.spacing.y, 1, 1e-15);
    EXPECT_NEAR(volume.spacing.z, 10, 1e-15);
    EXPECT_EQ(values_of(volume), values);
}

TEST(Volume, SeveralGzipMembersAreOneStream) {
    const std::string data = bytes_of_values<std::uint8_t>(values);
    const std::string members = gzipped(data.substr(0, 5)) + gzipped("") + gzipped(data.substr(5));
    EXPECT_EQ(values_of(read(Format::nrrd, nrrd_file(nrrd_fields("uint8", "gzip"), members))), values);
}

// A file that ends too early is refused, wherever it ends.
TEST(Volume, TruncatedFilesAreRefusedAtEveryLength) {
    const std::string data = bytes_of_values<std::uint16_t>(values);
    const std::vector<std::pair<Format, std::string>> files = {
        {Format::nifti, nifti_file(nifti_header({2, 3, 2}, 512), data)},
        {Format::nifti, gzipped(nifti_file(nifti_header({2, 3, 2}, 512), data))},
        {Format::nrrd, nrrd_file(nrrd_fields("uint16"), data)},
        {Format::nrrd, nrrd_file(nrrd_fields("uint16", "gzip"), gzipped(data))},
        {Format::nrrd, nrrd_file(nrrd_fields("uint16", "bzip2"), bzip2ed(data))},
        {Format::nifti, nifti_file(nifti_2_header_of(nifti_header({2, 3, 2}, 512)), data)},
        {Format::metaimage, metaimage_file(metaimage_fields("MET_USHORT"), data)},
        {Format::metaimage,
         metaimage_file(metaimage_fields("MET_USHORT", "CompressedData = True\n"), zlib_packed(data))},
    };
    for (const auto& [format, file] : files) {
        EXPECT_EQ(refusal(format, file), "accepted");
        for (std::size_t length = 0; length < file.size(); ++length)
            EXPECT_NE(refusal(format, file.substr(0, length)), "accepted") << length;
    }
    EXPECT_EQ(
        refusal(Format::nifti, files[0].second.substr(0, 360)),
        "f: voxels: 8 bytes of data is not accepted; expected 24 bytes, 12 voxels of datatype 512 as the "
        "header says");
    EXPECT_EQ(
        refusal(Format::nrrd, files[2].second + "x"),
        "f: data: more than 24 bytes of data is not accepted; expected 24 bytes, 12 voxels of type uint16 "
        "as the header says");
}

TEST(Volume, DamagedGzipIsRefused) {
    std::string packed = gzipped(bytes_of_values<std::uint8_t>(values));
    packed[packed.size() - 8] ^= 1;  // the checksum
    EXPECT_EQ(refusal(Format::nrrd, nrrd_file(nrrd_fields("uint8", "gzip"), packed)),
              "f: gzip data: incorrect data check is not accepted; expected a whole gzip stream");
    EXPECT_EQ(refusal(Format::nrrd, nrrd_file(nrrd_fields("uint8", "gzip"), std::string(12, 'x'))),
              "f: gzip data: incorrect header check is not accepted; expected a whole gzip stream");
}

// The header claims 8 GB of doubles; the file has 12 bytes.
TEST(Volume, AHeaderAloneAllocatesNothing) {
    const SceneSizeLimits boundless{std::uint64_t{1} << 32, std::uint64_t{1} << 32};
    const std::string data = bytes_of_values<std::uint8_t>(values);
    const std::string fields =
        "type: double\ndimension: 3\nsizes: 1000 1000 1000\nendian: little\nencoding: ";
    const nifti_1_header header = nifti_header({1000, 1000, 1000}, 64);
    const std::vector<std::pair<Format, std::string>> files = {
        {Format::nifti, nifti_file(header, data)},
        {Format::nifti, gzipped(nifti_file(header, data))},
        {Format::nrrd, nrrd_file(fields + "raw\n", data)},
        {Format::nrrd, nrrd_file(fields + "gzip\n", gzipped(data))},
        {Format::nrrd, nrrd_file(fields + "bzip2\n", bzip2ed(data))},
        {Format::nifti, nifti_file(nifti_2_header_of(header), data)},
        {Format::metaimage,
         metaimage_file("NDims = 3\nDimSize = 1000 1000 1000\nElementType = MET_DOUBLE\n", data)},
    };
    for (const auto& [format, file] : files) {
        largest_allocation = 0;
        EXPECT_NE(
            refusal(format, file, boundless).find("12 bytes of data is not accepted; expected 8000000000"),
            std::string::npos);
        EXPECT_LT(largest_allocation, std::size_t{1} << 18);
    }
    // A long stream of zeros, 1000 times smaller when packed, is not inflated beyond what the header says.
    largest_allocation = 0;
    const std::string bomb = gzipped(std::string(std::size_t{1} << 24, '\0'));
    largest_allocation = 0;
    EXPECT_EQ(
        refusal(Format::nrrd, nrrd_file(nrrd_fields("uint8", "gzip"), bomb)),
        "f: data: more than 12 bytes of data is not accepted; expected 12 bytes, 12 voxels of type uint8 "
        "as the header says");
    EXPECT_LT(largest_allocation, std::size_t{1} << 18);
}

TEST(Volume, GridsBeyondTheLimitsAreRefused) {
    EXPECT_EQ(
        refusal(Format::nifti, nifti_file(nifti_header({30000, 30000, 30000}, 2), "")),
        "f: dim: 30000 x 30000 x 30000 is not accepted; expected at most 1000000 voxels on this machine, "
        "not 27000000000000");
    EXPECT_EQ(
        refusal(Format::nrrd,
                nrrd_file("type: uint8\ndimension: 3\nsizes: 1048576 1048576 1048576\nencoding: raw\n", "")),
        "f: sizes: 1048576 x 1048576 x 1048576 is not accepted; expected at most 1000000 voxels on this "
        "machine, not 1152921504606846976");
}

TEST(Volume, NiftiHeadersThatLieAreRefused) {
    const std::string data = bytes_of_values<std::uint8_t>(values);
    const auto refused = [&](const auto& spoil) {
        nifti_1_header header = nifti_header({2, 3, 2}, 2);
        spoil(header);
        return refusal(Format::nifti, nifti_file(header, data));
    };
    EXPECT_EQ(refused([](nifti_1_header&) {}), "accepted");
    EXPECT_EQ(refused([](nifti_1_header& h) { h.sizeof_hdr = 540; }),
              "f: header: 364 bytes is not accepted; expected the 540 bytes of a NIfTI-2 header");
    EXPECT_EQ(
        refused([](nifti_1_header& h) { std::memcpy(h.magic, "n+2", 4); }),
        "f: magic: n+2 is not accepted; expected \"n+1\", header and data in one file, or \"ni1\", a pair "
        "of .hdr and .img");
    EXPECT_EQ(refused([](nifti_1_header& h) { h.sizeof_hdr = 349; }),
              "f: sizeof_hdr: 349 is not accepted; expected 348, the mark of a NIfTI-1 file, or 540, that of "
              "NIfTI-2");
    EXPECT_EQ(refused([](nifti_1_header& h) { std::memcpy(h.magic, "ni1", 4); }),
              "f: a header without its image is not accepted; expected the file f.img beside it");
    EXPECT_EQ(refused([](nifti_1_header& h) {
                  std::memcpy(h.magic, "\x01\xff\n!", 4);
              }).rfind("f: magic: \\x01\xff\\x0a! is not", 0),
              0u);
    EXPECT_EQ(refused([](nifti_1_header& h) { h.dim[0] = 2; }),
              "f: dim[0]: 2 is not accepted; expected 3 dimensions, or up to 7 of which the further ones are "
              "time and "
              "values of a voxel");
    EXPECT_NE(refused([](nifti_1_header& h) { h.dim[0] = -3; }), "accepted");
    EXPECT_NE(refused([](nifti_1_header& h) { h.dim[0] = 8; }), "accepted");
    EXPECT_EQ(refused([](nifti_1_header& h) { h.dim[2] = -3; }),
              "f: dim: 2 x -3 x 2 is not accepted; expected sides from 1 to 1048576");
    EXPECT_EQ(refused([](nifti_1_header& h) { h.datatype = 128; }),
              "f: datatype: 128 is not accepted; expected one of the scalar types 2, 4, 8, 16, 64, 256, 512, "
              "768, 1024, 1280");
    for (const float distance : {0.F, -0.F, std::numeric_limits<float>::infinity(),
                                 std::numeric_limits<float>::quiet_NaN(), 1e-30F, -1e30F}) {
        EXPECT_EQ(refused([&](nifti_1_header& h) { h.pixdim[2] = distance; }).rfind("f: pixdim[2]: ", 0), 0u);
    }
    for (const float offset : {348.F, -1.F, 1e30F, std::numeric_limits<float>::quiet_NaN()})
        EXPECT_EQ(refused([&](nifti_1_header& h) { h.vox_offset = offset; }).rfind("f: vox_offset: ", 0), 0u);
}

TEST(Volume, NrrdHeadersThatLieAreRefused) {
    const std::string data = bytes_of_values<std::uint8_t>(values);
    const auto refused = [&](const std::string& fields) {
        return refusal(Format::nrrd, nrrd_file(fields, data));
    };
    const std::string start = "type: uint8\ndimension: 3\n";
    const std::string good = start + "sizes: 2 3 2\nencoding: raw\n";
    EXPECT_EQ(refused(good), "accepted");
    EXPECT_EQ(refusal(Format::nrrd, "NRRD0009\n" + good + "\n" + data),
              "f: magic: NRRD0009 is not accepted; expected NRRD0001 to NRRD0006");
    EXPECT_EQ(refused("dimension: 3\nsizes: 2 3 2\nencoding: raw\n"), "f: type is missing; expected a value");
    EXPECT_EQ(refused("type: block\ndimension: 3\nsizes: 2 3 2\nencoding: raw\n"),
              "f: type: block is not accepted; expected int8, uint8, int16, uint16, int32, uint32, int64, "
              "uint64, float or double");
    EXPECT_EQ(refused("type: uint8\ndimension: 2\nsizes: 4 3\nencoding: raw\n"),
              "f: dimension: 2 is not accepted; expected 3 to 16");
    for (const std::string sizes : {"2 3", "2 3 2 1", "2 3 x", "2 3 2.0", "2 3 99999999999999999999", ""}) {
        EXPECT_EQ(refused(start + "sizes: " + sizes + "\nencoding: raw\n"),
                  "f: sizes: " + sizes + " is not accepted; expected 3 whole numbers");
    }
    EXPECT_EQ(refused(start + "sizes: 2 -3 2\nencoding: raw\n"),
              "f: sizes: 2 x -3 x 2 is not accepted; expected sides from 1 to 1048576");
    EXPECT_EQ(refused(start + "sizes: 2 3 2\nencoding: ascii\n"),
              "f: encoding: ascii is not accepted; expected raw, gzip or bzip2");
    EXPECT_EQ(refused("type: short\ndimension: 3\nsizes: 2 3 2\nencoding: raw\n"),
              "f: endian is missing; expected a value");
    EXPECT_EQ(refused("type: short\ndimension: 3\nsizes: 2 3 2\nencoding: raw\nendian: middle\n"),
              "f: endian: middle is not accepted; expected little or big");
    EXPECT_EQ(
        refused(good + "data file: other.raw\n"),
        "f: data file: other.raw is not accepted; expected a file with the data, other.raw, that exists");
    EXPECT_EQ(refused(good + "data file: slice%03d.raw 1 2 1\n"),
              "f: data file: slice%03d.raw 1 2 1 is not accepted; expected the name of a file, or LIST with "
              "names of files below it");
    EXPECT_EQ(refused(good + "byte skip: -2\n"),
              "f: byte skip: -2 is not accepted; expected a whole number of at least -1");
    EXPECT_EQ(refused(good + "line skip: 1e3\n"),
              "f: line skip: 1e3 is not accepted; expected a whole number of at least 0");
    EXPECT_EQ(refused(good + "type: int8\n"), "f: type: two values is not accepted; expected one value");
    EXPECT_EQ(refused(good + "nonsense\n"),
              "f: header: nonsense is not accepted; expected lines of the form FIELD: VALUE");
    for (const std::string spacings : {"1 1", "1 1 0", "1 nan 1", "1 1 inf", "1 1 one"}) {
        EXPECT_EQ(refused(good + "spacings: " + spacings + "\n"),
                  "f: spacings: " + spacings + " is not accepted; expected " + a_distance);
    }
    for (const std::string directions :
         {"(1,0,0) (0,1,0)", "(1,0,0) (0,1,0) (0,0)", "(1,0,0) (0,1,0) (0,0,x)", "(1,0,0) (0,1,0) (0,0,1",
          "(1,0,0) (0,1,0) 1", "(1,0,0) (0,1,0) (0,0,1,)", ""}) {
        EXPECT_EQ(refused(good + "space directions: " + directions + "\n"),
                  "f: space directions: " + directions +
                      " is not accepted; expected a vector (x,y,z) for each axis of space");
    }
    EXPECT_EQ(
        refusal(Format::nrrd, "NRRD0004\n" + std::string(2000000, '#')).rfind("f: header: more than", 0), 0u);
}

TEST(Volume, FilesAreToldApartByName) {
    const TemporaryFolder folder;
    const std::string data = bytes_of_values<std::uint8_t>(values);
    const std::string nifti = nifti_file(nifti_header({2, 3, 2}, 2), data);
    EXPECT_EQ(values_of(read_volume(folder.write("a.nii", nifti), large)), values);
    EXPECT_EQ(values_of(read_volume(folder.write("a.nii.gz", gzipped(nifti)), large)), values);
    EXPECT_EQ(values_of(read_volume(folder.write("a.nrrd", nrrd_file(nrrd_fields("uint8"), data)), large)),
              values);
    const auto refused = [](const std::string& file) {
        try {
            read_volume(file, large);
        } catch (const BadInput& bad) {
            return std::string(bad.what());
        }
        return std::string("accepted");
    };
    EXPECT_EQ(refused("a.vtk"),
              "a.vtk: file name: a.vtk is not accepted; expected a volume file, whose name ends in .nii, "
              ".nii.gz, .hdr, .hdr.gz, .img, .img.gz, .nrrd, .nhdr, .mha or .mhd");
    EXPECT_EQ(refused("absent.nii"), "absent.nii: a missing file is not accepted; expected a volume file");
    std::filesystem::create_directory(folder.path() / "folder.nii");
    const std::string a_folder = (folder.path() / "folder.nii").string();
    EXPECT_EQ(refused(a_folder), a_folder + ": a folder is not accepted; expected a volume file");
    std::filesystem::create_symlink("/dev/zero", folder.path() / "endless.nii");
    const std::string endless = (folder.path() / "endless.nii").string();
    EXPECT_EQ(refused(endless), endless + ": a pipe or a device is not accepted; expected a volume file");
}

std::string refusal_of_file(const std::string& file) {
    try {
        read_volume(file, large);
    } catch (const BadInput& bad) {
        return bad.what();
    }
    return "accepted";
}

TEST(Volume, PairsOfHeaderAndImage) {
    const std::string data = bytes_of_values<std::int16_t>(values);
    nifti_1_header header = nifti_header({2, 3, 2}, 4, {0.5F, 1, 2});
    for (const std::string& pair :
         {nifti_pair_header(header), nifti_pair_header(nifti_2_header_of(header))}) {
        const TemporaryFolder folder;
        const std::string head = folder.write("a.hdr", pair);
        EXPECT_EQ(refusal_of_file(head),
                  head + ": a header without its image is not accepted; expected the file " +
                      (folder.path() / "a.img").string() + " beside it");
        const std::string image = folder.write("a.img", data);
        for (const std::string& name : {head, image}) {
            EXPECT_EQ(values_of(read_volume(name, large)), values);
            EXPECT_EQ(read_volume(name, large).spacing, glm::dvec3(0.5, 1, 2));
        }
        folder.write("a.img", data.substr(1));
        EXPECT_EQ(refusal_of_file(head), image +
                                             ": voxels: 23 bytes of data is not accepted; expected 24 bytes, "
                                             "12 voxels of datatype 4 as the header says");
        // Compressed as FSL does.
        folder.write("b.hdr.gz", gzipped(pair));
        const std::string packed = folder.write("b.img.gz", gzipped(data));
        EXPECT_EQ(values_of(read_volume(packed, large)), values);
        EXPECT_EQ(values_of(read_volume(folder.path() / "b.hdr.gz", large)), values);
    }
    const TemporaryFolder folder;
    EXPECT_EQ(
        refusal_of_file(folder.write("alone.img", data)),
        (folder.path() / "alone.img").string() +
            ": an image without its header is not accepted; expected alone.hdr beside it, or alone.hdr.gz "
            "if that has no other image");
}

TEST(Volume, NrrdAxesAreWhatTheirKindsSay) {
    const std::string data = bytes_of_values<std::uint8_t>(values);
    const std::string start = "type: uint8\nencoding: raw\n";
    const auto refused = [&](const std::string& fields) {
        return refusal(Format::nrrd, nrrd_file(start + fields, data));
    };
    const std::string three_axes = "three axes along which voxels lie: time, colours and lists are none";
    // One slice of an RGB picture is no volume of 3 x 2 x 2.
    for (const std::string kind : {"RGB-color", "vector", "list", "3-color", "time"}) {
        EXPECT_EQ(refused("dimension: 3\nsizes: 3 2 2\nkinds: " + kind + " domain domain\n"),
                  "f: kinds: " + kind + " domain domain is not accepted; expected " + three_axes);
    }
    EXPECT_EQ(refused("dimension: 3\nsizes: 3 2 2\nspace directions: none (1,0,0) (0,1,0)\n"),
              "f: space directions: none (1,0,0) (0,1,0) is not accepted; expected " + three_axes);
    EXPECT_EQ(refused("dimension: 3\nsizes: 3 2 2\nkinds: domain domain\n"),
              "f: kinds: domain domain is not accepted; expected 3 words, one for each axis");
    // An axis that is not one of space goes first, wherever it is.
    const Volume volume = read(
        Format::nrrd, nrrd_file(start + "dimension: 4\nsizes: 12 1 1 1\nkinds: space scalar space space\n"
                                        "space directions: (0,0,2) none (3,0,0) (0,4,0)\n",
                                data));
    EXPECT_EQ(volume.dims, glm::ivec3(12, 1, 1));
    EXPECT_EQ(volume.spacing, glm::dvec3(2, 3, 4));
}

TEST(Volume, NrrdWithDataInOtherFiles) {
    const TemporaryFolder folder;
    const std::string data = bytes_of_values<std::uint16_t>(values);
    const auto values_behind = [&](const std::string& fields) {
        return values_of(read_volume(folder.write("a.nhdr", "NRRD0005\n" + fields), large));
    };
    const auto refused = [&](const std::string& fields) {
        const std::string message = refusal_of_file(folder.write("a.nhdr", "NRRD0005\n" + fields));
        return message.substr(folder.path().string().size() + 1);
    };
    folder.write("a.raw", data);
    // As 3D Slicer and teem write it: with and without an empty line at the end.
    EXPECT_EQ(values_behind(nrrd_fields("uint16") + "data file: a.raw\n"), values);
    EXPECT_EQ(values_behind(nrrd_fields("uint16") + "data file: a.raw\n\n"), values);
    EXPECT_EQ(values_behind(nrrd_fields("uint16") + "datafile: " + (folder.path() / "a.raw").string()),
              values);
    folder.write("a.raw.gz", gzipped(data));
    EXPECT_EQ(values_behind(nrrd_fields("uint16", "gzip") + "data file: a.raw.gz\n"), values);
    folder.write("skip.raw", "one\ntwo\n???" + data);
    EXPECT_EQ(values_behind(nrrd_fields("uint16") + "line skip: 2\nbyte skip: 3\ndata file: skip.raw\n"),
              values);
    EXPECT_EQ(values_behind(nrrd_fields("uint16") + "byte skip: -1\ndata file: skip.raw\n"), values);
    folder.write("tail.gz", gzipped("???" + data));
    EXPECT_EQ(values_behind(nrrd_fields("uint16", "gzip") + "byte skip: -1\ndata file: tail.gz\n"), values);
    EXPECT_EQ(
        refused(nrrd_fields("uint32", "gzip") + "byte skip: -1\ndata file: tail.gz\n"),
        "tail.gz: data: 27 bytes of data is not accepted; expected 48 bytes, 12 voxels of type uint32 as the "
        "header says");
    folder.write("skip.gz", "one\n" + gzipped("???" + data));
    EXPECT_EQ(
        values_behind(nrrd_fields("uint16", "gzip") + "line skip: 1\nbyte skip: 3\ndata file: skip.gz\n"),
        values);
    folder.write("1.raw", data.substr(0, 12));
    folder.write("2.raw", data.substr(12));
    EXPECT_EQ(values_behind(nrrd_fields("uint16") + "data file: LIST\n1.raw\n2.raw\n"), values);

    EXPECT_EQ(refused(nrrd_fields("uint16") + "data file: b.raw\n"),
              "a.nhdr: data file: b.raw is not accepted; expected a file with the data, " +
                  (folder.path() / "b.raw").string() + ", that exists");
    EXPECT_EQ(
        refused(nrrd_fields("uint16") + "data file: LIST\n1.raw\n"),
        "1.raw: data: 12 bytes of data is not accepted; expected 24 bytes, 12 voxels of type uint16 as the "
        "header says");
    EXPECT_EQ(refused(nrrd_fields("uint16") + "data file: LIST\n\n"),
              "a.nhdr: data file: LIST is not accepted; expected LIST with names of files below it");
    EXPECT_EQ(refused(nrrd_fields("uint16") + "data file: LIST\n1.raw\n1.raw\n1.raw\n1.raw\n1.raw\n"),
              "a.nhdr: data file: 5 files is not accepted; expected files with an equal part of 24 bytes, 12 "
              "voxels of type uint16 as the header says");
    EXPECT_EQ(
        refused(nrrd_fields("uint16") + "data file: skip.raw\n"),
        "skip.raw: data: more than 24 bytes of data is not accepted; expected 24 bytes, 12 voxels of type "
        "uint16 as the header says");
    EXPECT_EQ(refused(nrrd_fields("uint16") + "line skip: 99\ndata file: skip.raw\n"),
              "skip.raw: line skip: 99 is not accepted; expected no more lines than the file has");
    EXPECT_EQ(refused(nrrd_fields("uint16") + "byte skip: 99\ndata file: skip.raw\n"),
              "skip.raw: byte skip: 99 is not accepted; expected a place within the data");
    EXPECT_EQ(
        refused(nrrd_fields("uint32") + "byte skip: -1\ndata file: skip.raw\n"),
        "skip.raw: data: 35 bytes of data is not accepted; expected 48 bytes, 12 voxels of type uint32 as "
        "the header says");
}

TEST(Volume, MetaImageAsItkWritesIt) {
    const TemporaryFolder folder;
    const std::string data = bytes_of_values<std::uint8_t>(values);
    const std::string fields =
        "ObjectType = Image\nNDims = 3\nBinaryData = True\nBinaryDataByteOrderMSB = False\n"
        "CompressedData = True\nCompressedDataSize = 20\nTransformMatrix = -1 0 0 0 -1 0 0 0 1\n"
        "Offset = 31.9 -3 40\nCenterOfRotation = 0 0 0\nAnatomicalOrientation = RAI\n"
        "ElementSpacing = 0.5 1 2.25\nDimSize = 2 3 2\nElementType = MET_UCHAR\nElementDataFile = ";
    folder.write("a.zraw", zlib_packed(data));
    const Volume volume = read_volume(folder.write("a.mhd", fields + "a.zraw\n"), large);
    EXPECT_EQ(volume.dims, glm::ivec3(2, 3, 2));
    EXPECT_EQ(volume.spacing, glm::dvec3(0.5, 1, 2.25));
    EXPECT_EQ(values_of(volume), values);
    EXPECT_EQ(values_of(read_volume(folder.write("a.mha", fields + "LOCAL\n" + zlib_packed(data)), large)),
              values);
    folder.write("1.raw", "??" + data.substr(0, 6));
    folder.write("2.raw", "??" + data.substr(6));
    const std::string list = metaimage_fields("MET_UCHAR") + "HeaderSize = ";
    const std::string names = "\nElementDataFile = LIST\n1.raw\n2.raw\n";
    EXPECT_EQ(values_of(read_volume(folder.write("list.mhd", list + "2" + names), large)), values);
    EXPECT_EQ(values_of(read_volume(folder.write("list.mhd", list + "-1" + names), large)), values);
}

TEST(Volume, MetaImageHeadersThatLieAreRefused) {
    const std::string data = bytes_of_values<std::uint8_t>(values);
    const auto refused = [&](const std::string& fields) {
        return refusal(Format::metaimage, metaimage_file(fields, data));
    };
    const std::string good = metaimage_fields("MET_UCHAR");
    EXPECT_EQ(refused(good), "accepted");
    EXPECT_EQ(refusal(Format::metaimage, good),
              "f: ElementDataFile is missing; expected LOCAL, the "
              "name of a file, or LIST with names of files below it");
    EXPECT_EQ(refused(good + "nonsense\n"),
              "f: header: nonsense is not accepted; expected lines of the form NAME = VALUE");
    EXPECT_EQ(refused(good + "NDims = 3\nComment = one\nComment = two\n"), "accepted");
    EXPECT_EQ(refused(good + "NDims = 4\n"), "f: NDims: two values is not accepted; expected one value");
    EXPECT_EQ(refused(good + "BinaryData = 1\nElementToIntensityFunctionSlope = 1.0\n"), "accepted");
    EXPECT_EQ(refused(good + "BinaryData = False\n"),
              "f: BinaryData: False is not accepted; expected True: voxels as bytes, not as text");
    EXPECT_EQ(refused(good + "ElementToIntensityFunctionSlope = 0\n"),
              "f: ElementToIntensityFunctionSlope: 0 is not accepted; expected a number other than 0");
    EXPECT_EQ(refused(good + "CompressedData = perhaps\n"),
              "f: CompressedData: perhaps is not accepted; expected True or False");
    EXPECT_EQ(refused(good + "CompressedData = True\n").rfind("f: zlib data: ", 0), 0u);
    EXPECT_EQ(refused(good + "HeaderSize = 9999\n"),
              "f: HeaderSize: 9999 is not accepted; expected a place within the file");
    EXPECT_EQ(
        refused(metaimage_fields("MET_STRING")).rfind("f: ElementType: MET_STRING is not accepted; ", 0), 0u);
    EXPECT_EQ(refused("NDims = 2\nDimSize = 4 3\nElementType = MET_UCHAR\n"),
              "f: NDims: 2 is not accepted; expected 3 to 10");
    for (const std::string sizes : {"2 3", "2 3 x", "2 3 2 1", "", "2 3 99999999999999999999"}) {
        EXPECT_EQ(refused("NDims = 3\nDimSize = " + sizes + "\nElementType = MET_UCHAR\n"),
                  "f: DimSize: " + sizes + " is not accepted; expected 3 whole numbers");
    }
    EXPECT_EQ(refused("NDims = 3\nDimSize = 2 99999999 2\nElementType = MET_UCHAR\n"),
              "f: DimSize: 2 x 99999999 x 2 is not accepted; expected sides from 1 to 1048576");
    for (const std::string spacings : {"1 1 0", "nan 1 1", "1 1 one", "1 1"}) {
        EXPECT_EQ(refused(good + "ElementSpacing = " + spacings + "\n"),
                  "f: ElementSpacing: " + spacings + " is not accepted; expected " + a_distance);
    }
}

// --- One rule for each question, in every format --------------------------------------------------------

const std::vector<Format> all_formats = {Format::nifti, Format::nrrd, Format::metaimage};

/// What the reader has to say about a file's grid, whatever the format.
struct Described {
    std::vector<int> sizes{2, 3, 2};
    std::vector<double> spacing{0.5, 1, 2};
    bool directed = true;
    /// Unit vectors of the axes, in right, anterior and superior.
    std::array<glm::dvec3, 3> direction{glm::dvec3(1, 0, 0), glm::dvec3(0, 1, 0), glm::dvec3(0, 0, 1)};
    glm::dvec3 origin{10, 20, 30};
    std::string unit{"mm"};
    double slope = 1, intercept = 0;
};

template <class Numbers>
std::string text_of(const Numbers& numbers) {
    std::ostringstream text;
    text.precision(17);
    for (const auto number : numbers) text << (text.tellp() > 0 ? " " : "") << number;
    return text.str();
}

std::string nifti_described(const Described& grid, const std::string& data) {
    nifti_1_header header = nifti_header({1, 1, 1}, 4);
    header.dim[0] = short(grid.sizes.size());
    for (std::size_t a = 0; a < grid.sizes.size(); ++a) {
        header.dim[a + 1] = short(grid.sizes[a]);
        header.pixdim[a + 1] = float(grid.spacing[a]);
    }
    header.xyzt_units = char(grid.unit == "mm" ? 2 : grid.unit == "um" ? 3 : 0);
    header.scl_slope = float(grid.slope);
    header.scl_inter = float(grid.intercept);
    if (grid.directed) {
        header.sform_code = 1;
        float* rows[] = {header.srow_x, header.srow_y, header.srow_z};
        for (int row = 0; row < 3; ++row) {
            for (int axis = 0; axis < 3; ++axis) {
                const double distance =
                    std::isnan(grid.spacing[std::size_t(axis)]) ? 1 : grid.spacing[std::size_t(axis)];
                rows[row][axis] = float(distance * grid.direction[std::size_t(axis)][row]);
            }
            rows[row][3] = float(grid.origin[row]);
        }
    }
    return nifti_file(header, data);
}

std::string nrrd_described(const Described& grid, const std::string& data) {
    std::string fields = "type: short\ndimension: " + std::to_string(grid.sizes.size()) +
                         "\nsizes: " + text_of(grid.sizes) + "\nencoding: raw\nendian: little\n";
    if (grid.directed) {
        fields += "space: right-anterior-superior\nspace directions:";
        for (std::size_t a = 0; a < grid.sizes.size(); ++a) {
            if (a >= 3) {
                fields += " none";
                continue;
            }
            const glm::dvec3 v = grid.spacing[a] * grid.direction[a];
            std::string vector = text_of(std::vector<double>{v.x, v.y, v.z});
            std::replace(vector.begin(), vector.end(), ' ', ',');
            fields += " (" + vector + ")";
        }
        fields += "\nspace origin: (" + std::to_string(grid.origin.x) + "," + std::to_string(grid.origin.y) +
                  "," + std::to_string(grid.origin.z) + ")\nspace units: \"" + grid.unit + "\" \"" +
                  grid.unit + "\" \"" + grid.unit + "\"\n";
    } else {
        fields += "spacings: " + text_of(grid.spacing) + "\n";
    }
    return nrrd_file(fields, data);
}

std::string metaimage_described(const Described& grid, const std::string& data) {
    const std::size_t n = grid.sizes.size();
    std::string fields = "NDims = " + std::to_string(n) + "\nDimSize = " + text_of(grid.sizes) +
                         "\nElementType = MET_SHORT\nElementSpacing = " + text_of(grid.spacing) +
                         "\nDistanceUnits = " + grid.unit + "\n";
    if (grid.slope != 1) {
        fields += "ElementToIntensityFunctionSlope = " + text_of(std::vector<double>{grid.slope}) +
                  "\nElementToIntensityFunctionOffset = " + text_of(std::vector<double>{grid.intercept}) +
                  "\n";
    }
    if (grid.directed) {
        // In left, posterior and superior.
        std::vector<double> matrix(n * n), offset(n);
        for (std::size_t a = 0; a < n; ++a) matrix[a * n + a] = 1;
        for (std::size_t a = 0; a < 3; ++a) {
            for (int c = 0; c < 3; ++c)
                matrix[a * n + std::size_t(c)] = (c < 2 ? -1 : 1) * grid.direction[a][c];
            offset[a] = (a < 2 ? -1 : 1) * grid.origin[int(a)];
        }
        fields += "TransformMatrix = " + text_of(matrix) + "\nOffset = " + text_of(offset) + "\n";
    }
    return metaimage_file(fields, data);
}

std::string file_of(Format format, const Described& grid, const std::string& data) {
    return format == Format::nifti  ? nifti_described(grid, data)
           : format == Format::nrrd ? nrrd_described(grid, data)
                                    : metaimage_described(grid, data);
}

const std::string shorts = bytes_of_values<std::int16_t>(values);

bool says(const Volume& volume, const std::string& words) {
    return std::any_of(volume.notes.begin(), volume.notes.end(),
                       [&](const std::string& note) { return note.find(words) != std::string::npos; });
}

std::string all_notes(const Volume& volume) {
    std::string text;
    for (const std::string& note : volume.notes) text += note + "\n";
    return text;
}

TEST(VolumeRules, ThePlaceInABodyIsTheSame) {
    Described grid;
    grid.direction = {glm::dvec3(0, 0, -1), glm::dvec3(-1, 0, 0), glm::dvec3(0, 1, 0)};
    for (const Format format : all_formats) {
        const Volume volume = read(format, file_of(format, grid, shorts));
        EXPECT_EQ(all_notes(volume), "");
        EXPECT_EQ(volume.facts.unit, "mm");
        ASSERT_TRUE(volume.facts.placement);
        const Placement& placement = *volume.facts.placement;
        EXPECT_EQ(placement.space, format == Format::metaimage ? "LPS" : "RAS");
        const double sign = format == Format::metaimage ? -1 : 1;
        EXPECT_EQ(placement.origin, glm::dvec3(sign * 10, sign * 20, 30));
        EXPECT_EQ(placement.towards(AnatomicalSide::inferior), glm::dvec3(1, 0, 0));
        EXPECT_EQ(placement.towards(AnatomicalSide::right), glm::dvec3(0, -1, 0));
        EXPECT_EQ(placement.towards(AnatomicalSide::posterior), glm::dvec3(0, 0, -1));
        EXPECT_EQ(nearest_side(placement, 0).first, AnatomicalSide::inferior);
        EXPECT_EQ(nearest_side(placement, 1).first, AnatomicalSide::left);
        EXPECT_EQ(nearest_side(placement, 2).first, AnatomicalSide::anterior);
        const GridSide superior = nearest_grid_side(placement, AnatomicalSide::superior);
        EXPECT_EQ(superior.axis, 0);
        EXPECT_FALSE(superior.upper);
        EXPECT_EQ(superior.degrees, 0);
    }
    grid.directed = false;
    for (const Format format : all_formats)
        EXPECT_FALSE(read(format, file_of(format, grid, shorts)).facts.placement);
}

TEST(VolumeRules, AQformAndLettersPlaceAGridToo) {
    nifti_1_header header = nifti_header({2, 3, 2}, 4, {0.5F, 1, 2});
    header.qform_code = 1;
    header.quatern_b = 1;  // half a turn about x
    header.qoffset_z = 7;
    const Placement nifti = *read(Format::nifti, nifti_file(header, shorts)).facts.placement;
    EXPECT_EQ(nifti.direction[1], glm::dvec3(0, -1, 0));
    EXPECT_EQ(nifti.direction[2], glm::dvec3(0, 0, -1));
    EXPECT_EQ(nifti.origin.z, 7);
    header.pixdim[0] = -1;  // a mirror image
    EXPECT_EQ(read(Format::nifti, nifti_file(header, shorts)).facts.placement->direction[2],
              glm::dvec3(0, 0, 1));

    const std::string fields = metaimage_fields("MET_SHORT", "AnatomicalOrientation = SLA\n");
    const Placement letters = *read(Format::metaimage, metaimage_file(fields, shorts)).facts.placement;
    EXPECT_EQ(nearest_side(letters, 0).first, AnatomicalSide::inferior);
    EXPECT_EQ(nearest_side(letters, 1).first, AnatomicalSide::right);
    EXPECT_EQ(nearest_side(letters, 2).first, AnatomicalSide::posterior);
    const Volume both =
        read(Format::metaimage, metaimage_file(metaimage_fields("MET_SHORT",
                                                                "AnatomicalOrientation = SLA\n"
                                                                "TransformMatrix = 1 0 0 0 1 0 0 0 1\n"),
                                               shorts));
    EXPECT_EQ(both.facts.placement->direction[0], glm::dvec3(1, 0, 0));
    EXPECT_TRUE(says(both, "AnatomicalOrientation SLA contradicts TransformMatrix")) << all_notes(both);
}

TEST(VolumeRules, ANegativeDistanceIsItsLengthAndTurnsTheAxis) {
    nifti_1_header header = nifti_header({2, 3, 2}, 4, {-0.5F, 1, 2});
    header.qform_code = 1;
    const std::string more = "ElementSpacing = -0.5 1 2\nTransformMatrix = 1 0 0 0 1 0 0 0 1\n";
    for (const Volume& volume :
         {read(Format::nifti, nifti_file(header, shorts)),
          read(Format::metaimage, metaimage_file(metaimage_fields("MET_SHORT", more), shorts)),
          read(Format::nrrd, nrrd_file(nrrd_fields("short", "raw", "spacings: -0.5 1 2\n"), shorts))}) {
        EXPECT_EQ(volume.spacing, glm::dvec3(0.5, 1, 2));
        EXPECT_TRUE(says(volume, "it counts as its length, and x runs the other way")) << all_notes(volume);
        if (volume.facts.placement) {
            EXPECT_EQ(volume.facts.placement->direction[0], glm::dvec3(-1, 0, 0));
        }
    }
}

TEST(VolumeRules, AxesMustBeAtRightAngles) {
    const auto sheared = [](double degrees) {
        Described grid;
        const double angle = degrees * std::numbers::pi / 180;
        grid.direction[1] = {std::sin(angle), std::cos(angle), 0};
        return grid;
    };
    for (const Format format : all_formats) {
        const std::string key = format == Format::nifti  ? "sform"
                                : format == Format::nrrd ? "space directions"
                                                         : "TransformMatrix";
        EXPECT_EQ(
            refusal(format, file_of(format, sheared(2), shorts)),
            "f: " + key +
                ": 88 degrees between x and y is not accepted; expected axes at right angles, to within 0.5 "
                "degrees; --spacing or \"spacing\" in a scene takes its place");
        const VolumeChoice choice{.spacing = glm::dvec3(1, 2, 3)};
        const Volume mended = read(format, file_of(format, sheared(2), shorts), large, choice);
        EXPECT_EQ(mended.spacing, glm::dvec3(1, 2, 3));
        EXPECT_TRUE(says(mended, "88 degrees between x and y, taken for a right angle")) << all_notes(mended);
        const Volume nearly = read(format, file_of(format, sheared(0.4), shorts));
        EXPECT_TRUE(says(nearly, "89.6 degrees between x and y, taken for a right angle"))
            << all_notes(nearly);
        EXPECT_EQ(all_notes(read(format, file_of(format, sheared(0.03), shorts))), "");
    }
}

TEST(VolumeRules, AChosenSpacingTakesThePlaceOfABadOne) {
    const VolumeChoice choice{.spacing = glm::dvec3(1, 2, 3)};
    for (const double bad : {0.0, std::numeric_limits<double>::quiet_NaN()}) {
        Described grid;
        grid.directed = false;
        grid.spacing[1] = bad;
        for (const Format format : all_formats) {
            EXPECT_NE(refusal(format, file_of(format, grid, shorts)).find("expected " + a_distance),
                      std::string::npos);
            const Volume volume = read(format, file_of(format, grid, shorts), large, choice);
            EXPECT_EQ(volume.spacing, glm::dvec3(1, 2, 3));
            EXPECT_TRUE(volume.facts.spacing_chosen);
        }
    }
    // Directions of length 0 say nothing about the orientation.
    const Volume flat =
        read(Format::nrrd,
             nrrd_file(nrrd_fields("short", "raw", "space: RAS\nspace directions: (1,0,0) (0,1,0) (0,0,0)\n"),
                       shorts),
             large, choice);
    EXPECT_FALSE(flat.facts.placement);
    EXPECT_TRUE(says(flat, "the orientation is not known")) << all_notes(flat);
}

TEST(VolumeRules, OtherUnitsAreSaid) {
    Described grid;
    grid.unit = "um";
    for (const Format format : all_formats) {
        const Volume volume = read(format, file_of(format, grid, shorts));
        EXPECT_EQ(volume.facts.unit, "um");
        EXPECT_EQ(all_notes(volume), "lengths are in um, as the file has them: nothing is converted\n");
    }
    const std::string mixed = nrrd_fields("short", "raw", "spacings: 1 1 1\nunits: \"mm\" \"mm\" \"s\"\n");
    EXPECT_EQ(
        refusal(Format::nrrd, nrrd_file(mixed, shorts)),
        "f: units: mm, mm, s is not accepted; expected one unit for the three axes; --spacing or \"spacing\" "
        "in a scene takes its place");
    EXPECT_EQ(refusal(Format::nrrd, nrrd_file(mixed, shorts), large, {.spacing = glm::dvec3(1)}), "accepted");
    const std::string none = nrrd_fields("short");
    EXPECT_TRUE(says(read(Format::nrrd, nrrd_file(none, shorts)), "no distance between voxels: 1 is taken"));
    EXPECT_TRUE(says(read(Format::metaimage, metaimage_file(metaimage_fields("MET_SHORT"), shorts)),
                     "no distance between voxels: 1 is taken"));
}

TEST(VolumeRules, TwoLengthsOfAStepAreSaid) {
    nifti_1_header header = nifti_header({2, 3, 2}, 4, {0.5F, 1, 2});
    header.sform_code = 1;
    header.srow_x[0] = 0.75F;
    header.srow_y[1] = 1;
    header.srow_z[2] = 2;
    const Volume volume = read(Format::nifti, nifti_file(header, shorts));
    EXPECT_EQ(volume.spacing, glm::dvec3(0.5, 1, 2));
    EXPECT_EQ(all_notes(volume), "pixdim[1] says 0.5 and sform says 0.75: the first is taken\n");
}

TEST(VolumeRules, OneOfSeveralValuesIsChosen) {
    std::vector<double> second = values;
    std::reverse(second.begin(), second.end());
    std::vector<double> mixed;
    for (std::size_t v = 0; v < values.size(); ++v) {
        mixed.push_back(values[v]);
        mixed.push_back(second[v]);
    }
    Described grid;
    grid.sizes.push_back(2);
    grid.spacing.push_back(7);
    const std::string both = shorts + bytes_of_values<std::int16_t>(second);
    std::vector<std::pair<Format, std::string>> files;
    for (const Format format : all_formats) files.emplace_back(format, file_of(format, grid, both));
    files.emplace_back(Format::metaimage,
                       metaimage_file(metaimage_fields("MET_SHORT", "ElementNumberOfChannels = 2\n"),
                                      bytes_of_values<std::int16_t>(mixed)));
    files.emplace_back(
        Format::nrrd,
        nrrd_file("type: short\ndimension: 4\nsizes: 2 2 3 2\nkinds: list domain domain domain\n"
                  "encoding: raw\nendian: little\n",
                  bytes_of_values<std::int16_t>(mixed)));
    // The other axis lies between those of space.
    std::string between;
    for (int z = 0; z < 2; ++z) {
        const std::size_t half = shorts.size() / 2;
        between += shorts.substr(std::size_t(z) * half, half) +
                   both.substr(shorts.size() + std::size_t(z) * half, half);
    }
    files.emplace_back(
        Format::nrrd,
        nrrd_file("type: short\ndimension: 4\nsizes: 2 3 2 2\nkinds: domain domain time domain\n"
                  "encoding: raw\nendian: little\n",
                  between));
    for (const auto& [format, file] : files) {
        const std::string refused = refusal(format, file);
        EXPECT_NE(refused.find(
                      "expected one value per voxel; --frame or \"frame\" of a scene's dataset chooses one, "
                      "from 0 to 1"),
                  std::string::npos)
            << refused;
        EXPECT_EQ(refusal(format, file, large, {.frame = 2}),
                  "f: frame: 2 is not accepted; expected 0 to 1: the file has 2 values per voxel");
        const Volume first = read(format, file, large, {.frame = 0});
        EXPECT_EQ(first.dims, glm::ivec3(2, 3, 2));
        EXPECT_EQ(values_of(first), values);
        const Volume last = read(format, file, large, {.frame = 1});
        EXPECT_EQ(values_of(last), second);
        EXPECT_EQ(last.facts.frame, 1);
        EXPECT_EQ(last.facts.frames, 2);
        EXPECT_NE(refusal(format, file.substr(0, file.size() - 1), large, {.frame = 0}), "accepted");
    }
    EXPECT_EQ(refusal(Format::nrrd, nrrd_described({}, shorts), large, {.frame = 1}),
              "f: frame: 1 is not accepted; expected 0: the file has one value per voxel");
    EXPECT_EQ(
        refusal(Format::nifti, nifti_described({.sizes = {2, 3, 2, 2, 2}, .spacing = {1, 1, 1, 1, 1}}, both)),
        "f: dim: 2 values along dim[4], which is time, and 2 along dim[5], values of a voxel, is not "
        "accepted; "
        "expected one value per voxel, or several along one axis");
}

TEST(VolumeRules, AFileOfOneFrameIsAVolume) {
    Described grid;
    grid.sizes.push_back(1);
    grid.spacing.push_back(std::numeric_limits<double>::quiet_NaN());
    for (const Format format : all_formats) {
        const Volume volume = read(format, file_of(format, grid, shorts));
        EXPECT_EQ(volume.dims, glm::ivec3(2, 3, 2));
        EXPECT_EQ(volume.spacing, glm::dvec3(0.5, 1, 2));
        EXPECT_EQ(values_of(volume), values);
        EXPECT_EQ(all_notes(volume), "");
    }
}

// dim[4] of NIfTI is time, whatever the sizes. In other formats an axis of size 1 before x is left out, and a
// note says so.
TEST(VolumeRules, TimeIsNeverSpace) {
    nifti_1_header header = nifti_header({1, 2, 3}, 4, {3, 0.5F, 1});
    header.dim[0] = 4;
    header.dim[4] = 2;
    header.pixdim[4] = 2;
    const std::string file = nifti_file(header, shorts);
    EXPECT_EQ(
        refusal(Format::nifti, file),
        "f: dim: 2 along dim[4], which is time, is not accepted; expected one value per voxel; --frame or "
        "\"frame\" of a scene's dataset chooses one, from 0 to 1");
    const Volume frame = read(Format::nifti, file, large, {.frame = 0});
    EXPECT_EQ(frame.dims, glm::ivec3(1, 2, 3));
    EXPECT_EQ(frame.spacing, glm::dvec3(3, 0.5, 1));
    EXPECT_TRUE(says(frame, "the grid has 1 voxel along x"));

    const std::string fields =
        "type: short\ndimension: 5\nsizes: 1 2 3 2 1\nencoding: raw\nendian: little\nspacings: NaN 0.5 1 2 "
        "NaN\n";
    const std::string fields_of_meta =
        "NDims = 4\nDimSize = 1 2 3 2\nElementSpacing = 9 0.5 1 2\nElementType = MET_SHORT\n";
    for (const Volume& volume : {read(Format::nrrd, nrrd_file(fields, shorts)),
                                 read(Format::metaimage, metaimage_file(fields_of_meta, shorts))}) {
        EXPECT_EQ(volume.dims, glm::ivec3(2, 3, 2));
        EXPECT_EQ(volume.spacing, glm::dvec3(0.5, 1, 2));
        EXPECT_EQ(values_of(volume), values);
        EXPECT_EQ(all_notes(volume), "axis 1 has size 1 and is left out: x is axis 2\n");
    }
}

TEST(VolumeRules, LabelsThatAreStoredScaledAreWholeNumbers) {
    Described grid;
    grid.slope = double(1.0F / 13107.0F);
    std::vector<double> stored;
    for (const double value : {0, 1, 2, 5, 0, 0, 2, 1, 0, 0, 0, 5}) stored.push_back(13107 * value / 2);
    grid.slope *= 2;
    const std::string data = bytes_of_values<std::int16_t>(stored);
    for (const Format format : {Format::nifti, Format::metaimage}) {
        const Volume volume = read(format, file_of(format, grid, data));
        EXPECT_NE(volume.slope * 6553 + volume.intercept, 1);
        const LabelledGrid labelled = with_labels(volume, Words{"1", "2", "5"});
        EXPECT_EQ(labelled.counts, (Counts{{"1", 2}, {"2", 2}, {"5", 2}}));
        EXPECT_EQ(names(with_labels(volume, std::nullopt)), (Words{"1", "2", "5"}));
        ASSERT_EQ(labelled.notes.size(), 1u);
        EXPECT_EQ(labelled.notes[0].rfind("values up to ", 0), 0u) << labelled.notes[0];
    }
    // Half a step of a quarter would reach 0.75, but that is not 1.
    grid.slope = 0.25;
    const Volume coarse = read(
        Format::nifti,
        file_of(Format::nifti, grid, bytes_of_values<std::int16_t>({3, 4, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0})));
    EXPECT_EQ(with_labels(coarse, Words{"1"}).counts, (Counts{{"1", 1}}));
    EXPECT_THROW(with_labels(coarse, std::nullopt), BadInput);
    // A value that was stored for 1 does not exceed 1.
    grid.slope = double(1.0F / 49.0F);  // rounded to a float, 49 of them exceed 1
    const Volume threshold = read(
        Format::nifti,
        file_of(Format::nifti, grid, bytes_of_values<std::int16_t>({49, 98, 50, 0, 0, 0, 0, 0, 0, 0, 0, 0})));
    EXPECT_NE(threshold.slope * 49, 1);
    EXPECT_EQ(above_threshold(threshold, 1).grid.label,
              (std::vector<std::uint8_t>{0, 1, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0}));
    EXPECT_EQ(above_threshold(threshold, 2 - 1.0 / 49).grid.label[1], 1);
}

TEST(VolumeRules, NanIsBackground) {
    std::vector<double> with_nan = values;
    with_nan[0] = with_nan[5] = std::numeric_limits<double>::quiet_NaN();
    const Volume volume =
        read(Format::nrrd, nrrd_file(nrrd_fields("double"), bytes_of_values<double>(with_nan)));
    EXPECT_EQ(names(with_labels(volume, std::nullopt)), (Words{"1", "2", "3", "5", "7", "100"}));
    EXPECT_EQ(with_labels(volume, std::nullopt).grid.label[0], 0);
}

TEST(VolumeRules, BytesBehindCompressedDataAreIgnoredAndSaid) {
    const std::vector<std::pair<Format, std::string>> files = {
        {Format::nifti, gzipped(nifti_file(nifti_header({2, 3, 2}, 4), shorts))},
        {Format::nrrd, nrrd_file(nrrd_fields("short", "gzip"), gzipped(shorts))},
        {Format::nrrd, nrrd_file(nrrd_fields("short", "bzip2"), bzip2ed(shorts))},
        {Format::metaimage,
         metaimage_file(metaimage_fields("MET_SHORT", "CompressedData = True\nCompressedDataSize = 20\n"),
                        zlib_packed(shorts))},
        {Format::metaimage,
         metaimage_file(metaimage_fields("MET_SHORT", "CompressedData = True\n"), gzipped(shorts))},
    };
    for (const auto& [format, file] : files) {
        for (const std::string& behind :
             {std::string("\n"), std::string(512, '\0'), std::string(200000, '\0'), std::string("\x1f")}) {
            const Volume volume = read(format, file + behind);
            EXPECT_EQ(values_of(volume), values);
            EXPECT_TRUE(says(volume, std::to_string(behind.size()) +
                                         (behind.size() == 1 ? " byte" : " bytes") +
                                         " behind the compressed data ignored"))
                << all_notes(volume);
        }
        EXPECT_FALSE(says(read(format, file), "ignored"));
    }
    EXPECT_NE(refusal(Format::nrrd, nrrd_file(nrrd_fields("short"), shorts + "\n")), "accepted");
}

TEST(VolumeRules, TheNamedFileIsRead) {
    const std::string pair = nifti_pair_header(nifti_header({2, 3, 2}, 4));
    std::vector<double> other = values;
    std::reverse(other.begin(), other.end());
    const std::string others = bytes_of_values<std::int16_t>(other);
    const TemporaryFolder folder;
    const auto read_name = [&](const std::string& name) {
        return values_of(read_volume(folder.path() / name, large));
    };
    folder.write("a.hdr", pair);
    folder.write("a.img", shorts);
    folder.write("a.hdr.gz", gzipped(pair));
    folder.write("a.img.gz", gzipped(others));
    for (const std::string name : {"a.hdr", "a.img"}) EXPECT_EQ(read_name(name), values);
    for (const std::string name : {"a.hdr.gz", "a.img.gz"}) EXPECT_EQ(read_name(name), other);
    // A compressed and a plain file belong together if nothing else does.
    folder.write("b.hdr", pair);
    folder.write("b.img.gz", gzipped(others));
    for (const std::string name : {"b.hdr", "b.img.gz"}) EXPECT_EQ(read_name(name), other);
    // Now b.hdr belongs to b.img: the rest of the other pair does not take it.
    folder.write("b.img", shorts);
    EXPECT_EQ(read_name("b.hdr"), values);
    EXPECT_EQ(
        refusal_of_file((folder.path() / "b.img.gz").string()),
        (folder.path() / "b.img.gz").string() +
            ": an image without its header is not accepted; expected b.hdr.gz beside it, or b.hdr if that "
            "has no other image");
    // A header that contains its voxels is not the header of an image.
    folder.write("c.hdr", nifti_file(nifti_header({2, 3, 2}, 4), shorts));
    folder.write("c.img", others);
    EXPECT_EQ(read_name("c.hdr"), values);
    EXPECT_NE(refusal_of_file((folder.path() / "c.img").string()), "accepted");
    // Capitals make no difference.
    folder.write("D.HDR", pair);
    folder.write("D.IMG", shorts);
    EXPECT_EQ(read_name("D.IMG"), values);
    EXPECT_EQ(read_name("D.HDR"), values);
    folder.write("E.NII.GZ", gzipped(nifti_file(nifti_header({2, 3, 2}, 4), shorts)));
    EXPECT_EQ(read_name("E.NII.GZ"), values);
    folder.write("F.Nrrd", nrrd_file(nrrd_fields("short"), shorts));
    EXPECT_EQ(read_name("F.Nrrd"), values);
    // A single file has the magic of a pair.
    nifti_1_header header = nifti_header({2, 3, 2}, 4);
    std::memcpy(header.magic, "ni1", 4);
    const std::string file = folder.write("g.nii", nifti_file(header, shorts));
    EXPECT_EQ(
        refusal_of_file(file),
        file +
            ": magic: ni1 is not accepted; expected \"n+1\" in a .nii: this is the magic of a header whose "
            "voxels are in another file, of a pair of .hdr and .img");
}

TEST(VolumeRules, NiftiFieldsThatAreZero) {
    nifti_1_header header = nifti_header({2, 3, 2}, 4);
    header.dim[0] = 4;
    header.dim[4] = 0;
    Volume volume = read(Format::nifti, nifti_file(header, shorts));
    EXPECT_EQ(values_of(volume), values);
    EXPECT_EQ(all_notes(volume), "dim[4] is 0 and is taken for 1\n");
    header = nifti_header({2, 3, 2}, 4);
    header.vox_offset = 0;
    std::string file = nifti_file(header, shorts);
    for (const std::string& same : {file, gzipped(file)}) {
        volume = read(Format::nifti, same);
        EXPECT_EQ(values_of(volume), values);
        EXPECT_EQ(all_notes(volume),
                  "vox_offset is 0: voxels are taken to begin right behind the header, at 352\n");
    }
    file[348] = 1;  // extensions of unknown length follow
    EXPECT_EQ(refusal(Format::nifti, file).rfind("f: vox_offset: 0", 0), 0u);
}

TEST(VolumeRules, WhatIsNoVolumeIsRefused) {
    for (const int code : {3001, 3006, 1008, 1009, 2002, 2005}) {
        nifti_1_header header = nifti_header({2, 3, 2}, 4);
        header.intent_code = short(code);
        EXPECT_EQ(
            refusal(Format::nifti, nifti_file(header, shorts)),
            "f: intent_code: " + std::to_string(code) +
                " is not accepted; expected that of a volume of voxels: this one is for " +
                (code > 3000 ? "connectivity between parts of a brain (CIFTI)" : "points of a surface"));
    }
    nifti_1_header header = nifti_header({2, 3, 2}, 4);
    header.intent_code = 1002;  // labels
    EXPECT_EQ(refusal(Format::nifti, nifti_file(header, shorts)), "accepted");
}

TEST(VolumeRules, MetaImageCountsItsHeaderBeforeItDecodes) {
    const TemporaryFolder folder;
    folder.write("a.zraw", "?????" + zlib_packed(shorts));
    const std::string fields = metaimage_fields("MET_SHORT", "CompressedData = True\nHeaderSize = 5\n");
    EXPECT_EQ(values_of(read_volume(folder.write("a.mhd", fields + "ElementDataFile = a.zraw\n"), large)),
              values);
    Described grid;
    grid.slope = 2;
    grid.intercept = -1;
    const Volume volume = read(Format::metaimage, file_of(Format::metaimage, grid, shorts));
    EXPECT_EQ(volume.slope, 2);
    EXPECT_EQ(volume.intercept, -1);
}

// --- Segments of 3D Slicer ------------------------------------------------------------------------------

/// Three segments in two layers: "wall" and "valve" in the first, and "scar" in the second, which overlaps
/// both.
std::string segmentation(const std::string& more = "", bool layers = true) {
    std::string text =
        layers ? "type: uchar\ndimension: 4\nspace: left-posterior-superior\nsizes: 2 2 3 1\n"
                 "space directions: none (1,0,0) (0,1,0) (0,0,1)\nkinds: list domain domain domain\n"
               : "type: uchar\ndimension: 3\nspace: left-posterior-superior\nsizes: 2 3 1\n"
                 "space directions: (1,0,0) (0,1,0) (0,0,1)\nkinds: domain domain domain\n";
    text +=
        "encoding: raw\nspace origin: (0,0,0)\nSegment0_ID:=Segment_1\nSegment0_LabelValue:=1\n"
        "Segment0_Layer:=0\nSegment0_Name:=wall\nSegment1_ID:=Segment_2\nSegment1_LabelValue:=2\n"
        "Segment1_Layer:=0\nSegment1_Name:=valve: left\n" +
        more;
    return nrrd_file(
        text, layers ? std::string{1, 0, 1, 1, 2, 1, 2, 0, 0, 1, 0, 0} : std::string{1, 1, 2, 2, 0, 3});
}

const std::string scar =
    "Segment2_ID:=Segment_3\nSegment2_LabelValue:=1\nSegment2_Layer:=1\nSegment2_Name:=scar\n";

TEST(Segments, AreChosenByNameIdOrValue) {
    const Volume volume = read(Format::nrrd, segmentation(scar));
    EXPECT_EQ(volume.dims, glm::ivec3(2, 3, 1));
    EXPECT_EQ(volume.layers, 2u);
    const Counts counts = {{"wall", 2}, {"valve: left", 2}, {"scar", 3}};
    const LabelledGrid all = with_labels(volume, std::nullopt);
    EXPECT_EQ(names(all), (Words{"wall", "valve: left", "scar"}));
    EXPECT_EQ(all.counts, counts);
    EXPECT_EQ(all.grid.label, (std::vector<std::uint8_t>{1, 3, 3, 2, 3, 0}));
    EXPECT_EQ(all.notes,
              Words{"2 voxels are in several segments: each is part of the one that comes last in the file"});
    for (const std::string word : {"valve: left", "Segment_2", "2"}) {
        const LabelledGrid one = with_labels(volume, Words{word});
        EXPECT_EQ(one.grid.label, (std::vector<std::uint8_t>{0, 0, 1, 1, 0, 0}));
        EXPECT_EQ(one.counts, counts);
        EXPECT_TRUE(one.notes.empty());
    }
    const LabelledGrid turned = with_labels(volume, Words{"scar", "wall"});
    EXPECT_EQ(names(turned), (Words{"scar", "wall"}));
    EXPECT_EQ(turned.grid.label, (std::vector<std::uint8_t>{2, 2, 1, 0, 1, 0}));
    EXPECT_EQ(
        turned.notes,
        Words{
            "1 voxel is in several segments: each is part of the one that comes last in the list of labels"});

    const auto refused = [&](const auto& use) {
        try {
            use();
        } catch (const BadInput& bad) {
            return std::string(bad.what());
        }
        return std::string("accepted");
    };
    // Two segments have the value 1.
    for (const std::string word : {"aorta", "1"}) {
        EXPECT_EQ(
            refused([&] { with_labels(volume, Words{word}); }),
            "f: labels: " + word +
                " is not accepted; expected a name, an ID or a value that one of the segments has alone: "
                "wall, valve: left, scar");
    }
    EXPECT_EQ(refused([&] {
                  with_labels(volume, Words{"wall", "Segment_1"});
              }),
              "f: labels: Segment_1 is not accepted; expected each segment once");
    EXPECT_EQ(
        refused([&] { above_threshold(volume, 0); }),
        "f: threshold: 0 is not accepted; expected labels, by the names of segments: the file has 2 layers");
    EXPECT_EQ(refusal(Format::nrrd, segmentation(scar), large, {.frame = 0}),
              "f: frame: 0 is not accepted; expected none for a segmentation, whose segments are chosen by "
              "their names");
    EXPECT_EQ(refusal(Format::nrrd, segmentation(scar + "Segment3_Name:=far\nSegment3_Layer:=2\n")),
              "f: Layer of segment far: 2 is not accepted; expected 0 to 1: the file has 2 layers");
    EXPECT_EQ(refusal(Format::nrrd, segmentation("Segment2_Name:=far\nSegment2_Layer:=one\n")),
              "f: Segment2_Layer: one is not accepted; expected a whole number of at least 0");
    EXPECT_EQ(
        refused([&] {
            with_labels(read(Format::nifti, nifti_file(nifti_header({2, 3, 2}, 4), shorts)), Words{"wall"});
        }),
        "f: labels: wall is not accepted; expected whole numbers: the file has no segments that could be "
        "named");
}

TEST(Segments, OfOneLayer) {
    const std::string file =
        segmentation("Segment2_ID:=Segment_3\nSegment2_LabelValue:=7\nSegment2_Layer:=0\n", false);
    const Volume volume = read(Format::nrrd, file);
    const LabelledGrid all = with_labels(volume, std::nullopt);
    EXPECT_EQ(all.grid.label, (std::vector<std::uint8_t>{1, 1, 2, 2, 0, 0}));
    EXPECT_EQ(all.counts, (Counts{{"wall", 2}, {"valve: left", 2}, {"Segment_3", 0}}));
    EXPECT_EQ(all.notes, (Words{"segment Segment_3 has no voxel",
                                "1 voxel has a value that no segment has, and is left out"}));
    EXPECT_THROW(with_labels(volume, Words{"Segment_3"}), BadInput);
    EXPECT_EQ(above_threshold(volume, 2).grid.label, (std::vector<std::uint8_t>{0, 0, 0, 0, 0, 1}));
}

// Files as Slicer wrote them before segments could share a layer.
TEST(Segments, WithoutLayersHaveOneEach) {
    const Volume volume =
        read(Format::nrrd,
             nrrd_file("type: uchar\ndimension: 4\nsizes: 2 2 3 1\nkinds: list domain domain domain\n"
                       "encoding: raw\nSegment0_ID:=a\nSegment1_ID:=b\n",
                       std::string{1, 0, 1, 0, 0, 1, 0, 1, 0, 0, 0, 0}));
    EXPECT_EQ(with_labels(volume, std::nullopt).grid.label, (std::vector<std::uint8_t>{1, 1, 2, 2, 0, 0}));
}

}  // namespace
}  // namespace voxspring::testing
