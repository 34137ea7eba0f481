#include <iostream>
#include <string>

#include "harness/scene/scene.h"

namespace voxspring {

void say_notes(const Scene& scene) {
    std::string lines;
    for (const std::string& note : scene.notes) lines += "voxspring: " + scene.name + ": " + note + "\n";
    std::cerr << lines << std::flush;
}

}  // namespace voxspring
