// The kind of study `timing`: the time of a step, with its errors.
#include "harness/results/result.h"
#include "harness/study/measure.h"
#include "harness/study/study_kind.h"

namespace voxspring {
namespace {

class TimingStudy final : public StudyKind {
public:
    void read(JsonObject& study) override {
        if (const auto total = study.find("total_error")) total_error_ = total->boolean();
        if (const auto times = study.find("start_times")) start_times_ = times->boolean();
    }
    std::string read_scene(JsonObject& item) const override {
        if (const auto times = item.find("start_times")) (void)times->boolean();
        return StudyKind::read_scene(item);
    }
    void check(const Study& study, const StudyScene& item, const Scene& scene) const override {
        check_batch(study, scene, batch_of(study, item));
    }
    void run(StudyBench& bench) override { measure(bench, batch_of(bench.study(), bench.item())); }
    void print(const nlohmann::json& result, std::ostream& out, TableWidth width) const override {
        print_table(result, out, width);
    }

private:
    Batch batch_of(const Study& study, const StudyScene& item) const {
        return {.steps = item.steps,
                .repetitions = study.repetitions,
                .total_error = total_error_,
                .start_times = item.settings.value("start_times", start_times_)};
    }

    bool total_error_ = true, start_times_ = true;
};

const RegisteredStudyKind timing_kind("timing", [] { return std::make_unique<TimingStudy>(); });

}  // namespace
}  // namespace voxspring
