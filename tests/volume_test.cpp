// Volume files: every format, scalar type, byte order and encoding, and files that are truncated or
// inconsistent.
#include "harness/volume/volume.h"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <cstdlib>
#include <glm/geometric.hpp>
#include <limits>
#include <new>
#include <numbers>
#include <numeric>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include "harness/base/bad_input.h"
#include "harness/volume/claims.h"
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

using ::testing::EndsWith;
using ::testing::HasSubstr;
using ::testing::Not;
using ::testing::StartsWith;

constexpr SceneSizeLimits large{1000000, 1000000};

enum class Format : std::uint8_t { nifti, nrrd, metaimage };

struct File {
    Format format;
    std::string bytes;
};

template <class Header>
File nifti(const Header& header, const std::string& data) {
    return {Format::nifti, nifti_file(header, data)};
}
File nrrd(const std::string& fields, const std::string& data) {
    return {Format::nrrd, nrrd_file(fields, data)};
}
File metaimage(const std::string& fields, const std::string& data) {
    return {Format::metaimage, metaimage_file(fields, data)};
}
File packed(const File& file) { return {file.format, gzipped(file.bytes)}; }

Volume read(const File& file, const VolumeChoice& choice = {}, const SceneSizeLimits& limits = large) {
    std::istringstream stream(file.bytes);
    const VolumeClaims claims = file.format == Format::nifti  ? read_nifti(stream, "f")
                                : file.format == Format::nrrd ? read_nrrd(stream, "f")
                                                              : read_metaimage(stream, "f");
    return read_voxels(stream, claims, choice, limits);
}

/// What is refused of the file, as refused() says it.
std::string refused_of(const File& file, const VolumeChoice& choice = {},
                       const SceneSizeLimits& limits = large) {
    return refused([&] { (void)read(file, choice, limits); });
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
        const nifti_2_header second = nifti_2_header_of(header);
        const std::string little = scalar.encode(values, false), big = scalar.encode(values, true);
        const std::string spacings = "spacings: 0.5 1 2\n";
        const std::string big_fields =
            "type: " + scalar.name + "\ndimension: 3\nsizes: 2 3 2\nencoding: gzip\nendian: big\n" + spacings;
        for (const File& file :
             {nifti(header, little), packed(nifti(header, little)), nifti(swapped(header), big),
              nifti(second, little), packed(nifti(swapped(second), big)),
              nrrd(nrrd_fields(scalar.name, "raw", spacings), little), nrrd(big_fields, gzipped(big)),
              nrrd(nrrd_fields(scalar.name, "bzip2", spacings), bzip2ed(little)),
              metaimage(metaimage_fields(scalar.met, "ElementSpacing = 0.5 1 2\n"), little),
              metaimage(metaimage_fields(scalar.met,
                                         "BinaryDataByteOrderMSB = True\nCompressedData = 1\n"
                                         "ElementSize = 0.5 1 2\n"),
                        zlib_packed(big))}) {
            const Volume volume = read(file);
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
    const Volume volume = read(nrrd(nrrd_fields("double"), bytes_of_values<double>(signed_values)));
    EXPECT_EQ(above_threshold(volume, 0.5).grid.label,
              (std::vector<std::uint8_t>{0, 0, 0, 0, 1, 1, 0, 1, 0, 1, 0, 0}));
    EXPECT_EQ(names(above_threshold(volume, 0.5)), Words{"1"});
    const LabelledGrid labelled = with_labels(volume, Words{"7", "-3", "2"});
    EXPECT_EQ(names(labelled), (Words{"-3", "2", "7"}));
    EXPECT_EQ(labelled.counts, (Counts{{"-3", 2}, {"2", 2}, {"7", 1}}));
    EXPECT_EQ(labelled.grid.label, (std::vector<std::uint8_t>{1, 0, 0, 0, 0, 2, 0, 2, 1, 3, 0, 0}));
    EXPECT_EQ(
        refusal([&] { above_threshold(volume, 7); }),
        "f: threshold: 7 is not accepted; expected a number below the largest value in the volume, 7, so "
        "that some voxel is active");
    const Words absent = {"7", "4"};
    EXPECT_EQ(refused([&] { with_labels(volume, absent); }), "labels: 4");
    EXPECT_THAT(refusal([&] { with_labels(volume, absent); }), EndsWith(": -3, 1, 2, 7"));
    EXPECT_EQ(refused([&] { with_labels(volume, std::nullopt); }), "voxel 1: -0.5");
    const Volume zeros = read(nrrd(nrrd_fields("uint8"), std::string(12, '\0')));
    EXPECT_EQ(refused([&] { with_labels(zeros, std::nullopt); }), "labels: a volume of zeros");
    EXPECT_EQ(refused([&] { above_threshold(zeros, 0); }), "threshold: 0");
}

TEST(Volume, AtMost255Labels) {
    std::vector<double> many(256);
    std::iota(many.begin(), many.end(), 0);
    const auto labelled = [&] {
        const std::string fields =
            "type: short\ndimension: 3\nsizes: 256 1 1\nencoding: raw\nendian: little\n";
        return with_labels(read(nrrd(fields, bytes_of_values<std::int16_t>(many))), std::nullopt);
    };
    EXPECT_EQ(labelled().grid.label.back(), 255);
    many[0] = 256;
    EXPECT_EQ(refused(labelled), "labels: more than 255 labels");
}

TEST(Volume, AnAbsentLabelIsRefusedWithTheLowestThatOccur) {
    const auto refused_with = [](std::vector<double> voxels) {
        voxels.resize(12);
        const Volume volume = read(nrrd(nrrd_fields("double"), bytes_of_values<double>(voxels)));
        return refusal([&] { with_labels(volume, Words{"99"}); });
    };
    EXPECT_THAT(refused_with({12, 11, 10, 9, 8, 7, 6, 5, 4, 3}),
                EndsWith(": 3, 4, 5, 6, 7, 8, 9, 10, 11, 12"));
    EXPECT_THAT(refused_with({12, 11, 10, 9, 8, 7, 6, 5, 4, 3, -2}),
                HasSubstr(": -2, 3, 4, 5, 6, 7, 8, 9, 10, 11 and"));
    EXPECT_THAT(refused_with({0.5, 2.5}), HasSubstr("no value but 0"));
}

TEST(Volume, NiftiScalingIsApplied) {
    nifti_1_header header = nifti_header({2, 3, 2}, 2);
    header.scl_slope = 2;
    header.scl_inter = -4;
    const std::string data = bytes_of_values<std::uint8_t>(values);
    // 2 v - 4 > 0
    EXPECT_EQ(above_threshold(read(nifti(header, data)), 0).grid.label,
              (std::vector<std::uint8_t>{0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 0, 1}));
    header.scl_slope = 0;  // no scaling at all
    EXPECT_EQ(values_of(read(nifti(header, data))), values);
    // Infinity exceeds every threshold, and scaling does not change that.
    nifti_1_header floats = nifti_header({2, 3, 2}, 16);
    floats.scl_slope = 2;
    std::vector<double> infinite(12);
    infinite[4] = std::numeric_limits<double>::infinity();
    EXPECT_EQ(above_threshold(read(nifti(floats, bytes_of_values<float>(infinite))), 0).grid.label[4], 1);
}

TEST(Volume, NiftiExtensionsAreSkipped) {
    nifti_1_header header = nifti_header({2, 3, 2}, 2);
    header.vox_offset = 352 + 32;
    const std::string data = std::string(32, 'e') + bytes_of_values<std::uint8_t>(values);
    EXPECT_EQ(values_of(read(nifti(header, data))), values);
    header.vox_offset = 352 + 5000;
    EXPECT_EQ(refused_of(nifti(header, data)), "vox_offset: 5352");
}

TEST(Volume, TrailingDimensionsOfOneAreAccepted) {
    const std::string data = bytes_of_values<std::uint8_t>(values);
    nifti_1_header header = nifti_header({2, 3, 2}, 2);
    header.dim[0] = 5;
    EXPECT_EQ(values_of(read(nifti(header, data))), values);
    const std::string fields =
        "type: uchar\ndimension: 4\nsizes: 2 3 2 1\nencoding: raw\nspacings: 1 2 3 NaN\n";
    EXPECT_EQ(read(nrrd(fields, data)).spacing, glm::dvec3(1, 2, 3));
}

TEST(Volume, NrrdAsSlicerWritesIt) {
    const std::string fields =
        "# Complete NRRD file format specification at:\r\n# http://teem.sourceforge.net/nrrd/format.html\r\n"
        "type: unsigned char\r\ndimension: 3\r\nspace: left-posterior-superior\r\nsizes: 2 3 2\r\n"
        "space directions: (0,0.5,0) (-0.8, 0, 0.6) (0.6e1,0,8)\r\nkinds: domain domain domain\r\n"
        "Encoding: gzip\r\nspace origin: (1 2 3)\r\ncontent:=wall: left\r\n\r\n";
    const Volume volume =
        read({Format::nrrd, "NRRD0005\r\n" + fields + gzipped(bytes_of_values<std::uint8_t>(values))});
    EXPECT_EQ(volume.dims, glm::ivec3(2, 3, 2));
    EXPECT_LT(glm::distance(volume.spacing, glm::dvec3(0.5, 1, 10)), 1e-14);
    EXPECT_EQ(volume.facts.placement->origin, glm::dvec3(1, 2, 3));
    EXPECT_EQ(values_of(volume), values);
}

TEST(Volume, SeveralMembersAreOneStream) {
    const std::string data = bytes_of_values<std::uint8_t>(values);
    const std::string first = data.substr(0, 5), rest = data.substr(5);
    EXPECT_EQ(
        values_of(read(nrrd(nrrd_fields("uint8", "gzip"), gzipped(first) + gzipped("") + gzipped(rest)))),
        values);
    EXPECT_EQ(values_of(read(nrrd(nrrd_fields("uint8", "bzip2"), bzip2ed(first) + bzip2ed(rest)))), values);
    // What MetaImage calls compressed is zlib's format, which has a single member, or gzip.
    const std::string compressed = metaimage_fields("MET_UCHAR", "CompressedData = True\n");
    EXPECT_EQ(values_of(read(metaimage(compressed, gzipped(first) + gzipped("") + gzipped(rest)))), values);
    EXPECT_EQ(refused_of(metaimage(compressed, zlib_packed(first) + zlib_packed(rest))),
              "data: 5 bytes of data");
}

/// A file of twelve 16-bit numbers in every format and encoding.
std::vector<File> short_files() {
    const std::string data = bytes_of_values<std::int16_t>(values);
    const nifti_1_header header = nifti_header({2, 3, 2}, 4);
    return {nifti(header, data),
            nrrd(nrrd_fields("short"), data),
            metaimage(metaimage_fields("MET_SHORT"), data),
            nifti(nifti_2_header_of(header), data),
            packed(nifti(header, data)),
            nrrd(nrrd_fields("short", "gzip"), gzipped(data)),
            nrrd(nrrd_fields("short", "bzip2"), bzip2ed(data)),
            metaimage(metaimage_fields("MET_SHORT", "CompressedData = True\nCompressedDataSize = 20\n"),
                      zlib_packed(data)),
            metaimage(metaimage_fields("MET_SHORT", "CompressedData = True\n"), gzipped(data))};
}

// A file that ends too early is refused, wherever it ends.
TEST(Volume, TruncatedFilesAreRefusedAtEveryLength) {
    for (File file : short_files()) {
        EXPECT_EQ(values_of(read(file)), values);
        while (!file.bytes.empty()) {
            file.bytes.pop_back();
            EXPECT_NE(refused_of(file), "accepted") << file.bytes.size();
        }
    }
    const File file = short_files()[0];
    EXPECT_EQ(refusal([&] {
                  (void)read({file.format, file.bytes.substr(0, 360)});
              }),
              "f: voxels: 8 bytes of data is not accepted; expected 24 bytes, 12 voxels of datatype 4 as the "
              "header says");
    EXPECT_EQ(refused_of({Format::nrrd, short_files()[1].bytes + "x"}), "data: more than 24 bytes of data");
}

TEST(Volume, DamagedDataIsRefused) {
    std::string packed = gzipped(bytes_of_values<std::uint8_t>(values));
    packed[packed.size() - 8] ^= 1;  // the checksum
    EXPECT_EQ(refused_of(nrrd(nrrd_fields("uint8", "gzip"), packed)), "gzip data: incorrect data check");
    const std::string other(12, 'x');
    EXPECT_EQ(refused_of(nrrd(nrrd_fields("uint8", "gzip"), other)), "gzip data: incorrect header check");
    EXPECT_EQ(refused_of(nrrd(nrrd_fields("uint8", "bzip2"), other)), "bzip2 data: a damaged stream");
    EXPECT_EQ(refused_of(metaimage(metaimage_fields("MET_UCHAR", "CompressedData = True\n"), other)),
              "zlib data: incorrect header check");
}

// The header claims 8 GB of doubles; the file has 12 bytes.
TEST(Volume, AHeaderAloneAllocatesNothing) {
    const SceneSizeLimits boundless{std::uint64_t{1} << 32, std::uint64_t{1} << 32};
    const std::string data = bytes_of_values<std::uint8_t>(values);
    const std::string fields =
        "type: double\ndimension: 3\nsizes: 1000 1000 1000\nendian: little\nencoding: ";
    const nifti_1_header header = nifti_header({1000, 1000, 1000}, 64);
    for (const File& file :
         {nifti(header, data), packed(nifti(header, data)), nrrd(fields + "raw\n", data),
          nrrd(fields + "gzip\n", gzipped(data)), nrrd(fields + "bzip2\n", bzip2ed(data)),
          nifti(nifti_2_header_of(header), data),
          metaimage("NDims = 3\nDimSize = 1000 1000 1000\nElementType = MET_DOUBLE\n", data)}) {
        largest_allocation = 0;
        EXPECT_THAT(refused_of(file, {}, boundless), HasSubstr(": 12 bytes of data"));
        EXPECT_LT(largest_allocation, std::size_t{1} << 18);
    }
    // A long stream of zeros, 1000 times smaller when packed, is not inflated beyond what the header says.
    const File bomb = nrrd(nrrd_fields("uint8", "gzip"), gzipped(std::string(std::size_t{1} << 24, '\0')));
    largest_allocation = 0;
    EXPECT_EQ(refused_of(bomb), "data: more than 12 bytes of data");
    EXPECT_LT(largest_allocation, std::size_t{1} << 18);
}

TEST(Volume, GridsBeyondTheLimitsAreRefused) {
    EXPECT_EQ(
        refusal([] {
            (void)read(nifti(nifti_header({30000, 30000, 30000}, 2), ""));
        }),
        "f: dim: 30000 x 30000 x 30000 is not accepted; expected at most 1000000 voxels on this machine, "
        "not 27000000000000");
    const std::string fields = "type: uint8\ndimension: 3\nsizes: 1048576 1048576 1048576\nencoding: raw\n";
    EXPECT_EQ(refused_of(nrrd(fields, "")), "sizes: 1048576 x 1048576 x 1048576");
}

TEST(Volume, NiftiHeadersThatLieAreRefused) {
    const auto with = [&](const auto& spoil) {
        nifti_1_header header = nifti_header({2, 3, 2}, 2);
        spoil(header);
        return refused_of(nifti(header, bytes_of_values<std::uint8_t>(values)));
    };
    using Header = nifti_1_header&;
    EXPECT_EQ(with([](Header) {}), "accepted");
    EXPECT_EQ(with([](Header h) { h.sizeof_hdr = 540; }), "header: 364 bytes");
    EXPECT_EQ(with([](Header h) { h.sizeof_hdr = 349; }), "sizeof_hdr: 349");
    EXPECT_EQ(with([](Header h) { std::memcpy(h.magic, "n+2", 4); }), "magic: n+2");
    EXPECT_EQ(with([](Header h) { std::memcpy(h.magic, "ni1", 4); }), "a header without its image");
    EXPECT_EQ(with([](Header h) { std::memcpy(h.magic, "\x01\xff\n!", 4); }), "magic: \\x01\xff\\x0a!");
    for (const int count : {2, -3, 8})
        EXPECT_EQ(with([&](Header h) { h.dim[0] = short(count); }), "dim[0]: " + std::to_string(count));
    EXPECT_EQ(with([](Header h) { h.dim[2] = -3; }), "dim: 2 x -3 x 2");
    EXPECT_EQ(with([](Header h) { h.datatype = 128; }), "datatype: 128");
    constexpr float nan = std::numeric_limits<float>::quiet_NaN();
    for (const float distance : {0.F, -0.F, std::numeric_limits<float>::infinity(), nan, 1e-30F, -1e30F})
        EXPECT_THAT(with([&](Header h) { h.pixdim[2] = distance; }), StartsWith("pixdim[2]: "));
    for (const float offset : {348.F, 352.5F, -1.F, 1e30F, nan})
        EXPECT_THAT(with([&](Header h) { h.vox_offset = offset; }), StartsWith("vox_offset: "));
    EXPECT_EQ(with([](Header h) { h.vox_offset = 348; }), "vox_offset: 348");
    for (const int code : {3001, 3006, 1008, 1009, 2002, 2005})  // connectivity and surfaces
        EXPECT_EQ(with([&](Header h) { h.intent_code = short(code); }),
                  "intent_code: " + std::to_string(code));
    EXPECT_EQ(with([](Header h) { h.intent_code = 1002; }), "accepted") << "labels";
}

/// Fields of a header, and what is refused of them.
using Refused = std::vector<std::pair<std::string, std::string>>;

TEST(Volume, NrrdHeadersThatLieAreRefused) {
    const std::string data = bytes_of_values<std::uint8_t>(values);
    const std::string start = "type: uint8\ndimension: 3\n", good = start + "sizes: 2 3 2\nencoding: raw\n";
    EXPECT_EQ(refused_of(nrrd(good, data)), "accepted");
    EXPECT_EQ(refused_of({Format::nrrd, "NRRD0009\n" + good + "\n" + data}), "magic: NRRD0009");
    EXPECT_THAT(refused_of({Format::nrrd, "NRRD0004\n" + std::string(2000000, '#')}),
                StartsWith("header: more than"));
    Refused cases = {
        {"dimension: 3\nsizes: 2 3 2\nencoding: raw\n", "type is missing"},
        {"type: block\ndimension: 3\nsizes: 2 3 2\nencoding: raw\n", "type: block"},
        {"type: uint8\ndimension: 2\nsizes: 4 3\nencoding: raw\n", "dimension: 2"},
        {start + "sizes: 2 -3 2\nencoding: raw\n", "sizes: 2 x -3 x 2"},
        {start + "sizes: 2 3 2\nencoding: ascii\n", "encoding: ascii"},
        {"type: short\ndimension: 3\nsizes: 2 3 2\nencoding: raw\n", "endian is missing"},
        {"type: short\ndimension: 3\nsizes: 2 3 2\nencoding: raw\nendian: middle\n", "endian: middle"},
        {good + "type: int8\n", "type: two values"},
        {good + "nonsense\n", "header: nonsense"},
        {good + "kinds: domain domain\n", "kinds: domain domain"},
    };
    for (const std::string sizes : {"2 3", "2 3 2 1", "2 3 x", "2 3 2.0", "2 3 99999999999999999999", ""})
        cases.emplace_back(start + "sizes: " + sizes + "\nencoding: raw\n", "sizes: " + sizes);
    for (const std::string field :
         {"data file: other.raw", "data file: slice%03d.raw 1 2 1", "byte skip: -2", "line skip: 1e3",
          "spacings: 1 1", "spacings: 1 1 0", "spacings: 1 nan 1", "spacings: 1 1 inf", "spacings: 1 1 one",
          "space directions: (1,0,0) (0,1,0)", "space directions: (1,0,0) (0,1,0) (0,0)",
          "space directions: (1,0,0) (0,1,0) (0,0,x)", "space directions: (1,0,0) (0,1,0) (0,0,1",
          "space directions: (1,0,0) (0,1,0) 1", "space directions: (1,0,0) (0,1,0) (0,0,1,)",
          "space directions: "})
        cases.emplace_back(good + field + "\n", field);
    // One slice of an RGB picture is no volume of 3 x 2 x 2.
    for (const std::string kind : {"RGB-color", "vector", "list", "3-color", "time"})
        cases.emplace_back(good + "kinds: " + kind + " domain domain\n", "kinds: " + kind + " domain domain");
    const std::string two_of_space = "space directions: none (1,0,0) (0,1,0)";
    cases.emplace_back(good + two_of_space + "\n", two_of_space);
    for (const auto& [fields, expected] : cases)
        EXPECT_EQ(refused_of(nrrd(fields, data)), expected) << fields;
}

TEST(Volume, MetaImageHeadersThatLieAreRefused) {
    const std::string data = bytes_of_values<std::uint8_t>(values);
    const std::string good = metaimage_fields("MET_UCHAR");
    EXPECT_EQ(refused_of({Format::metaimage, good}), "ElementDataFile is missing");
    Refused cases = {
        {good, "accepted"},
        {good + "NDims = 3\nComment = one\nComment = two\n", "accepted"},
        {good + "BinaryData = 1\nElementToIntensityFunctionSlope = 1.0\nElementSpacing = 1.0 1.0 1.0\n",
         "accepted"},
        {good + "NDims = 4\n", "NDims: two values"},
        {good + "ObjectType = Mesh\n", "ObjectType: two values"},
        {good + "nonsense\n", "header: nonsense"},
        {metaimage_fields("MET_STRING"), "ElementType: MET_STRING"},
        {"NDims = 2\nDimSize = 4 3\nElementType = MET_UCHAR\n", "NDims: 2"},
        {"NDims = 3\nDimSize = 2 99999999 2\nElementType = MET_UCHAR\n", "DimSize: 2 x 99999999 x 2"},
    };
    for (const std::string sizes : {"2 3", "2 3 x", "2 3 2 1", "", "2 3 99999999999999999999"})
        cases.emplace_back("NDims = 3\nDimSize = " + sizes + "\nElementType = MET_UCHAR\n",
                           "DimSize: " + sizes);
    for (const auto& [key, value] : Refused{{"BinaryData", "False"},
                                            {"ElementToIntensityFunctionSlope", "0"},
                                            {"CompressedData", "perhaps"},
                                            {"HeaderSize", "9999"},
                                            {"ElementSpacing", "1 1 0"},
                                            {"ElementSpacing", "nan 1 1"},
                                            {"ElementSpacing", "1 1 one"},
                                            {"ElementSpacing", "1 1"},
                                            {"ElementNumberOfChannels", "0"},
                                            {"TransformMatrix", "1 0 0"},
                                            {"Offset", "1 2"}})
        cases.emplace_back(good + key + " = " + value + "\n", key + ": " + value);
    for (const auto& [fields, expected] : cases)
        EXPECT_EQ(refused_of(metaimage(fields, data)), expected) << fields;
}

std::string refused_file(const std::string& file) {
    return refused([&] { (void)read_volume(file, large); });
}

TEST(Volume, FilesAreToldApartByName) {
    const TemporaryFolder folder;
    const File file = short_files()[0];
    EXPECT_EQ(values_of(read_volume(folder.write("a.nii", file.bytes), large)), values);
    EXPECT_EQ(values_of(read_volume(folder.write("a.nii.gz", gzipped(file.bytes)), large)), values);
    EXPECT_EQ(values_of(read_volume(folder.write("a.nrrd", short_files()[1].bytes), large)), values);
    EXPECT_EQ(refusal([] { (void)read_volume("a.vtk", large); }),
              "a.vtk: file name: a.vtk is not accepted; expected a volume file, whose name ends in .nii, "
              ".nii.gz, .hdr, .hdr.gz, .img, .img.gz, .nrrd, .nhdr, .mha or .mhd");
    EXPECT_EQ(refused_file("absent.nii"), "a missing file");
    std::filesystem::create_directory(folder.path() / "folder.nii");
    EXPECT_EQ(refused_file(folder.path() / "folder.nii"), "a folder");
    std::filesystem::create_symlink("/dev/zero", folder.path() / "endless.nii");
    EXPECT_EQ(refused_file(folder.path() / "endless.nii"), "a pipe or a device");
}

TEST(Volume, PairsOfHeaderAndImage) {
    const std::string data = bytes_of_values<std::int16_t>(values);
    const nifti_1_header header = nifti_header({2, 3, 2}, 4, {0.5F, 1, 2});
    for (const std::string& pair :
         {nifti_pair_header(header), nifti_pair_header(nifti_2_header_of(header))}) {
        const TemporaryFolder folder;
        const std::string head = folder.write("a.hdr", pair);
        EXPECT_EQ(refused_file(head), "a header without its image");
        const std::string image = folder.write("a.img", data);
        for (const std::string& name : {head, image}) {
            EXPECT_EQ(values_of(read_volume(name, large)), values);
            EXPECT_EQ(read_volume(name, large).spacing, glm::dvec3(0.5, 1, 2));
        }
        folder.write("a.img", data.substr(1));
        EXPECT_THAT(refusal([&] { (void)read_volume(head, large); }),
                    StartsWith(image + ": voxels: 23 bytes of data is not accepted"));
        // Compressed as FSL does.
        folder.write("b.hdr.gz", gzipped(pair));
        const std::string packed = folder.write("b.img.gz", gzipped(data));
        EXPECT_EQ(values_of(read_volume(packed, large)), values);
        EXPECT_EQ(values_of(read_volume(folder.path() / "b.hdr.gz", large)), values);
    }
    const TemporaryFolder folder;
    EXPECT_THAT(
        refusal([&] { (void)read_volume(folder.write("alone.img", data), large); }),
        EndsWith(": an image without its header is not accepted; expected the header alone.hdr beside it, or "
                 "alone.hdr.gz if that is not the header of another image"));
}

TEST(Volume, NrrdAxesAreWhatTheirKindsSay) {
    // An axis that is not one of space goes first, wherever it is.
    const std::string fields =
        "type: uint8\nencoding: raw\ndimension: 4\nsizes: 12 1 1 1\nkinds: space scalar space space\n"
        "space directions: (0,0,2) none (3,0,0) (0,4,0)\n";
    const Volume volume = read(nrrd(fields, bytes_of_values<std::uint8_t>(values)));
    EXPECT_EQ(volume.dims, glm::ivec3(12, 1, 1));
    EXPECT_EQ(volume.spacing, glm::dvec3(2, 3, 4));
}

TEST(Volume, NrrdWithDataInOtherFiles) {
    const TemporaryFolder folder;
    const std::string data = bytes_of_values<std::uint16_t>(values);
    folder.write("a.raw", data);
    folder.write("a.raw.gz", gzipped(data));
    folder.write("skip.raw", "one\ntwo\n???" + data);
    folder.write("tail.gz", gzipped("???" + data));
    folder.write("skip.gz", "one\n" + gzipped("???" + data));
    folder.write("1.raw", data.substr(0, 12));
    folder.write("2.raw", data.substr(12));
    const std::string raw = nrrd_fields("uint16"), packed = nrrd_fields("uint16", "gzip");
    const auto file = [&](const std::string& fields) {
        return folder.write("a.nhdr", "NRRD0005\n" + fields);
    };
    // As 3D Slicer and teem write it: with and without an empty line at the end.
    for (const std::string& fields :
         {raw + "data file: a.raw\n", raw + "data file: a.raw\n\n",
          raw + "datafile: " + (folder.path() / "a.raw").string(), packed + "data file: a.raw.gz\n",
          raw + "line skip: 2\nbyte skip: 3\ndata file: skip.raw\n",
          raw + "byte skip: -1\ndata file: skip.raw\n", packed + "byte skip: -1\ndata file: tail.gz\n",
          packed + "line skip: 1\nbyte skip: 3\ndata file: skip.gz\n",
          raw + "data file: LIST\n1.raw\n2.raw\n"})
        EXPECT_EQ(values_of(read_volume(file(fields), large)), values) << fields;
    const std::string wide = "type: uint32\ndimension: 3\nsizes: 2 3 2\nendian: little\nbyte skip: -1\n";
    for (const auto& [fields, expected] : Refused{
             {wide + "encoding: gzip\ndata file: tail.gz\n", "data: 27 bytes of data"},
             {wide + "encoding: raw\ndata file: skip.raw\n", "data: 35 bytes of data"},
             {raw + "data file: b.raw\n", "data file: b.raw"},
             {raw + "data file: LIST\n1.raw\n", "data: 12 bytes of data"},
             {raw + "data file: LIST\n\n", "data file: LIST"},
             {raw + "data file: LIST\n1.raw\n1.raw\n1.raw\n1.raw\n1.raw\n", "data file: 5 files"},
             {raw + "data file: skip.raw\n", "data: more than 24 bytes of data"},
             {raw + "line skip: 99\ndata file: skip.raw\n", "line skip: 99"},
             {raw + "byte skip: 99\ndata file: skip.raw\n", "byte skip: 99"},
         })
        EXPECT_EQ(refused_file(file(fields)), expected) << fields;
}

TEST(Volume, MetaImageAsItkWritesIt) {
    const TemporaryFolder folder;
    const std::string data = bytes_of_values<std::uint8_t>(values), packed = zlib_packed(data);
    const std::string fields =
        "ObjectType = Image\nNDims = 3\nBinaryData = True\nBinaryDataByteOrderMSB = False\n"
        "CompressedData = True\nCompressedDataSize = 20\nTransformMatrix = -1 0 0 0 -1 0 0 0 1\n"
        "Offset = 31.9 -3 40\nCenterOfRotation = 0 0 0\nAnatomicalOrientation = RAI\n"
        "ElementSpacing = 0.5 1 2.25\nDimSize = 2 3 2\nElementType = MET_UCHAR\nElementDataFile = ";
    folder.write("a.zraw", packed);
    const Volume volume = read_volume(folder.write("a.mhd", fields + "a.zraw\n"), large);
    EXPECT_EQ(volume.dims, glm::ivec3(2, 3, 2));
    EXPECT_EQ(volume.spacing, glm::dvec3(0.5, 1, 2.25));
    EXPECT_EQ(values_of(volume), values);
    EXPECT_EQ(values_of(read_volume(folder.write("a.mha", fields + "LOCAL\n" + packed), large)), values);
    folder.write("1.raw", "??" + data.substr(0, 6));
    folder.write("2.raw", "??" + data.substr(6));
    folder.write("b.zraw", "?????" + packed);
    // HeaderSize counts bytes before they are decoded.
    for (const std::string place : {"HeaderSize = 2\nElementDataFile = LIST\n1.raw\n2.raw\n",
                                    "HeaderSize = -1\nElementDataFile = LIST\n1.raw\n2.raw\n",
                                    "HeaderSize = 5\nCompressedData = True\nElementDataFile = b.zraw\n"}) {
        const std::string file = folder.write("b.mhd", metaimage_fields("MET_UCHAR", place));
        EXPECT_EQ(values_of(read_volume(file, large)), values) << place;
    }
}

// --- One rule for each question, in every format --------------------------------------------------------

const std::vector<Format> all_formats = {Format::nifti, Format::nrrd, Format::metaimage};

/// What a file says about its grid, whatever the format.
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

std::string text_of(const auto& numbers, const char* between = " ") {
    return fmt::format("{}", fmt::join(numbers, between));
}

File nifti_described(const Described& grid, const std::string& data) {
    nifti_1_header header = nifti_header({1, 1, 1}, 4);
    header.dim[0] = short(grid.sizes.size());
    for (std::size_t a = 0; a < grid.sizes.size(); ++a) {
        header.dim[a + 1] = short(grid.sizes[a]);
        header.pixdim[a + 1] = float(grid.spacing[a]);
    }
    header.xyzt_units = char(grid.unit == "mm" ? 2 : grid.unit == "um" ? 3 : 0);
    header.scl_slope = float(grid.slope);
    header.scl_inter = float(grid.intercept);
    header.sform_code = grid.directed ? 1 : 0;
    float* rows[] = {header.srow_x, header.srow_y, header.srow_z};
    for (int row = 0; row < 3; ++row) {
        for (std::size_t axis = 0; axis < 3; ++axis) {
            const double distance = std::isnan(grid.spacing[axis]) ? 1 : grid.spacing[axis];
            rows[row][axis] = float(distance * grid.direction[axis][row]);
        }
        rows[row][3] = float(grid.origin[row]);
    }
    return nifti(header, data);
}

File nrrd_described(const Described& grid, const std::string& data) {
    std::string fields = fmt::format("type: short\ndimension: {}\nsizes: {}\nencoding: raw\nendian: little\n",
                                     grid.sizes.size(), text_of(grid.sizes));
    if (!grid.directed) return nrrd(fields + "spacings: " + text_of(grid.spacing) + "\n", data);
    fields += "space: right-anterior-superior\nspace directions:";
    for (std::size_t a = 0; a < grid.sizes.size(); ++a) {
        const glm::dvec3 v = a < 3 ? grid.spacing[a] * grid.direction[a] : glm::dvec3(0);
        fields += a < 3 ? fmt::format(" ({},{},{})", v.x, v.y, v.z) : " none";
    }
    fields += fmt::format("\nspace origin: ({0},{1},{2})\nspace units: \"{3}\" \"{3}\" \"{3}\"\n",
                          grid.origin.x, grid.origin.y, grid.origin.z, grid.unit);
    return nrrd(fields, data);
}

File metaimage_described(const Described& grid, const std::string& data) {
    const std::size_t n = grid.sizes.size();
    std::string fields = fmt::format(
        "NDims = {}\nDimSize = {}\nElementType = MET_SHORT\nElementSpacing = {}\nDistanceUnits = {}\n"
        "ElementToIntensityFunctionSlope = {}\nElementToIntensityFunctionOffset = {}\n",
        n, text_of(grid.sizes), text_of(grid.spacing), grid.unit, grid.slope, grid.intercept);
    if (!grid.directed) return metaimage(fields, data);
    // In left, posterior and superior.
    std::vector<double> matrix(n * n), offset(n);
    for (std::size_t a = 0; a < n; ++a) matrix[a * n + a] = 1;
    for (std::size_t a = 0; a < 3; ++a) {
        for (int c = 0; c < 3; ++c) matrix[a * n + std::size_t(c)] = (c < 2 ? -1 : 1) * grid.direction[a][c];
        offset[a] = (a < 2 ? -1 : 1) * grid.origin[int(a)];
    }
    fields += "TransformMatrix = " + text_of(matrix) + "\nOffset = " + text_of(offset) + "\n";
    return metaimage(fields, data);
}

const std::string shorts = bytes_of_values<std::int16_t>(values);

File file_of(Format format, const Described& grid, const std::string& data = shorts) {
    return format == Format::nifti  ? nifti_described(grid, data)
           : format == Format::nrrd ? nrrd_described(grid, data)
                                    : metaimage_described(grid, data);
}

std::string all_notes(const Volume& volume) { return text_of(volume.notes, "\n"); }

TEST(VolumeRules, ThePlaceInABodyIsTheSame) {
    Described grid;
    grid.direction = {glm::dvec3(0, 0, -1), glm::dvec3(-1, 0, 0), glm::dvec3(0, 1, 0)};
    for (const Format format : all_formats) {
        grid.directed = true;
        const Volume volume = read(file_of(format, grid));
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
        grid.directed = false;
        EXPECT_FALSE(read(file_of(format, grid)).facts.placement);
    }
}

TEST(VolumeRules, AQformAndLettersPlaceAGridToo) {
    nifti_1_header header = nifti_header({2, 3, 2}, 4, {0.5F, 1, 2});
    header.qform_code = 1;
    header.quatern_b = 1;  // half a turn about x
    header.qoffset_z = 7;
    const Placement qform = *read(nifti(header, shorts)).facts.placement;
    EXPECT_EQ(qform.direction[1], glm::dvec3(0, -1, 0));
    EXPECT_EQ(qform.direction[2], glm::dvec3(0, 0, -1));
    EXPECT_EQ(qform.origin.z, 7);
    header.pixdim[0] = -1;  // a mirror image
    EXPECT_EQ(read(nifti(header, shorts)).facts.placement->direction[2], glm::dvec3(0, 0, 1));

    const std::string fields = metaimage_fields("MET_SHORT", "AnatomicalOrientation = SLA\n");
    const Placement letters = *read(metaimage(fields, shorts)).facts.placement;
    EXPECT_EQ(nearest_side(letters, 0).first, AnatomicalSide::inferior);
    EXPECT_EQ(nearest_side(letters, 1).first, AnatomicalSide::right);
    EXPECT_EQ(nearest_side(letters, 2).first, AnatomicalSide::posterior);
    const Volume both = read(metaimage(fields + "TransformMatrix = 1 0 0 0 1 0 0 0 1\n", shorts));
    EXPECT_EQ(both.facts.placement->direction[0], glm::dvec3(1, 0, 0));
    EXPECT_THAT(all_notes(both), HasSubstr("AnatomicalOrientation SLA contradicts TransformMatrix"));
}

TEST(VolumeRules, ANegativeDistanceIsItsLengthAndTurnsAPlacedAxis) {
    nifti_1_header qform = nifti_header({2, 3, 2}, 4, {-0.5F, 1, 2}), sform = qform;
    const nifti_1_header unplaced = qform;
    qform.qform_code = sform.sform_code = 1;
    sform.srow_x[0] = 0.5F;
    sform.srow_y[1] = 1;
    sform.srow_z[2] = 2;
    const std::string spacing = "ElementSpacing = -0.5 1 2\n", spacings = "spacings: -0.5 1 2\n";
    const auto in_metaimage = [&](const std::string& more) {
        return metaimage(metaimage_fields("MET_SHORT", spacing + more), shorts);
    };
    const auto in_nrrd = [&](const std::string& more) {
        return nrrd(nrrd_fields("short", "raw", spacings + more), shorts);
    };
    const auto notes_of = [](const File& file) {
        const Volume volume = read(file);
        EXPECT_EQ(volume.spacing, glm::dvec3(0.5, 1, 2));
        EXPECT_THAT(all_notes(volume), HasSubstr("its absolute value is used for x"));
        return all_notes(volume);
    };
    for (const File& file :
         {nifti(qform, shorts), in_metaimage("TransformMatrix = 1 0 0 0 1 0 0 0 1\n"),
          in_metaimage("Offset = 1 2 3\n"), in_nrrd("space dimension: 3\nspace origin: (1,2,3)\n")}) {
        EXPECT_THAT(notes_of(file), EndsWith(" is negative: x runs the other way"));
        EXPECT_EQ(read(file).facts.placement->direction[0], glm::dvec3(-1, 0, 0));
        // The user's spacing replaces the length, but not the direction.
        const Volume chosen = read(file, {.spacing = glm::dvec3(1)});
        EXPECT_THAT(all_notes(chosen), EndsWith(" is negative: x runs the other way"));
        EXPECT_EQ(chosen.facts.placement->direction[0], glm::dvec3(-1, 0, 0));
    }
    // The sform gives the direction alone.
    EXPECT_THAT(notes_of(nifti(sform, shorts)), Not(HasSubstr("the other way")));
    EXPECT_EQ(read(nifti(sform, shorts)).facts.placement->direction[0], glm::dvec3(1, 0, 0));
    // A grid without a place runs nowhere.
    for (const File& file : {nifti(unplaced, shorts), in_metaimage(""), in_nrrd("")}) {
        EXPECT_THAT(notes_of(file), Not(HasSubstr("the other way")));
        EXPECT_FALSE(read(file).facts.placement);
    }
}

TEST(VolumeRules, AxesMustBeAtRightAngles) {
    const auto sheared = [](Format format, double degrees) {
        Described grid;
        const double angle = degrees * std::numbers::pi / 180;
        grid.direction[1] = {std::sin(angle), std::cos(angle), 0};
        return file_of(format, grid);
    };
    for (const Format format : all_formats) {
        const std::string key = format == Format::nifti  ? "sform"
                                : format == Format::nrrd ? "space directions"
                                                         : "TransformMatrix";
        EXPECT_EQ(
            refusal([&] { (void)read(sheared(format, 2)); }),
            "f: " + key +
                ": 88 degrees between x and y is not accepted; expected axes at right angles, to within "
                "0.5 degrees; --spacing, or \"spacing\" in a scene, replaces what the file says");
        const Volume mended = read(sheared(format, 2), {.spacing = glm::dvec3(1, 2, 3)});
        EXPECT_EQ(mended.spacing, glm::dvec3(1, 2, 3));
        EXPECT_THAT(all_notes(mended), HasSubstr("88 degrees between x and y, taken for a right angle"));
        EXPECT_THAT(all_notes(read(sheared(format, 0.4))), HasSubstr("89.6 degrees between x and y, taken"));
        EXPECT_EQ(all_notes(read(sheared(format, 0.03))), "");
    }
}

TEST(VolumeRules, AChosenSpacingTakesThePlaceOfABadOne) {
    const VolumeChoice choice{.spacing = glm::dvec3(1, 2, 3)};
    for (const double bad : {0.0, std::numeric_limits<double>::quiet_NaN()}) {
        Described grid;
        grid.directed = false;
        grid.spacing[1] = bad;
        for (const Format format : all_formats) {
            EXPECT_THAT(refusal([&] { (void)read(file_of(format, grid)); }),
                        EndsWith("; expected a distance between voxels along each axis, other than 0; "
                                 "--spacing, or \"spacing\" in a scene, replaces what the file says"));
            const Volume volume = read(file_of(format, grid), choice);
            EXPECT_EQ(volume.spacing, glm::dvec3(1, 2, 3));
            EXPECT_TRUE(volume.facts.spacing_chosen);
        }
    }
    // Directions of length 0 say nothing about the orientation.
    const std::string flat = "space: RAS\nspace directions: (1,0,0) (0,1,0) (0,0,0)\n";
    const Volume volume = read(nrrd(nrrd_fields("short", "raw", flat), shorts), choice);
    EXPECT_FALSE(volume.facts.placement);
    EXPECT_THAT(all_notes(volume), HasSubstr("the orientation is not known"));
    // Neither do axes in one plane: no combination of these three leads forward.
    Described grid;
    grid.direction = {glm::dvec3(1, 0, 0), glm::dvec3(0, 0, 1), glm::dvec3(0.6, 0, 0.8)};
    for (const Format format : all_formats) {
        const Volume in_a_plane = read(file_of(format, grid), choice);
        EXPECT_FALSE(in_a_plane.facts.placement);
        EXPECT_THAT(all_notes(in_a_plane), EndsWith("in one plane: the orientation is not known"));
    }
}

TEST(VolumeRules, WhatIsNotUsualIsSaid) {
    Described grid;
    grid.unit = "um";
    for (const Format format : all_formats) {
        const Volume volume = read(file_of(format, grid));
        EXPECT_EQ(volume.facts.unit, "um");
        EXPECT_EQ(all_notes(volume), "lengths are in um, as the file has them: nothing is converted");
    }
    const File mixed =
        nrrd(nrrd_fields("short", "raw", "spacings: 1 1 1\nunits: \"mm\" \"mm\" \"s\"\n"), shorts);
    EXPECT_EQ(refused_of(mixed), "units: mm, mm, s");
    EXPECT_EQ(refused_of(mixed, {.spacing = glm::dvec3(1)}), "accepted");
    for (const File& file :
         {nrrd(nrrd_fields("short"), shorts), metaimage(metaimage_fields("MET_SHORT"), shorts)}) {
        EXPECT_EQ(read(file).spacing, glm::dvec3(1));
        EXPECT_EQ(all_notes(read(file)), "the file gives no distance between voxels: 1 is taken");
    }
    const File lost = nrrd(nrrd_fields("short", "raw", "spacings: 1 1 1\nspace origin: (1,2)\n"), shorts);
    EXPECT_THAT(all_notes(read(lost)), StartsWith("space origin is no vector"));
    for (const double bad : {std::numeric_limits<double>::quiet_NaN(), 1e30}) {
        Described astray;
        astray.origin.z = bad;
        for (const Format format : all_formats) {
            const Volume volume = read(file_of(format, astray));
            EXPECT_EQ(volume.facts.placement->origin, glm::dvec3(0));
            EXPECT_EQ(volume.facts.placement->direction[2], glm::dvec3(0, 0, 1));
            EXPECT_THAT(all_notes(volume), EndsWith(" is not of numbers up to 1e+12: 0 is taken"));
        }
    }
    nifti_1_header header = nifti_header({2, 3, 2}, 4, {0.5F, 1, 2});
    header.sform_code = 1;
    header.srow_x[0] = 0.75F;
    header.srow_y[1] = 1;
    header.srow_z[2] = 2;
    const Volume two_lengths = read(nifti(header, shorts));
    EXPECT_EQ(two_lengths.spacing, glm::dvec3(0.5, 1, 2));
    EXPECT_EQ(all_notes(two_lengths), "pixdim[1] says 0.5 and sform says 0.75: the first is taken");
}

TEST(VolumeRules, OneOfSeveralValuesIsChosen) {
    std::vector<double> second = values, mixed;
    std::reverse(second.begin(), second.end());
    for (std::size_t v = 0; v < values.size(); ++v) mixed.insert(mixed.end(), {values[v], second[v]});
    const std::string both = shorts + bytes_of_values<std::int16_t>(second),
                      alternating = bytes_of_values<std::int16_t>(mixed);
    // The other axis lies between those of space.
    std::string between;
    const std::size_t half = shorts.size() / 2;
    for (const std::size_t part : {0, 2, 1, 3}) between += both.substr(part * half, half);
    Described grid;
    grid.sizes.push_back(2);
    grid.spacing.push_back(7);
    const std::string nrrd_of_four = "type: short\ndimension: 4\nencoding: raw\nendian: little\n";
    for (const File& file :
         {nifti_described(grid, both), nrrd_described(grid, both), metaimage_described(grid, both),
          metaimage(metaimage_fields("MET_SHORT", "ElementNumberOfChannels = 2\n"), alternating),
          nrrd(nrrd_of_four + "sizes: 2 2 3 2\nkinds: list domain domain domain\n", alternating),
          nrrd(nrrd_of_four + "sizes: 2 3 2 2\nkinds: domain domain time domain\n", between)}) {
        EXPECT_THAT(
            refusal([&] { (void)read(file); }),
            EndsWith("expected one value per voxel; --frame or \"frame\" of a scene's dataset chooses "
                     "one, from 0 to 1"));
        EXPECT_EQ(refused_of(file, {.frame = 2}), "frame: 2");
        const Volume first = read(file, {.frame = 0}), last = read(file, {.frame = 1});
        EXPECT_EQ(first.dims, glm::ivec3(2, 3, 2));
        EXPECT_EQ(values_of(first), values);
        EXPECT_EQ(values_of(last), second);
        EXPECT_EQ(last.facts.frame, 1);
        EXPECT_EQ(last.facts.frames, 2);
        const std::string cut = file.bytes.substr(0, file.bytes.size() - 1);
        EXPECT_NE(refused_of({file.format, cut}, {.frame = 0}), "accepted");
    }
    EXPECT_EQ(refused_of(nrrd_described({}, shorts), {.frame = 1}), "frame: 1");
    const Described two_times_two{.sizes = {2, 3, 2, 2, 2}, .spacing = {1, 1, 1, 1, 1}};
    EXPECT_EQ(refused_of(nifti_described(two_times_two, both)),
              "dim: 2 values along dim[4], which is time, and 2 along dim[5], values of a voxel,");
}

TEST(VolumeRules, AFileOfOneFrameIsAVolume) {
    Described grid;
    grid.sizes.push_back(1);
    grid.spacing.push_back(std::numeric_limits<double>::quiet_NaN());
    for (const Format format : all_formats) {
        const Volume volume = read(file_of(format, grid));
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
    EXPECT_EQ(refused_of(nifti(header, shorts)), "dim: 2 along dim[4], which is time,");
    const Volume frame = read(nifti(header, shorts), {.frame = 0});
    EXPECT_EQ(frame.dims, glm::ivec3(1, 2, 3));
    EXPECT_EQ(frame.spacing, glm::dvec3(3, 0.5, 1));
    EXPECT_THAT(all_notes(frame), HasSubstr("the grid has 1 voxel along x"));
    for (const File& file :
         {nrrd("type: short\ndimension: 5\nsizes: 1 2 3 2 1\nencoding: raw\nendian: little\n"
               "spacings: NaN 0.5 1 2 NaN\n",
               shorts),
          metaimage("NDims = 4\nDimSize = 1 2 3 2\nElementSpacing = 9 0.5 1 2\n"
                    "ElementType = MET_SHORT\n",
                    shorts)}) {
        const Volume volume = read(file);
        EXPECT_EQ(volume.dims, glm::ivec3(2, 3, 2));
        EXPECT_EQ(volume.spacing, glm::dvec3(0.5, 1, 2));
        EXPECT_EQ(values_of(volume), values);
        EXPECT_EQ(all_notes(volume), "axis 1 has size 1 and is left out: x is axis 2");
    }
}

TEST(VolumeRules, LabelsThatAreStoredScaledAreWholeNumbers) {
    Described grid;
    grid.slope = 2 * double(1.0F / 13107.0F);
    std::vector<double> stored;
    for (const double value : {0, 1, 2, 5, 0, 0, 2, 1, 0, 0, 0, 5}) stored.push_back(13107 * value / 2);
    const std::string data = bytes_of_values<std::int16_t>(stored);
    for (const Format format : {Format::nifti, Format::metaimage}) {
        const Volume volume = read(file_of(format, grid, data));
        EXPECT_NE(volume.slope * 6553 + volume.intercept, 1);
        const LabelledGrid labelled = with_labels(volume, Words{"1", "2", "5"});
        EXPECT_EQ(labelled.counts, (Counts{{"1", 2}, {"2", 2}, {"5", 2}}));
        EXPECT_EQ(names(with_labels(volume, std::nullopt)), (Words{"1", "2", "5"}));
        ASSERT_EQ(labelled.notes.size(), 1u);
        EXPECT_THAT(labelled.notes[0], StartsWith("values within "));
    }
    const auto stored_as = [&](double slope, std::vector<double> numbers) {
        grid.slope = slope;
        numbers.resize(12);
        return read(nifti_described(grid, bytes_of_values<std::int16_t>(numbers)));
    };
    // Half a step of a quarter would reach 0.75, but that is not 1.
    const Volume coarse = stored_as(0.25, {3, 4});
    EXPECT_EQ(with_labels(coarse, Words{"1"}).counts, (Counts{{"1", 1}}));
    EXPECT_THROW(with_labels(coarse, std::nullopt), BadInput);
    // A value that was stored for 1 does not exceed 1. The slope is rounded to a float; 49 of it exceed 1.
    const Volume threshold = stored_as(double(1.0F / 49.0F), {49, 98, 50});
    EXPECT_NE(threshold.slope * 49, 1);
    EXPECT_EQ(above_threshold(threshold, 1).grid.label,
              (std::vector<std::uint8_t>{0, 1, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0}));
    EXPECT_EQ(above_threshold(threshold, 2 - 1.0 / 49).grid.label[1], 1);
    grid.slope = 2;
    grid.intercept = -1;
    const Volume meta = read(metaimage_described(grid, shorts));
    EXPECT_EQ(meta.slope, 2);
    EXPECT_EQ(meta.intercept, -1);
}

TEST(VolumeRules, NanIsBackground) {
    std::vector<double> with_nan = values;
    with_nan[0] = with_nan[5] = std::numeric_limits<double>::quiet_NaN();
    const Volume volume = read(nrrd(nrrd_fields("double"), bytes_of_values<double>(with_nan)));
    EXPECT_EQ(names(with_labels(volume, std::nullopt)), (Words{"1", "2", "3", "5", "7", "100"}));
    EXPECT_EQ(with_labels(volume, std::nullopt).grid.label[0], 0);
}

TEST(VolumeRules, BytesBehindCompressedDataAreIgnoredAndSaid) {
    for (const File& file : short_files()) {
        EXPECT_THAT(all_notes(read(file)), Not(HasSubstr("ignored")));
        for (const std::string& behind :
             {std::string("\n"), std::string(512, '\0'), std::string(200000, '\0'), std::string("\x1f")}) {
            const File longer{file.format, file.bytes + behind};
            if (refused_of(longer) != "accepted") {
                EXPECT_EQ(file.bytes.substr(file.bytes.size() - shorts.size()), shorts)
                    << "only if it is plain";
                continue;
            }
            EXPECT_EQ(values_of(read(longer)), values);
            EXPECT_THAT(all_notes(read(longer)),
                        HasSubstr(fmt::format("{} byte{} behind the compressed data ignored", behind.size(),
                                              behind.size() == 1 ? "" : "s")));
        }
    }
}

TEST(VolumeRules, TheNamedFileIsRead) {
    const nifti_1_header header = nifti_header({2, 3, 2}, 4);
    const std::string pair = nifti_pair_header(header), single = nifti_file(header, shorts);
    std::vector<double> other = values;
    std::reverse(other.begin(), other.end());
    const std::string others = gzipped(bytes_of_values<std::int16_t>(other));
    const TemporaryFolder folder;
    const auto read_name = [&](const std::string& name) {
        return values_of(read_volume(folder.path() / name, large));
    };
    folder.write("a.hdr", pair);
    folder.write("a.img", shorts);
    folder.write("a.hdr.gz", gzipped(pair));
    folder.write("a.img.gz", others);
    for (const std::string name : {"a.hdr", "a.img"}) EXPECT_EQ(read_name(name), values);
    for (const std::string name : {"a.hdr.gz", "a.img.gz"}) EXPECT_EQ(read_name(name), other);
    // A compressed and a plain file belong together if nothing else does.
    folder.write("b.hdr", pair);
    folder.write("b.img.gz", others);
    for (const std::string name : {"b.hdr", "b.img.gz"}) EXPECT_EQ(read_name(name), other);
    // Now b.hdr belongs to b.img: the rest of the other pair does not take it.
    folder.write("b.img", shorts);
    EXPECT_EQ(read_name("b.hdr"), values);
    EXPECT_EQ(refused_file(folder.path() / "b.img.gz"), "an image without its header");
    // A header that contains its voxels is not the header of an image.
    folder.write("c.hdr", single);
    folder.write("c.img", shorts);
    EXPECT_EQ(read_name("c.hdr"), values);
    EXPECT_THAT(refused_file(folder.path() / "c.img"), StartsWith("magic: "));
    // Capitals make no difference.
    folder.write("D.HDR", pair);
    folder.write("D.IMG", shorts);
    folder.write("E.NII.GZ", gzipped(single));
    folder.write("F.Nrrd", nrrd_file(nrrd_fields("short"), shorts));
    for (const std::string name : {"D.IMG", "D.HDR", "E.NII.GZ", "F.Nrrd"})
        EXPECT_EQ(read_name(name), values);
    // A single file has the magic of a pair.
    folder.write("g.nii", pair + shorts);
    EXPECT_EQ(refused_file(folder.path() / "g.nii"), "magic: ni1");
}

TEST(VolumeRules, NiftiFieldsThatAreZero) {
    nifti_1_header header = nifti_header({2, 3, 2}, 4);
    header.dim[0] = 4;
    header.dim[4] = 0;
    EXPECT_EQ(values_of(read(nifti(header, shorts))), values);
    EXPECT_EQ(all_notes(read(nifti(header, shorts))), "dim[4] is 0 and is taken for 1");
    header = nifti_header({2, 3, 2}, 4);
    header.vox_offset = 0;
    File file = nifti(header, shorts);
    for (const File& same : {file, packed(file)}) {
        EXPECT_EQ(values_of(read(same)), values);
        EXPECT_EQ(all_notes(read(same)),
                  "vox_offset is 0: voxels are taken to begin right behind the header, at 352");
    }
    file.bytes[348] = 1;  // extensions of unknown length follow
    EXPECT_THAT(refused_of(file), StartsWith("vox_offset: 0"));
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
    const Volume volume = read({Format::nrrd, segmentation(scar)});
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
        EXPECT_EQ(one.counts, (Counts{{"valve: left", 2}}));
        EXPECT_TRUE(one.notes.empty());
    }
    const LabelledGrid turned = with_labels(volume, Words{"scar", "wall"});
    EXPECT_EQ(names(turned), (Words{"scar", "wall"}));
    EXPECT_EQ(turned.grid.label, (std::vector<std::uint8_t>{2, 2, 1, 0, 1, 0}));
    EXPECT_EQ(
        turned.notes,
        Words{
            "1 voxel is in several segments: each is part of the one that comes last in the list of labels"});

    // Two segments have the value 1.
    for (const std::string word : {"aorta", "1"})
        EXPECT_EQ(refused([&] { with_labels(volume, Words{word}); }), "labels: " + word);
    const Words twice = {"wall", "Segment_1"};
    EXPECT_EQ(refused([&] { with_labels(volume, twice); }), "labels: Segment_1");
    EXPECT_EQ(refused([&] { above_threshold(volume, 0); }), "threshold: 0");
    EXPECT_EQ(refused_of({Format::nrrd, segmentation(scar)}, {.frame = 0}), "frame: 0");
    EXPECT_EQ(refused_of({Format::nrrd, segmentation(scar + "Segment3_Name:=far\nSegment3_Layer:=2\n")}),
              "Layer of segment far: 2");
    EXPECT_EQ(refused_of({Format::nrrd, segmentation("Segment2_Name:=far\nSegment2_Layer:=one\n")}),
              "Segment2_Layer: one");
    EXPECT_EQ(refused([&] { with_labels(read(short_files()[0]), Words{"wall"}); }), "labels: wall");
}

TEST(Segments, OfOneLayer) {
    const std::string file =
        segmentation("Segment2_ID:=Segment_3\nSegment2_LabelValue:=7\nSegment2_Layer:=0\n", false);
    const Volume volume = read({Format::nrrd, file});
    const LabelledGrid all = with_labels(volume, std::nullopt);
    EXPECT_EQ(all.grid.label, (std::vector<std::uint8_t>{1, 1, 2, 2, 0, 0}));
    EXPECT_EQ(all.counts, (Counts{{"wall", 2}, {"valve: left", 2}, {"Segment_3", 0}}));
    EXPECT_EQ(all.notes, (Words{"segment Segment_3 has no voxel",
                                "1 voxel has a value that no segment has, and is left out"}));
    EXPECT_THAT(refusal([&] { with_labels(volume, Words{"Segment_3"}); }), EndsWith(": wall, valve: left"));
    EXPECT_EQ(above_threshold(volume, 2).grid.label, (std::vector<std::uint8_t>{0, 0, 0, 0, 0, 1}));
}

// Files as Slicer wrote them before segments could share a layer.
TEST(Segments, WithoutLayersHaveOneEach) {
    const Volume volume =
        read(nrrd("type: uchar\ndimension: 4\nsizes: 2 2 3 1\nkinds: list domain domain domain\n"
                  "encoding: raw\nSegment0_ID:=a\nSegment1_ID:=b\n",
                  std::string{1, 0, 1, 0, 0, 1, 0, 1, 0, 0, 0, 0}));
    EXPECT_EQ(with_labels(volume, std::nullopt).grid.label, (std::vector<std::uint8_t>{1, 1, 2, 2, 0, 0}));
}

}  // namespace
}  // namespace voxspring::testing
