// Compiles every kernel that a CUDA backend may ask for, for every architecture; no GPU is needed for that.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "backends/backend.h"
#include "backends/device_choice.h"
#include "backends/layout/decomposition.h"
#include "backends/layout/march_cost.h"
#include "backends/layout/march_layout.h"
#include "backends/layout/particles.h"
#include "cuda/common/axes_backend.h"
#include "cuda/common/support_kernels.h"
#include "cuda/device/compiler.h"
#include "cuda/device/serialiser.h"
#include "cuda/kernels/resident.h"
#include "tests/required.h"
#include "tests/support.h"
#include "tests/surroundings.h"

namespace voxspring::cuda {
namespace {

using ::testing::HasSubstr;

/// The source of a kernel with these macros and, where they leave it open, a simple case.
KernelSource source_of(const std::string& file, std::map<std::string, std::string> macros) {
    macros.merge(
        std::map<std::string, std::string>{{"REAL", "float"},
                                           {"FETCH", "PastL1"},
                                           {"THREADS", "512"},
                                           {"BLOCKS", "1"},
                                           {"TERMS", "KernelTerms<Formulation::position,262143u,6u,false>"}});
    return {file, macros};
}

struct Kind {
    const char* name;
    const char* file;
    std::map<std::string, std::string> macros;
    std::vector<const char*> fetches;
    /// The one formulation to compile the kind for; all, if there is none. One is enough for a kind that
    /// differs from another kind in the same way in every formulation.
    std::optional<Formulation> only = {};
    std::uint32_t terms = 0;  ///< besides those of a scene
};

using Macros = std::map<std::string, std::string>;
Macros with(Macros macros, const Macros& more) {
    macros.insert(more.begin(), more.end());
    return macros;
}

std::vector<Kind> kinds() {
    const std::vector<const char*> memory = {"PastL1", "ThroughL1", "ThroughTexture"}, past = {"PastL1"},
                                   through = {"ThroughL1"};
    const Macros four = {{"THREADS", "256"}, {"BLOCKS", "4"}}, two = {{"THREADS", "256"}, {"BLOCKS", "2"}},
                 springs = {{"SECONDARY", "1"}}, rows = {{"ROWS", "1"}}, part = {{"LISTED_BLOCKS", "1"}},
                 dependent = {{"DEPENDENT_LAUNCH", "1"}};
    constexpr Formulation position = Formulation::position, paper = Formulation::paper;
    return {{"implicit", "implicit.cu", four, memory},
            {"tile", "tile.cu", with(two, {{"WIDTH", "64"}, {"HEIGHT", "4"}}), past},
            {"by_groups", "explicit.cu", {}, memory},
            {"by_springs", "explicit.cu", springs, memory},
            {"delta", "delta.cu", four, through},
            {"groups_launched_dependent", "explicit.cu", dependent, past, position},
            {"deltas_launched_dependent", "delta.cu", with(four, dependent), through, position},
            {"groups_of_a_part", "explicit.cu", part, past, position},
            {"springs_of_a_part", "explicit.cu", with(springs, part), past, position},
            {"deltas_of_a_part", "delta.cu", with(four, part), through, position},
            {"implicit_bit_by_bit", "implicit.cu", four, past, paper, term_bit_by_bit},
            {"tile_bit_by_bit", "tile.cu", with(two, {{"WIDTH", "16"}, {"HEIGHT", "16"}}), past, paper,
             term_bit_by_bit},
            {"groups_by_rows", "explicit.cu", rows, past, paper},
            {"springs_by_rows", "explicit.cu", with(springs, rows), past, paper},
            {"add_forces", "scatter.cu", {{"FORCES", "1"}}, through},
            {"integrate", "scatter.cu", {}, through}};
}

void expect_machine_code(const KernelSource& source, int architecture) {
    EXPECT_EQ(compile(source, architecture).code.substr(1, 3), "ELF");
}

class Compiler : public ::testing::TestWithParam<Formulation> {};

/// Each call has another one than the oldest. Cases take turns, since every one for every architecture takes
/// too long.
int newer_architecture() {
    static int calls = 0;
    constexpr std::array all{80, 86, 89, 90, 100, 103, 120};
    return all[std::size_t(calls++) % all.size()];
}

// Compiles the terms of a scene of the paper, and all terms. That is enough: terms are independent of each
// other, and terms and formulation are independent of how a neighbour is fetched.
TEST_P(Compiler, CompilesEveryKernel) {
    const bool on_oldest = GetParam() == Formulation::position || GetParam() == Formulation::compensated;
    for (const Kind& kind : kinds()) {
        if (kind.only && kind.only != GetParam()) continue;
        for (const char* fetch : kind.fetches) {
            for (const char* real : {"float", "double"}) {
                for (const bool everything : {false, true}) {
                    // Other fetches are compiled only with every term, and in one formulation.
                    if (fetch != kind.fetches.front() && !(everything && GetParam() == Formulation::position))
                        continue;
                    for (const bool oldest : {true, false}) {
                        // The oldest architecture differs from the newest only in speed: one of each is
                        // enough there.
                        if (oldest && (everything || !on_oldest)) continue;
                        const int architecture = oldest ? 75 : newer_architecture();
                        SCOPED_TRACE(std::string(kind.name) + " " + fetch + " " + real);
                        KernelSource source = source_of(kind.file, kind.macros);
                        source.macros["REAL"] = real;
                        source.macros["FETCH"] = fetch;
                        const std::string terms =
                            everything
                                ? std::to_string(NEIGHBOUR_BITS) + "u," +
                                      std::to_string(all_terms | term_off_lattice_rests |
                                                     term_off_lattice_springs | term_full_stencil |
                                                     term_resting | term_flush | kind.terms) +
                                      "u,true"
                                : std::to_string(FACE_BITS | EDGE_BITS) + "u," +
                                      std::to_string(term_gravity | term_pins | kind.terms) + "u,false";
                        source.macros["TERMS"] =
                            "KernelTerms<Formulation::" + to_string(GetParam()) + "," + terms + ">";
                        expect_machine_code(source, architecture);
                    }
                }
            }
        }
    }
}

#define NAME(kernel) #kernel,
// The names by which cuda/common/support_kernels.cpp and cuda/device/limits.cpp find kernels are symbols of
// the machine code.
TEST(Compiler, CompilesWhatRunsBetweenStepsAndMeasuresLimits) {
    const auto expect_kernels = [](const KernelSource& source, const std::vector<const char*>& names) {
        for (const int architecture : {75, 90, 120}) {
            const std::string code = compile(source, architecture).code;
            for (const char* name : names)
                EXPECT_NE(code.find(std::string(".text.") + name), std::string::npos) << name;
        }
    };
    for (const char* real : {"float", "double"}) {
        expect_kernels({"between_steps.cu", {{"REAL", real}}}, {SUPPORT_KERNELS(NAME)});
    }
    expect_kernels({"limits.cu", {{"THREADS", "256"}}},
                   {"do_nothing", "sweep_1_0_1", "sweep_1_0_2", "sweep_1_1_1", "sweep_1_1_2", "sweep_2_1_1",
                    "sweep_2_1_2", "meet", "exchange", "multiply_add_float32", "multiply_add_float64"});
}

TEST(Compiler, SaysWhatItCompilesWith) {
    const std::string said = compiler_and_options(90);
    EXPECT_TRUE(said.starts_with("NVRTC " + compiler_build())) << said;
    EXPECT_NE(said.find(" --gpu-architecture=sm_90 --std=c++20 --fmad=false"), std::string::npos) << said;
}

KernelSource resident_source(
    const char* tool, const char* part = "0", const char* slots = "768", int borders = 1 << mixed_border,
    const char* masked = "0",
    const std::string& terms = "KernelTerms<Formulation::increment,262143u,0u,false>",
    const char* turns = "1") {
    return source_of("resident.cu", {{"LANES", "256"},
                                     {"POLLERS", "256"},
                                     {"ROUNDS", "2"},
                                     {"SLOTS", slots},
                                     {"BORDERS", std::to_string(borders)},
                                     {"MASKED", masked},
                                     {"TOOL", tool},
                                     {"PART", part},
                                     {"TURNS", turns},
                                     {"TERMS", terms}});
}

TEST_P(Compiler, CompilesTheResidentKernel) {
    if (GetParam() == Formulation::compensated) return;  // points of two parts do not fit into a tagged word
    struct Variant {
        int borders;
        const char *masked, *tool, *slots, *part;
        int architecture;
        const char* turns = "1";
    };
    // The maximum number of points for each.
    for (const auto& [borders, masked, tool, slots, part, architecture, turns] :
         {Variant{(1 << border_kinds) - 1, "0", "none", "2048", "0", newer_architecture()},
          Variant{1 | 1 << mixed_border, "0", "none", "4096", "0", newer_architecture(), "3"},
          Variant{1 | 1 << mixed_border, "1", "ticks", "2048", "0", 75, "2"},
          Variant{1 << mixed_border, "1", "none", "768", "0", 75},
          Variant{1 << mixed_border, "1", "launch", "768", "0", 75},
          Variant{(1 << border_kinds) - 1, "0", "ticks", "2016", "0", 90},
          Variant{1 << mixed_border, "0", "ticks", "768", "0", 120},
          Variant{1 << mixed_border, "0", "none", "2048", "1", 90},
          Variant{1 << mixed_border, "1", "launch", "768", "1", 75}}) {
        SCOPED_TRACE(std::string(tool) + ", part: " + part);
        const std::string terms = "KernelTerms<Formulation::" + to_string(GetParam()) + ",262143u," +
                                  std::to_string(all_terms & ~term_materials) + "u,true>";
        const KernelSource source = resident_source(tool, part, slots, borders, masked, terms, turns);
        expect_machine_code(source, architecture);
    }
}

std::size_t count_of(const std::string& word, const std::string& text) {
    std::size_t count = 0;
    for (std::size_t at = text.find(word); at != std::string::npos; at = text.find(word, at + 1)) ++count;
    return count;
}

// If other blocks never come, a waiting block ends its wait: each wait reads the clock. With ticks, block 0
// waits for the turns of the others and for the host, and they wait for its orders. No wait traps, since a
// trap would end everything else that runs on the device.
TEST(Compiler, TheResidentKernelDoesNotWaitForEver) {
    const auto waits = [](const char* tool, const char* part) {
        const std::string code = compile(resident_source(tool, part), 999).code;
        EXPECT_EQ(count_of("trap;", code), 0U);
        return count_of("%globaltimer", code);
    };
    EXPECT_GE(waits("none", "0"), 2U);
    EXPECT_GE(waits("launch", "0"), 2U);
    EXPECT_GE(waits("ticks", "0"), 4U);
    // The waits for its points, for the points of the last step, and for the begin of the others.
    EXPECT_GE(waits("none", "1"), 3U);
    EXPECT_EQ(ResidentStall::unpacked(ResidentStall{131, 70000}.packed()).block, 131U);
    EXPECT_EQ(ResidentStall::unpacked(ResidentStall{131, 70000}.packed()).step, 70000U);
}

// With dependent launches the step before may still write words while a kernel begins. So the kernel loads no
// word before the wait, and none by read-only loads.
TEST(DependentLaunches, LoadWordsAfterTheWait) {
    const auto code_of = [](const char* file, const char* real, const char* fetch, bool dependent) {
        KernelSource source = source_of(file, {{"REAL", real}, {"FETCH", fetch}});
        if (dependent) source.macros["DEPENDENT_LAUNCH"] = "1";
        return compile(source, 999).code;
    };
    for (const auto& [real, word] : {std::pair{"float", ".v4.f32"}, std::pair{"double", ".v2.f64"}}) {
        const std::string read_only = std::string("ld.global.nc") + word;
        EXPECT_GT(count_of(read_only, code_of("explicit.cu", real, "ThroughL1", false)), 0U);
        EXPECT_GT(count_of(read_only, code_of("delta.cu", real, "ThroughL1", false)), 0U);
        for (const auto& [file, fetch] :
             {std::pair{"explicit.cu", "ThroughL1"}, std::pair{"explicit.cu", "PastL1"},
              std::pair{"explicit.cu", "ThroughTexture"}, std::pair{"delta.cu", "ThroughL1"}}) {
            SCOPED_TRACE(std::string(file) + " " + real + " " + fetch);
            const std::string code = code_of(file, real, fetch, true);
            EXPECT_EQ(count_of(read_only, code), 0U);
            const std::size_t wait = code.find("griddepcontrol.wait");
            ASSERT_NE(wait, std::string::npos);
            EXPECT_GT(std::min(code.find("ld.global"), code.find("tex.1d")), wait);
        }
    }
}

// No load of a list or, past L1 or through a texture, of a position goes through a cache that 2008 lacked.
TEST(ThePapersLists, AreReadPastL1) {
    for (const char* secondary : {"", "1"}) {
        for (const char* fetch : {"PastL1", "ThroughTexture"}) {
            KernelSource source = source_of("explicit.cu", {{"FETCH", fetch}, {"ROWS", "1"}});
            if (*secondary != 0) source.macros["SECONDARY"] = secondary;
            const std::string code = compile(source, 999).code;
            EXPECT_EQ(count_of("ld.global.nc", code), 0U);
            EXPECT_EQ(count_of("ld.global.", code), count_of("ld.global.cg", code));
            EXPECT_GT(count_of("ld.global.cg.u32", code) + count_of("ld.global.cg.b32", code), 0U);
        }
    }
}

// Parts of a body wait for each other, each in its kernel.
TEST(Serialisers, AreTold) {
    const auto unset = [](const char*) -> const char* { return nullptr; };
    const auto with = [](const std::string& variable, const char* value) {
        return [variable, value](const char* name) { return name == variable ? value : nullptr; };
    };
    const std::vector<std::string> usual = {"", "/usr/lib/libcuda.so.1", "/usr/lib/libToolsInjection64.so"};
    EXPECT_EQ(serialised_by(8, unset, usual), "");
    EXPECT_EQ(serialised_by(1, with("CUDA_LAUNCH_BLOCKING", "1"), usual),
              "with CUDA_LAUNCH_BLOCKING=1 kernels run one at a time");
    EXPECT_EQ(serialised_by(2, with("CUDA_LAUNCH_BLOCKING", "0"), usual), "");
    EXPECT_EQ(serialised_by(2, with("CUDA_LAUNCH_BLOCKING", ""), usual), "");
    EXPECT_EQ(serialised_by(2, unset, {"/opt/nvidia/compute-sanitizer/libsanitizer-collection.so"}),
              "under compute-sanitizer kernels run one at a time");
    EXPECT_EQ(serialised_by(2, unset, {"/opt/nvidia/ncu/libcuda-injection.so"}),
              "under Nsight Compute kernels run one at a time");
    // A launch that blocks would keep the host from ordering a tick. Under compute-sanitizer it returns at
    // once.
    EXPECT_EQ(launches_block(unset, usual), "");
    EXPECT_EQ(launches_block(with("CUDA_LAUNCH_BLOCKING", "1"), usual),
              "with CUDA_LAUNCH_BLOCKING=1 kernels run one at a time");
    EXPECT_EQ(launches_block(unset, {"/opt/nvidia/compute-sanitizer/libsanitizer-collection.so"}), "");
    EXPECT_EQ(launches_block(unset, {"/opt/nvidia/ncu/libcuda-injection.so"}),
              "under Nsight Compute kernels run one at a time");
    EXPECT_EQ(serialised_by(9, unset, usual),
              "the streams of a process share 8 queues (environment variable CUDA_DEVICE_MAX_CONNECTIONS), "
              "but 9 kernels need one queue each");
    EXPECT_EQ(serialised_by(9, with("CUDA_DEVICE_MAX_CONNECTIONS", "32"), usual), "");
    EXPECT_NE(serialised_by(2, with("CUDA_DEVICE_MAX_CONNECTIONS", "1"), usual), "");
    EXPECT_EQ(serialised_by(33, with("CUDA_DEVICE_MAX_CONNECTIONS", "64"), usual),
              "the streams of a process share 32 queues (environment variable CUDA_DEVICE_MAX_CONNECTIONS), "
              "but 33 kernels need one queue each");
}

// The borders of a part are lists of elements in 32 bits.
TEST(Borders, OfAPartThatIsTooLargeForThemAreRefused) {
    Problem problem = make_lattice_problem(testing::solid({2, 2, 2}), FACE_BITS | EDGE_BITS);
    const auto refusal = [&] {
        return border_index_refusal(layout::march_strides(problem.lattice, sizeof(float)).axis);
    };
    problem.lattice.dims = {2048, 2048, 1024};
    EXPECT_NE(refusal(), "");
    problem.lattice.dims.z = 1023;
    EXPECT_EQ(refusal(), "");
    EXPECT_NE(border_index_refusal(std::size_t(1) << 32U), "");
    EXPECT_EQ(border_index_refusal((std::size_t(1) << 32U) - 1), "");
}

// Kernels with code per class of springs have one rest length for each class.
TEST(Classes, WithTwoRestLengthsAreRefused) {
    Problem problem = make_lattice_problem(testing::solid({2, 2, 2}), FACE_BITS | EDGE_BITS);
    const auto refusal = [&] {
        return class_refusal(problem, Precision::float32, Formulation::increment, "the march");
    };
    EXPECT_EQ(refusal(), "");
    for (const std::size_t bit : {8, 9}) problem.rest_length[bit] *= 1.1;  // (1, -1, 0) and its opposite
    EXPECT_NE(refusal(), "");
    for (const std::size_t bit : {6, 7}) problem.rest_length[bit] *= 1.1;  // (1, 1, 0) and its opposite
    EXPECT_EQ(refusal(), "");
}

/// A part of a body whose borders travel within steps.
struct Part {
    Part(const BackendSpec& spec, const Subdomain& of) : backend(spec.make()), subdomain(of) {}
    void upload(const State& start) {
        backend->upload(subdomain.problem, subdomain.part_of(start));
        std::vector<SharedParticles> shared;
        for (const Subdomain::Border& border : subdomain.borders)
            shared.push_back({border.subdomain, border.sent, border.received});
        borders = backend->borders()->device_borders(shared, "stores");
    }
    std::unique_ptr<Backend> backend;
    Subdomain subdomain;
    std::shared_ptr<DeviceBorders> borders;
};

// Runs on a card: one of two parts is not stepped, so that the other waits in vain. That is an error of its
// backend only; the process and the card go on.
TEST(Waits, InVainAreErrorsAndTheCardGoesOn) {
    const BackendSpec spec = BackendSpec::parse("cuda_resident:overlap=off");
    const BackendSpec other = BackendSpec::parse("cuda_implicit_device");
    std::unique_ptr<Backend> whole;
    testing::make_or_skip(spec, whole);
    if (!whole) return;
    Problem problem = make_lattice_problem(testing::solid({8, 8, 32}), FACE_BITS | EDGE_BITS);
    problem.gravity = {8e-4, 0, -2e-3};
    problem.time_step = 0.2;
    const State start = testing::random_state(problem, 0.05, 3);
    const DeviceOfThread shared({.number = 0, .wraps = false, .parts = 2});
    const Decomposition cuts(problem, Decomposition::slabs(problem, 2));
    std::vector<Part> parts;
    for (const int rank : {0, 1}) parts.emplace_back(spec, cuts.subdomain(problem, rank));
    if (const std::string why = parts[0].backend->unsupported(parts[0].subdomain.problem); !why.empty())
        GTEST_SKIP() << why;
    const auto begin_anew = [&] {
        std::vector<std::shared_ptr<DeviceBorders>> borders;
        for (Part& part : parts) {
            part.upload(start);
            borders.push_back(part.borders);
        }
        for (std::size_t rank = 0; rank < parts.size(); ++rank) parts[rank].borders->connect(borders, rank);
    };
    begin_anew();
    parts[1].backend->step(1000);
    EXPECT_THAT(testing::message_of<DeviceError>([&] { parts[1].backend->synchronize(); }),
                HasSubstr("waited in vain for step "));
    EXPECT_THROW((void)parts[1].backend->download(), DeviceError) << "its state is worthless";

    const State expected = testing::stepped(*other.make(), problem, start, 5);
    begin_anew();
    for (Part& part : parts) part.backend->step(5);
    State state = state_at_rest(problem);
    for (const Part& part : parts) part.subdomain.copy_own(part.backend->download(), state);
    testing::expect_same_bits(state, expected);
}

// In addition to the waits of any launch, a part of a body waits for the points of its last step. Words
// between devices have system scope on both sides; words between blocks of one device have not.
TEST(Compiler, AResidentKernelOfAPartSendsToOtherDevices) {
    const std::string whole = compile(resident_source("none"), 999).code;
    const std::string part = compile(resident_source("none", "1"), 999).code;
    EXPECT_GT(count_of("%globaltimer", part), count_of("%globaltimer", whole));
    EXPECT_EQ(count_of("st.relaxed.sys.global.b128", whole), 0U);
    EXPECT_GT(count_of("st.relaxed.sys.global.b128", part), 0U);
    EXPECT_GT(count_of("ld.relaxed.sys.global.b128", part), 0U);
    EXPECT_EQ(count_of("ld.relaxed.gpu.global.b128", part), 0U);
}

// A kernel without a tool has no code for it, and only ticks listen to the host.
TEST(Compiler, AToolCostsTheResidentKernelNothingWhereThereIsNone) {
    const std::string none = compile(resident_source("none"), 999).code;
    const std::string launch = compile(resident_source("launch"), 999).code;
    const std::string in_ticks = compile(resident_source("ticks"), 999).code;
    EXPECT_LT(none.size(), launch.size());
    EXPECT_EQ(count_of(".relaxed.sys", none) + count_of(".relaxed.sys", launch), 0U);
    EXPECT_GT(count_of("ld.relaxed.sys", in_ticks), 0U);
    EXPECT_GT(count_of("st.relaxed.sys", in_ticks), 0U);
    EXPECT_EQ(count_of("%globaltimer", none), count_of("%globaltimer", launch));
    EXPECT_LT(count_of("%globaltimer", none), count_of("%globaltimer", in_ticks));
}

/// Whether `tile` exists in that precision, and compiles.
void compile_march(const char* tile, Precision precision, Formulation formulation, const Problem& problem,
                   int architecture = 90, bool async = false, const char* kept_planes = "0") {
    SCOPED_TRACE(std::string(tile) + " " + to_string(precision) + " " + to_string(formulation));
    const MarchTile shape = march_tile(tile, precision);
    if (shape.shape.warps() == 0) return;
    const MarchShape& s = shape.shape;
    std::string numbers;
    for (const int number : {s.rows, s.lanes, s.wide, s.high, s.planes, s.previous_windows})
        numbers += (numbers.empty() ? "" : ",") + std::to_string(number);
    KernelSource source =
        source_of("march.cu", {{"REAL", precision == Precision::float32 ? "float" : "double"},
                               {"TERMS", "KernelTerms<Formulation::" + to_string(formulation) + "," +
                                             std::to_string(problem.group_bits) + "u," +
                                             std::to_string(terms_of(problem)) + "u,false>"},
                               {"THREADS", std::to_string(s.threads())},
                               {"BLOCKS", std::to_string(shape.blocks)},
                               {"SHAPE", "MarchShape{" + numbers + "}"},
                               {"EQUAL_EDGES", equal_edges(problem, formulation) ? "true" : "false"}});
    if (async) source.macros["ASYNC_COPIES"] = "1";
    source.macros["KEPT_PLANES"] = kept_planes;
    expect_machine_code(source, architecture);
}

TEST(Compiler, CompilesTheMarch) {
    Problem problem;
    problem.group_bits = FACE_BITS | EDGE_BITS;
    Problem moved = problem;
    moved.damping = 0.01;
    moved.gravity.z = 1;
    for (const Precision precision : {Precision::float32, Precision::float64}) {
        for (const char* tile : {"32x20", "64x4", "64x8", "64x16", "64x20", "128x8", "128x16", "128x20"})
            compile_march(tile, precision, Formulation::position, problem);
        for (const Formulation formulation :
             {Formulation::position, Formulation::displacement, Formulation::increment})
            compile_march("64x8", precision, formulation, moved, 90, false,
                          formulation == Formulation::position ? "2" : "0");
    }
    compile_march("64x16", Precision::float32, Formulation::position, moved, 80, true);
    compile_march("32x20", Precision::float32, Formulation::increment, moved, 89, true);
    compile_march("64x4", Precision::float64, Formulation::position, moved, 120, true);
    problem.group_bits = FACE_BITS;
    compile_march("64x8", Precision::float32, Formulation::increment, problem, 120);
}

// Tiles of every size; the largest need registers that are moved to their threads.
TEST(Compiler, CompilesBricks) {
    struct Variant {
        const char *shape, *formulation;
        int registers;
        int architecture;
        const char* in_memory = "false";
        bool pollers_send = false;
    };
    for (const auto& [shape, formulation, registers, architecture, in_memory, pollers_send] :
         {Variant{"3,1,1,8,6,6,true,1,2", "position", 0, 75},
          Variant{"2,1,2,16,6,4,false,0,0", "displacement", 0, 90},
          Variant{"2,2,2,16,4,4,false,0,0", "increment", 176, 90, "false", true},
          Variant{"2,2,2,16,4,4,false,0,0", "position", 0, 86, "false", true},
          Variant{"3,2,2,16,4,4,false,0,0", "position", 0, 120},
          Variant{"3,2,3,16,6,4,false,0,0", "position", 144, 90},
          Variant{"3,2,3,16,6,4,false,0,0", "increment", 144, 90, "true"}}) {
        SCOPED_TRACE(shape);
        KernelSource source = source_of("brick.cu", {{"SHAPE", std::string("BrickShape{") + shape + "}"},
                                                     {"POLLERS", "128"},
                                                     {"ROUNDS", pollers_send ? "6" : "12"},
                                                     {"POLLERS_SEND", pollers_send ? "1" : "0"},
                                                     {"SENT_ROUNDS", pollers_send ? "4" : "7"},
                                                     {"EQUAL_EDGES", "true"},
                                                     {"PLAIN_BLOCKS", "1"},
                                                     {"INCREMENTS_IN_MEMORY", in_memory},
                                                     {"LANE_REGISTERS", std::to_string(registers)},
                                                     {"POLLER_REGISTERS", "80"},
                                                     {"TERMS", std::string("KernelTerms<Formulation::") +
                                                                   formulation + ",262143u,6u,false>"}});
        source.moves_registers = registers > 0;
        expect_machine_code(source, architecture);
    }
}

TEST(Compiler, CompilesTiles) {
    struct Variant {
        const char *real, *formulation, *threads;
        int blocks, architecture;
    };
    for (const auto& [real, formulation, threads, blocks, architecture] :
         {Variant{"float", "position", "1", 4, 75}, Variant{"float", "displacement", "1", 4, 80},
          Variant{"float", "increment", "2", 5, 90}, Variant{"double", "position", "1", 2, 120}}) {
        SCOPED_TRACE(formulation);
        const KernelSource source = source_of(
            "tiles.cu",
            {{"REAL", real},
             {"THREADS", "128"},
             {"TILE_THREADS", threads},
             {"BLOCKS", std::to_string(blocks)},
             {"EQUAL_EDGES", "true"},
             {"TERMS", std::string("KernelTerms<Formulation::") + formulation + ",262143u,6u,false>"}});
        expect_machine_code(source, architecture);
    }
}

INSTANTIATE_TEST_SUITE_P(Formulations, Compiler, ::testing::ValuesIn(all_formulations),
                         [](const auto& tested) { return to_string(tested.param); });

TEST(Compiler, FindsOnDiskWhatItCompiledBefore) {
    const testing::TemporaryFolder folder;
    const testing::Variable cache("VOXSPRING_CACHE", folder.path().string());
    KernelSource source = source_of("implicit.cu", {{"THREADS", "64"}});
    const CompiledKernel first = compile(source, 90);
    const CompiledKernel again = compile(source, 90);
    EXPECT_FALSE(first.found);
    EXPECT_TRUE(again.found);
    EXPECT_GT(first.seconds, 0);
    EXPECT_EQ(again.seconds, first.seconds) << "a start without kernels on disk has a known length";
    EXPECT_EQ(again.code, first.code);
    source.macros["THREADS"] = "128";
    EXPECT_FALSE(compile(source, 90).found);
    EXPECT_FALSE(compile(source, 80).found);
}

// NVRTC reports 13.0 without a patch level. The id that `readelf -n` shows has 20 bytes, of two digits each.
TEST(Compiler, KernelsOnDiskAreOfOneBuildOfTheCompiler) {
    const std::string& build = compiler_build();
    const std::size_t version = build.find(' ');
    ASSERT_NE(version, std::string::npos);
    const std::string id = build.substr(version + 1);
    EXPECT_GE(id.size(), 16U) << "no build id";
    EXPECT_EQ(id.find_first_not_of("0123456789abcdef"), std::string::npos) << "results take text: " << id;
}

TEST(Compiler, SaysWhatIsWrong) {
    EXPECT_THAT(testing::message_of<DeviceError>([] {
                    compile({"implicit.cu", {{"REAL", "half_a_float"}}}, 90);
                }),
                HasSubstr("half_a_float"));
}

// For a card newer than the compiler it emits code that the driver finishes.
TEST(Compiler, FallsBackToPtx) {
    const KernelSource source = source_of("implicit.cu", {{"FETCH", "ThroughL1"}, {"THREADS", "64"}});
    EXPECT_NE(compile(source, 999).code.find(".target"), std::string::npos);
    EXPECT_THROW(compile(source, 30), DeviceError);
}

}  // namespace
}  // namespace voxspring::cuda
