// Lists that shaders reach by address (vulkan_explicit) give the bits of lists in bound storage buffers: on
// small bodies that ask for addresses, and on bodies whose lists exceed a storage buffer.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <numeric>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "backends/glsl/compute_backend.h"
#include "backends/glsl/explicit.h"
#include "backends/registry.h"
#include "backends/vulkan/compute_device.h"
#include "backends/vulkan/queue.h"
#include "tests/required.h"
#include "tests/shader_support.h"
#include "tests/support.h"

namespace voxspring::testing {
namespace {

using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::EndsWith;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::StartsWith;

std::unique_ptr<Backend> make(const std::string& specification) {
    return BackendSpec::parse(specification).make();
}

/// Skips its tests if there is no Vulkan, or no device with buffer addresses.
class AddressedLists : public ::testing::Test {
protected:
    void SetUp() override {
        make_or_skip(BackendSpec::parse("vulkan_explicit"), probe_);
        if (probe_ != nullptr && !limits().has_addresses) GTEST_SKIP() << "no addresses of buffers";
    }
    const vulkan::Device& device() const { return vulkan::device_of(*probe_); }
    const glsl::BufferLimits& limits() const { return device().buffer_limits(); }

private:
    std::unique_ptr<Backend> probe_;
};

// --- Small bodies that ask for it --------------------------------------------------------------------------

/// Expects the bits of bound lists: in steps between `edits`, and after a rewind if there are none.
void expect_bits_of_bound_lists(const std::string& options, const Problem& problem,
                                const std::vector<SpringEdit>& edits = {}) {
    const auto play = [&](const std::string& lists) {
        const auto backend = make("vulkan_explicit:" + options + ",lists=" + lists);
        Problem now = problem;
        std::vector<State> states;
        const auto step = [&](int count) {
            backend->step(count);
            states.push_back(backend->download());
        };
        backend->upload(problem, random_state(problem, 0.05, 3));
        EXPECT_TRUE(backend->keep_start());
        step(20);
        for (const SpringEdit& edit : edits) {
            apply(now, edit);
            backend->edit(now, edit);
            step(5);
        }
        if (!edits.empty()) return states;
        backend->rewind();
        step(7);
        return states;
    };
    const std::vector<State> bound = play("auto"), addressed = play("addressed");
    for (std::size_t n = 0; n < bound.size(); ++n) expect_same_bits(addressed[n], bound[n]);
}

TEST_F(AddressedLists, ChangeNoBit) {
    Problem stressed = problem_with_everything();
    for (double& length : stressed.rest_length) length *= 0.97;
    const std::vector<std::pair<std::string, Problem>> scenes = {
        {"a group", plain_problem()}, {"materials", stressed}, {"no grid", random_network(500, 2000, 7)}};
    for (const char* options :
         {"formulation=position", "formulation=displacement", "formulation=compensated",
          "formulation=position,precision=float64", "formulation=increment,precision=float64"}) {
        for (const auto& [name, problem] : scenes) {
            SCOPED_TRACE(name + ", " + options);
            expect_bits_of_bound_lists(options, problem);
        }
    }
}

TEST_F(AddressedLists, AreEdited) {
    Problem problem = make_lattice_problem(random_grid({13, 11, 9}, 0.67, 11), FACE_BITS | EDGE_BITS);
    problem.gravity = {8e-4, 0, -2e-3};
    problem.time_step = 0.2;
    Problem edited = problem;
    const std::vector<SpringEdit> edits = edit_everything(edited, true);
    for (const char* options :
         {"formulation=position", "formulation=increment", "formulation=displacement,precision=float64"}) {
        SCOPED_TRACE(options);
        expect_bits_of_bound_lists(options, problem, edits);
    }
}

TEST_F(AddressedLists, OutliveTheStepsThatReadThem) {
    const Problem problem = make_lattice_problem(solid({40, 40, 40}), NEIGHBOUR_BITS);
    const auto backend_with_steps_in_flight = [&] {
        auto backend = make("vulkan_explicit:lists=addressed");
        backend->upload(problem, state_at_rest(problem));
        backend->step(20);
        return backend;
    };
    EXPECT_NO_THROW(backend_with_steps_in_flight().reset());
}

// --- Arrays of slots ---------------------------------------------------------------------------------------

TEST_F(AddressedLists, LieInArraysOfWholeSlots) {
    vulkan::Queue queue(device());
    std::vector<std::uint32_t> values(7 * 64);
    std::iota(values.begin(), values.end(), 1000U);
    constexpr std::size_t slot_bytes = 64 * sizeof(std::uint32_t);
    const auto bytes = std::as_bytes(std::span(values));
    // Room for three slots and a part of a fourth.
    const auto list = vulkan::addressed_list(queue, bytes, 7, 4 * slot_bytes - 1);
    ASSERT_EQ(list.addresses.size(), 7u);
    ASSERT_EQ(list.parts.size(), 3u);
    std::vector<std::uint32_t> back;
    for (std::size_t n = 0, slot = 0; n < list.parts.size(); ++n) {
        const vulkan::Buffer& part = vulkan::buffer_of(*list.parts[n]);
        EXPECT_EQ(part.bytes(), (n < 2 ? 3 : 1) * slot_bytes);
        for (std::size_t begin = 0; begin < part.bytes(); begin += slot_bytes)
            EXPECT_EQ(list.addresses[slot++], part.address() + begin);
        std::vector<std::uint32_t> here(part.bytes() / sizeof(std::uint32_t));
        queue.download(part, std::as_writable_bytes(std::span(here)));
        back.insert(back.end(), here.begin(), here.end());
    }
    EXPECT_EQ(back, values);
    const auto in_one = vulkan::addressed_list(queue, bytes, 7, 7 * slot_bytes);
    const auto empty = vulkan::addressed_list(queue, {}, 7, slot_bytes);
    EXPECT_EQ(in_one.parts.size(), 1u);
    EXPECT_TRUE(empty.addresses.empty());
    queue.wait();
    device().check("testing");
}

// --- What is refused ---------------------------------------------------------------------------------------

Options options_of(const std::string& specification) { return BackendSpec::parse(specification).options; }

TEST(ListsOfAProblem, GoByAddressWhereAStorageBufferDoesNotHoldThem) {
    const Problem problem = plain_problem();
    const Options options = options_of("vulkan_explicit");
    const std::uint64_t bytes = glsl::list_bytes(problem, options).front().second;
    EXPECT_FALSE(glsl::by_address(problem, options, {.max_bytes = bytes, .has_addresses = true}));
    EXPECT_TRUE(glsl::by_address(problem, options, {.max_bytes = bytes - 1, .has_addresses = true}));
    EXPECT_TRUE(glsl::by_address(problem, options_of("vulkan_explicit:lists=addressed"),
                                 {.max_bytes = bytes, .has_addresses = true}));
}

TEST(ListsOfAProblem, AreRefusedWithTheReason) {
    const Problem problem = plain_problem();
    const Options options = options_of("vulkan_explicit");
    const std::uint64_t bytes = glsl::list_bytes(problem, options).front().second;
    const std::uint64_t slot = bytes / 6;
    const auto refusal = [&](std::uint64_t max_bytes, bool has_addresses) {
        return glsl::lists_refusal(problem, options, {max_bytes, "maxStorageBufferRange", has_addresses});
    };
    EXPECT_THAT(refusal(bytes, false), IsEmpty());
    EXPECT_THAT(refusal(bytes - 1, false),
                AllOf(StartsWith("neighbour lists of " + std::to_string(bytes) + " bytes exceed the " +
                                 std::to_string(bytes - 1) + " that"),
                      HasSubstr("(maxStorageBufferRange)"), EndsWith("(bufferDeviceAddress)")));
    EXPECT_THAT(refusal(bytes - 1, true), IsEmpty());
    EXPECT_THAT(refusal(slot, true), IsEmpty());
    EXPECT_THAT(refusal(slot - 1, true),
                AllOf(StartsWith("slots of neighbour lists of " + std::to_string(slot) + " bytes exceed"),
                      EndsWith("(maxStorageBufferRange)")));
    EXPECT_THAT(glsl::lists_refusal(problem, options_of("vulkan_explicit:lists=addressed"),
                                    {bytes, "maxStorageBufferRange", false}),
                EndsWith("(bufferDeviceAddress)"));
}

// --- What an edit sends ------------------------------------------------------------------------------------

/// A device that computes nothing. It knows which lists the shader of an edit wrote and did not get.
class DeviceWithoutWork final : public glsl::Device {
public:
    explicit DeviceWithoutWork(std::vector<std::string>& edits) : edits_(edits) {}

    const Capabilities& capabilities() const override { return capabilities_; }
    glsl::WorkGroupLimits work_group_limits() const override { return {1024, {1024, 1024, 64}, 0}; }
    const glsl::BufferLimits& buffer_limits() const override { return limits_; }
    std::optional<std::uint64_t> free_memory_bytes() const override { return std::nullopt; }
    void use(const char*, const std::function<void()>& work) const override { work(); }
    void check(const char*) const override {}
    void wait() override {}
    std::unique_ptr<glsl::Array> make(std::span<const std::byte> values) override {
        return make_zeros(values.size());
    }
    std::unique_ptr<glsl::Array> make_zeros(std::size_t bytes) override {
        return std::make_unique<Empty>(bytes);
    }
    void overwrite(glsl::Array&, std::span<const std::byte>) override {}
    void download(const glsl::Array&, std::span<std::byte>) override {}
    std::unique_ptr<glsl::Array> copy_of(const glsl::Array& array) override {
        return make_zeros(array.bytes());
    }
    void copy(const glsl::Array&, glsl::Array&) override {}
    std::shared_ptr<glsl::Pass> pass(const glsl::Shader&, const glsl::Uniforms&,
                                     const glsl::Arrays&) override {
        return std::make_shared<glsl::Pass>();
    }
    void set(glsl::Pass&, const glsl::Uniforms&) override {}
    void dispatch_once(const glsl::Shader& shader, std::size_t, const glsl::Uniforms&, const glsl::Arrays&,
                       const std::map<unsigned, std::span<const std::byte>>& sent) override {
        if (shader.file != "edit_rows") return;
        std::string& missing = edits_.emplace_back();
        for (const auto& [list, binding] : {std::pair("SECONDARY", 2U), std::pair("OFF_LATTICE_REST", 3U)}) {
            if (shader.constants.at(list) == "true" && sent.at(binding).empty()) missing += list;
        }
    }
    bool records_checks() const override { return false; }
    void step_by(glsl::Dispatches) override {}
    void step(int) override {}
    std::optional<std::uint64_t> step_counted() override { return std::nullopt; }
    double seconds_of(const std::vector<glsl::Dispatch>&, int) override { return 0; }
    bool has_float64() const override { return false; }
    void mark(bool) override {}
    double seconds_between_marks() const override { return 0; }

private:
    class Empty final : public glsl::Array {
    public:
        explicit Empty(std::size_t bytes) : Array(bytes) {}
    };
    void check_by(glsl::Dispatches) override {}

    const Capabilities capabilities_;
    const glsl::BufferLimits limits_{.max_bytes = std::uint64_t(1) << 30};
    std::vector<std::string>& edits_;
};

// Without the last suture the rows of an edit have no rest offsets, though their list still exists. A shader
// that read some would read beyond the end of a buffer.
TEST(ListsOfAProblem, AreSentForAllThatAnEditWrites) {
    Problem now = make_lattice_problem(solid({4, 4, 4}), FACE_BITS);
    now.materials = {{1, 1}, {2, 0.25}};
    now.material.assign(now.particle_count(), 1);
    const Problem uploaded = now;
    Problem edited = now;
    SpringEditor editor(edited);
    const std::pair<std::uint32_t, std::uint32_t> far_apart[] = {{0, 63}};
    const SpringEdit edits[] = {editor.suture(far_apart, 1.0), editor.cut(far_apart)};
    std::vector<std::string> missing;
    const auto backend = glsl::make_explicit(options_of("vulkan_explicit:formulation=increment"),
                                             std::make_unique<DeviceWithoutWork>(missing));
    backend->upload(uploaded, state_at_rest(uploaded));
    for (const SpringEdit& edit : edits) {
        ASSERT_FALSE(edit.empty());
        apply(now, edit);
        backend->edit(now, edit);
    }
    EXPECT_THAT(missing, ElementsAre(IsEmpty()));
}

// --- Bodies whose lists exceed a storage buffer ------------------------------------------------------------

/// A body, and many copies of it side by side, which no spring joins. On displacements all of them move
/// alike, to the bit.
class Copies {
public:
    static constexpr glm::ivec3 dims = {12, 64, 63};
    static constexpr std::uint32_t particles = dims.x * dims.y * dims.z;

    Copies(int count, std::uint32_t groups) : one(make_body(1, groups)), many(make_body(count, groups)) {
        start_of_one = random_state(one, 0.05, 3);
        for (int n = 0; n < count; ++n) {
            for (auto part : {&State::displacement, &State::increment})
                (start.*part)
                    .insert((start.*part).end(), (start_of_one.*part).begin(), (start_of_one.*part).end());
        }
    }

    /// Expects each copy to be where the body is.
    static void expect_alike(const State& body, const State& copies) {
        std::size_t different = 0;
        for (std::size_t i = 0; i < copies.displacement.size(); ++i) {
            if (copies.displacement[i] != body.displacement[i % particles] ||
                copies.increment[i] != body.increment[i % particles])
                ++different;
        }
        EXPECT_EQ(different, 0u);
    }

    Problem one, many;
    State start_of_one, start;

private:
    static Problem make_body(int count, std::uint32_t groups) {
        Problem problem =
            make_lattice_problem(make_grid({dims.x, dims.y, count * (dims.z + 1)},
                                           [](int, int, int z) { return z % (dims.z + 1) < dims.z; }),
                                 groups);
        problem.gravity = {8e-4, 0, -2e-3};
        problem.time_step = 0.2;
        return problem;
    }
};

/// The number of copies whose list, at `bytes` bytes per particle, exceeds a storage buffer.
int copies_beyond(const glsl::BufferLimits& limits, std::size_t bytes) {
    return int(limits.max_bytes * 5 / 4 / (Copies::particles * bytes));
}

/// With buffers as large as those of cards the lists would take the host minutes.
bool takes_long(const glsl::BufferLimits& limits) { return limits.max_bytes > std::uint64_t(1) << 28; }

TEST_F(AddressedLists, OfNeighboursMayExceedAStorageBuffer) {
    if (takes_long(limits())) GTEST_SKIP() << "storage buffers are large here";
    const Copies copies(copies_beyond(limits(), 26 * sizeof(std::uint32_t)), NEIGHBOUR_BITS);
    const auto small = make("vulkan_explicit"), large = make("vulkan_explicit");
    const Options options = options_of("vulkan_explicit");
    ASSERT_FALSE(glsl::by_address(copies.one, options, limits()));
    ASSERT_TRUE(glsl::by_address(copies.many, options, limits()));
    ASSERT_EQ(large->unsupported(copies.many), "");
    small->upload(copies.one, copies.start_of_one);
    large->upload(copies.many, copies.start);
    for (Backend* const backend : {small.get(), large.get()}) backend->step(3);
    Copies::expect_alike(small->download(), large->download());
}

TEST_F(AddressedLists, OfSpringsAndRestsMayExceedAStorageBuffer) {
    if (takes_long(limits())) GTEST_SKIP() << "storage buffers are large here";
    if (!device().has_float64()) GTEST_SKIP() << "no float64";
    const std::string specification = "vulkan_explicit:formulation=displacement,precision=float64";
    const Options options = options_of(specification);
    // Lists of 18 slots. Once a suture leaves the lattice, a spring's constants take 16 bytes and its
    // rest 32.
    Copies copies(copies_beyond(limits(), 18 * 16), FACE_BITS | EDGE_BITS);
    const auto small = make(specification), large = make(specification);
    small->upload(copies.one, copies.start_of_one);
    large->upload(copies.many, copies.start);
    Problem one = copies.one, many = copies.many;
    SpringEditor of_one(one), of_many(many);
    const auto edit_and_step = [&](const char* what, auto change) {
        SCOPED_TRACE(what);
        const SpringEdit small_edit = change(of_one, one), large_edit = change(of_many, many);
        ASSERT_FALSE(small_edit.empty());
        ASSERT_EQ(large->unsupported(many), "");
        small->edit(one, small_edit);
        large->edit(many, large_edit);
        for (Backend* const backend : {small.get(), large.get()}) backend->step(2);
        Copies::expect_alike(small->download(), large->download());
    };
    ASSERT_FALSE(glsl::by_address(many, options, limits()));
    edit_and_step("lists become too large", [](SpringEditor& editor, const Problem& problem) {
        // Springs from corner to corner of each copy, within a plane that nothing below cuts.
        std::vector<std::pair<std::uint32_t, std::uint32_t>> ends;
        for (std::uint32_t first = 0; first < problem.particle_count(); first += Copies::particles)
            ends.emplace_back(first + 4, first + Copies::particles - 8);
        return editor.suture(ends, 0.02);
    });
    ASSERT_TRUE(glsl::by_address(many, options, limits()));
    const Plane middle{{0.5 * Copies::dims.x - 0.5, 0, 0}, {1, 0, 0}};
    edit_and_step("a cut", [&](SpringEditor& editor, const Problem&) { return editor.cut(middle); });
    edit_and_step("a suture",
                  [&](SpringEditor& editor, const Problem&) { return editor.suture(middle, 1.5); });
    edit_and_step("more rows than a storage buffer holds", [](SpringEditor& editor, const Problem&) {
        TrianglePatch sheets;
        for (int x = 1; x < Copies::dims.x; x += 2) {
            const double at = x + 0.5;
            sheets.triangles.push_back({{{at, -1e5, -1e5}, {at, 3e5, -1e5}, {at, -1e5, 3e5}}});
        }
        return editor.cut(sheets);
    });
}

}  // namespace
}  // namespace voxspring::testing
