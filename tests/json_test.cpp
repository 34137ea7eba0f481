// The strict JSON reader: what it accepts, what it refuses, and its messages.
#include "harness/base/json.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <zlib.h>

#include <fstream>
#include <nlohmann/json.hpp>
#include <string>

#include "harness/base/bad_input.h"
#include "tests/volume_files.h"

namespace voxspring::testing {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::StartsWith;

std::string parse_refusal(const std::string& text) {
    return refusal([&] { parse_json(text, "f.json"); });
}

JsonValue value(const std::string& text) {
    return parse_json("{\"a\": {\"b\": " + text + "}}", "f.json").require("a").object().require("b");
}

TEST(Json, SyntaxErrorsNameLineAndColumn) {
    EXPECT_EQ(parse_refusal("{\n  \"a\": 1,\n  \"b\" 2\n}"),
              "f.json: line 3, column 7: unexpected number literal is not accepted; expected ':'");
    EXPECT_THAT(parse_refusal("{\"a\": nul}"), StartsWith("f.json: line 1, column 10: invalid literal"));
    for (const std::string text :
         {"", " ", "{", "{\"a\": ", "{\"a\": 1,}", "{\"a\": 1} {}", "{\"a\": NaN}", "{\"a\": Infinity}",
          "{'a': 1}", "{\"a\": 01}", "{\"a\": +1}", "{\"a\": .5}", "{\"a\": \"\x01\"}", "{\"a\": \"\xff\"}",
          "\xff\xfe", "{\"a\": 1} // comment", "{\"a\": \"\\ud800\"}"}) {
        EXPECT_THAT(parse_refusal(text), StartsWith("f.json: line 1, column ")) << text;
    }
}

TEST(Json, BytesThatAreNotUtf8AreReplacedWhereItIsWritten) {
    const std::string latin = "b\xf6x", replaced = "b\xef\xbf\xbdx", utf8 = "b\xc3\xb6x";
    EXPECT_EQ(json_text({{latin, {latin, utf8}}}),
              "{\"" + replaced + "\":[\"" + replaced + "\",\"" + utf8 + "\"]}");
    EXPECT_EQ(json_text({{"a", 1}}, 2), "{\n  \"a\": 1\n}");
    EXPECT_EQ(utf8_text(latin), replaced);
    EXPECT_EQ(utf8_text(utf8), utf8);
}

TEST(Json, AByteOrderMarkIsReadOver) {
    EXPECT_EQ(parse_json("\xEF\xBB\xBF{\"a\": 1}\r\n", "f").find("a")->number(), 1);
}

TEST(Json, OnlyAnObjectIsADocument) {
    EXPECT_EQ(parse_refusal("[1]"), "f.json: [1] is not accepted; expected an object");
    EXPECT_EQ(parse_refusal("null"), "f.json: null is not accepted; expected an object");
}

TEST(Json, AKeyGivenTwiceIsRefused) {
    for (const std::string text : {R"({"a": [0, {"b": 1, "b": 2}]})", R"({"b": 1, "a": {"b": 1}, "b": 1})"})
        EXPECT_EQ(parse_refusal(text), "f.json: b: a second value is not accepted; expected each key once");
    EXPECT_EQ(parse_refusal(R"({"a": {"b": 1}, "b": [{"b": 1}, {"b": 1}]})"), "accepted");
}

TEST(Json, NumbersThatOverflowAreRefused) {
    for (const std::string& number : {std::string("1e999"), "-" + std::string(400, '9')}) {
        EXPECT_THAT(parse_refusal("{\"a\": " + number + "}"),
                    AllOf(HasSubstr(number.substr(0, 20)), HasSubstr("a 64-bit float can hold")));
    }
    EXPECT_EQ(value("123456789012345678901234567890").number(), 123456789012345678901234567890.0);
}

TEST(Json, DeepNestingIsRefusedHoweverDeep) {
    for (const int depth : {32, 40, 1000000})
        EXPECT_THAT(parse_refusal("{\"a\": " + std::string(std::size_t(depth), '[')),
                    HasSubstr("deeper nesting is not accepted; expected at most 32"));
    EXPECT_EQ(parse_refusal("{\"a\": " + std::string(31, '[') + std::string(31, ']') + "}"), "accepted");
}

/// `text` is refused by `use`, whose message names its place, itself and what is `accepted`.
template <class Use>
void expect_refused(const std::string& text, const Use& use, const std::string& accepted) {
    EXPECT_EQ(refusal([&] { use(value(text)); }),
              "f.json: a.b: " + value(text).text() + " is not accepted; expected " + accepted);
}

TEST(Json, Numbers) {
    EXPECT_EQ(value("-2.5").number(), -2.5);
    EXPECT_EQ(value("3").number(0, 3), 3);
    for (const char* text : {"3.01", "true", "\"1\""})
        expect_refused(
            text, [](const JsonValue& v) { v.number(0, 3); }, "a number from 0 to 3");
}

TEST(Json, WholeNumbers) {
    constexpr std::int64_t largest = (std::int64_t{1} << 53) - 1;
    EXPECT_EQ(value("7").integer(0, 7), 7);
    EXPECT_EQ(value("7.0").integer(0, 7), 7);
    EXPECT_EQ(value("-9007199254740991").integer(-largest, 0), -largest);
    // Read as a double the first number equals the second.
    for (const std::string text : {"9007199254740993", "9007199254740992"})
        EXPECT_NE(refusal([&] { value(text).integer(0, largest); }), "accepted");
    for (const char* text : {"8", "-1", "6.5", "18446744073709551615", "1e300", "-1e300", "null", "[]"})
        expect_refused(
            text, [](const JsonValue& v) { v.integer(0, 7); }, "a whole number from 0 to 7");
}

TEST(Json, OtherTypes) {
    EXPECT_TRUE(value("true").boolean());
    EXPECT_EQ(value("\"x\"").string(), "x");
    EXPECT_EQ(value("\"x\"").one_of({"y", "x"}), "x");
    EXPECT_EQ(value("[1, 2, 3]").vec3(3), glm::dvec3(1, 2, 3));
    EXPECT_EQ(value("[1, [2]]").array()[1].array(1, 1)[0].path(), "a.b[1][0]");
    expect_refused(
        "0", [](const JsonValue& v) { v.boolean(); }, "true or false");
    expect_refused(
        "\"\"", [](const JsonValue& v) { v.string(); }, "a string that is not empty");
    expect_refused(
        "\"z\"",
        [](const JsonValue& v) {
            v.one_of({"y", "x"});
        },
        "one of y, x");
    EXPECT_EQ(refusal([] { value("[1, 2, 4]").vec3(3); }),
              "f.json: a.b[2]: 4 is not accepted; expected a number from -3 to 3");
    expect_refused(
        "[1, 2]", [](const JsonValue& v) { v.vec3(3); }, "an array of 3 numbers");
    expect_refused(
        "[1]", [](const JsonValue& v) { v.array(2); }, "an array of 2 elements or more");
    expect_refused(
        "1", [](const JsonValue& v) { v.array(); }, "an array");
    expect_refused(
        "1", [](const JsonValue& v) { v.object(); }, "an object");
}

TEST(Json, UnknownAndMissingKeysAreRefused) {
    JsonObject object = parse_json(R"({"a": 1, "c": {"x": 2}})", "f.json");
    EXPECT_TRUE(object.find("a").has_value());
    EXPECT_FALSE(object.find("b").has_value());
    EXPECT_EQ(refusal([&] { object.finish(); }),
              "f.json: c: {\"x\":2} is not accepted; expected the keys: a, b");
    EXPECT_EQ(refusal([&] { object.require("d", "a whole number"); }),
              "f.json: d is missing; expected a whole number");
    JsonObject inner = object.require("c").object();
    EXPECT_EQ(refusal([&] { inner.finish(); }), "f.json: c.x: 2 is not accepted; expected the keys of c: ");
    EXPECT_EQ(inner.items().at(0).first, "x");
    EXPECT_EQ(refusal([&] { inner.finish(); }), "accepted");
}

TEST(Json, MessagesAreOnePrintableLine) {
    const std::string message = refusal(
        [] { parse_json(R"({"a\nb": ")" + std::string(500, 'x') + "\\u0007\"}", "f\n.json").finish(); });
    EXPECT_EQ(message.rfind("f\\x0a.json: a\\x0ab: \"xxx", 0), 0u) << message;
    EXPECT_EQ(message.find('\n'), std::string::npos);
    EXPECT_LT(message.size(), 200u);
    EXPECT_NE(message.find("xxx... is not accepted"), std::string::npos) << message;
    // Truncation never splits a character.
    EXPECT_NE(std::string(BadInput("f", "k", std::string(79, 'x') + "\xc3\xa9\xc3\xa9", "e").what())
                  .find("x... is"),
              std::string::npos);
}

TEST(Json, FilesAreReadWhole) {
    const TemporaryFolder folder;
    EXPECT_EQ(read_json(folder.write("good.json", "{\"a\": 5}")).require("a").number(), 5);
    EXPECT_EQ(
        refusal([&] { read_json(folder.path() / "absent.json"); }),
        (folder.path() / "absent.json").string() + ": a missing file is not accepted; expected a JSON file");
    EXPECT_EQ(refusal([&] { read_json(folder.path()); }),
              folder.path().string() + ": a folder is not accepted; expected a JSON file");
    const std::string loop = (folder.path() / "loop.json").string();
    std::filesystem::create_symlink(loop, loop);
    EXPECT_EQ(refusal([&] { read_json(loop); }),
              loop +
                  ": an unreadable file (Too many levels of symbolic links) is not accepted; expected a "
                  "JSON file");
    const std::string large = folder.write("large.json", "{}");
    std::filesystem::resize_file(large, (std::uintmax_t{16} << 20) + 1);
    EXPECT_EQ(refusal([&] { read_json(large); }),
              large + ": 16777217 bytes is not accepted; expected a file of at most 16777216 bytes");
}

TEST(Json, CompressedFilesAreUnpacked) {
    const TemporaryFolder folder;
    const auto write = [&](const std::string& name, const std::string& text) {
        const auto path = folder.path() / name;
        const gzFile file = gzopen(path.c_str(), "wb");
        EXPECT_EQ(gzwrite(file, text.data(), unsigned(text.size())), int(text.size()));
        EXPECT_EQ(gzclose(file), Z_OK);
        return path;
    };
    const std::string number = std::string(200'000, ' ') + "{\"a\": 5}";
    const auto good = write("good.json.gz", number);
    EXPECT_EQ(read_json(good).require("a").number(), 5);
    // A truncated stream, and one with a flipped bit that its checksum detects.
    const auto size = std::filesystem::file_size(good);
    std::filesystem::resize_file(good, size - 9);
    EXPECT_THAT(refusal([&] { read_json(good); }), HasSubstr("good.json.gz: a damaged gzip file"));
    const auto damaged = write("damaged.json.gz", number);
    {
        std::fstream file(damaged, std::ios::binary | std::ios::in | std::ios::out);
        file.seekp(std::streamoff(size) - 8).put('x');
    }
    EXPECT_THAT(refusal([&] { read_json(damaged); }), HasSubstr("damaged.json.gz: a damaged gzip file"));
    EXPECT_THAT(refusal([&] { read_json(write("bomb.json.gz", std::string((16 << 20) + 1, ' '))); }),
                HasSubstr("more bytes when unpacked is not accepted; expected a file of at most 16777216"));
}

}  // namespace
}  // namespace voxspring::testing
