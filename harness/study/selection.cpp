#include "harness/study/selection.h"

#include <fnmatch.h>

#include <algorithm>
#include <functional>
#include <iterator>
#include <optional>
#include <set>
#include <utility>

#include "backends/suggestion.h"
#include "harness/base/bad_input.h"
#include "harness/base/text.h"
#include "harness/choice/auto_choice.h"

namespace voxspring {
namespace {

/// Copies of `options` in which KEY=* is replaced by each value that `entry` has for the key.
std::vector<std::string> each_of(const BackendEntry& entry, const std::string& options) {
    std::vector<std::string> all = {options};
    const auto replace = [&](const std::string& key, const std::vector<std::string>& values) {
        std::vector<std::string> replaced;
        for (const std::string& one : all) {
            const auto pattern = one.find(key + "=*");
            // The key must be the whole word before "=*", not merely the end of another key.
            if (pattern == std::string::npos || (one[pattern - 1] != ':' && one[pattern - 1] != ',')) {
                replaced.push_back(one);
                continue;
            }
            for (const std::string& value : values) {
                replaced.push_back(one);
                replaced.back().replace(pattern + key.size() + 1, 1, value);
            }
        }
        all = std::move(replaced);
    };
    const auto names = [](const auto& values) {
        std::vector<std::string> texts;
        for (const auto value : values) texts.push_back(to_string(value));
        return texts;
    };
    replace("formulation", names(entry.formulations));
    replace("precision", names(entry.precisions));
    for (const auto& [key, values] : entry.tuning) {
        if (!values.empty()) replace(key, values);
    }
    return all;
}

}  // namespace

bool matches(const std::string& glob, const std::string& text) {
    return fnmatch(glob.c_str(), text.c_str(), 0) == 0;
}

bool matches(const std::string& glob, const BackendSpec& spec) {
    return matches(glob, spec.entry->name) || matches(glob, spec.label());
}

std::vector<BackendSpec> expand(const std::string& pattern) {
    const auto colon = pattern.find(':');
    const std::string glob = pattern.substr(0, colon);
    const std::string options = colon == std::string::npos ? "" : pattern.substr(colon);
    std::vector<BackendSpec> specs;
    std::optional<BadSpecification> refusal;
    for (const auto& [name, entry] : registry()) {
        if (!matches(glob, name)) continue;
        for (const std::string& one : each_of(entry, options)) {
            try {
                specs.push_back(BackendSpec::parse(name + one));
            } catch (const BadSpecification& error) {
                if (!refusal) refusal = error;
            }
        }
    }
    if (specs.empty() && refusal) throw BadSpecification(*refusal);
    return specs;
}

bool matches_left_out(const std::string& pattern) {
    const std::string glob = pattern.substr(0, pattern.find(':'));
    return std::any_of(left_out().begin(), left_out().end(),
                       [&](const auto& backend) { return matches(glob, backend.first); });
}

std::vector<BackendSpec> expand_all(const std::vector<std::string>& patterns) {
    std::vector<BackendSpec> specs;
    std::set<std::string> seen;
    for (const std::string& pattern : patterns) {
        for (BackendSpec& spec : expand(pattern)) {
            if (seen.insert(spec.label()).second) specs.push_back(std::move(spec));
        }
    }
    return specs;
}

bool leaves_out(const std::string& glob) { return glob.starts_with('!'); }

std::vector<BackendSpec> select(std::vector<BackendSpec> specs, const std::vector<std::string>& globs) {
    std::vector<BackendSpec> kept;
    for (const std::string& glob : globs) {
        if (leaves_out(glob) || asks_for_auto(glob)) continue;
        std::vector<BackendSpec> found;
        std::copy_if(specs.begin(), specs.end(), std::back_inserter(found),
                     [&](const BackendSpec& spec) { return matches(glob, spec); });
        if (found.empty()) found = expand(glob);
        for (BackendSpec& spec : found) {
            const std::string label = spec.label();
            if (std::none_of(kept.begin(), kept.end(), [&](const auto& k) { return k.label() == label; })) {
                kept.push_back(std::move(spec));
            }
        }
    }
    if (std::all_of(globs.begin(), globs.end(), leaves_out)) kept = std::move(specs);
    for (const std::string& glob : globs) {
        if (leaves_out(glob))
            std::erase_if(kept, [&](const BackendSpec& spec) { return matches(glob.substr(1), spec); });
    }
    return kept;
}

const std::vector<std::string>& patterns_of(const Study& study, const StudyScene& item) {
    return item.backends.empty() ? study.backends : item.backends;
}

std::vector<BackendSpec> known_specs(const Study& study, const StudyScene& item) {
    std::vector<std::string> patterns = patterns_of(study, item);
    std::erase_if(patterns, asks_for_auto);
    return select(expand_all(patterns), item.only);
}

bool has_backends(const Study& study, const StudyScene& item) {
    const bool takes_all = std::all_of(item.only.begin(), item.only.end(), leaves_out);
    const std::vector<std::string>& asked = takes_all ? patterns_of(study, item) : item.only;
    return std::any_of(asked.begin(), asked.end(), asks_for_auto) || !known_specs(study, item).empty();
}

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

std::vector<std::string> globs_without_effect(const Study& study, const std::vector<std::string>& globs) {
    if (study.scenes.empty()) return {};
    std::vector<std::string> patterns;
    std::copy_if(globs.begin(), globs.end(), std::back_inserter(patterns), std::not_fn(leaves_out));
    for (const StudyScene& item : study.scenes) {
        const std::vector<std::string>& own = patterns_of(study, item);
        patterns.insert(patterns.end(), own.begin(), own.end());
    }
    if (std::any_of(patterns.begin(), patterns.end(), asks_for_auto)) return {};
    const std::vector<BackendSpec> specs = expand_all(patterns);
    std::vector<std::string> without;
    std::copy_if(globs.begin(), globs.end(), std::back_inserter(without), [&](const std::string& glob) {
        return leaves_out(glob) && std::none_of(specs.begin(), specs.end(), [&](const BackendSpec& spec) {
                   return matches(glob.substr(1), spec);
               });
    });
    return without;
}

std::vector<std::string> select_backends(Study& study, const std::vector<std::string>& globs) {
    const auto asks_for = [](const StudyScene& item, const Study& of, const std::string& glob) {
        std::vector<std::string> patterns = patterns_of(of, item);
        std::erase_if(patterns, asks_for_auto);
        const std::vector<BackendSpec> specs = expand_all(patterns);
        return std::any_of(specs.begin(), specs.end(),
                           [&](const BackendSpec& spec) { return matches(glob, spec); });
    };
    std::vector<std::vector<bool>> asked;  // indexed by glob, then by scene
    for (const std::string& glob : globs) {
        const std::string named = leaves_out(glob) ? glob.substr(1) : glob;
        std::vector<bool>& by_scene = asked.emplace_back();
        for (const StudyScene& item : study.scenes) by_scene.push_back(asks_for(item, study, named));
        const bool is_in_study = std::find(by_scene.begin(), by_scene.end(), true) != by_scene.end();
        if (!is_in_study && !asks_for_auto(glob) && expand(named).empty())
            throw BadInput("command line", "--backend", glob, accepted_globs(named));
        // Names and labels, which a glob is compared with, have no ':'; "[:" begins a class of characters.
        if (leaves_out(glob) && named.find(':') != std::string::npos && named.find("[:") == std::string::npos)
            throw BadInput("command line", "--backend", glob,
                           "a glob of backends' names or of labels (as in results) after the !, such as "
                           "!cpu_parallel/increment/float64");
        std::set<std::string> added;
        for (std::size_t n = 0; n < study.scenes.size(); ++n) {
            if (leaves_out(glob)) {
                by_scene[n] = true;
            } else if (!is_in_study) {
                by_scene[n] = added.insert(study.scenes[n].scene).second;
            }
        }
    }
    const bool takes_all = std::all_of(globs.begin(), globs.end(), leaves_out);
    std::vector<StudyScene> kept;
    std::set<std::string> dropped;
    for (std::size_t n = 0; n < study.scenes.size(); ++n) {
        StudyScene& item = study.scenes[n];
        bool is_asked = takes_all;
        for (std::size_t g = 0; g < globs.size(); ++g) {
            if (!asked[g][n]) continue;
            item.only.push_back(globs[g]);
            is_asked = is_asked || !leaves_out(globs[g]);
        }
        if (globs.empty() || (is_asked && has_backends(study, item))) {
            kept.push_back(std::move(item));
        } else {
            dropped.insert(item.scene);
        }
    }
    if (kept.empty() && !dropped.empty())
        throw BadInput("command line", "--backend", joined(globs), "globs that leave the study a backend");
    study.scenes = std::move(kept);
    for (const StudyScene& item : study.scenes) dropped.erase(item.scene);
    return {dropped.begin(), dropped.end()};
}

std::string accepted_globs(const std::string& pattern) {
    std::vector<std::string> names;
    for (const auto& [name, entry] : registry()) names.push_back(name);
    return "a glob that matches one of: " + joined(names) +
           did_you_mean(pattern.substr(0, pattern.find(':')), names);
}

}  // namespace voxspring
