// Tables for people that fit the width of the terminal.
#pragma once

#include <cstddef>
#include <optional>
#include <ostream>
#include <string>
#include <vector>

namespace voxspring {

/// How many characters wide a table may be; 0: any width.
using TableWidth = std::size_t;

/// The width of the terminal behind `descriptor`, at least 80; 0 for a pipe or a file.
TableWidth terminal_width(int descriptor);

struct Column {
    std::string heading;
    /// If there is no room, columns are dropped in this order, the highest first; 0: never dropped.
    int expendable = 0;
    /// Names are aligned to the left, and shortened in the middle if there is no room. Figures are aligned to
    /// the right.
    bool is_name = false;
};

/// Prints rows, each with one cell per column, and a line that names the columns for which there was no room.
/// If there is too little room, headings take several lines first. A line is longer than `width` only if two
/// names could not be told apart otherwise.
void print_columns(const std::vector<Column>& columns, const std::vector<std::vector<std::string>>& rows,
                   TableWidth width, std::ostream& out);

/// `text` in at most `length` characters. "..." stands after the first two thirds of what is kept, since the
/// names of strategies differ late.
std::string shortened(const std::string& text, std::size_t length);

/// "1.2e-05" and "12%", or "-" if the value is not known.
std::string error_cell(const std::optional<double>& error);
std::string percent_cell(const std::optional<double>& fraction);

}  // namespace voxspring
