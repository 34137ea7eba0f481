# Libraries that a build needs, and those that it can do without. Versions are the oldest that are tested: those of Debian 12.
set(voxspring_missing "")

# voxspring_needs(TARGET PACKAGE VERSION DEBIAN_NAME [OPTION OF find_package...]) finds the package that defines TARGET, or lists it
# as missing. A target that the surrounding project has defined is used as it is.
macro(voxspring_needs target package version debian)
    if(NOT TARGET ${target})
        find_package(${package} ${version} QUIET ${ARGN})
        if(NOT TARGET ${target})
            string(APPEND voxspring_missing "\n  ${package} ${version} or newer (Debian: ${debian})")
        endif()
    endif()
endmacro()

# voxspring_needs_pc(PREFIX MODULE VERSION DEBIAN_NAME) finds a library by its pkg-config file, or lists it as missing.
macro(voxspring_needs_pc prefix module version debian)
    pkg_check_modules(${prefix} QUIET IMPORTED_TARGET ${module}>=${version})
    if(NOT TARGET PkgConfig::${prefix})
        string(APPEND voxspring_missing "\n  ${module} ${version} or newer (Debian: ${debian})")
    endif()
endmacro()

voxspring_needs(nlohmann_json::nlohmann_json nlohmann_json 3.11 nlohmann-json3-dev)
voxspring_needs(CLI11::CLI11 CLI11 2.1 libcli11-dev)
voxspring_needs(glm::glm glm 0.9.9 libglm-dev)
voxspring_needs(benchmark::benchmark benchmark 1.7 libbenchmark-dev)
voxspring_needs(fmt::fmt fmt 9 libfmt-dev)
voxspring_needs(Eigen3::Eigen Eigen3 3.4 libeigen3-dev NO_MODULE)
voxspring_needs(OpenMP::OpenMP_CXX OpenMP 4.5 "g++, or libomp-14-dev for Clang" COMPONENTS CXX)
voxspring_needs(ZLIB::ZLIB ZLIB 1.2 zlib1g-dev)
voxspring_needs(BZip2::BZip2 BZip2 1.0 libbz2-dev)
voxspring_needs(PNG::PNG PNG 1.6 libpng-dev)
if(VOXSPRING_TESTS OR VOXSPRING_PACKAGE)
    voxspring_needs(GTest::gmock GTest 1.12 "libgtest-dev, libgmock-dev")
endif()
find_package(PkgConfig REQUIRED)
voxspring_needs_pc(EPOXY epoxy 1.5 libepoxy-dev)
voxspring_needs_pc(HWY libhwy 1.0 libhwy-dev)
voxspring_needs_pc(MINIZIP minizip 1.1 libminizip-dev)
# libnifti has neither a CMake nor a pkg-config file, and of xxhash only the header is used.
find_path(XXHASH_INCLUDE_DIR xxhash.h)
find_path(NIFTI_INCLUDE_DIR nifti/nifti2_io.h)
find_library(NIFTI_LIBRARY nifti2)
mark_as_advanced(XXHASH_INCLUDE_DIR NIFTI_INCLUDE_DIR NIFTI_LIBRARY)
if(NOT XXHASH_INCLUDE_DIR)
    string(APPEND voxspring_missing "\n  xxhash.h (Debian: libxxhash-dev)")
endif()
if(NOT NIFTI_INCLUDE_DIR OR NOT NIFTI_LIBRARY)
    string(APPEND voxspring_missing "\n  nifti2 (Debian: libnifti-dev)")
endif()
if(voxspring_missing)
    message(FATAL_ERROR "Voxspring needs these libraries, which were not found:${voxspring_missing}")
endif()
add_library(NIFTI::nifti UNKNOWN IMPORTED)
set_target_properties(NIFTI::nifti PROPERTIES IMPORTED_LOCATION ${NIFTI_LIBRARY}
    INTERFACE_INCLUDE_DIRECTORIES "${NIFTI_INCLUDE_DIR};${NIFTI_INCLUDE_DIR}/nifti")

# --- Optional features: VOXSPRING_NO_<FEATURE> says why a feature is left out, and is empty if it is built ---------
foreach(feature CUDA VULKAN MPI WINDOW)
    set(VOXSPRING_NO_${feature} "")
    if(NOT VOXSPRING_${feature})
        set(VOXSPRING_NO_${feature} "it was configured with VOXSPRING_${feature}=OFF")
    endif()
endforeach()

# voxspring_leave_out(FEATURE REASON CONDITION...): leaves the feature out for this reason if the condition holds.
macro(voxspring_leave_out feature reason)
    if((NOT VOXSPRING_NO_${feature}) AND (${ARGN}))
        set(VOXSPRING_NO_${feature} "${reason}")
    endif()
endmacro()

# CUDA: headers, the runtime and NVRTC, which compiles kernels at run time; no nvcc.
if(VOXSPRING_CUDA)
    find_package(CUDAToolkit QUIET)
    voxspring_leave_out(CUDA "no CUDA toolkit (headers, cudart_static, NVRTC) was found when it was configured"
        NOT TARGET CUDA::cudart_static OR NOT TARGET CUDA::nvrtc)
endif()

# Vulkan: headers and a compiler of shaders. The loader, if present, is opened at run time.
if(VOXSPRING_VULKAN)
    find_path(VULKAN_INCLUDE_DIR vulkan/vulkan_raii.hpp)
    find_program(GLSLANG_VALIDATOR glslangValidator)
    mark_as_advanced(VULKAN_INCLUDE_DIR GLSLANG_VALIDATOR)
    voxspring_leave_out(VULKAN "no vulkan/vulkan_raii.hpp was found when it was configured" NOT VULKAN_INCLUDE_DIR)
    voxspring_leave_out(VULKAN "no glslangValidator was found when it was configured" NOT GLSLANG_VALIDATOR)
endif()

# MPI: Open MPI's header. Processes that mpirun starts open its library at run time.
if(VOXSPRING_MPI)
    find_path(OPENMPI_INCLUDE_DIR mpi.h PATHS /usr/lib/${CMAKE_LIBRARY_ARCHITECTURE}/openmpi/include)
    mark_as_advanced(OPENMPI_INCLUDE_DIR)
    set(open_mpi_version "")
    if(OPENMPI_INCLUDE_DIR)
        file(STRINGS ${OPENMPI_INCLUDE_DIR}/mpi.h open_mpi_version REGEX "define OMPI_MAJOR_VERSION")
    endif()
    voxspring_leave_out(MPI "no mpi.h was found when it was configured" NOT OPENMPI_INCLUDE_DIR)
    voxspring_leave_out(MPI "the mpi.h that was found when it was configured is not Open MPI's" NOT open_mpi_version)
endif()

# A window: GLFW and Dear ImGui.
if(VOXSPRING_WINDOW)
    find_package(glfw3 3.3 QUIET)
    pkg_check_modules(IMGUI QUIET IMPORTED_TARGET imgui)
    voxspring_leave_out(WINDOW "no GLFW was found when it was configured (Debian: libglfw3-dev)" NOT glfw3_FOUND)
    voxspring_leave_out(WINDOW "no Dear ImGui was found when it was configured (Debian: libimgui-dev)" NOT IMGUI_FOUND)
endif()
