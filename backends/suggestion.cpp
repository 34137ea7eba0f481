#include "backends/suggestion.h"

#include <algorithm>
#include <cstddef>

namespace voxspring {
namespace {

/// The least number of letters to leave out, add, change or swap with their neighbour until one word becomes
/// the other (restricted Damerau-Levenshtein distance).
std::size_t distance(const std::string& a, const std::string& b) {
    // Rows of the table for the first i - 2, i - 1 and i letters of a.
    std::vector<std::size_t> before(b.size() + 1), last(b.size() + 1), row(b.size() + 1);
    for (std::size_t j = 0; j <= b.size(); ++j) last[j] = j;
    for (std::size_t i = 1; i <= a.size(); ++i) {
        row[0] = i;
        for (std::size_t j = 1; j <= b.size(); ++j) {
            const std::size_t changed = last[j - 1] + (a[i - 1] == b[j - 1] ? 0 : 1);
            row[j] = std::min({changed, last[j] + 1, row[j - 1] + 1});
            if (i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1])
                row[j] = std::min(row[j], before[j - 2] + 1);
        }
        std::swap(before, last);
        std::swap(last, row);
    }
    return last[b.size()];
}

}  // namespace

std::string closest(const std::string& word, const std::vector<std::string>& known) {
    constexpr std::size_t longest = 100;  // a longer word is no name
    std::string found;
    std::size_t least = std::max<std::size_t>(1, word.size() / 3) + 1;
    if (word.empty() || word.size() > longest) return found;
    for (const std::string& name : known) {
        const std::size_t letters = distance(word, name);
        if (letters >= std::min(least, name.size())) continue;
        least = letters;
        found = name;
    }
    return found;
}

std::string did_you_mean(const std::string& word, const std::vector<std::string>& known) {
    const std::string name = closest(word, known);
    return name.empty() ? "" : "; did you mean " + name + "?";
}

}  // namespace voxspring
