// Suggests a name after an unknown one: "did you mean heart?"
#pragma once

#include <string>
#include <vector>

namespace voxspring {

/// The word of `known` that is most like `word`, or an empty string if none is close. A close word has up to
/// a third of the letters of `word` (or one, if that is more), but fewer than its own number, left out,
/// added, changed or swapped with the next.
std::string closest(const std::string& word, const std::vector<std::string>& known);

/// "; did you mean heart?", to be put after a message. Empty if no word is close.
std::string did_you_mean(const std::string& word, const std::vector<std::string>& known);

}  // namespace voxspring
