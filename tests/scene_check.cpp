// Reads one scene document per line and answers for each, on one line, "accepted" or why it was refused.
// tests/schema_test.py compares the answers with the published schema. Makes no voxels.
#include <iostream>
#include <string>

#include "harness/base/bad_input.h"
#include "harness/scene/scene_file.h"

int main() {
    for (std::string text; std::getline(std::cin, text);) {
        try {
            voxspring::read_scene_file(voxspring::parse_json(text, "scene"));
            std::cout << "accepted\n";
        } catch (const voxspring::BadInput& refused) {
            std::cout << refused.what() << '\n';
        }
    }
}
