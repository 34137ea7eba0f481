#include "cuda/device/compiler.h"

#include <dlfcn.h>
#include <elf.h>
#include <fmt/format.h>
#include <link.h>

#include <algorithm>
#include <bit>
#include <chrono>
#include <cstddef>
#include <cstring>
#include <filesystem>
#include <memory>
#include <source_location>
#include <string_view>
#include <vector>

#include "backends/backend.h"
#include "backends/disk_cache.h"
#include "cuda/device/nvrtc.h"
#include "embedded_kernels.h"  // generated

namespace voxspring::cuda {
namespace {

using namespace std::literals;

const Nvrtc& nvrtc() { return Nvrtc::load(); }

void check(nvrtcResult result, const std::source_location& where = std::source_location::current()) {
    if (result != NVRTC_SUCCESS)
        throw DeviceError(std::string("NVRTC: ") + nvrtc().GetErrorString(result) +
                          " (compiler.cpp:" + std::to_string(where.line()) + ")");
}

/// The parts of the standard library that kernels use: NVRTC has no headers of that library.
const std::map<std::string, std::string> standard_headers = {
    {"cstddef", "namespace std { using size_t = decltype(sizeof(0)); using ptrdiff_t = long; }"},
    {"cstdint",
     "namespace std { using uint8_t = unsigned char; using uint16_t = unsigned short; using int32_t = int; "
     "using uint32_t = unsigned; using uint64_t = unsigned long; }"},
    {"cfloat", "#define FLT_MIN 1.17549435e-38F\n#define DBL_MIN 2.2250738585072014e-308"},
    {"cmath",
     "namespace std {\n"
     "__device__ inline float fma(float a, float b, float c) { return __fmaf_rn(a, b, c); }\n"
     "__device__ inline double fma(double a, double b, double c) { return __fma_rn(a, b, c); }\n"
     "__device__ inline float sqrt(float a) { return __fsqrt_rn(a); }\n"
     "__device__ inline double sqrt(double a) { return __dsqrt_rn(a); }\n"
     "}"},
    {"type_traits",
     "namespace std {\n"
     "template <bool, class A, class> struct conditional { using type = A; };\n"
     "template <class A, class B> struct conditional<false, A, B> { using type = B; };\n"
     "template <bool b, class A, class B> using conditional_t = typename conditional<b, A, B>::type;\n"
     "}"}};

/// The text of every header that a kernel may include, by its name in the #include.
std::map<std::string, std::string> headers() {
    std::map<std::string, std::string> all;
    for (const auto& [name, text] : standard_headers) all.emplace(name, "#pragma once\n" + text);
    for (const auto& [path, text] : embedded_kernels) {
        all.emplace(path, text);
        // Headers that shaders include too, such as backends/physics/spring.h, include this header by its
        // bare name.
        if (path == "backends/physics/portable.h") all.emplace("portable.h", text);
    }
    return all;
}

class Program {
public:
    Program(const std::string& text, const std::string& name,
            const std::map<std::string, std::string>& headers) {
        std::vector<const char*> texts, names;
        for (const auto& [header, content] : headers) {
            names.push_back(header.c_str());
            texts.push_back(content.c_str());
        }
        check(nvrtc().CreateProgram(&program_, text.c_str(), name.c_str(), int(names.size()), texts.data(),
                                    names.data()));
    }
    Program(const Program&) = delete;
    Program& operator=(const Program&) = delete;
    ~Program() { nvrtc().DestroyProgram(&program_); }

    /// An output of NVRTC for this program. `get_size`, `get_text`: NVRTC's two functions for that output.
    std::string take(nvrtcResult (*get_size)(nvrtcProgram, std::size_t*),
                     nvrtcResult (*get_text)(nvrtcProgram, char*)) const {
        std::size_t size = 0;
        check(get_size(program_, &size));
        std::string text(size, '\0');
        check(get_text(program_, text.data()));
        return text;
    }
    nvrtcProgram get() const { return program_; }

private:
    nvrtcProgram program_ = nullptr;
};

/// Compute capabilities that NVRTC compiles for, ascending.
std::vector<int> known_architectures() {
    int count = 0;
    check(nvrtc().GetNumSupportedArchs(&count));
    std::vector<int> known(std::size_t(count), 0);
    check(nvrtc().GetSupportedArchs(known.data()));
    return known;
}

/// The architecture to compile for, if the card is of `architecture`. The bool says whether the two are
/// equal: then NVRTC makes machine code. Otherwise it makes PTX, which the driver compiles for the card.
std::pair<int, bool> nearest(int architecture) {
    const std::vector<int> known = known_architectures();
    if (std::find(known.begin(), known.end(), architecture) != known.end()) return {architecture, true};
    // Take the newest architecture that is older than the card: a driver can compile its PTX for the card.
    int best = 0;
    for (const int a : known) best = a <= architecture ? std::max(best, a) : best;
    if (best == 0)
        throw DeviceError("the card has compute capability " + version_of(architecture) +
                          ", but NVRTC compiles only for " + version_of(known.front()) + " and later");
    return {best, false};
}

/// The build id of an ELF file that is loaded, in hexadecimal digits; empty if it has none.
std::string build_id(const dl_phdr_info& file) {
    for (int n = 0; n < file.dlpi_phnum; ++n) {
        const auto& part = file.dlpi_phdr[n];
        if (part.p_type != PT_NOTE) continue;
        const char* at = std::bit_cast<const char*>(file.dlpi_addr + part.p_vaddr);
        const char* const end = at + part.p_memsz;
        while (end - at >= std::ptrdiff_t(sizeof(ElfW(Nhdr)))) {
            ElfW(Nhdr) note{};
            std::memcpy(&note, at, sizeof note);
            const auto aligned = [](std::size_t size) { return (size + 3) / 4 * 4; };
            const char* const name = at + sizeof note;
            const char* const content = name + aligned(note.n_namesz);
            if (note.n_type == NT_GNU_BUILD_ID && std::string_view(name, note.n_namesz) == "GNU\0"sv) {
                std::string digits;
                for (const char byte : std::string_view(content, note.n_descsz))
                    digits += fmt::format("{:02x}", static_cast<unsigned char>(byte));
                return digits;
            }
            at = content + aligned(note.n_descsz);
        }
    }
    return {};
}

/// NVRTC's options. With `moves_registers` the target has the suffix "a" ("sm_90a"), which allows setmaxnreg.
/// NVRTC must not fuse multiplications and additions: only the source says which are fused.
std::vector<std::string> options_for(int architecture, bool moves_registers) {
    const auto [target, exact] = nearest(architecture);
    return {std::string("--gpu-architecture=") + (exact ? "sm_" : "compute_") + std::to_string(target) +
                (moves_registers ? "a" : ""),
            "--std=c++20", "--fmad=false", "--extra-device-vectorization"};
}

}  // namespace

const std::string& compiler_build() {
    static const std::string build = [] {
        int major = 0, minor = 0;
        check(nvrtc().Version(&major, &minor));
        std::string text = std::to_string(major) + "." + std::to_string(minor) + " ";
        // NVRTC does not tell its patch level, but the build id of its library differs between patch levels.
        Dl_info library{};
        if (dladdr(reinterpret_cast<const void*>(nvrtc().Version), &library) == 0) return text;
        struct Search {
            const void* base;
            std::string id;
        } search{library.dli_fbase, {}};
        dl_iterate_phdr(
            [](dl_phdr_info* file, std::size_t, void* found) {
                auto& wanted = *static_cast<Search*>(found);
                if (std::bit_cast<const void*>(file->dlpi_addr) != wanted.base) return 0;
                wanted.id = build_id(*file);
                return 1;
            },
            &search);
        return text + search.id;
    }();
    return build;
}

std::string version_of(int architecture) {
    return std::to_string(architecture / 10) + "." + std::to_string(architecture % 10);
}

int oldest_architecture() { return std::max(75, known_architectures().front()); }

bool moves_registers(int architecture) { return architecture >= 90 && nearest(architecture).second; }

std::string compiler_and_options(int architecture) {
    std::string text = "NVRTC " + compiler_build();
    for (const std::string& option : options_for(architecture, false)) text += " " + option;
    return text;
}

CompiledKernel compile(const KernelSource& source, int architecture) {
    const bool exact = nearest(architecture).second;
    const std::string name = "cuda/kernels/" + source.file;
    std::vector<std::string> options = options_for(architecture, source.moves_registers);
    for (const auto& [macro, value] : source.macros)
        options.push_back("--define-macro=" + macro + "=" + value);

    static const auto all_headers = headers();
    Hash inputs;
    inputs.add("seconds and code");
    inputs.add(compiler_build());
    inputs.add(name);
    for (const auto& [header, content] : all_headers) {
        inputs.add(header);
        inputs.add(content);
    }
    inputs.add(embedded_kernels.at(name));
    for (const std::string& option : options) inputs.add(option);
    const std::filesystem::path user = DiskCache::folder_of_user();
    constexpr std::uint64_t max_bytes = std::uint64_t(256) << 20;
    const DiskCache cache(user.empty() ? user : user / "kernels", max_bytes);
    const std::string key = inputs.text();
    CompiledKernel compiled;
    constexpr std::size_t head = sizeof compiled.seconds;  // an entry on disk begins with `seconds`
    if (const auto kept = cache.find(key); kept && kept->size() > head) {
        std::memcpy(&compiled.seconds, kept->data(), head);
        compiled.code = kept->substr(head);
        compiled.found = true;
        return compiled;
    }

    using Clock = std::chrono::steady_clock;
    const auto begin = Clock::now();
    std::vector<const char*> arguments;
    for (const std::string& option : options) arguments.push_back(option.c_str());
    // Recent versions of NVRTC also cache what they compiled, in ~/.nv. A start without this program's cache
    // would then find its kernels compiled, and be timed as a cold one.
    arguments.push_back("--no-cache");
    std::unique_ptr<Program> program;
    const auto result_of_compiling = [&] {
        program = std::make_unique<Program>(std::string(embedded_kernels.at(name)), name, all_headers);
        return nvrtc().CompileProgram(program->get(), int(arguments.size()), arguments.data());
    };
    nvrtcResult result = result_of_compiling();
    if (result == NVRTC_ERROR_INVALID_OPTION) {  // an older version, which has no cache
        arguments.pop_back();
        result = result_of_compiling();
    }
    if (result != NVRTC_SUCCESS)
        throw DeviceError("NVRTC: " + program->take(nvrtc().GetProgramLogSize, nvrtc().GetProgramLog));
    compiled.code = exact ? program->take(nvrtc().GetCUBINSize, nvrtc().GetCUBIN)
                          : program->take(nvrtc().GetPTXSize, nvrtc().GetPTX);
    compiled.seconds = std::chrono::duration<double>(Clock::now() - begin).count();
    std::string kept(head, '\0');
    std::memcpy(kept.data(), &compiled.seconds, head);
    cache.keep(key, kept + compiled.code);
    return compiled;
}

}  // namespace voxspring::cuda
