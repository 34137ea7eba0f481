// What a program calls that runs studies.
#pragma once

#include <nlohmann/json.hpp>

namespace voxspring {

/// The first call in main() of a program that calls run_study(): a study measures in processes of this same
/// executable, which are started as `PROGRAM worker --of-a-study` and come here. For them it does not return.
/// For the program itself it notes that this is so, and returns at once. Backends of the program's own are
/// registered before main(), as static objects are. Started by hand like that the program says so and exits
/// with 2.
void worker_main(int argc, char** argv);

/// Whether worker_main() has been called.
bool has_worker_main();

/// How a program is started as a launcher: its two arguments, and the number of the socket to the study.
inline constexpr const char* worker_word = "worker";
inline constexpr const char* worker_mark = "--of-a-study";
inline constexpr int launcher_socket = 3;
/// What is said to who starts one by hand.
inline constexpr const char* refusal_of_worker_by_hand = "a worker is started by a study and serves it";

/// What two programs must have in common in order to work on one study: version, commit, compilers and flags.
nlohmann::json build_of_workers();

}  // namespace voxspring
