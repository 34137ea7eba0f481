// Tables for people that fit the width of the terminal.
#pragma once

#include <cstddef>
#include <optional>
#include <ostream>
#include <string>
#include <vector>

namespace voxspring {

/// The largest width of a table in characters; 0: any width.
using TableWidth = std::size_t;

/// The width of the terminal behind `descriptor`, at least 80; 0 for a pipe or a file.
TableWidth terminal_width(int descriptor);

struct Column {
    std::string heading;
    /// Columns with the highest number are dropped first if the table is too wide, columns with 0 never.
    int expendable = 0;
    /// Whether the cells are names: aligned to the left, and shortened in the middle if the table is too
    /// wide. Other cells are figures, aligned to the right.
    bool is_name = false;
};

/// Prints rows, each with one cell per column, and a last line that names the columns that were dropped. If
/// the table is wider than `width`, first headings are broken into several lines, then columns are dropped
/// and names shortened. The table is still wider than `width` if the columns that stay need more, or if
/// shorter names could not be told apart.
void print_columns(const std::vector<Column>& columns, const std::vector<std::vector<std::string>>& rows,
                   TableWidth width, std::ostream& out);

/// `text` in at most `length` characters. What is left out is replaced by "...", if `length` is above 3. Two
/// thirds of the characters that are kept stand before it and one third behind, since names of backends often
/// differ near their end.
std::string shortened(const std::string& text, std::size_t length);

/// error_cell() returns text like "1.2e-05", percent_cell() like "12%"; both return "-" for no value.
std::string error_cell(const std::optional<double>& error);
std::string percent_cell(const std::optional<double>& fraction);

}  // namespace voxspring
