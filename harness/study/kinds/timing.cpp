// Two kinds of study. `timing` measures the time of a step and its errors. `fastest` also says for each
// dataset which strategy is the fastest, and compares it with targets.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "harness/results/print.h"
#include "harness/study/fastest.h"
#include "harness/study/measure.h"
#include "harness/study/study_kind.h"

namespace voxspring {
namespace {

class TimingStudy : public StudyKind {
public:
    void read(JsonObject& study) override {
        read_start_times(study);
        if (const auto total = study.find("total_error")) total_error_ = total->boolean();
        if (const auto most = study.find("most_particle_steps"))
            most_particle_steps_ = most->integer(1, max_particle_steps);
        if (const auto most = study.find("most_case_seconds")) most_case_seconds_ = most->number(1e-3, 1e6);
        read_sustained(study);
    }
    std::string read_scene(JsonObject& item) const override {
        if (const auto times = item.find("start_times")) (void)times->boolean();
        if (const auto strained = item.find(StudyScene::strained_key)) (void)strained->boolean();
        return StudyKind::read_scene(item);
    }
    void check(const Study& study, const StudyScene& item, const Scene& scene) const override {
        check_batch(study, scene, batch_of(study, item, scene));
    }
    /// If slow cases may stop repeating early (`most_case_seconds`), this assumes two repetitions per case,
    /// since the cases of large scenes stop early and take most of the time.
    double steps_of_case(const Study& study, const StudyScene& item) const override {
        const bool cuts = std::isfinite(most_case_seconds_);
        return double(item.steps) * (cuts ? std::min(study.repetitions, 2) : study.repetitions);
    }
    void run(StudyBench& bench) override {
        measure(bench, batch_of(bench.study(), bench.item(), bench.scene()));
    }
    void print(const Result& result, std::ostream& out, TableWidth width) const override {
        print_table(result, out, width);
    }

protected:
    void read_start_times(JsonObject& study) {
        if (const auto times = study.find("start_times")) start_times_ = times->boolean();
    }
    void read_sustained(JsonObject& study) {
        if (const auto seconds = study.find("sustained_seconds"))
            sustained_seconds_ = seconds->number(0, 3600);
    }
    /// The batch for a scene. To stay within `most_particle_steps` it may have fewer steps than the item
    /// says, unless the scene has edits, which belong to certain steps.
    Batch batch_of(const Study& study, const StudyScene& item, const Scene& scene) const {
        const auto most = most_particle_steps_ / std::int64_t(scene.problem.particle_count());
        const bool fewer = scene.edits.empty() && most < item.steps;
        return {.steps = fewer ? int(std::max<std::int64_t>(most, 1)) : item.steps,
                .repetitions = study.repetitions,
                .total_error = total_error_,
                .start_times = item.settings.value("start_times", start_times_),
                .rewind = item.settings.value("rewind", true),
                .sustained_seconds = sustained_seconds_,
                .most_seconds = most_case_seconds_};
    }

    bool total_error_ = true;

private:
    static constexpr std::int64_t max_particle_steps = 1'000'000'000'000;

    bool start_times_ = true;
    double sustained_seconds_ = 0;
    std::int64_t most_particle_steps_ = max_particle_steps;
    double most_case_seconds_ = Batch().most_seconds;
};

class FastestStudy final : public TimingStudy {
public:
    FastestStudy() { total_error_ = false; }
    void read(JsonObject& study) override {
        read_start_times(study);
        read_sustained(study);
        const auto targets = study.find("targets"), scenes = study.find("scenes");
        if (!targets) return;
        targets_ = read_targets(*targets);
        if (scenes) check_targets(*targets, *scenes);
    }
    std::string read_scene(JsonObject& item) const override {
        if (const auto rewind = item.find("rewind")) (void)rewind->boolean();
        return TimingStudy::read_scene(item);
    }
    void make_lists(Result& result) const override { result.rows<nlohmann::json>("fastest"); }
    void summarise(Result& result) const override {
        result.rows<nlohmann::json>("fastest") = fastest_of(result, targets_);
    }
    void print(const Result& result, std::ostream& out, TableWidth width) const override {
        print_fastest(result, out, width);
    }

private:
    /// Refuses a target on a scene that the study does not have, since nothing would judge it. Results name a
    /// scene without the folder of its file.
    static void check_targets(const JsonValue& targets, const JsonValue& scenes) {
        std::vector<std::string> names;
        for (const JsonValue& item : scenes.array())
            names.push_back(std::filesystem::path(item.object().require("scene").string()).filename());
        for (const JsonValue& target : targets.array()) (void)target.object().require("scene").one_of(names);
    }

    std::vector<Target> targets_;
};

const RegisteredStudyKind timing_kind("timing", [] { return std::make_unique<TimingStudy>(); });
const RegisteredStudyKind fastest_kind("fastest", [] { return std::make_unique<FastestStudy>(); });

}  // namespace
}  // namespace voxspring
