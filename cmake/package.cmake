# The package that `./run package` makes: a component that must be requested. It contains every shared library except those of glibc
# and of the graphics driver.
install(TARGETS ${programs} ${VOXSPRING_PACKAGED_TESTS}
    RUNTIME_DEPENDENCIES PRE_EXCLUDE_REGEXES "^ld-linux" "^lib(c|m|dl|pthread|rt)\\.so" "^lib(EGL|GL|OpenGL)"
    RUNTIME DESTINATION bin COMPONENT package EXCLUDE_FROM_ALL
    LIBRARY DESTINATION lib COMPONENT package EXCLUDE_FROM_ALL)
set(packaged COMPONENT package EXCLUDE_FROM_ALL)
if(NOT VOXSPRING_NO_CUDA)
    # NVRTC is opened by name, and opens its built-in functions in the same way.
    get_target_property(nvrtc_file CUDA::nvrtc IMPORTED_LOCATION)
    file(REAL_PATH ${nvrtc_file} nvrtc)
    install(FILES ${nvrtc} DESTINATION lib RENAME libnvrtc.so.${CUDAToolkit_VERSION_MAJOR} ${packaged})
    file(GLOB nvrtc_builtins ${CUDAToolkit_LIBRARY_DIR}/libnvrtc-builtins.so.[0-9]*)
    install(FILES ${nvrtc_builtins} DESTINATION lib ${packaged})
endif()
if(NOT VOXSPRING_NO_VULKAN)
    # Vulkan's loader is opened by name as well.
    find_library(VULKAN_LOADER libvulkan.so.1)
    mark_as_advanced(VULKAN_LOADER)
    if(VULKAN_LOADER)
        file(REAL_PATH ${VULKAN_LOADER} loader)
        install(FILES ${loader} DESTINATION lib RENAME libvulkan.so.1 ${packaged})
    endif()
endif()
install(PROGRAMS package/run DESTINATION . ${packaged})
install(FILES package/README.md LICENSE DESTINATION . ${packaged})
install(DIRECTORY harness/scenes harness/studies DESTINATION harness ${packaged})
install(FILES ${schemas} ${result_scripts} results/requirements.txt DESTINATION results ${packaged})
install(DIRECTORY results/page DESTINATION results ${packaged} PATTERN __pycache__ EXCLUDE)
