#include "harness/base/text.h"

#include <algorithm>
#include <iomanip>
#include <sstream>

namespace voxspring {

std::string percent_text(const nlohmann::json& fraction) {
    if (!fraction.is_number()) return "-";
    const double percent = 100 * fraction.get<double>();
    std::ostringstream text;
    text << std::fixed << std::setprecision(percent < 9.95 ? 1 : 0) << percent << "%";
    return text.str();
}

std::string joined(const std::vector<std::string>& words) {
    std::string text;
    for (const std::string& word : words) text += (text.empty() ? "" : ", ") + word;
    return text;
}

std::string error_text(const nlohmann::json& value) {
    if (!value.is_number()) return "-";
    std::ostringstream text;
    text << std::scientific << std::setprecision(1) << value.get<double>();
    return text.str();
}

void print_aligned(const std::vector<std::vector<std::string>>& rows, std::ostream& out, std::size_t names) {
    std::vector<std::size_t> width;
    for (const std::vector<std::string>& row : rows) {
        width.resize(std::max(width.size(), row.size()));
        for (std::size_t c = 0; c < row.size(); ++c) width[c] = std::max(width[c], row[c].size());
    }
    for (const std::vector<std::string>& row : rows) {
        std::string line;
        for (std::size_t c = 0; c < row.size(); ++c) {
            const std::string padding(width[c] - row[c].size(), ' ');
            line += (c == 0 ? "" : "  ") + (c < names ? row[c] + padding : padding + row[c]);
        }
        out << line << "\n";
    }
}

std::string si(double value, const std::string& unit) {
    static const std::pair<double, const char*> prefixes[] = {
        {1e12, "T"}, {1e9, "G"}, {1e6, "M"}, {1e3, "k"}, {1, ""}, {1e-3, "m"}, {1e-6, "u"}, {1e-9, "n"}};
    for (const auto& [scale, prefix] : prefixes) {
        if (value < 0.9995 * scale && scale > 1e-9) continue;
        std::ostringstream text;
        const double scaled = value / scale;
        text << std::fixed
             << std::setprecision(scaled < 9.995   ? 2
                                  : scaled < 99.95 ? 1
                                                   : 0)
             << scaled << " " << prefix << unit;
        return text.str();
    }
    return {};
}

}  // namespace voxspring
