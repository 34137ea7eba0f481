// The command line. Exit codes: 0 (done), 1 (a backend failed or an error exceeded its tolerance), 2 (bad
// input or usage), 130 (interrupted).
#include <malloc.h>
#include <unistd.h>

#include <cerrno>
#include <csignal>
#include <exception>
#include <filesystem>
#include <iostream>
#include <new>
#include <string>
#include <system_error>

#include "backends/registry.h"
#include "harness/base/bad_input.h"
#include "harness/cli/arguments.h"
#include "harness/process/worker_main.h"
#ifdef VOXSPRING_HAS_WINDOW
#include "harness/window/viewer.h"
#else
#include "window_found.h"
#endif

namespace {

#ifdef VOXSPRING_HAS_WINDOW

voxspring::ViewScene viewer(char** /*argv*/) { return voxspring::view_scene; }

#else

/// Replaces this process by the program voxspring-view, which lies beside this one, with the same arguments.
voxspring::ViewScene viewer(char** argv) {
    return [argv](const std::string&, const voxspring::ViewOptions&, std::ostream&) -> int {
        if (*no_window != '\0')
            throw voxspring::Unavailable(std::string("view: this build has no window: ") + no_window);
        const auto program = std::filesystem::read_symlink("/proc/self/exe").parent_path() / "voxspring-view";
        execv(program.c_str(), argv);
        throw std::system_error(errno, std::generic_category(),
                                program.string() + ", which draws the window");
    };
}

#endif

int exit_code_of(int argc, char** argv) {
    try {
        return voxspring::run_command_line(argc, argv, std::cout, viewer(argv));
    } catch (const voxspring::BadInput& error) {
        std::cerr << "voxspring: " << error.what() << "\n";
        return 2;
    } catch (const voxspring::BadSpecification& error) {
        std::cerr << "voxspring: " << error.what() << "\n";
        return 2;
    } catch (const std::bad_alloc&) {
        std::cerr
            << "voxspring: out of memory: this takes more than the machine gives it; `voxspring info SCENE` "
               "shows what a scene takes on each backend\n";
        return 1;
    } catch (const std::exception& error) {
        std::cerr << "voxspring: " << error.what() << "\n";
        return 1;
    }
}

}  // namespace

int main(int argc, char** argv) {
    // Freed memory is kept for reuse, so that the system need not map it and clear its pages again: the
    // states of a large scene are allocated and freed with every row of a study.
    mallopt(M_MMAP_MAX, 0);
    mallopt(M_TRIM_THRESHOLD, -1);  // never
    // A limit on the size of files is then an error of write().
    std::signal(SIGXFSZ, SIG_IGN);
    voxspring::worker_main(argc, argv);
    const int code = exit_code_of(argc, argv);
    // A full disk may show only when buffered output is written.
    if (!std::cout.flush()) {
        std::cerr << "voxspring: not all of the output could be written to standard output\n";
        return code == 0 ? 1 : code;
    }
    return code;
}
