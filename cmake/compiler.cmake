# Options of every target of this project. They do not affect a surrounding project.
set(CMAKE_CXX_STANDARD 20)
set(CMAKE_CXX_STANDARD_REQUIRED ON)
set(CMAKE_CXX_EXTENSIONS OFF)

# With this setting ccache caches files that use a precompiled header, and the language of messages does not matter.
if(CMAKE_CXX_COMPILER_LAUNCHER MATCHES "ccache")
    list(PREPEND CMAKE_CXX_COMPILER_LAUNCHER ${CMAKE_COMMAND} -E env CCACHE_SLOPPINESS=pch_defines,time_macros,locale)
endif()

include_directories(${PROJECT_SOURCE_DIR} ${PROJECT_BINARY_DIR}/generated)
add_compile_options(-Wall -Wextra -Wpedantic -Wconversion -Wshadow -Wno-sign-conversion
    # GCC 12 wrongly reports copies of std::string as overlapping (its bug 105651), too long or out of bounds: the latter two where
    # the header is precompiled.
    "$<$<CXX_COMPILER_ID:GNU>:-Wno-restrict;-Wno-stringop-overflow;-Wno-stringop-overread;-Wno-array-bounds>"
    $<$<BOOL:${VOXSPRING_WERROR}>:-Werror>
    # Floating-point contraction is off unless a file asks for it: the bits of the reference must not depend on the compiler.
    -ffp-contract=off)

# For sources whose run time does not matter: less optimisation, with which they compile in two thirds of the time. The presets with
# sanitizers use the build type None.
set(VOXSPRING_QUICK_COMPILE $<$<CONFIG:Release>:-O1> $<$<CONFIG:None>:-O0>)

# Headers that most sources include. Each library but the viewer's precompiles them, which saves a sixth of the time of its compilation.
set(VOXSPRING_COMMON_HEADERS <glm/vec3.hpp> <algorithm> <array> <cmath> <filesystem> <functional> <map> <memory> <optional> <span>
    <sstream> <string> <vector>)
