// Tests of the OpenGL backends alone: the stencil mask masks; the mask and skipped terms change no bit; only
// particles are written; and failures read well. Tests of compute shaders of any API are in
// compute_shader_test.cpp.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "backends/gl/context.h"
#include "backends/gl/fragment_backend.h"
#include "backends/gl/program.h"
#include "backends/gl/step_queue.h"
#include "backends/gl/texture.h"
#include "backends/glsl/compute.h"
#include "backends/glsl/implicit.h"
#include "backends/physics/edit.h"
#include "backends/registry.h"
#include "harness/verification/verify.h"
#include "tests/required.h"
#include "tests/shader_support.h"
#include "tests/support.h"
#include "tests/surroundings.h"

namespace voxspring::testing {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

/// Skips its tests if there is no OpenGL.
class Gl : public ::testing::Test {
protected:
    void SetUp() override {
        skip_without("gl", [&] {
            const gl::Context probe;
            software_ = probe.capabilities().device.find("llvmpipe") != std::string::npos;
        });
    }

    static std::unique_ptr<gl::FragmentBackend> make(const std::string& specification) {
        auto backend = BackendSpec::parse(specification).make();
        return std::unique_ptr<gl::FragmentBackend>(&dynamic_cast<gl::FragmentBackend&>(*backend.release()));
    }

    bool software_ = false;
};

/// Runs once for each fragment backend in each formulation, and skips if there is no OpenGL.
class GlFragment : public Gl, public ::testing::WithParamInterface<std::string> {
protected:
    const BackendSpec spec = BackendSpec::parse(GetParam());
    const Formulation formulation = spec.options.formulation;
    const bool lists = spec.entry->name == "gl_fragment_explicit";
};

const std::vector<std::string> fragment_backends = {"gl_fragment_implicit", "gl_fragment_explicit"};
INSTANTIATE_TEST_SUITE_P(, GlFragment, ::testing::ValuesIn(formulations_of(fragment_backends)), test_name);

TEST_P(GlFragment, SamplesPassedAreTheActiveParticles) {
    const Problem problem = plain_problem();
    const auto masked = make(GetParam() + ",mask=stencil");
    const auto unmasked = make(GetParam() + ",mask=none");
    masked->upload(problem, state_at_rest(problem));
    unmasked->upload(problem, state_at_rest(problem));
    const WorkCount with = masked->count_work();
    const WorkCount without = unmasked->count_work();
    EXPECT_EQ(with.at("samples_passed"), problem.particle_count());
    EXPECT_EQ(without.at("samples_passed"), unmasked->texels(0).size());
    EXPECT_GT(without.at("samples_passed"), problem.particle_count());
    // llvmpipe counts every fragment of the triangle, masked or not.
    const auto invocations = with.find("fragment_shader_invocations");
    if (!software_ && invocations != with.end()) {
        EXPECT_EQ(invocations->second, problem.particle_count());
    }
}

/// The index of each texel whose bits say that it holds no particle.
std::vector<std::size_t> guards(const std::vector<glm::vec4>& texels) {
    std::vector<std::size_t> list;
    for (std::size_t i = 0; i < texels.size(); ++i) {
        if ((std::bit_cast<std::uint32_t>(texels[i].w) & ACTIVE_BIT) == 0) list.push_back(i);
    }
    return list;
}

using TexelBits = std::array<std::uint32_t, 4>;

TEST_P(GlFragment, MaskedTexelsKeepTheirBits) {
    const Problem problem = problem_with_everything();
    const auto backend = make(GetParam() + ",mask=stencil");
    backend->upload(problem, random_state(problem, 0.05, 3));
    const std::vector<glm::vec4> before = backend->texels(0);
    const std::vector<std::size_t> guard = guards(before);
    ASSERT_EQ(guard.size(), before.size() - problem.particle_count());
    ASSERT_GT(guard.size(), 0u);
    for (const std::size_t i : guard) ASSERT_TRUE(std::isnan(before[i].x)) << "no canary in texel " << i;
    backend->step(7);
    for (std::size_t age = 0; age < backend->frame_count(); ++age) {
        for (std::size_t target = 0; target < backend->target_count(); ++target) {
            const std::vector<glm::vec4> texels = backend->texels(age, target);
            for (const std::size_t i : guard) {
                EXPECT_EQ(std::bit_cast<TexelBits>(texels[i]), std::bit_cast<TexelBits>(before[i]))
                    << "texel " << i << ", age " << age << ", target " << target;
            }
        }
    }
}

TEST_P(GlFragment, UnmaskedTexelsWithoutAParticleStayInactiveAndHarmless) {
    const Problem problem = problem_with_everything();
    const auto backend = make(GetParam() + ",mask=none");
    backend->monitor({.largest_increment = 1, .every = 3});
    backend->upload(problem, random_state(problem, 0.05, 3));
    const std::vector<std::size_t> guard = guards(backend->texels(0));
    backend->step(20);
    EXPECT_EQ(guards(backend->texels(0)), guard);
    EXPECT_FALSE(backend->divergence());
    // These texels hold NaN, which would have spread through every neighbour by now.
    for (const glm::dvec3& u : backend->download().displacement) {
        ASSERT_TRUE(std::isfinite(u.x) && std::isfinite(u.y) && std::isfinite(u.z));
    }
}

TEST_P(GlFragment, InterleavedInstancesDoNotMeet) {
    const Problem one = problem_with_everything();
    const Problem other = plain_problem();
    const State alone = after(*make(GetParam()), one, 12);
    const State other_alone = after(*make("gl_fragment_implicit:mask=none"), other, 12);

    const auto first = make(GetParam());
    auto second = make("gl_fragment_implicit:mask=none");
    first->upload(one, random_state(one, 0.05, 3));
    second->upload(other, random_state(other, 0.05, 3));
    for (int n = 0; n < 6; ++n) {
        first->step(1);
        second->step(2);
    }
    expect_same_bits(second->download(), other_alone);
    second.reset();
    first->step(6);
    expect_same_bits(first->download(), alone);
}

TEST_P(GlFragment, DegenerateSpringsFollowTheReference) {
    // A row of three particles whose ends coincide with the middle, and three particles without a spring.
    Problem problem = make_lattice_problem(
        make_grid({9, 1, 1}, [](int x, int, int) { return x < 3 || x % 2 == 0; }), FACE_BITS);
    problem.time_step = 0.25;
    problem.gravity = {0, 0, -1e-3};
    State state = state_at_rest(problem);
    state.displacement[0] = {1, 0, 0};
    std::vector<Problem> problems = {problem};
    if (lists) {
        // One spring has rest length zero, another gets none.
        problem.springs = {{3, 4, 0.1, 0}, {4, 5, 0.1, 2}};
        problem.rest_position[3] = problem.rest_position[4];
        problems.push_back(problem);
    }
    for (const Problem& p : problems) {
        const auto run = [&](Backend& backend) { return stepped(backend, p, state, 10); };
        const Comparison comparison =
            compare(p, run(*make(GetParam())), run(*BackendSpec::parse("cpu_reference").make()),
                    Precision::float32, 10);
        EXPECT_TRUE(comparison.passed()) << comparison.reason;
    }
}

/// `arms` particles around one, each joined to it by a spring; on no grid.
Problem star(std::uint32_t arms) {
    Problem problem;
    problem.rest_position.assign(arms + 1, glm::dvec3(0));
    for (std::uint32_t i = 1; i <= arms; ++i) {
        const double angle = 2 * 3.14159265358979 * i / arms;
        problem.rest_position[i] = {std::cos(angle), std::sin(angle), 0.1 * i / arms};
        problem.springs.push_back({0, i, 1.0 + 0.5 * i / arms, 0.9});
    }
    problem.time_step = 0.1;
    return problem;
}

TEST_F(Gl, GridBeyondTheTextureLimitIsUnsupported) {
    const auto backend = make("gl_fragment_implicit");
    Problem problem;
    for (const glm::ivec3 dims : {glm::ivec3(1 << 20, 1, 1), glm::ivec3(1, 1 << 20, 1),
                                  glm::ivec3(1 << 15, 1 << 15, 2), glm::ivec3(1 << 12, 1 << 12, 1 << 10)}) {
        problem.lattice.dims = dims;
        EXPECT_THAT(backend->unsupported(problem),
                    AllOf(HasSubstr("grid of " + std::to_string(dims.x) + " x " + std::to_string(dims.y)),
                          HasSubstr("exceeds the texture limit of ")));
    }
    problem.lattice.dims = {1, 1, 1 << 20};  // slices fold into rows
    EXPECT_THAT(backend->unsupported(problem), IsEmpty());
    problem.lattice.dims = {1 << 7, 1 << 7, 1 << 14};  // 4 GiB per texture
    if (software_) {
        EXPECT_THAT(backend->unsupported(problem), HasSubstr("more bytes than the driver allows"));
    }
}

TEST_F(Gl, SlicesInSeveralColumnsFollowTheReference) {
    // 80000 rows of voxels exceed a texture's height, so that slices also lie side by side.
    Problem problem = make_lattice_problem(random_grid({2, 16, 5000}, 0.8, 5), NEIGHBOUR_BITS);
    problem.gravity = {8e-4, 0, -2e-3};
    problem.time_step = 0.2;
    const int steps = 3;
    const State reference = after(*BackendSpec::parse("cpu_reference").make(), problem, steps);
    const auto backend = make("gl_fragment_implicit");
    ASSERT_THAT(backend->unsupported(problem), IsEmpty());
    const Comparison comparison =
        compare(problem, after(*backend, problem, steps), reference, Precision::float32, steps);
    EXPECT_TRUE(comparison.passed()) << comparison.reason;
    EXPECT_LE(double(backend->texels(0).size()), 1.01 * double(problem.lattice.voxel_count()));
}

TEST_F(Gl, SpringsBeyondTheGridNeedExplicitAddressing) {
    const auto implicit = make("gl_fragment_implicit");
    const auto explicit_lists = make("gl_fragment_explicit");
    Problem sutured = plain_problem();
    sutured.springs.push_back({0, std::uint32_t(sutured.particle_count() - 1), 0.1, 3});
    EXPECT_THAT(implicit->unsupported(sutured), HasSubstr("needs neighbour lists"));
    EXPECT_THAT(implicit->unsupported(star(5)), HasSubstr("needs a lattice"));
    EXPECT_THAT(explicit_lists->unsupported(sutured), IsEmpty());
    EXPECT_THAT(explicit_lists->unsupported(star(5)), IsEmpty());
    EXPECT_THAT(explicit_lists->unsupported(star(100000)),
                AllOf(HasSubstr("100000 springs"), HasSubstr("texture layers")));
}

// --- Compute shaders -----------------------------------------------------------------------------------

TEST_F(Gl, PositionsBeyondAStorageBufferAreRefused) {
    const gl::Context context;
    const GLint64 most = context.max_storage_block_size();
    const auto backend = BackendSpec::parse("gl_compute_implicit").make();
    Problem problem;
    // The maximum number of slices of 1024 voxels, beside the guard words, which take a slice and a row on
    // either side.
    const int slices = int(std::min<GLint64>(most / 16 / 1024, 1 << 20));
    problem.lattice.dims = {32, 32, slices - 4};
    EXPECT_THAT(backend->unsupported(problem), IsEmpty());
    problem.lattice.dims = {1024, 1024, slices / 1024};
    EXPECT_THAT(backend->unsupported(problem),
                AllOf(HasSubstr("positions of "), HasSubstr("exceed the " + std::to_string(most))));
}

TEST_F(Gl, ListsBeyondAStorageBufferAreRefused) {
    const gl::Context context;
    const auto backend = BackendSpec::parse("gl_compute_explicit").make();
    // One particle has so many springs that every particle's list becomes too long.
    const Problem problem = star(30000);
    const std::string why = backend->unsupported(problem);
    EXPECT_THAT(why, AllOf(HasSubstr("neighbour lists of "),
                           HasSubstr("exceed the " + std::to_string(context.max_storage_block_size()))));
    if (software_) {
        EXPECT_THAT(backend->unsupported(star(1000)), IsEmpty());
    }
}

TEST_F(Gl, TilesBeyondSharedMemoryAreRefused) {
    const gl::Context context;
    const auto backend =
        BackendSpec::parse("gl_compute_implicit:formulation=compensated,tile=shared,block=128x1x1").make();
    // Three rows of three slices of 130 particles, six numbers each.
    const int needed = 130 * 9 * 6 * 4;
    if (context.max_shared_memory() >= needed) {
        EXPECT_THAT(backend->unsupported(plain_problem()), IsEmpty());
    } else {
        EXPECT_THAT(
            backend->unsupported(plain_problem()),
            AllOf(HasSubstr(std::to_string(needed)), HasSubstr(std::to_string(context.max_shared_memory()))));
    }
}

TEST_F(Gl, ErrorsSurfaceAtTheNextCheck) {
    const gl::Context context;
    EXPECT_NO_THROW(context.check("testing"));
    glEnable(GL_RGBA32F);  // an enum that is no capability
    EXPECT_THAT(message_of<DeviceError>([&] { context.check("testing"); }),
                AllOf(HasSubstr("GL_INVALID_ENUM"), HasSubstr("while testing")));
    EXPECT_NO_THROW(context.check("testing"));
    const int limit = context.max_texture_size();
    EXPECT_FALSE(gl::fits(gl::rgba32f, {limit + 1, 1}));
    EXPECT_THROW(gl::make_texture(context, gl::rgba32f, {limit + 1, 1}, nullptr), DeviceError);
}

// --- The shader loader --------------------------------------------------------------------------------

std::string reason_of_loading(const std::string& file, const gl::Files& files) {
    return message_of<DeviceError>([&] { gl::load_source(file, {}, files); });
}

TEST(ShaderLoader, WritesVersionDefinesAndIncludesOnce) {
    const gl::Source source = gl::load_source(
        "a", {{"TERM", "1"}},
        {{"a", "#include \"b\"\n#include <cmath>\nint a;\n#include \"b\"\n"}, {"b", "int b;\n"}});
    EXPECT_EQ(source.text, "#version 450 core\n#define VOXSPRING_GLSL\n#define TERM 1\nint b;\nint a;\n");
    EXPECT_EQ(source.origin, (std::vector<std::string>{"", "", "", "b:1", "a:3"}));
}

TEST(ShaderLoader, NamesTheFileItCannotInclude) {
    EXPECT_THAT(reason_of_loading("nowhere.frag", {}), HasSubstr("no shader 'nowhere.frag'"));
    EXPECT_THAT(reason_of_loading("a.frag", {{"a.frag", "\n\n#include \"b.glsl\"\n"}}),
                HasSubstr("a.frag:3: no file to include: 'b.glsl'"));
}

TEST_F(Gl, CompileErrorsNameFileAndLineAndLinkErrorsAreErrors) {
    const gl::Context context;
    const gl::Files files{
        {"outer.frag", "#include \"inner.glsl\"\nvoid main() {}\n"},
        {"inner.glsl", "float right;\n\nfloat wrong = nonsense;\n"},
        {"lone.frag", "float undefined();\nout vec4 c;\nvoid main() { c = vec4(undefined()); }\n"}};
    const auto link = [&](const char* fragments) {
        gl::Program(context, gl::load_source("full_screen.vert", {}), gl::load_source(fragments, {}, files));
    };
    EXPECT_THAT(message_of<DeviceError>([&] { link("outer.frag"); }),
                AllOf(HasSubstr("outer.frag does not compile"), HasSubstr("inner.glsl:3")));
    EXPECT_NO_THROW(context.check("testing")) << "a compile error is told once";
    EXPECT_THROW(link("lone.frag"), DeviceError);
}

// --- No OpenGL ----------------------------------------------------------------------------------------

TEST(NoGl, AMissingDriverIsASkipAndNoCrash) {
    // It needs a fresh process, since this one may have loaded a driver already.
    GTEST_FLAG_SET(death_test_style, "threadsafe");
    EXPECT_EXIT(
        {
            setenv("__EGL_VENDOR_LIBRARY_DIRS", "/nonexistent", 1);
            setenv("__EGL_VENDOR_LIBRARY_FILENAMES", "/nonexistent.json", 1);
            try {
                BackendSpec::parse("gl_fragment_implicit").make();
            } catch (const Unavailable& absent) {
                std::fprintf(stderr, "Unavailable: %s\n", absent.what());
                std::exit(0);
            }
            std::exit(1);
        },
        ::testing::ExitedWithCode(0), "Unavailable: no OpenGL");
}

// --- Large runs and large problems -----------------------------------------------------------------------

TEST_F(Gl, TexturesAreReadInBandsOfWhichACallCanSayTheSize) {
    // 2^27 texels of 16 bytes are one byte more than a GLsizei holds.
    for (const int width : {1, 100, 8192, 16384, 32768}) {
        const std::int64_t rows = gl::rows_of_a_read(gl::rgba32f, width);
        EXPECT_LE(rows * width * gl::rgba32f.bytes, std::numeric_limits<GLsizei>::max());
        EXPECT_GT((rows + 1) * width * gl::rgba32f.bytes, std::numeric_limits<GLsizei>::max());
    }
    const gl::Context context;
    const glm::ivec2 size(5, 7);
    std::vector<glm::vec4> written;
    for (int i = 0; i < size.x * size.y; ++i) written.push_back({i, -i, 0.5 * i, 1});
    const gl::Texture texture = gl::make_texture(context, gl::rgba32f, size, written.data());
    for (const int rows : {1, 3, 7, 100}) {
        std::vector<glm::vec4> read(written.size() + 1, glm::vec4(-1));
        gl::read_texture(texture, gl::rgba32f, size, read.data(), rows);
        context.check("reading");
        EXPECT_EQ(read.back(), glm::vec4(-1));
        read.pop_back();
        EXPECT_EQ(read, written) << rows;
    }
}

TEST_F(Gl, NoMoreStepsAreQueuedThanTheQueueHolds) {
    const Problem problem = make_lattice_problem(solid({2, 2, 2}), FACE_BITS);
    const auto backend = BackendSpec::parse("gl_compute_implicit").make();
    backend->upload(problem, random_state(problem, 0.05, 3));
    const int steps = gl::StepQueue::steps_per_fence;
    const int fences = int(gl::StepQueue::max_fences);
    backend->step((fences + 1) * steps);  // libepoxy then has looked up the replaced functions
    // Counts the fences that are enqueued and not waited for.
    static int now, most, all;
    now = most = all = 0;
    static const auto fence = glFenceSync;
    static const auto wait = glClientWaitSync;
    const Replaced counts(glFenceSync, [](GLenum condition, GLbitfield flags) {
        most = std::max(most, ++now);
        ++all;
        return fence(condition, flags);
    });
    const Replaced counts_less(glClientWaitSync, [](GLsync sync, GLbitfield flags, GLuint64 timeout) {
        --now;
        return wait(sync, flags, timeout);
    });
    backend->step(2 * steps);
    EXPECT_EQ(all, 2);
    // Each older fence was waited for as well, so that at most one is open.
    EXPECT_LE(most, 1);
    EXPECT_EQ(now, 0);
    backend->synchronize();
}

// A step overwrites what the check before it reads, and the next check overwrites the number that this check
// writes.
TEST_F(Gl, AStepWaitsForTheCheckBeforeIt) {
    // 'd' for a dispatch or draw, 'b' for a barrier before further writes of shaders.
    static std::string order;
    const Problem problem = plain_problem();
    for (const auto& [name, step] :
         {std::pair{"gl_compute_implicit", "db"}, std::pair{"gl_compute_explicit", "db"},
          std::pair{"gl_fragment_implicit", "d"}, std::pair{"gl_fragment_explicit", "d"}}) {
        SCOPED_TRACE(name);
        const auto backend = BackendSpec::parse(name).make();
        backend->monitor({.largest_increment = 1, .every = 1});
        backend->upload(problem, random_state(problem, 0.05, 3));
        backend->step(1);  // libepoxy then has looked up the replaced functions
        static PFNGLDISPATCHCOMPUTEPROC dispatch;
        static PFNGLDRAWARRAYSPROC draw;
        static PFNGLMEMORYBARRIERPROC barrier;
        dispatch = glDispatchCompute;
        draw = glDrawArrays;
        barrier = glMemoryBarrier;
        order.clear();
        const Replaced dispatches(glDispatchCompute, [](GLuint x, GLuint y, GLuint z) {
            order += 'd';
            dispatch(x, y, z);
        });
        const Replaced draws(glDrawArrays, [](GLenum mode, GLint first, GLsizei count) {
            order += 'd';
            draw(mode, first, count);
        });
        const Replaced barriers(glMemoryBarrier, [](GLbitfield bits) {
            if ((bits & GL_SHADER_STORAGE_BARRIER_BIT) != 0) order += 'b';
            barrier(bits);
        });
        backend->step(2);
        const std::string step_and_check = std::string(step) + "db";
        EXPECT_EQ(order, step_and_check + step_and_check);
        backend->synchronize();
    }
}

// The fourth component of a word is normal in float64 as well: hardware may flush subnormal numbers to zero.
TEST(GlWords, HaveAnExponentInFloat64) {
    EXPECT_THAT(gl::load_source("divergence_check.comp", {{"STORAGE_BUFFERS", ""}}).text,
                HasSubstr("packDouble2x32(uvec2(bits, 0x3FF00000u))"));
    static_assert(layout::upper_half_of_one == 0x3FF00000U);
}

TEST(WorkGroups, AreRefusedBeyondWhatADeviceAllows) {
    const glsl::WorkGroupLimits limits{128, {128, 64, 4}};
    EXPECT_EQ(glsl::work_group_refusal({32, 4, 1}, limits), "");
    EXPECT_THAT(glsl::work_group_refusal({64, 4, 1}, limits),
                AllOf(HasSubstr("256 invocations"), HasSubstr("the 128")));
    EXPECT_THAT(glsl::work_group_refusal({1, 128, 1}, limits),
                AllOf(HasSubstr("128 invocations along y"), HasSubstr("the 64")));
    EXPECT_THAT(glsl::work_group_refusal({1, 1, 8}, limits), HasSubstr("8 invocations along z"));
    // One work group more along an axis than every driver accepts.
    Lattice lattice;
    lattice.dims = {1, 1, 65535};
    EXPECT_EQ(glsl::too_long(lattice, {64, 4, 1}), "");
    lattice.dims.z = 65536;
    EXPECT_THAT(glsl::too_long(lattice, {64, 4, 1}), HasSubstr("65536 work groups along z"));
    EXPECT_EQ(glsl::too_long(lattice, {32, 4, 2}), "");
}

TEST(GlMemory, IsRefusedWhereFewerBytesAreFreeThanAnUploadTakes) {
    EXPECT_EQ(glsl::memory_refusal(1000, 0, std::nullopt), "");
    EXPECT_EQ(glsl::memory_refusal(1000, 0, 1000), "");
    EXPECT_EQ(glsl::memory_refusal(1000, 600, 400), "");
    EXPECT_THAT(glsl::memory_refusal(1000, 599, 400),
                AllOf(HasSubstr("1000 bytes"), HasSubstr("999 are free")));
}

/// Returns action(), while new contexts have a driver that tells its free memory, as NVIDIA's or AMD's does.
/// A context must have called both functions before, because libepoxy looks them up at their first call.
template <class Action>
std::string with_memory_told(const char* its_extension, GLenum its_query, GLint free_kilobytes,
                             const Action& action) {
    static const char* extension;
    static GLenum query;
    static GLint kilobytes;
    static const auto integer = glGetIntegerv;
    static const auto string = glGetStringi;
    extension = its_extension;
    query = its_query;
    kilobytes = free_kilobytes;
    const Replaced tells(glGetIntegerv, [](GLenum asked, GLint* value) {
        if (asked == query) {
            *value = kilobytes;
        } else {
            integer(asked, value);
        }
    });
    const Replaced offers(glGetStringi, [](GLenum asked, GLuint index) {
        if (asked == GL_EXTENSIONS && index == 0) return reinterpret_cast<const GLubyte*>(extension);
        return string(asked, index);
    });
    return action();
}

TEST_F(Gl, ProblemsThatExceedFreeMemoryAreRefused) {
    const Problem problem = make_lattice_problem(solid({32, 32, 32}), FACE_BITS);
    for (const std::string name :
         {"gl_compute_implicit", "gl_compute_explicit", "gl_fragment_implicit", "gl_fragment_explicit"}) {
        SCOPED_TRACE(name);
        // libepoxy looks functions up at their first call.
        const BackendSpec spec = BackendSpec::parse(name);
        const auto first = spec.make();
        EXPECT_EQ(first->unsupported(problem), "");
        (void)glGetStringi(GL_EXTENSIONS, 0);
        const auto needed = GLint((spec.entry->bytes(problem, spec.options) + 1023) / 1024);
        const auto refusal = [&](const char* extension, GLenum query, GLint free_kilobytes) {
            return with_memory_told(extension, query, free_kilobytes,
                                    [&] { return spec.make()->unsupported(problem); });
        };
        EXPECT_THAT(
            refusal("GL_NVX_gpu_memory_info", GL_GPU_MEMORY_INFO_CURRENT_AVAILABLE_VIDMEM_NVX, needed - 1),
            HasSubstr("bytes of device memory"));
        EXPECT_THAT(refusal("GL_ATI_meminfo", GL_TEXTURE_FREE_MEMORY_ATI, needed - 1),
                    HasSubstr("bytes of device memory"));
        EXPECT_EQ(refusal("GL_ATI_meminfo", GL_TEXTURE_FREE_MEMORY_ATI, needed), "");
    }
}

// The next upload frees the lists, which are larger than those that the upload before the edit made.
TEST_F(Gl, ListsThatAnEditMakesAnewCountAsMemoryToFree) {
    const Problem problem = make_lattice_problem(solid({16, 16, 16}), FACE_BITS);
    Problem edited = problem;
    const std::vector<std::pair<std::uint32_t, std::uint32_t>> pairs = {
        {0, 100}, {0, 200}, {0, 300}, {0, 400}};
    const SpringEdit edit = SpringEditor(edited).suture(pairs);
    for (const std::string name : {"gl_compute_explicit", "gl_fragment_explicit"}) {
        SCOPED_TRACE(name);
        const BackendSpec spec = BackendSpec::parse(name);
        const auto first = spec.make();
        EXPECT_EQ(first->unsupported(edited), "");
        (void)glGetStringi(GL_EXTENSIONS, 0);
        const std::string refused = with_memory_told("GL_ATI_meminfo", GL_TEXTURE_FREE_MEMORY_ATI, 0, [&] {
            const auto backend = spec.make();
            backend->upload(problem, state_at_rest(problem));
            EXPECT_EQ(backend->unsupported(problem), "");
            EXPECT_THAT(backend->unsupported(edited), HasSubstr("bytes of device memory"));
            backend->edit(edited, edit);
            return backend->unsupported(edited);
        });
        EXPECT_EQ(refused, "");
    }
}

}  // namespace
}  // namespace voxspring::testing
