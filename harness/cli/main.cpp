// The program voxspring. To show a window it starts another program, voxspring-view.
#include <unistd.h>

#include <cerrno>
#include <filesystem>
#include <string>
#include <system_error>

#include "backends/backend.h"
#include "harness/cli/arguments.h"
#include "window_found.h"

int main(int argc, char** argv) {
    return voxspring::run_program(argc, argv, [argv](const auto&...) -> int {
        if (*no_window != '\0')
            throw voxspring::Unavailable(std::string("view: this program was built without a window: ") +
                                         no_window);
        // voxspring-view lies in the folder of this program and takes the same arguments.
        const auto program = std::filesystem::read_symlink("/proc/self/exe").parent_path() / "voxspring-view";
        execv(program.c_str(), argv);
        throw std::system_error(errno, std::generic_category(),
                                "cannot start " + program.string() + ", which draws the window");
    });
}
