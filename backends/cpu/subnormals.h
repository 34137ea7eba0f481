// Arithmetic without subnormal numbers, which many processors compute in microcode, some 100 cycles each.
#pragma once

#include <cstdint>

#if defined(__SSE__)
#include <xmmintrin.h>
#endif

namespace voxspring {

/// If `flush`, from construction to destruction the constructing thread computes with 0 in place of subnormal
/// operands and results: numbers closer to 0 than 1.2e-38 in float32 and 2.2e-308 in float64. Other threads
/// are not affected, and the destructor restores the setting from before. Does nothing on processors other
/// than x86-64 and AArch64.
class FlushSubnormals {
public:
    explicit FlushSubnormals(bool flush) : before_(control()) {
        if (flush) set_control(before_ | flush_bits);
    }
    ~FlushSubnormals() { set_control(before_); }
    FlushSubnormals(const FlushSubnormals&) = delete;
    FlushSubnormals& operator=(const FlushSubnormals&) = delete;

private:
#if defined(__SSE__)
    using Control = unsigned;
    static constexpr Control flush_bits = 0x8040;  ///< bits of MXCSR: FTZ for results, DAZ for operands
    static Control control() { return _mm_getcsr(); }
    static void set_control(Control control) { _mm_setcsr(control); }
#elif defined(__aarch64__)
    using Control = std::uint64_t;
    static constexpr Control flush_bits = 1U << 24U;  ///< bit FZ of FPCR, for results and operands
    static Control control() {
        Control control = 0;
        asm volatile("mrs %0, fpcr" : "=r"(control));
        return control;
    }
    static void set_control(Control control) { asm volatile("msr fpcr, %0" : : "r"(control) : "memory"); }
#else
    using Control = unsigned;
    static constexpr Control flush_bits = 0;
    static Control control() { return 0; }
    static void set_control(Control) {}
#endif

    const Control before_;
};

}  // namespace voxspring
