#include "harness/cli/scripts.h"

#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <filesystem>

#include "harness/base/bad_input.h"

namespace voxspring {
namespace {

std::filesystem::path this_program() {
    std::error_code error;
    return std::filesystem::read_symlink("/proc/self/exe", error);
}

/// The folder with the scripts.
std::filesystem::path find_scripts(const std::string& name) {
    std::filesystem::path above = this_program().parent_path();
    const std::filesystem::path first = above;
    // build/release/voxspring of a tree is the deepest.
    for (int levels = 0; levels < 4 && above != above.root_path(); ++levels, above = above.parent_path()) {
        for (const char* folder : {"share/voxspring/results", "results"}) {
            std::error_code error;
            if (std::filesystem::is_regular_file(above / folder / name, error)) return above / folder;
        }
    }
    throw BadInput("command line", "command", std::filesystem::path(name).stem().string(),
                   "a " + name + " in results/ or share/voxspring/results/ beside or above " +
                       first.string() + ", where the program is");
}

/// That of the environment which `./run report` makes in a source tree, if it is there; the PATH's otherwise.
std::string python_for(const std::string& command, const std::filesystem::path& folder) {
    const std::filesystem::path own = folder.parent_path() / "build" / (command + "-venv") / "bin/python";
    return access(own.c_str(), X_OK) == 0 ? own.string() : "python3";
}

bool has(const std::vector<std::string>& arguments, const std::string& option) {
    return std::any_of(arguments.begin(), arguments.end(), [&](const std::string& argument) {
        return argument == option || argument.starts_with(option + "=");
    });
}

}  // namespace

const std::map<std::string, std::string>& scripts() {
    static const std::map<std::string, std::string> all = {
        {"diff", "Compare two results: what got slower, or less accurate (needs Python 3 with scipy)"},
        {"report",
         "A page of results as one HTML file (needs Python 3 with altair, scipy and vl-convert-python)"},
    };
    return all;
}

bool is_script(const std::string& command) { return scripts().contains(command); }

int run_script(const std::string& command, const std::vector<std::string>& arguments) {
    const std::string name = command + ".py";
    const std::filesystem::path folder = find_scripts(name);
    std::vector<std::string> words = {python_for(command, folder), (folder / name).string()};
    words.insert(words.end(), arguments.begin(), arguments.end());
    // A report draws its datasets with this program.
    if (command == "report" && has(arguments, "--pictures") && !has(arguments, "--program"))
        words.insert(words.end(), {"--program", this_program().string()});
    std::vector<char*> pointers;
    for (std::string& word : words) pointers.push_back(word.data());
    pointers.push_back(nullptr);
    execvp(pointers[0], pointers.data());
    throw BadInput("command line", command, words[0],
                   std::string("a Python 3 that can be started (") + std::strerror(errno) + "); " +
                       scripts().at(command));
}

}  // namespace voxspring
