#include "cuda/common/edit.h"

#include <cstring>

namespace voxspring::cuda {
namespace {

template <class Argument>
void send_in_words(const Kernel& kernel, std::byte* to, std::span<const std::byte> from, unsigned words,
                   const Stream& stream) {
    Argument argument{};
    std::memcpy(&argument, from.data(), from.size());
    auto* const first = reinterpret_cast<ArgumentWord*>(to);
    constexpr auto threads = unsigned(sizeof(Argument) / sizeof(ArgumentWord));
    kernel.launch(stream, dim3(1), dim3(threads), 0, argument, words, first);
}

}  // namespace

void send_as_argument(std::byte* to, std::span<const std::byte> from, const Stream& stream) {
    // A launch with a shorter argument is cheaper. Both kernels have the same code in float32 and float64.
    const SupportKernels& kernels = any_support_kernels();
    const auto words = unsigned((from.size() + sizeof(ArgumentWord) - 1) / sizeof(ArgumentWord));
    if (from.size() <= sizeof(ShortArgument)) {
        send_in_words<ShortArgument>(*kernels.write_short_argument, to, from, words, stream);
    } else {
        send_in_words<LongArgument>(*kernels.write_long_argument, to, from, words, stream);
    }
}

}  // namespace voxspring::cuda
