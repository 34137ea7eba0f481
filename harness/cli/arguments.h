// The command line's words: which commands and options there are and what they accept.
#pragma once

#include <ostream>

namespace voxspring {

/// Does what the command line asks for and returns the exit code. Throws BadInput, BadSpecification and what
/// the commands throw.
int run_command_line(int argc, char** argv, std::ostream& out);

}  // namespace voxspring
