// Volume files: every format, scalar type, byte order and encoding, and files that are cut short or lie.
#include "harness/volume/volume.h"

#include <gtest/gtest.h>

#include <atomic>
#include <cstdlib>
#include <limits>
#include <new>
#include <sstream>

#include "harness/base/bad_input.h"
#include "harness/volume/readers.h"
#include "tests/volume_files.h"

namespace {
std::atomic<std::size_t> largest_allocation{0};
}

// Replaced for the whole program, so that tests can tell how much a header made the reader allocate. Not
// inlined: GCC would take malloc and free for a mismatch.
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

Volume read(Format format, const std::string& bytes, const SceneSizeLimits& limits = large) {
    std::istringstream stream(bytes);
    switch (format) {
        case Format::nifti:
            return read_nifti(stream, "f", limits);
        case Format::nrrd:
            return read_nrrd(stream, "f", limits);
        default:
            return read_metaimage(stream, "f", limits);
    }
}

std::string refusal(Format format, const std::string& bytes, const SceneSizeLimits& limits = large) {
    try {
        read(format, bytes, limits);
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

/// Twelve values that every scalar type can hold.
const std::vector<double> values = {0, 1, 2, 3, 0, 0, 7, 100, 0, 0, 0, 5};

/// The values of a volume as its labels see them.
std::vector<double> values_of(const Volume& volume) {
    std::vector<double> out(volume.data.size() / bytes_of(volume.type));
    const LabelledGrid labelled = with_labels(volume, std::nullopt);
    for (std::size_t v = 0; v < out.size(); ++v) {
        const int material = labelled.grid.label[v];
        out[v] = material == 0 ? 0 : double(labelled.labels[std::size_t(material - 1)]);
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
    EXPECT_EQ(above_threshold(volume, 0.5).labels, std::vector<std::int64_t>{1});
    const LabelledGrid labelled = with_labels(volume, std::vector<std::int64_t>{7, -3, 2});
    EXPECT_EQ(labelled.labels, (std::vector<std::int64_t>{-3, 2, 7}));
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
                  with_labels(volume, std::vector<std::int64_t>{7, 4});
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
              "f: vox_offset: 5352 is not accepted; expected an offset within the file");
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
        "Encoding: gzip\r\nspace origin: (1,2,3)\r\nSegment0_Name:=wall: left\r\n\r\n";
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

// Every file that ends too early, wherever it does, is refused, and so is one with a byte too many.
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
        EXPECT_NE(refusal(format, file + '\0'), "accepted");
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

// 8 GB of doubles claimed, 12 bytes there.
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
    // A long stream of zeros, 1000 times smaller when packed, is inflated no further than the header says.
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
    EXPECT_EQ(
        refused([](nifti_1_header& h) { h.dim[0] = 2; }),
        "f: dim[0]: 2 is not accepted; expected 3 dimensions, or up to 7 of which all further ones are 1");
    EXPECT_NE(refused([](nifti_1_header& h) { h.dim[0] = -3; }), "accepted");
    EXPECT_NE(refused([](nifti_1_header& h) { h.dim[0] = 8; }), "accepted");
    EXPECT_EQ(refused([](nifti_1_header& h) { h.dim[2] = -3; }),
              "f: dim: 2 x -3 x 2 is not accepted; expected sides from 1 to 1048576");
    EXPECT_EQ(refused([](nifti_1_header& h) {
                  h.dim[0] = 4;
                  h.dim[4] = 2;
              }),
              "f: dim[4]: 2 is not accepted; expected 1: a volume has 3 dimensions and one value a voxel");
    EXPECT_EQ(refused([](nifti_1_header& h) { h.datatype = 128; }),
              "f: datatype: 128 is not accepted; expected one of the scalar types 2, 4, 8, 16, 64, 256, 512, "
              "768, 1024, 1280");
    for (const float distance : {0.F, -0.F, std::numeric_limits<float>::infinity(),
                                 std::numeric_limits<float>::quiet_NaN(), 1e-30F, -1e30F}) {
        EXPECT_EQ(refused([&](nifti_1_header& h) { h.pixdim[2] = distance; }),
                  "f: pixdim[2]: " + std::to_string(distance) +
                      " is not accepted; expected a distance between voxels other than 0");
    }
    for (const float offset : {0.F, 348.F, -1.F, 1e30F, std::numeric_limits<float>::quiet_NaN()})
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
              "f: dimension: 2 is not accepted; expected 3, or more where all further sizes are 1");
    for (const std::string sizes : {"2 3", "2 3 2 1", "2 3 x", "2 3 2.0", "2 3 99999999999999999999", ""}) {
        EXPECT_EQ(refused(start + "sizes: " + sizes + "\nencoding: raw\n"),
                  "f: sizes: " + sizes +
                      " is not accepted; expected 3 whole numbers, 3 of them sides and all further ones 1: a "
                      "volume has one value a voxel");
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
    EXPECT_EQ(refused(start + "sizes: 2 3 2\nencoding: gzip\nbyte skip: -1\n"),
              "f: byte skip: -1 is not accepted; expected 0 or more: -1 is for raw data");
    EXPECT_EQ(refused(good + "type: uint8\n"),
              "f: type: a second value is not accepted; expected each field once");
    EXPECT_EQ(refused(good + "nonsense\n"),
              "f: header: nonsense is not accepted; expected lines of the form FIELD: VALUE");
    for (const std::string spacings : {"1 1", "1 1 0", "1 1 -1", "1 nan 1", "1 1 inf", "1 1 one"}) {
        EXPECT_EQ(refused(good + "spacings: " + spacings + "\n"),
                  "f: spacings: " + spacings +
                      " is not accepted; expected a positive distance between voxels along each axis");
    }
    for (const std::string directions :
         {"(1,0,0) (0,1,0)", "(1,0,0) (0,1,0) none", "(1,0,0) (0,1,0) (0,0)", "(1,0,0) (0,1,0) (0,0,x)",
          "(1,0,0) (0,1,0) (0,0,1", "(1,0,0) (0,1,0) 1", "(1,0,0) (0,1,0) (0,0,1,)", ""}) {
        EXPECT_EQ(refused(good + "space directions: " + directions + "\n"),
                  "f: space directions: " + directions +
                      " is not accepted; expected a vector (x,y,z) for each axis of space");
    }
    EXPECT_EQ(
        refused(good + "space directions: (1,0,0) (0.5,1,0) (0,0,1)\n"),
        "f: space directions: (1,0,0) (0.5,1,0) (0,0,1) is not accepted; expected axes at right angles");
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
        // As FSL packs them.
        folder.write("b.hdr.gz", gzipped(pair));
        const std::string packed = folder.write("b.img.gz", gzipped(data));
        EXPECT_EQ(values_of(read_volume(packed, large)), values);
        EXPECT_EQ(values_of(read_volume(folder.path() / "b.hdr.gz", large)), values);
    }
    const TemporaryFolder folder;
    EXPECT_EQ(refusal_of_file(folder.write("alone.img", data)),
              (folder.path() / "alone.hdr").string() +
                  ": a missing file is not accepted; expected the header of " +
                  (folder.path() / "alone.img").string());
}

TEST(Volume, ADistanceAgainstTheAxisCountsAsItsLength) {
    nifti_1_header header = nifti_header({2, 3, 2}, 2, {-0.5F, 1, -2});
    header.pixdim[0] = -1;  // qfac
    EXPECT_EQ(read(Format::nifti, nifti_file(header, bytes_of_values<std::uint8_t>(values))).spacing,
              glm::dvec3(0.5, 1, 2));
}

TEST(Volume, LeadingDimensionsOfOneAreAccepted) {
    const std::string data = bytes_of_values<std::uint8_t>(values);
    nifti_1_header header = nifti_header({1, 2, 3}, 2, {9, 0.5F, 1});
    header.dim[0] = 4;
    header.dim[4] = 2;
    header.pixdim[4] = 2;
    const std::string fields =
        "type: uchar\ndimension: 5\nsizes: 1 2 3 2 1\nencoding: raw\n"
        "spacings: NaN 0.5 1 2 NaN\n";
    const std::string fields_of_meta =
        "NDims = 4\nDimSize = 1 2 3 2\nElementSpacing = 9 0.5 1 2\nElementType = MET_UCHAR\n";
    for (const Volume& volume :
         {read(Format::nifti, nifti_file(header, data)), read(Format::nrrd, nrrd_file(fields, data)),
          read(Format::metaimage, metaimage_file(fields_of_meta, data))}) {
        EXPECT_EQ(volume.dims, glm::ivec3(2, 3, 2));
        EXPECT_EQ(volume.spacing, glm::dvec3(0.5, 1, 2));
        EXPECT_EQ(values_of(volume), values);
    }
    header.dim[1] = 2;
    EXPECT_EQ(refusal(Format::nifti, nifti_file(header, data)),
              "f: dim[4]: 2 is not accepted; expected 1: a volume has 3 dimensions and one value a voxel");
}

TEST(Volume, NrrdAxesAreWhatTheirKindsSay) {
    const std::string data = bytes_of_values<std::uint8_t>(values);
    const std::string start = "type: uint8\nencoding: raw\n";
    const auto refused = [&](const std::string& fields) {
        return refusal(Format::nrrd, nrrd_file(start + fields, data));
    };
    // One slice of an RGB picture is no volume of 3 x 2 x 2.
    for (const std::string kind : {"RGB-color", "vector", "list", "3-color", "time"}) {
        EXPECT_EQ(
            refused("dimension: 3\nsizes: 3 2 2\nkinds: " + kind + " domain domain\n"),
            "f: kinds: " + kind +
                " domain domain is not accepted; expected domain or space for the 3 axes of a volume, and "
                "a size of 1 along any other: it has one value a voxel");
    }
    EXPECT_EQ(
        refused("dimension: 3\nsizes: 3 2 2\nspace directions: none (1,0,0) (0,1,0)\n"),
        "f: space directions: none (1,0,0) (0,1,0) is not accepted; expected a vector (x,y,z) for each axis "
        "of space");
    EXPECT_EQ(refused("dimension: 3\nsizes: 3 2 2\nkinds: domain domain\n"),
              "f: kinds: domain domain is not accepted; expected 3 words, one for each axis");
    // An axis beside those of space goes first, wherever it is.
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
    EXPECT_EQ(refused(good + "NDims = 3\n"),
              "f: NDims: a second value is not accepted; expected each field once");
    EXPECT_EQ(refused(good + "BinaryData = False\n"),
              "f: BinaryData: False is not accepted; expected True: voxels as bytes, not as text");
    EXPECT_EQ(refused(good + "ElementNumberOfChannels = 3\n"),
              "f: ElementNumberOfChannels: 3 is not accepted; expected 1: a volume has one value a voxel");
    EXPECT_EQ(
        refused(good + "ElementToIntensityFunctionSlope = 2\n"),
        "f: ElementToIntensityFunctionSlope: 2 is not accepted; expected 1: voxels are taken as they are");
    EXPECT_EQ(refused(good + "CompressedData = perhaps\n"),
              "f: CompressedData: perhaps is not accepted; expected True or False");
    EXPECT_EQ(refused(good + "CompressedData = True\n").rfind("f: zlib data: ", 0), 0u);
    EXPECT_EQ(refused(good + "CompressedData = True\nHeaderSize = -1\n"),
              "f: HeaderSize: -1 is not accepted; expected 0 or more: -1 is for raw data");
    EXPECT_EQ(refused(good + "HeaderSize = 13\n"),
              "f: HeaderSize: 13 is not accepted; expected a place within the data");
    EXPECT_EQ(
        refused(metaimage_fields("MET_STRING")).rfind("f: ElementType: MET_STRING is not accepted; ", 0), 0u);
    EXPECT_EQ(refused("NDims = 2\nDimSize = 4 3\nElementType = MET_UCHAR\n"),
              "f: NDims: 2 is not accepted; expected 3, or more where all further sizes are 1");
    for (const std::string sizes : {"2 3", "2 3 x", "2 3 2 1", "", "2 3 99999999999999999999"}) {
        EXPECT_EQ(refused("NDims = 3\nDimSize = " + sizes + "\nElementType = MET_UCHAR\n"),
                  "f: DimSize: " + sizes +
                      " is not accepted; expected 3 whole numbers, 3 of them sides and all further ones 1: a "
                      "volume has one value a voxel");
    }
    EXPECT_EQ(refused("NDims = 3\nDimSize = 2 99999999 2\nElementType = MET_UCHAR\n"),
              "f: DimSize: 2 x 99999999 x 2 is not accepted; expected sides from 1 to 1048576");
    for (const std::string spacings : {"1 1 0", "1 -1 1", "nan 1 1", "1 1 one"}) {
        EXPECT_EQ(refused(good + "ElementSpacing = " + spacings + "\n"),
                  "f: ElementSpacing: " + spacings +
                      " is not accepted; expected a positive distance between voxels along each axis");
    }
    EXPECT_EQ(refused(good + "ElementSpacing = 1 1\n"),
              "f: ElementSpacing: 1 1 is not accepted; expected 3 distances between voxels");
}

}  // namespace
}  // namespace voxspring::testing
