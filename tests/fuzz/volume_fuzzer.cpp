// libFuzzer: any bytes, read as a volume file in the format of READER, either become a grid with an active
// voxel or are refused with BadInput.
#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <sstream>

#include "harness/base/bad_input.h"
#include "harness/volume/claims.h"
#include "harness/volume/volume.h"

namespace {

void require(bool condition) {
    if (!condition) std::abort();
}

template <class Select>
void try_to(const Select& select) {
    try {
        const voxspring::LabelledGrid labelled = select();
        const auto& label = labelled.grid.label;
        require(std::any_of(label.begin(), label.end(), [](std::uint8_t l) { return l != 0; }));
        require(*std::max_element(label.begin(), label.end()) <= labelled.labels.size());
    } catch (const voxspring::BadInput&) {
    }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    const voxspring::SceneSizeLimits limits{1 << 16, 1 << 16};
    // The last byte selects the options that a user may choose, so that the fuzzer finds both kinds of
    // inputs.
    voxspring::VolumeChoice choice;
    if (size > 0 && data[size - 1] % 2 == 1) choice.frame = 1;
    if (size > 0 && data[size - 1] % 4 > 1) choice.spacing = {1, 2, 3};
    std::istringstream stream(std::string(reinterpret_cast<const char*>(data), size));
    try {
        const voxspring::Volume volume =
            read_voxels(stream, voxspring::READER(stream, "volume.hdr"), choice, limits);
        require(volume.voxel_count() ==
                std::size_t(volume.dims.x) * std::size_t(volume.dims.y) * std::size_t(volume.dims.z));
        require(volume.spacing.x > 0 && volume.spacing.y > 0 && volume.spacing.z > 0);
        try_to([&] { return above_threshold(volume, 0); });
        try_to([&] { return with_labels(volume, std::nullopt); });
        try_to([&] { return with_labels(volume, std::vector<std::string>{"2", "1"}); });
        try_to([&] { return with_labels(volume, std::vector<std::string>{"wall"}); });
    } catch (const voxspring::BadInput&) {
    }
    return 0;
}
