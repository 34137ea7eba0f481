#include "harness/result.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <iomanip>
#include <map>
#include <sstream>
#include <system_error>
#include <vector>

#include "backends/cpu_backend.h"
#include "harness/bad_input.h"
#include "harness/limits.h"
#include "harness/noise.h"
#include "version.h"  // generated

namespace voxspring {
namespace {

using Row = std::vector<std::string>;

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

}  // namespace

std::string error_text(const nlohmann::json& value) {
    if (!value.is_number()) return "-";
    std::ostringstream text;
    text << std::scientific << std::setprecision(1) << value.get<double>();
    return text.str();
}

void print_aligned(const std::vector<Row>& rows, std::ostream& out, std::size_t names) {
    std::vector<std::size_t> width;
    for (const Row& row : rows) {
        width.resize(std::max(width.size(), row.size()));
        for (std::size_t c = 0; c < row.size(); ++c) width[c] = std::max(width[c], row[c].size());
    }
    for (const Row& row : rows) {
        std::string line;
        for (std::size_t c = 0; c < row.size(); ++c) {
            const std::string padding(width[c] - row[c].size(), ' ');
            line += (c == 0 ? "" : "  ") + (c < names ? row[c] + padding : padding + row[c]);
        }
        out << line << "\n";
    }
}

bool is_median(const nlohmann::json& row) {
    const bool only = row.at("run_type") == "iteration" && row.at("repetitions") == 1;
    return only || row.value("aggregate_name", "") == "median";
}

std::string contender_name(const nlohmann::json& row) {
    const std::string name = row.at("name");
    return name.substr(0, name.find("/iterations:"));
}

std::string contender(const nlohmann::json& row) {
    const std::string scene = row.at("scene");
    std::string text = contender_name(row).substr(scene.size() + 1);
    std::replace(text.begin(), text.end(), '/', ' ');
    return text;
}

void print_unmeasured(const nlohmann::json& result, std::ostream& out) {
    for (const char* list : {"skipped", "failed"}) {
        // A reason once, with all that it holds for.
        std::vector<std::string> reasons;
        std::map<std::string, std::vector<std::string>> contenders, on;
        const auto add = [](std::vector<std::string>& to, const std::string& text) {
            if (std::find(to.begin(), to.end(), text) == to.end()) to.push_back(text);
        };
        for (const auto& row : result.at(list)) {
            const std::string reason = row.at("reason");
            add(reasons, reason);
            add(contenders[reason], contender(row));
            add(on[reason], row.at("scene"));
        }
        for (const std::string& reason : reasons) {
            out << list << ": " << reason << "\n    " << joined(contenders[reason]) << "\n    on "
                << joined(on[reason]) << "\n";
        }
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

bool write_all(int file, std::string_view text) {
    while (!text.empty()) {
        const ssize_t n = write(file, text.data(), text.size());
        if (n < 0 && errno == EINTR) continue;
        if (n < 0) return false;
        text.remove_prefix(std::size_t(n));
    }
    return true;
}

void sync_folder_of(const std::filesystem::path& file) {
    const std::filesystem::path folder = file.has_parent_path() ? file.parent_path() : ".";
    const int descriptor = open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    if (descriptor < 0) return;
    fsync(descriptor);
    close(descriptor);
}

void write_atomically(const std::filesystem::path& path, const std::string& text) {
    const auto fail = [&](const char* what) {
        throw std::system_error(errno, std::generic_category(), what + (" " + path.string()));
    };
    std::string temporary = path.string() + ".XXXXXX";
    const int file = mkstemp(temporary.data());
    if (file < 0) fail("cannot write");
    const bool written = write_all(file, text);
    // mkstemp makes the file private; a result is as readable as any file its user writes.
    const mode_t mask = umask(0);
    umask(mask);
    const bool done = written && fchmod(file, 0666 & ~mask) == 0 && fsync(file) == 0;
    const int error = errno;
    close(file);
    if (!done || std::rename(temporary.c_str(), path.c_str()) != 0) {
        if (!done) errno = error;
        const int reason = errno;
        unlink(temporary.c_str());
        errno = reason;
        fail("cannot write");
    }
    sync_folder_of(path);
}

void check_writable(const std::filesystem::path& path, const std::string& option,
                    const std::string& extension) {
    if (path.extension() != extension) {
        throw BadInput("command line", option, path.string(), "a path that ends in " + extension);
    }
    std::string probe = path.string() + ".XXXXXX";
    const int file = mkstemp(probe.data());
    if (file < 0) {
        throw BadInput(
            "command line", option, path.string(),
            std::string("a path in a folder that takes a new file (") + std::strerror(errno) + ")");
    }
    close(file);
    unlink(probe.c_str());
}

nlohmann::json build_context() {
    const auto or_null = [](const std::string& text) {
        return text.empty() ? nlohmann::json(nullptr) : nlohmann::json(text);
    };
    return {{"commit", version_commit},
            {"clean", version_clean},
            {"compiler", version_compiler},
            {"flags", version_flags},
            {"cuda_compiler", or_null(version_cuda_compiler)},
            {"cuda_flags", or_null(version_cuda_flags)},
            {"cuda_architectures", or_null(version_cuda_architectures)},
            {"cpu", cpu_name()}};
}

void print_table(const nlohmann::json& result, std::ostream& out) {
    std::vector<std::string> scenes;
    std::map<std::string, std::vector<nlohmann::json>> medians;
    for (const auto& row : result.at("benchmarks")) {
        if (!is_median(row)) continue;
        const std::string scene = row.at("scene");
        if (!medians.contains(scene)) scenes.push_back(scene);
        medians[scene].push_back(row);
    }
    std::vector<Row> edits = {
        {"scene", "backend", "edits", "an edit (median)", "(max)", "a step without", "slow-down"}};
    std::vector<Row> table = {{"scene", "backend", "time a step", "particles/s", "springs/s",
                               "rounding error", "(max)", "total error", "x fastest", "of limit"}};
    std::vector<std::string> chaotic;
    for (const std::string& scene : scenes) {
        auto& rows = medians[scene];
        const auto time = [](const nlohmann::json& row) { return row.at("real_time").get<double>(); };
        std::stable_sort(rows.begin(), rows.end(),
                         [&](const auto& a, const auto& b) { return time(a) < time(b); });
        if (rows.front().at("chaotic").get<bool>()) {
            chaotic.push_back(scene + ": two float64 runs differ by " +
                              error_text(rows.front().at("divergence")) + " after " +
                              std::to_string(rows.front().at("steps").get<int>()) + " steps");
        }
        for (const auto& row : rows) {
            std::ostringstream ratio;
            ratio << std::fixed << std::setprecision(2) << time(row) / time(rows.front());
            table.push_back({scene, contender(row), noise_mark(row) + si(time(row) * 1e-6, "s"),
                             si(row.at("particle_updates_per_second"), "/s"),
                             si(row.at("spring_updates_per_second"), "/s"),
                             error_text(row.at("error_relative_l2")), error_text(row.at("error_max")),
                             error_text(row.at("total_error_relative_l2")), ratio.str(),
                             percent_text(row.at("fraction_of_limit"))});
            if (!row.contains("edits")) continue;
            const double without = row.at("seconds_per_step_without_edits");
            std::ostringstream slow_down;
            slow_down << std::showpos << std::fixed << std::setprecision(1)
                      << 100 * (time(row) * 1e-6 / without - 1) << " %";
            edits.push_back({scene, contender(row), std::to_string(row.at("edits").get<int>()),
                             si(row.at("edit_seconds_median"), "s"), si(row.at("edit_seconds_max"), "s"),
                             si(without, "s"), slow_down.str()});
        }
    }
    print_aligned(table, out);
    for (const std::string& scene : scenes) print_noise(medians[scene], out);
    for (const std::string& scene : chaotic) out << "chaotic, errors say nothing: " << scene << "\n";
    if (edits.size() > 1) {
        out << "\n";
        print_aligned(edits, out);
    }
    print_limits(result.at("context").at("voxspring").at("limits"), out);
    print_unmeasured(result, out);
}

}  // namespace voxspring
