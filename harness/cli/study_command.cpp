#include <unistd.h>

#include <iostream>
#include <memory>
#include <ostream>
#include <string>

#include "harness/base/interruption.h"
#include "harness/cli/commands.h"
#include "harness/ranks/mpi_ranks.h"
#include "harness/results/table.h"
#include "harness/scene/scene.h"
#include "harness/study/study.h"
#include "harness/study/study_kind.h"
#include "harness/volume/volume.h"

namespace voxspring {

int run_and_print_study(const std::string& argument, const StudyOptions& asked, std::ostream& out) {
    const std::unique_ptr<MpiRanks> mpi = MpiRanks::join();
    if (mpi != nullptr && mpi->rank() > 0) {
        mpi->serve({[&](const std::string& scene) {
                        return load_scene(scene, is_body_file(scene) ? asked.volume : VolumeOptions{});
                    },
                    asked.worker, asked.timeout});
        return 0;
    }
    StudyOptions options = asked;
    options.mpi = mpi.get();
    const Result result = run_study(load_study(argument), options);
    print_result(result, out, &out == &std::cout ? terminal_width(STDOUT_FILENO) : 0);
    if (options.out) {
        out << "written: " << options.out->string() << "\n";
    } else {
        std::cerr
            << "voxspring: this result is not saved; --out FILE.json saves each part of a result as soon "
               "as it is measured\n";
    }
    if (is_unfinished(result)) {
        out << "interrupted: this is what was finished"
            << (options.out ? "; the same command with --resume goes on" : "") << "\n";
        return interrupted_exit_code;
    }
    if (!has_measured(result)) {
        out << "nothing was measured\n";
        return 1;
    }
    return result.rows("failed").empty() ? 0 : 1;
}

}  // namespace voxspring
