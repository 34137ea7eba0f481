#include "harness/process/worker_main.h"

#include <sys/stat.h>

#include <cstdlib>
#include <iostream>
#include <nlohmann/json.hpp>
#include <string_view>

#include "harness/process/case.h"
#include "harness/process/launcher.h"
#include "version.h"

namespace voxspring {
namespace {

bool called = false;

bool is_socket(int descriptor) {
    struct stat about {};
    return fstat(descriptor, &about) == 0 && S_ISSOCK(about.st_mode);
}

}  // namespace

bool has_worker_main() { return called; }

void worker_main(int argc, char** argv) {
    called = true;
    if (argc != 3 || std::string_view(argv[1]) != worker_word || std::string_view(argv[2]) != worker_mark)
        return;
    if (!is_socket(launcher_socket)) {
        std::cerr << argv[0] << ": " << worker_word << " is not accepted; expected "
                  << refusal_of_worker_by_hand << "\n";
        std::exit(2);
    }
    serve_as_launcher(launcher_socket, case_answerer);
}

nlohmann::json build_of_workers() {
    return {{"version", version_number}, {"commit", version_commit},
            {"clean", version_clean},    {"compiler", version_compiler},
            {"flags", version_flags},    {"cuda_compiler", version_cuda_compiler}};
}

}  // namespace voxspring
