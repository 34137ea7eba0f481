#include <malloc.h>

#include <csignal>
#include <exception>
#include <iostream>
#include <new>

#include "backends/registry.h"
#include "harness/base/bad_input.h"
#include "harness/cli/arguments.h"
#include "harness/process/worker_main.h"

namespace voxspring {
namespace {

int exit_code_of(int argc, char** argv, const ViewScene& view) {
    try {
        return run_command_line(argc, argv, std::cout, view);
    } catch (const BadInput& error) {
        std::cerr << "voxspring: " << error.what() << "\n";
        return 2;
    } catch (const BadSpecification& error) {
        std::cerr << "voxspring: " << error.what() << "\n";
        return 2;
    } catch (const std::bad_alloc&) {
        std::cerr << "voxspring: out of memory: this command needs more than the machine has; "
                     "`voxspring info SCENE` shows what a scene needs on each backend\n";
        return 1;
    } catch (const std::exception& error) {
        std::cerr << "voxspring: " << error.what() << "\n";
        return 1;
    }
}

}  // namespace

int run_program(int argc, char** argv, const ViewScene& view) {
    // Freed memory is kept for reuse, so that the system need not map it and clear its pages again: the
    // states of a large scene are allocated and freed with every row of a study.
    mallopt(M_MMAP_MAX, 0);
    mallopt(M_TRIM_THRESHOLD, -1);  // never return memory to the system
    // With this signal ignored, write() returns an error at the limit on file sizes.
    std::signal(SIGXFSZ, SIG_IGN);
    worker_main(argc, argv);
    const int code = exit_code_of(argc, argv, view);
    // A full disk may show only when buffered output is written.
    if (!std::cout.flush()) {
        std::cerr << "voxspring: not all of the output could be written to standard output\n";
        return code == 0 ? 1 : code;
    }
    return code;
}

}  // namespace voxspring
