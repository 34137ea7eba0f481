#include "backends/physics/formulation.h"

namespace voxspring {

std::string to_string(Formulation formulation) {
    switch (formulation) {
        case Formulation::paper:
            return "paper";
        case Formulation::position:
            return "position";
        case Formulation::displacement:
            return "displacement";
        case Formulation::increment:
            return "increment";
        case Formulation::compensated:
            return "compensated";
    }
    return {};
}

}  // namespace voxspring
