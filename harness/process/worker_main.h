// The function that a program must call in main() so that studies can measure in processes of it.
#pragma once

#include <nlohmann/json_fwd.hpp>

namespace voxspring {

/// Must be the first call in main() of a program that StudyOptions::worker names, or that calls run_study()
/// without naming one. A study measures in further processes of this program, started as `PROGRAM worker
/// --of-a-study`. In these processes the call does not return. In the program itself it returns at once, and
/// has_worker_main() is true from then on.
/// Backends that the program adds must be registered before main(), by static objects. If a user starts
/// `PROGRAM worker --of-a-study` by hand, the call prints a refusal and exits with code 2.
void worker_main(int argc, char** argv);

/// Whether worker_main() has been called.
bool has_worker_main();

/// A launcher is started with these two arguments, and with the socket to the study as this descriptor.
inline constexpr const char* worker_word = "worker";
inline constexpr const char* worker_mark = "--of-a-study";
inline constexpr int launcher_socket = 3;
/// The text after "expected" in the message to a user who starts a worker by hand.
inline constexpr const char* refusal_of_worker_by_hand = "another command: only a study starts workers";

/// The version, commit, compilers and flags of this program, which must be the same in the study's process
/// and in its workers.
nlohmann::json build_of_workers();

}  // namespace voxspring
