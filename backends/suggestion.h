// "did you mean heart?" after an unknown name.
#pragma once

#include <string>
#include <vector>

namespace voxspring {

/// The word of `known` that is most like `word`, if it could be a misspelling of it: up to a third of its
/// letters, and at least one, are left out, added, changed or swapped with the next one. Empty if there is
/// none.
std::string closest(const std::string& word, const std::vector<std::string>& known);

/// "; did you mean heart?", to be put after a message. Empty if no word is close.
std::string did_you_mean(const std::string& word, const std::vector<std::string>& known);

}  // namespace voxspring
