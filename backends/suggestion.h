// "did you mean heart?" after a name that is not known.
#pragma once

#include <string>
#include <vector>

namespace voxspring {

/// The one of `known` that `word` is most like, if it is as like as a misspelling: a third of its letters,
/// one at least, left out, added, changed or swapped with the next one. Empty if none is.
std::string closest(const std::string& word, const std::vector<std::string>& known);

/// "; did you mean heart?", to be put after a message; empty where nothing is close.
std::string did_you_mean(const std::string& word, const std::vector<std::string>& known);

}  // namespace voxspring
