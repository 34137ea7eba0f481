// The program voxspring-view, which `voxspring view` starts. It has every command of voxspring, and a window.
#include "harness/cli/arguments.h"
#include "harness/viewer/viewer.h"

int main(int argc, char** argv) { return voxspring::run_program(argc, argv, voxspring::view_scene); }
