#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <filesystem>

#include "harness/base/bad_input.h"
#include "harness/base/text.h"
#include "harness/cli/commands.h"

namespace voxspring {
namespace {

std::filesystem::path this_program() {
    std::error_code error;
    return std::filesystem::read_symlink("/proc/self/exe", error);
}

/// The folder that has the script file `name`. Throws BadInput if no such folder is found.
std::filesystem::path find_scripts(const std::string& name) {
    std::filesystem::path above = this_program().parent_path();
    const std::filesystem::path first = above;
    // In a source tree the program is build/release/voxspring, and results/ is beside build/.
    for (int levels = 0; levels < 4 && above != above.root_path(); ++levels, above = above.parent_path()) {
        for (const char* folder : {"share/voxspring/results", "results"}) {
            std::error_code error;
            if (std::filesystem::is_regular_file(above / folder / name, error)) return above / folder;
        }
    }
    throw BadInput("command line", "command", std::filesystem::path(name).stem().string(),
                   "a folder results/ or share/voxspring/results/ that has " + name +
                       ", in the program's folder " + first.string() +
                       " or in one of the three folders above it");
}

/// Runs the line `code` in `python`. Returns an empty text or, if `code` fails, the last line of its output.
std::string failure_of(const std::string& python, const std::string& code) {
    const std::string command =
        shell_word(python) + " -c " + shell_word(code) + " 2>&1 >/dev/null </dev/null";
    FILE* const process = popen(command.c_str(), "re");
    if (process == nullptr) return std::strerror(errno);
    std::string output;
    for (std::array<char, 4096> part{}; std::fgets(part.data(), int(part.size()), process) != nullptr;)
        output = part.data();
    if (pclose(process) == 0) return "";
    output.erase(output.find_last_not_of('\n') + 1);
    return output.empty() ? "failed without a message" : output;
}

/// Returns the first Python interpreter that is at least 3.9 and can import the modules. Tries the
/// environment that `./run report` makes in a source tree, then /usr/bin/python3, then python3 in the PATH.
/// Throws BadInput if none will do; the message says why each one failed.
std::string find_python(const std::string& command, const std::filesystem::path& folder,
                        const std::string& modules) {
    const Script& script = scripts().at(command);
    const std::filesystem::path own = folder.parent_path() / "build/report-venv/bin/python";
    const std::string code =
        "import sys; sys.version_info >= (3, 9) or sys.exit('it is older than Python 3.9')" +
        (modules.empty() ? "" : "; import " + modules);
    std::string asked;
    for (const std::string& python :
         {own.string(), std::string("/usr/bin/python3"), std::string("python3")}) {
        if (python == own && access(own.c_str(), X_OK) != 0) continue;
        const std::string failure = failure_of(python, code);
        if (failure.empty()) return python;
        asked +=
            (asked.empty() ? "" : "; ") + python + (python == "python3" ? " of the PATH: " : ": ") + failure;
    }
    const std::string install = "pip install -r " + (folder / "requirements.txt").string();
    throw BadInput("command line", command, "python3",
                   "a Python 3 that can import " + script.modules + " (" + asked + "); " +
                       (script.packages.empty() ? "" : "install Debian's " + script.packages + ", or ") +
                       install);
}

bool has(const std::vector<std::string>& arguments, const std::string& option) {
    return std::any_of(arguments.begin(), arguments.end(), [&](const std::string& argument) {
        return argument == option || argument.starts_with(option + "=");
    });
}

}  // namespace

const std::map<std::string, Script>& scripts() {
    static const std::map<std::string, Script> all = {
        {"diff",
         {"Compare two results: what became slower or less accurate (needs Python 3 with scipy and "
          "fastjsonschema)",
          "scipy.stats, fastjsonschema", "python3-scipy python3-fastjsonschema"}},
        {"report",
         {"Make a page of results as one HTML file (needs Python 3 with scipy and vl-convert-python)",
          "fastjsonschema, jinja2, PIL, scipy.stats, vl_convert", ""}},
    };
    return all;
}

int run_script(const std::string& command, const std::vector<std::string>& arguments) {
    const std::string name = command + ".py";
    const std::filesystem::path folder = find_scripts(name);
    const bool explains = has(arguments, "--help") || has(arguments, "-h");
    std::vector<std::string> words = {
        find_python(command, folder, explains ? "" : scripts().at(command).modules),
        (folder / name).string()};
    words.insert(words.end(), arguments.begin(), arguments.end());
    // The script of a report calls this program to draw the datasets.
    if (command == "report" && has(arguments, "--pictures") && !has(arguments, "--program"))
        words.insert(words.end(), {"--program", this_program().string()});
    std::vector<char*> pointers;
    for (std::string& word : words) pointers.push_back(word.data());
    pointers.push_back(nullptr);
    execvp(pointers[0], pointers.data());
    throw BadInput("command line", command, words[0],
                   std::string("a Python 3 that can be started: ") + std::strerror(errno));
}

}  // namespace voxspring
