// The kind of study `fastest`: the time of a step, and for each dataset the fastest strategy, compared with
// targets.
#include "harness/study/fastest.h"

#include <nlohmann/json.hpp>

#include "harness/study/measure.h"
#include "harness/study/study_kind.h"

namespace voxspring {
namespace {

class FastestStudy final : public StudyKind {
public:
    void read(JsonObject& study) override {
        if (const auto targets = study.find("targets")) targets_ = read_targets(*targets);
        if (const auto times = study.find("start_times")) start_times_ = times->boolean();
    }
    std::string read_scene(JsonObject& item) const override {
        for (const char* key : {"rewind", "start_times"}) {
            if (const auto value = item.find(key)) (void)value->boolean();
        }
        return StudyKind::read_scene(item);
    }
    void check(const Study& study, const StudyScene& item, const Scene& scene) const override {
        check_batch(study, scene, batch_of(study, item));
    }
    void run(StudyBench& bench) override { measure(bench, batch_of(bench.study(), bench.item())); }
    std::vector<std::string> lists() const override { return {"fastest"}; }
    void summarise(nlohmann::json& result) const override {
        result["fastest"] = fastest_of(result, targets_);
    }
    void print(const nlohmann::json& result, std::ostream& out, TableWidth width) const override {
        print_fastest(result, out, width);
    }

private:
    Batch batch_of(const Study& study, const StudyScene& item) const {
        return {.steps = item.steps,
                .repetitions = study.repetitions,
                .total_error = false,
                .start_times = item.settings.value("start_times", start_times_),
                .rewind = item.settings.value("rewind", true)};
    }

    std::vector<Target> targets_;
    bool start_times_ = true;
};

const RegisteredStudyKind fastest_kind("fastest", [] { return std::make_unique<FastestStudy>(); });

}  // namespace
}  // namespace voxspring
