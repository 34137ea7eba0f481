// The scenes of a study: which of them, loaded, and told apart.
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

/// What --scene leaves of the study's scenes, each once, and what it adds to them.
void select_scenes(Study& study, const std::vector<std::string>& globs);

/// Distributes what --backend asks for over the study's scenes, as StudyOptions::backends says: a glob that
/// backends of the study match is for the scenes that have these. Scenes that are left without a backend are
/// taken out; their names. Throws BadInput for a glob that no backend matches.
std::vector<std::string> select_backends(Study& study, const std::vector<std::string>& globs);

/// Loads scenes and keeps them, up to a quarter of the machine's memory, as each is asked for twice. Where
/// that is too little it keeps the largest, which take the longest to build.
class StudyScenes {
public:
    /// `volume` is of those that are volume files.
    StudyScenes(const StudyKind& kind, VolumeOptions volume) : kind_(kind), volume_(std::move(volume)) {}

    /// Throws BadInput, TooLarge.
    std::shared_ptr<const Scene> of(const StudyScene& item);
    /// Refuses `scene`, which is that of `item`, if another one that is not the same has its name: results
    /// tell scenes apart by name.
    void check_name(const StudyScene& item, const Scene& scene);

private:
    void keep(const std::string& name, const std::shared_ptr<const Scene>& scene);

    const StudyKind& kind_;
    const VolumeOptions volume_;
    std::map<std::string, std::shared_ptr<const Scene>> kept_;
    std::uint64_t particles_ = 0;
    std::map<std::string, const StudyScene*> named_;  ///< the first of each name
};

}  // namespace voxspring
