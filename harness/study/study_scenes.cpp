#include "harness/study/study_scenes.h"

#include <algorithm>
#include <set>
#include <utility>

#include "harness/base/bad_input.h"
#include "harness/choice/auto_choice.h"
#include "harness/study/selection.h"
#include "harness/verification/reference.h"
#include "harness/volume/dataset.h"
#include "harness/volume/volume.h"

namespace voxspring {

void select_scenes(Study& study, const std::vector<std::string>& globs) {
    if (globs.empty()) return;
    std::vector<StudyScene> kept;
    std::set<std::size_t> taken;
    for (const std::string& glob : globs) {
        bool found = false;
        for (std::size_t i = 0; i < study.scenes.size(); ++i) {
            if (!matches(glob, study.scenes[i].scene)) continue;
            found = true;
            if (taken.insert(i).second) kept.push_back(study.scenes[i]);
        }
        const auto same = [&](const StudyScene& item) { return item.scene == glob; };
        if (!found && std::none_of(kept.begin(), kept.end(), same))
            kept.push_back({.scene = glob, .steps = study.steps, .backends = {}});
    }
    study.scenes = std::move(kept);
}

std::vector<std::string> select_backends(Study& study, const std::vector<std::string>& globs) {
    const auto asks_for = [](const StudyScene& item, const Study& of, const std::string& glob) {
        std::vector<std::string> patterns = item.backends.empty() ? of.backends : item.backends;
        std::erase_if(patterns, asks_for_auto);
        const std::vector<BackendSpec> specs = expand_all(patterns);
        return std::any_of(specs.begin(), specs.end(),
                           [&](const BackendSpec& spec) { return matches(glob, spec); });
    };
    std::vector<std::vector<bool>> asked;  // by glob, by scene
    for (const std::string& glob : globs) {
        std::vector<bool>& by_scene = asked.emplace_back();
        for (const StudyScene& item : study.scenes)
            by_scene.push_back(leaves_out(glob) || (!asks_for_auto(glob) && asks_for(item, study, glob)));
        if (leaves_out(glob) || std::find(by_scene.begin(), by_scene.end(), true) != by_scene.end()) continue;
        if (!asks_for_auto(glob) && expand(glob).empty())
            throw BadInput("command line", "--backend", glob, accepted_globs(glob));
        std::set<std::string> added;
        for (std::size_t n = 0; n < study.scenes.size(); ++n)
            by_scene[n] = added.insert(study.scenes[n].scene).second;
    }
    std::vector<StudyScene> kept;
    std::vector<std::string> without;
    for (std::size_t n = 0; n < study.scenes.size(); ++n) {
        StudyScene& item = study.scenes[n];
        bool has_some = std::all_of(globs.begin(), globs.end(), leaves_out);
        for (std::size_t g = 0; g < globs.size(); ++g) {
            if (!asked[g][n]) continue;
            item.only.push_back(globs[g]);
            has_some = has_some || !leaves_out(globs[g]);
        }
        if (has_some) {
            kept.push_back(std::move(item));
        } else {
            without.push_back(item.scene);
        }
    }
    study.scenes = std::move(kept);
    return without;
}

std::shared_ptr<const Scene> StudyScenes::of(const StudyScene& item) {
    if (auto own = kind_.own_scene(item)) return own;
    if (item.built) return item.built;
    if (const auto known = kept_.find(item.scene); known != kept_.end()) return known->second;
    auto scene = std::make_shared<const Scene>(
        load_scene(item.scene, is_body_file(item.scene) ? volume_ : VolumeOptions{}));
    keep(item.scene, scene);
    return scene;
}

void StudyScenes::keep(const std::string& name, const std::shared_ptr<const Scene>& scene) {
    const std::uint64_t most = SceneSizeLimits::of_this_machine().particles / 4;
    if (scene->problem.particle_count() > most) return;
    kept_[name] = scene;
    particles_ += scene->problem.particle_count();
    while (particles_ > most) {
        const auto smallest = std::min_element(kept_.begin(), kept_.end(), [](const auto& a, const auto& b) {
            return a.second->problem.particle_count() < b.second->problem.particle_count();
        });
        particles_ -= smallest->second->problem.particle_count();
        kept_.erase(smallest);
    }
}

void StudyScenes::check_name(const StudyScene& item, const Scene& scene) {
    const auto [first, added] = named_.emplace(scene.name, &item);
    const StudyScene& other = *first->second;
    if (added || (other.scene == item.scene && other.built == item.built)) return;
    if (fingerprint_of(*of(other)) == fingerprint_of(scene)) return;
    throw BadInput("study", "scene", item.scene,
                   "a scene of another name: " + other.scene + " is called " + scene.name +
                       " as well, and rows of the two could not be told apart; rename the file");
}

}  // namespace voxspring
