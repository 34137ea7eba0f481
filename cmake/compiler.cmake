# Options of every target of this project, and of no target beside it.
set(CMAKE_CXX_STANDARD 20)
set(CMAKE_CXX_STANDARD_REQUIRED ON)
set(CMAKE_CXX_EXTENSIONS OFF)

# With this setting ccache caches files that use a precompiled header, and the language of messages does not matter.
if(CMAKE_CXX_COMPILER_LAUNCHER MATCHES "ccache")
    list(PREPEND CMAKE_CXX_COMPILER_LAUNCHER ${CMAKE_COMMAND} -E env CCACHE_SLOPPINESS=pch_defines,time_macros,locale)
endif()

include_directories(${PROJECT_SOURCE_DIR} ${PROJECT_BINARY_DIR}/generated)
add_compile_options(-Wall -Wextra -Wpedantic -Wconversion -Wshadow -Wno-sign-conversion
    # GCC 12 wrongly reports overlapping copies in std::string operator+ (its bug 105651).
    $<$<CXX_COMPILER_ID:GNU>:-Wno-restrict>
    $<$<BOOL:${VOXSPRING_WERROR}>:-Werror>
    # Floating-point contraction is off unless a file asks for it: the bits of the reference must not depend on the compiler.
    -ffp-contract=off)

# Sources whose own speed does not matter compile in two thirds of the time. The presets with sanitizers use the build type None.
set(VOXSPRING_QUICK_COMPILE $<$<CONFIG:Release>:-O1> $<$<CONFIG:None>:-O0>)
