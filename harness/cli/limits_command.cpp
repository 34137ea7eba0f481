#include <nlohmann/json.hpp>
#include <ostream>
#include <stdexcept>

#include "backends/registry.h"
#include "harness/base/json.h"
#include "harness/base/progress.h"
#include "harness/cli/commands.h"
#include "harness/device/limits.h"

namespace voxspring {

void list_limits(bool json, std::ostream& out) {
    MeasuredLimits limits;
    Activity activity;
    for (const auto& [name, entry] : registry()) {
        const BackendSpec spec = BackendSpec::parse(name);
        activity.begin("measuring what the device of " + name + " can do");
        try {
            const std::unique_ptr<Backend> backend = spec.make();
            if (backend->limits() != nullptr)
                limits.of(backend->capabilities(), [&] { return spec.make()->limits()->measure_limits(); });
        } catch (const std::runtime_error&) {
            // `voxspring list` says why there is no such device.
        }
    }
    activity.end();
    if (json) {
        out << json_text(limits.json(), 2) << "\n";
    } else {
        print_limits(limits.json(), out);
    }
}

}  // namespace voxspring
