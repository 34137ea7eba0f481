#include "harness/journal.h"

#include <utility>

namespace voxspring {

const nlohmann::json* Journal::find(const std::string& name) const {
    const auto found = finished_.find(name);
    return found == finished_.end() ? nullptr : &found->second;
}

void Journal::keep(const std::string& name, nlohmann::json value) { finished_[name] = std::move(value); }

}  // namespace voxspring
