#include "harness/cli/scripts.h"

#include <fcntl.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
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

/// The folder that has the script `name`.
std::filesystem::path find_scripts(const std::string& name) {
    std::filesystem::path above = this_program().parent_path();
    const std::filesystem::path first = above;
    // In a source tree the program is build/release/voxspring, which is the deepest case.
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

/// A script's description, and the Python packages that it needs: as modules, and by Debian's names if Debian
/// has all of them.
struct Script {
    std::string description, modules, packages;
};

const std::map<std::string, Script>& all_scripts() {
    static const std::map<std::string, Script> all = {
        {"diff",
         {"Compare two results: what got slower, or less accurate (needs Python 3 with scipy and "
          "fastjsonschema)",
          "scipy.stats, fastjsonschema", "python3-scipy python3-fastjsonschema"}},
        {"report",
         {"A page of results as one HTML file (needs Python 3 with scipy and vl-convert-python)",
          "fastjsonschema, jinja2, PIL, scipy.stats, vl_convert", ""}},
    };
    return all;
}

/// Runs a line of code in `python`. Returns why that failed, the last line of its output; empty if it did not
/// fail.
std::string failure_of(std::string python, std::string code) {
    std::array<int, 2> ends{};
    if (pipe2(ends.data(), O_CLOEXEC) != 0) return std::strerror(errno);
    posix_spawn_file_actions_t actions;
    posix_spawn_file_actions_init(&actions);
    posix_spawn_file_actions_addopen(&actions, STDIN_FILENO, "/dev/null", O_RDONLY, 0);
    posix_spawn_file_actions_addopen(&actions, STDOUT_FILENO, "/dev/null", O_WRONLY, 0);
    posix_spawn_file_actions_adddup2(&actions, ends[1], STDERR_FILENO);
    std::string option = "-c";
    const std::array words = {python.data(), option.data(), code.data(), static_cast<char*>(nullptr)};
    pid_t process = -1;
    const int error = posix_spawnp(&process, python.c_str(), &actions, nullptr, words.data(), environ);
    posix_spawn_file_actions_destroy(&actions);
    close(ends[1]);
    std::string said;
    std::array<char, 4096> part{};
    for (ssize_t count = 0; error == 0 && (count = read(ends[0], part.data(), part.size())) > 0;)
        said.append(part.data(), static_cast<std::size_t>(count));
    close(ends[0]);
    if (error != 0) return std::strerror(error);
    int status = 0;
    while (waitpid(process, &status, 0) < 0 && errno == EINTR) {
    }
    if (status == 0) return "";
    said.erase(said.find_last_not_of('\n') + 1);
    said.erase(0, said.find_last_of('\n') + 1);
    return said.empty() ? "it fails without a word" : said;
}

/// The first of these Pythons that can import the modules: the environment that `./run report` makes in a
/// source tree, the system's Python, the PATH's Python. Throws BadInput, which says what each lacks.
std::string find_python(const std::string& command, const std::filesystem::path& folder,
                        const std::string& modules) {
    const Script& script = all_scripts().at(command);
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

const std::map<std::string, std::string>& scripts() {
    static const std::map<std::string, std::string> descriptions = [] {
        std::map<std::string, std::string> found;
        for (const auto& [name, script] : all_scripts()) found[name] = script.description;
        return found;
    }();
    return descriptions;
}

bool is_script(const std::string& command) { return all_scripts().contains(command); }

int run_script(const std::string& command, const std::vector<std::string>& arguments) {
    const std::string name = command + ".py";
    const std::filesystem::path folder = find_scripts(name);
    const bool explains = has(arguments, "--help") || has(arguments, "-h");
    std::vector<std::string> words = {
        find_python(command, folder, explains ? "" : all_scripts().at(command).modules),
        (folder / name).string()};
    words.insert(words.end(), arguments.begin(), arguments.end());
    // A report calls this program to draw its datasets.
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
