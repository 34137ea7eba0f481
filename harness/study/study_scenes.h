// The scenes of a study: selects them, loads them and checks that their names differ.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "harness/scene/scene.h"
#include "harness/study/study_kind.h"

namespace voxspring {

/// Applies --scene to the study's scenes: it keeps some of them, each once, and may add others.
void select_scenes(Study& study, const std::vector<std::string>& globs);

/// Distributes the globs of --backend over the study's scenes, as StudyOptions::backends says. A glob that
/// matches backends of the study applies to the scenes that have these. Removes scenes that are left without
/// a backend and returns their names. Throws BadInput for a glob that no backend matches.
std::vector<std::string> select_backends(Study& study, const std::vector<std::string>& globs);

/// Loads scenes and keeps them, since each is asked for twice. It keeps up to a quarter of the machine's
/// memory; if that is too little, the largest scenes are kept, which take the longest to build.
class StudyScenes {
public:
    /// `volume` has the options for scenes that are volume files.
    StudyScenes(const StudyKind& kind, VolumeOptions volume) : kind_(kind), volume_(std::move(volume)) {}

    /// The scene of an item. Throws BadInput, TooLarge.
    std::shared_ptr<const Scene> of(const StudyScene& item);
    /// Refuses `scene`, the scene of `item`, if a different scene has the same name, since results identify
    /// scenes by name.
    void check_name(const StudyScene& item, const Scene& scene);

private:
    void keep(const std::string& name, const std::shared_ptr<const Scene>& scene);

    const StudyKind& kind_;
    const VolumeOptions volume_;
    std::map<std::string, std::shared_ptr<const Scene>> kept_;
    std::uint64_t particles_ = 0;
    std::map<std::string, const StudyScene*> named_;  ///< the first item of each name
};

}  // namespace voxspring
