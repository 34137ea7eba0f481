// Tables for people, as wide as there is room for.
#pragma once

#include <cstddef>
#include <optional>
#include <ostream>
#include <string>
#include <vector>

namespace voxspring {

/// Columns that a table may take; 0: as many as it likes.
using TableWidth = std::size_t;

/// Of the terminal that a stream's descriptor is, 80 at least; 0 for a pipe or a file.
TableWidth terminal_width(int descriptor);

struct Column {
    std::string heading;
    /// Where there is no room columns go by it, the highest first; 0: it stays.
    int expendable = 0;
    /// A name, to the left and shortened in its middle where there is no room, or a figure, to the right.
    bool is_name = false;
};

/// Prints rows of as many cells as there are columns, and a line that names the columns for which there was
/// no room. Where there is too little, headings first take several lines. A line is longer than `width` where
/// two names would be one otherwise.
void print_columns(const std::vector<Column>& columns, const std::vector<std::vector<std::string>>& rows,
                   TableWidth width, std::ostream& out);

/// `text` in at most `length` characters: "..." is behind two thirds of what is left, since the names of
/// strategies differ late.
std::string shortened(const std::string& text, std::size_t length);

/// "1.2e-05" and "12%", or "-" for what is not known.
std::string error_cell(const std::optional<double>& error);
std::string percent_cell(const std::optional<double>& fraction);

}  // namespace voxspring
