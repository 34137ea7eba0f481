// The text headers of NRRD and MetaImage files: fields by name.
#pragma once

#include <charconv>
#include <cstddef>
#include <istream>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <vector>

namespace voxspring {

/// `text` without the blanks around it.
std::string trimmed(std::string_view text);
std::string lower_case(std::string text);
std::string upper_case(std::string text);
/// What blanks part.
std::vector<std::string> words(const std::string& text);

/// The number that all of `text` is.
template <class Number>
std::optional<Number> parse_number(const std::string& text) {
    const std::string plain = trimmed(text);
    Number number{};
    const char* end = plain.data() + plain.size();
    const auto [stop, error] = std::from_chars(plain.data(), end, number);
    if (error != std::errc() || stop != end) return std::nullopt;
    return number;
}

/// Lines of a header that together have at most 1 MiB, so that a file that is none does not fill memory.
class HeaderLines {
public:
    HeaderLines(std::istream& stream, const std::string& file) : stream_(stream), file_(file) {}
    /// The next line without its end; nothing at the end of the file. Throws BadInput beyond the limit.
    std::optional<std::string> next();

private:
    std::istream& stream_;
    const std::string& file_;
    std::size_t read_ = 0;
};

/// Fields by name; capitals and blanks in names make no difference. Refusals are BadInput and name the file.
/// A field may be there twice; one that is asked for must have the same value each time.
class TextHeader {
public:
    explicit TextHeader(std::string file) : file_(std::move(file)) {}

    const std::string& file() const { return file_; }
    void add(const std::string& name, const std::string& value);
    const std::string* find(const std::string& name) const;
    const std::string& require(const std::string& name) const;
    [[noreturn]] void refuse(const std::string& name, std::string_view accepted) const;
    /// A whole number of at least `min`, 0 where there is no such field.
    std::int64_t whole_number(const std::string& name, std::int64_t min) const;

private:
    std::string file_;
    std::map<std::string, std::string> fields_;
    std::set<std::string> ambiguous_;  ///< those with two values
};

}  // namespace voxspring
