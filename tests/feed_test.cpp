// Feeds: a backend puts the values that it downloads into a window's buffer, or into host memory. A headless
// context takes the place of the window.
#include "cuda/kernels/feed.h"

#include <gtest/gtest.h>

#include <glm/geometric.hpp>
#include <glm/vec4.hpp>
#include <limits>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "backends/gl/context.h"
#include "backends/gl/storage_buffer.h"
#include "backends/registry.h"
#include "tests/required.h"
#include "tests/support.h"

namespace voxspring::testing {
namespace {

/// Every third particle, and the last.
std::vector<std::uint32_t> some_of(const Problem& problem) {
    std::vector<std::uint32_t> some;
    for (std::uint32_t i = 0; i < problem.particle_count(); i += 3) some.push_back(i);
    if (some.back() + 1 != problem.particle_count())
        some.push_back(std::uint32_t(problem.particle_count() - 1));
    return some;
}

class Feeding : public ::testing::TestWithParam<std::string> {
protected:
    void SetUp() override {
        skip_without("gl", [&] { sharing_.emplace(window_.emplace()); });
        if (window_) make_or_skip(BackendSpec::parse(GetParam()), backend_);
    }

    std::optional<gl::Context> window_;
    std::optional<gl::Sharing> sharing_;
    std::unique_ptr<Backend> backend_;
};

void expect_displacements(std::span<const glm::vec4> seen, const std::vector<std::uint32_t>& some,
                          const State& state) {
    ASSERT_EQ(seen.size(), some.size());
    for (std::size_t n = 0; n < some.size(); ++n) {
        // If the state is a position, up to 8 here, the displacement has its float32 rounding.
        const double rounding = 8 * double(std::numeric_limits<float>::epsilon());
        EXPECT_LE(glm::distance(glm::dvec3(seen[n]), state.displacement[some[n]]), rounding) << some[n];
        EXPECT_EQ(seen[n].w, 0);
    }
}

INSTANTIATE_TEST_SUITE_P(, Feeding, ::testing::ValuesIn(in_every_formulation()), test_name);

TEST_P(Feeding, BringsWhatIsDownloaded) {
    Problem problem = make_lattice_problem(random_grid({7, 6, 5}, 0.8, 3), NEIGHBOUR_BITS);
    problem.time_step = 0.1;
    if (const std::string why = backend_->unsupported(problem); !why.empty()) GTEST_SKIP() << why;
    backend_->upload(problem, random_state(problem, 0.1, 4));
    const std::vector<std::uint32_t> some = some_of(problem);
    window_->make_current();
    gl::StorageBuffer buffer;
    buffer.upload(*window_, std::vector<glm::vec4>(some.size(), glm::vec4(7)));
    if (backend_->feeds() == nullptr) GTEST_SKIP() << "has no way but its whole state";
    const auto feed = backend_->feeds()->feed(some, buffer.get());
    const auto host_feed = backend_->feeds()->host_feed(some);
    // CUDA's backends have both feeds, or only the host feed if OpenGL is not on the card; OpenGL's backends
    // have only the feed into a buffer.
    const std::string family = backend_->capabilities().family;
    EXPECT_EQ(host_feed != nullptr, family == "cuda");
    if (!window_->capabilities().is_software || !host_feed) {
        EXPECT_NE(feed, nullptr);
    }
    // After one step, after none, and after an odd number, whichever array holds the state.
    for (const int steps : {0, 1, 4}) {
        SCOPED_TRACE(steps);
        backend_->step(steps);
        std::vector<glm::vec4> written(some.size());
        if (feed) {
            window_->make_current();
            feed->write();
            window_->make_current();
            buffer.download(written);
        }
        const std::span<const glm::vec4> brought = host_feed ? host_feed->read() : written;
        const State state = backend_->download();
        if (feed) expect_displacements(written, some, state);
        expect_displacements(brought, some, state);
    }
    // A feed changes no bit of the steps.
    const auto alone = BackendSpec::parse(GetParam()).make();
    alone->upload(problem, random_state(problem, 0.1, 4));
    alone->step(5);
    if (alone->capabilities().deterministic) {
        EXPECT_EQ(backend_->download().displacement, alone->download().displacement);
    }
}

TEST_P(Feeding, WithoutAWindowThereIsNone) {
    sharing_.reset();
    backend_ = BackendSpec::parse(GetParam()).make();
    Problem problem = make_lattice_problem(solid({3, 3, 3}), NEIGHBOUR_BITS);
    problem.time_step = 0.1;
    if (const std::string why = backend_->unsupported(problem); !why.empty()) GTEST_SKIP() << why;
    backend_->upload(problem, state_at_rest(problem));
    window_->make_current();
    gl::StorageBuffer buffer;
    buffer.upload(*window_, std::vector<glm::vec4>(problem.particle_count()));
    if (backend_->capabilities().family == "opengl") {
        EXPECT_EQ(backend_->feeds()->feed(some_of(problem), buffer.get()), nullptr);
    }
}

/// Runs the body of CUDA's kernel on a word.
TEST(FedDisplacementTest, IsThePlaceLessTheRestPosition) {
    using cuda::FedWord, cuda::Feeding, cuda::ParticleRecord, cuda::Vector;
    const std::vector<ParticleRecord<double>> words = {{}, {Vector<double>{3, 5, 7}, 9}};
    const std::vector<ParticleRecord<double>> low = {{}, {Vector<double>{0.25, 0, -0.5}, 0}};
    const FedWord<double> fed{.rest = {1, 2, 3}, .word = 1};
    const auto shown = [&](const ParticleRecord<double>* low_words) {
        const auto displaced = cuda::fed_displacement(
            Feeding<double>{.fed = &fed, .count = 1, .words = words.data(), .words_low = low_words}, 0);
        EXPECT_EQ(displaced.zero, 0);
        return displaced.displacement;
    };
    EXPECT_EQ(shown(nullptr), (Vector<float>{2, 3, 4}));
    EXPECT_EQ(shown(low.data()), (Vector<float>{2.25, 3, 3.5}));
}

}  // namespace
}  // namespace voxspring::testing
