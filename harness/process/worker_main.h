// The call that a program needs in order to run studies.
#pragma once

#include <nlohmann/json_fwd.hpp>

namespace voxspring {

/// Must be the first call in main() of a program that calls run_study(). A study measures in processes of the
/// same executable, started as `PROGRAM worker --of-a-study`; in these the call does not return. In the
/// program itself the call returns at once, and has_worker_main() is true from then on. Backends that the
/// program adds must be registered before main(), by static objects. If a user starts the program with these
/// words by hand, the call prints a refusal and exits with code 2.
void worker_main(int argc, char** argv);

/// Whether worker_main() has been called.
bool has_worker_main();

/// How a launcher is started: with these two arguments, and this descriptor of the socket to the study.
inline constexpr const char* worker_word = "worker";
inline constexpr const char* worker_mark = "--of-a-study";
inline constexpr int launcher_socket = 3;
/// What is expected of a user who starts a worker by hand.
inline constexpr const char* refusal_of_worker_by_hand = "another command: only a study starts workers";

/// What two programs must have in common to work on one study: version, commit, compilers and flags.
nlohmann::json build_of_workers();

}  // namespace voxspring
