#include "harness/results/table.h"

#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <map>
#include <numeric>
#include <sstream>

#include "harness/base/text.h"

namespace voxspring {
namespace {

constexpr std::size_t min_name = 12;  ///< least number of characters of a shortened name
constexpr std::size_t gap = 2;        ///< number of blanks between columns

/// The layout of a table.
struct Laid {
    std::vector<std::size_t> columns = {};  ///< indices of the columns that are not dropped
    std::vector<std::size_t> widths = {};   ///< widths of all columns
    std::size_t total() const {
        std::size_t sum = columns.empty() ? 0 : gap * (columns.size() - 1);
        for (const std::size_t c : columns) sum += widths[c];
        return sum;
    }
};

/// Drops the column with the highest Column::expendable. Returns false if none may be dropped.
bool drop_one(Laid& laid, const std::vector<Column>& columns) {
    const auto worst = std::max_element(laid.columns.begin(), laid.columns.end(), [&](auto a, auto b) {
        return columns[a].expendable < columns[b].expendable;
    });
    if (worst == laid.columns.end() || columns[*worst].expendable == 0) return false;
    laid.columns.erase(worst);
    return true;
}

/// Narrows the columns of names, the widest first, until the table fits or all have min_name characters.
void narrow_names(Laid& laid, const std::vector<Column>& columns, std::size_t width) {
    while (laid.total() > width) {
        std::size_t* widest = nullptr;
        for (const std::size_t c : laid.columns) {
            if (columns[c].is_name && laid.widths[c] > min_name &&
                (widest == nullptr || laid.widths[c] > *widest))
                widest = &laid.widths[c];
        }
        if (widest == nullptr) return;
        --*widest;
    }
}

using Rows = std::vector<std::vector<std::string>>;

/// Wraps `text` into lines of at most `width` characters. A word that is longer has a line to itself.
std::vector<std::string> wrapped(const std::string& text, std::size_t width) {
    std::vector<std::string> lines;
    std::istringstream words(text);
    for (std::string word; words >> word;) {
        if (!lines.empty() && character_count(lines.back()) + 1 + character_count(word) <= width) {
            lines.back() += " " + word;
        } else {
            lines.push_back(word);
        }
    }
    return lines;
}

/// The width that column `c` needs for its cells and its heading. With `wraps` the heading has one word per
/// line, otherwise it is one line.
std::size_t width_of(const Column& column, const Rows& rows, std::size_t c, bool wraps) {
    std::size_t width = 0;
    for (const std::string& line : wrapped(column.heading, wraps ? 1 : column.heading.size()))
        width = std::max(width, character_count(line));
    for (const auto& row : rows) width = std::max(width, character_count(row[c]));
    return width;
}

/// Whether different names in column `c` are still different when they are shortened to `width`.
bool tells_apart(const Rows& rows, std::size_t c, std::size_t width) {
    std::map<std::string, std::string> whole;
    return std::all_of(rows.begin(), rows.end(), [&](const auto& row) {
        return whole.emplace(shortened(row[c], width), row[c]).first->second == row[c];
    });
}

/// Whether the columns fit into `width` with readable names: the table would fit with 2 * min_name characters
/// per name, and narrow_names() makes no two names alike.
bool serves(Laid laid, const std::vector<Column>& columns, const Rows& rows, std::size_t width) {
    Laid least = laid;
    for (const std::size_t c : least.columns) {
        if (columns[c].is_name) least.widths[c] = std::min(least.widths[c], 2 * min_name);
    }
    if (least.total() > width) return false;
    narrow_names(laid, columns, width);
    return std::all_of(laid.columns.begin(), laid.columns.end(), [&](std::size_t c) {
        return !columns[c].is_name || tells_apart(rows, c, laid.widths[c]);
    });
}

/// Drops expendable columns until the others fit with readable names (serves()), then shortens names. Names
/// that would become alike stay longer, even if the table is then wider than `width`.
void fit_into(Laid& laid, const std::vector<Column>& columns, const Rows& rows, std::size_t width) {
    while (!serves(laid, columns, rows, width) && drop_one(laid, columns)) {
    }
    narrow_names(laid, columns, width);
    for (const std::size_t c : laid.columns) {
        while (columns[c].is_name && !tells_apart(rows, c, laid.widths[c])) ++laid.widths[c];
    }
}

}  // namespace

TableWidth terminal_width(int descriptor) {
    if (isatty(descriptor) == 0) return 0;
    constexpr TableWidth min_width = 80;
    winsize size{};
    if (ioctl(descriptor, TIOCGWINSZ, &size) != 0) return min_width;
    return std::max<TableWidth>(size.ws_col, min_width);
}

std::string shortened(const std::string& text, std::size_t length) {
    const std::string dots = "...";
    const std::size_t whole = character_count(text);
    if (whole <= length || length <= dots.size()) return text.substr(0, bytes_of_characters(text, length));
    const std::size_t kept = length - dots.size(), back = kept / 3;
    return text.substr(0, bytes_of_characters(text, kept - back)) + dots +
           text.substr(bytes_of_characters(text, whole - back));
}

void print_columns(const std::vector<Column>& columns, const std::vector<std::vector<std::string>>& rows,
                   TableWidth width, std::ostream& out) {
    Laid laid;
    laid.columns.resize(columns.size());
    std::iota(laid.columns.begin(), laid.columns.end(), std::size_t(0));
    const auto lay = [&](bool wraps) {
        laid.widths.clear();
        for (std::size_t c = 0; c < columns.size(); ++c)
            laid.widths.push_back(width_of(columns[c], rows, c, wraps));
    };
    lay(false);
    if (width > 0 && laid.total() > width) {
        lay(true);
        fit_into(laid, columns, rows, width);
    }
    const auto print = [&](const auto& cell_of) {
        std::string line;
        for (const std::size_t c : laid.columns) {
            const std::string cell = shortened(cell_of(c), laid.widths[c]);
            const std::string padding(laid.widths[c] - character_count(cell), ' ');
            line += (c == laid.columns.front() ? "" : std::string(gap, ' ')) +
                    (columns[c].is_name ? cell + padding : padding + cell);
        }
        out << line << "\n";
    };
    std::vector<std::vector<std::string>> headings;
    std::size_t height = 0;
    for (std::size_t c = 0; c < columns.size(); ++c) {
        headings.push_back(wrapped(columns[c].heading, laid.widths[c]));
    }
    for (const std::size_t c : laid.columns) height = std::max(height, headings[c].size());
    for (std::size_t line = 0; line < height; ++line) {
        print([&](std::size_t c) {
            const std::size_t above = height - headings[c].size();
            return line < above ? std::string() : headings[c][line - above];
        });
    }
    for (const auto& row : rows) print([&](std::size_t c) { return row[c]; });
    std::vector<std::string> left_out;
    for (std::size_t c = 0; c < columns.size(); ++c) {
        if (std::find(laid.columns.begin(), laid.columns.end(), c) == laid.columns.end())
            left_out.push_back(columns[c].heading);
    }
    if (!left_out.empty()) out << "no room for: " << joined(left_out) << "\n";
}

std::string error_cell(const std::optional<double>& error) { return error ? error_text(*error) : "-"; }

std::string percent_cell(const std::optional<double>& fraction) {
    return fraction ? percent_text(*fraction) : "-";
}

}  // namespace voxspring
