// What every strategy's backend shares: position buffers, per-particle arrays and the launch of a step.
#pragma once

#include <array>
#include <cstring>
#include <optional>

#include "cuda/cuda_backend.h"
#include "cuda/edit.h"
#include "cuda/fetch.cuh"
#include "cuda/layout.h"

namespace voxspring::cuda {

/// Fails unless the device can run `kernel`. Loads its code, which must not happen first in a capture.
template <class Kernel>
void load_kernel(Kernel kernel) {
    cudaFuncAttributes attributes{};
    check(cudaFuncGetAttributes(&attributes, kernel));
}

template <class... Parameters, class... Arguments>
void launch_kernel(const Stream& stream, void (*kernel)(Parameters...), dim3 grid, dim3 block,
                   const Arguments&... arguments) {
    cudaLaunchConfig_t config{};
    config.gridDim = grid;
    config.blockDim = block;
    config.stream = stream.get();
    check(cudaLaunchKernelEx(&config, kernel, arguments...));
}

/// Blocks of `block` threads for `count` of them.
inline unsigned blocks_for(std::size_t count, unsigned block) {
    return unsigned((count + block - 1) / block);
}

/// Bytes of the arrays that ParticleBackend keeps.
template <class Real>
std::uint64_t particle_bytes(const Problem& problem, std::size_t words) {
    return words * (2 * sizeof(Word<Real>) + (problem.load.empty() ? 0 : sizeof(Vector<Real>)) +
                    (problem.has_materials() ? sizeof(Real) : 0));
}

/// Empty, or why an array of `words` words cannot be indexed or, through a texture, fetched.
template <class Fetch>
std::string too_many_words(std::size_t words, const Device& device) {
    if (words > most_words)
        return std::to_string(words) + " words of positions exceed the index limit of " +
               std::to_string(most_words);
    const std::size_t texels = words * Fetch::texels_per_word;
    if (texels > device.most_texels())
        return std::to_string(texels) + " texels of positions exceed the device's limit of " +
               std::to_string(device.most_texels()) + " for a texture on linear memory";
    return {};
}

/// A backend with one kernel that reads all positions through Fetch and moves every particle by one step.
/// `Step` is that kernel's argument and has a member `motion`.
template <class Real, class Fetch, class Step>
class ParticleBackend : public CudaBackend {
public:
    State download() final {
        const Buffer<Word<Real>>& x = words_[std::size_t(current())];
        const Buffer<Word<Real>>& previous = words_[std::size_t(1 - current())];
        PackedState<Real> packed{std::vector<Word<Real>>(x.size()), std::vector<Word<Real>>(x.size())};
        x.download(packed.current, stream());
        previous.download(packed.previous, stream());
        return unpack(*problem_, packed, placement_);
    }

protected:
    using Kernel = void (*)(Step, Fetch, Word<Real>*);

    struct Launch {
        Kernel kernel = nullptr;
        dim3 grid, block;
        Step step;
    };

    /// Copies the state in and stands at step 0, ready to replay `launch`. `bits`: one a particle. Points the
    /// step's motion at the arrays kept here.
    void start(const Problem& problem, const State& state, const Placement& placement,
               std::span<const std::uint32_t> bits, Launch launch) {
        problem_ = &problem;
        placement_ = placement;
        bool changed = false;
        {
            const PackedState<Real> packed = pack<Real>(problem, state, placement, bits);
            changed = upload_words(0, packed.current) || changed;
            changed = upload_words(1, packed.previous) || changed;
        }
        load_.upload(pack_load<Real>(problem, placement), stream());
        inverse_masses_.upload(pack_inverse_masses<Real>(problem, placement), stream());
        launch.step.motion.load = load_.data();
        launch.step.motion.inverse_masses = inverse_masses_.data();
        rewind();
        replay(launch, changed);
    }

    /// Goes on with `launch`, whose motion points where the one before it did.
    void replay(const Launch& launch, bool words_moved = false) {
        const bool changed = words_moved || launch.kernel != launch_.kernel ||
                             !same(launch.grid, launch_.grid) || !same(launch.block, launch_.block) ||
                             !(launch.step == launch_.step);
        launch_ = launch;
        if (!changed) return;
        load_kernel(launch.kernel);
        capture();
    }
    const Launch& launch() const { return launch_; }

    /// From here on the particles have `edited`'s springs; the caller sees to it.
    void follow(const Problem& edited) { problem_ = &edited; }

    /// x(t) of every word.
    Word<Real>* current_words() const { return words_[std::size_t(current())].data(); }

    /// Gives particles new bits, which every step copies on from the buffer that it reads.
    void write_particle_bits(std::span<const std::uint32_t> particles, std::span<const std::uint32_t> bits) {
        std::vector<EditedWord> edited;
        edited.reserve(particles.size());
        for (std::size_t n = 0; n < particles.size(); ++n)
            edited.push_back({std::uint32_t(placement_.at(particles[n])), bits[n]});
        write_bits(current_words(), edited_words_.send(std::span<const EditedWord>(edited), stream()),
                   edited.size(), stream());
    }

    std::uint64_t particle_bytes_held() const {
        return words_[0].bytes() + words_[1].bytes() + load_.bytes() + inverse_masses_.bytes() +
               edited_words_.bytes();
    }

    Fetch reader(int buffer) const { return sources_[std::size_t(buffer)]->fetch(); }

    void enqueue_step(int reading) override {
        launch_kernel(stream(), launch_.kernel, launch_.grid, launch_.block, launch_.step, reader(reading),
                      words_[std::size_t(1 - reading)].data());
    }

private:
    static bool same(dim3 a, dim3 b) { return a.x == b.x && a.y == b.y && a.z == b.z; }

    // True if the words moved.
    bool upload_words(std::size_t buffer, const std::vector<Word<Real>>& words) {
        const bool moved = words_[buffer].size() != words.size();
        if (moved) sources_[buffer].reset();
        words_[buffer].upload(words, stream());
        if (moved) sources_[buffer].emplace(words_[buffer]);
        return moved;
    }

    const Problem* problem_ = nullptr;
    Placement placement_;
    std::array<Buffer<Word<Real>>, 2> words_;
    std::array<std::optional<typename Fetch::Source>, 2> sources_;
    Buffer<Vector<Real>> load_;
    Buffer<Real> inverse_masses_;
    Staging<EditedWord> edited_words_;
    Launch launch_{};
};

}  // namespace voxspring::cuda
