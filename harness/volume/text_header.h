// Reads the text headers of NRRD and MetaImage files as fields by name.
#pragma once

#include <algorithm>
#include <charconv>
#include <cstddef>
#include <istream>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "harness/volume/claims.h"

namespace voxspring {

/// `text` without blanks at its ends.
std::string trimmed(std::string_view text);
std::string lower_case(std::string text);
std::string upper_case(std::string text);
/// The words of `text`, which white space separates.
std::vector<std::string> words(const std::string& text);

/// The format whose `ending` the file's name has, in small or capital letters; null if there is none.
template <class Format>
const Format* format_of(const std::string& name, const std::vector<Format>& formats) {
    const std::string lower = lower_case(name);
    const auto found = std::find_if(formats.begin(), formats.end(),
                                    [&](const Format& format) { return lower.ends_with(format.ending); });
    return found == formats.end() ? nullptr : &*found;
}

/// ".a, .b or .c": the endings of the formats, for a message.
template <class Format>
std::string endings_of(const std::vector<Format>& formats) {
    std::string text;
    for (const Format& format : formats)
        text += (text.empty() ? "" : &format == &formats.back() ? " or " : ", ") + format.ending;
    return text;
}

/// The number that the whole of `text` spells; nullopt if it is not a number.
template <class Number>
std::optional<Number> parse_number(const std::string& text) {
    const std::string plain = trimmed(text);
    Number number{};
    const char* end = plain.data() + plain.size();
    const auto [stop, error] = std::from_chars(plain.data(), end, number);
    if (error != std::errc() || stop != end) return std::nullopt;
    return number;
}

/// Reads the lines of a header, at most 1 MiB together, so that a file without a header does not fill the
/// memory.
class HeaderLines {
public:
    HeaderLines(std::istream& stream, const std::string& file) : stream_(stream), file_(file) {}
    /// The next line without its line end; nullopt at the end of the file. Throws BadInput beyond the limit.
    std::optional<std::string> next();

private:
    std::istream& stream_;
    const std::string& file_;
    std::size_t read_ = 0;
};

/// The numbers in `text`, between blanks; nullopt unless they are exactly `count` numbers and nothing else.
std::optional<std::vector<double>> numbers_of(const std::string& text, std::size_t count);

/// The fields of a header by name. Case and blanks in names do not matter. Members throw BadInput, which
/// names the file. A field may occur repeatedly if its values are equal; unequal ones are refused on look-up.
class TextHeader {
public:
    explicit TextHeader(std::string file) : file_(std::move(file)) {}

    const std::string& file() const { return file_; }
    void add(const std::string& name, const std::string& value);
    /// The value of the field; null if there is no such field.
    const std::string* find(const std::string& name) const;
    const std::string& require(const std::string& name) const;
    [[noreturn]] void refuse(const std::string& name, std::string_view accepted) const;
    /// The field as a whole number of at least `min`; 0 if there is no such field.
    std::int64_t whole_number(const std::string& name, std::int64_t min) const;
    /// The value that `choices` has for `word`, the text of the field. Throws BadInput if `choices` has no
    /// such word.
    template <class Value>
    Value choose(const std::string& name, const std::string& word,
                 const std::map<std::string, Value>& choices, std::string_view accepted) const {
        const auto found = choices.find(word);
        if (found == choices.end()) refuse(name, accepted);
        return found->second;
    }

    /// The axes. Their number, from 3 to `max`, is in the field `count`, and their sizes are in the field
    /// `sizes`.
    std::vector<AxisClaim> axes(const std::string& count, int max, const std::string& sizes) const;
    /// Sets the distance between voxels of each axis from the field, if there is one. Text that is no number
    /// gives NaN.
    void set_distances(const std::string& name, std::vector<AxisClaim>& axes) const;
    /// Whether the value of the field is LIST: names of data files then stand below the header.
    bool is_list(const std::string& name) const;
    /// Sets the files with the data: the one that the field names or, if it is LIST, `listed`.
    void set_files(const std::string& name, const std::vector<std::string>& listed,
                   const std::string& accepted, DataPlace& place) const;

private:
    std::string file_;
    std::map<std::string, std::string> fields_;
    std::set<std::string> ambiguous_;  ///< fields that occur with different values
};

}  // namespace voxspring
