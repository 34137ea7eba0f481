// Specifications of backends as users write them, and which backends a test run requires.
#include "backends/registry.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "harness/choice/auto_choice.h"
#include "harness/study/selection.h"
#include "tests/required.h"
#include "tests/surroundings.h"

namespace voxspring::testing {
namespace {

using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

/// Why `text` is refused; empty if it is not.
std::string reason(const std::string& text) {
    return message_of<BadSpecification>([&] { (void)BackendSpec::parse(text); });
}

std::vector<std::string> labels(const std::string& pattern) {
    std::vector<std::string> all;
    for (const BackendSpec& spec : expand(pattern)) all.push_back(spec.label());
    return all;
}

TEST(BackendSpec, ReadsWhatItWrites) {
    const BackendSpec spec = BackendSpec::parse("cpu_parallel:rest=skip,precision=float64,threads=3");
    EXPECT_EQ(spec.label(), "cpu_parallel/increment/float64/rest=skip,threads=3");
    EXPECT_EQ(BackendSpec::parse(spec.text()).text(), spec.text());
}

TEST(BackendSpec, SaysWhatAutoIs) {
    EXPECT_THAT(reason("auto"), AllOf(HasSubstr("'auto'"), HasSubstr("for a scene")));
    EXPECT_THAT(reason("auto:precision=float64"), HasSubstr("for a scene"));
    EXPECT_THAT(reason("aut"), AllOf(HasSubstr("no backend 'aut'"), HasSubstr("cpu_parallel")));
}

TEST(BackendSpec, RefusesAKeyTwice) {
    for (const char* twice : {"rest=skip,rest=skip", "rest=skip,rest=step", "threads=2,rest=skip,threads=3",
                              "precision=float32,precision=float64", "formulation=paper,formulation=paper"}) {
        EXPECT_THAT(reason(std::string("cpu_parallel:") + twice), HasSubstr("twice")) << twice;
    }
    EXPECT_THAT(reason("cpu_parallel:rest=skip,rest=skip"),
                AllOf(HasSubstr("cpu_parallel"), HasSubstr("'rest'"), HasSubstr("rest=skip,rest=skip")));
}

TEST(BackendSpec, RefusesAnEmptyPlaceInItsOptions) {
    for (const char* empty : {"", ",", "threads=2,", ",threads=2", "threads=2,,rest=skip"}) {
        const std::string text = std::string("cpu_parallel:") + empty;
        const auto says =
            AllOf(HasSubstr("backend cpu_parallel:"), HasSubstr("'" + text + "'"), HasSubstr("key=value"));
        EXPECT_THAT(reason(text), says);
        EXPECT_THAT(message_of<BadSpecification>([&] { (void)expand(text); }), says);
    }
    for (const char* text : {"auto:", "auto:precision=float64,", "auto:,precision=float64"}) {
        EXPECT_THAT(message_of<BadSpecification>([&] { check_auto(text); }),
                    AllOf(HasSubstr("backend auto:"), HasSubstr("key=value")))
            << text;
    }
    for (const char* text : {"auto:precision=half", "auto:precision=float64,precision=float32"}) {
        EXPECT_THAT(message_of<BadSpecification>([&] { check_auto(text); }),
                    AllOf(HasSubstr("backend auto:"), Not(HasSubstr("cpu_parallel"))))
            << text;
    }
    EXPECT_NO_THROW(check_auto("auto:precision=float64"));
}

TEST(BackendSpec, RefusesValuesThatDoNotGoTogether) {
    EXPECT_THAT(reason("cpu_parallel:rest=flush,formulation=position"),
                AllOf(HasSubstr("cpu_parallel"), HasSubstr("rest=flush"), HasSubstr("increment")));
    EXPECT_EQ(reason("cpu_parallel:rest=flush"), "");
    EXPECT_THAT(reason("cpu_parallel:precision=float64,root=raw"), HasSubstr("float32"));
    for (const auto& [name, entry] : registry()) {
        if (!entry.tuning.contains("rest")) continue;
        EXPECT_THAT(reason(name + ":formulation=paper,rest=flush"), HasSubstr("rest=flush")) << name;
    }
}

TEST(Patterns, StandForEveryValueOfATuningParameter) {
    EXPECT_THAT(
        labels("cpu_parallel:rest=*"),
        ElementsAre("cpu_parallel/increment/float32", "cpu_parallel/increment/float32/rest=step",
                    "cpu_parallel/increment/float32/rest=skip", "cpu_parallel/increment/float32/rest=flush"));
    // A formulation that the backend does not take is left out.
    EXPECT_THAT(labels("cpu_parallel:formulation=position,rest=*"),
                ElementsAre("cpu_parallel/position/float32", "cpu_parallel/position/float32/rest=step",
                            "cpu_parallel/position/float32/rest=skip"));
    EXPECT_EQ(labels("cpu_parallel:precision=*,subnormals=*,terms=*").size(), 8u);
    EXPECT_THROW((void)expand("cpu_parallel:nosuch=*"), BadSpecification);
    EXPECT_THROW((void)expand("cpu_parallel:est=*"), BadSpecification);
    EXPECT_THROW((void)expand("cpu_parallel:threads=*"), BadSpecification);
}

TEST(Required, TakesAListOfPrefixes) {
    {
        const Variable required("VOXSPRING_REQUIRE", " cuda , gl_fragment ,,");
        EXPECT_THAT(required_prefixes(), ElementsAre("cuda", "gl_fragment"));
        EXPECT_TRUE(is_required("cuda_march"));
        EXPECT_TRUE(is_required("gl_fragment_implicit"));
        EXPECT_FALSE(is_required("gl_compute_implicit"));
    }
    const Variable nothing("VOXSPRING_REQUIRE", "");
    EXPECT_THAT(required_prefixes(), IsEmpty());
    EXPECT_FALSE(is_required("cpu_parallel"));
}

}  // namespace
}  // namespace voxspring::testing
