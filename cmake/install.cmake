# What `cmake --install` installs: the program, and what find_package(voxspring) gives to others.
include(GNUInstallDirs)
include(CMakePackageConfigHelpers)
set(programs voxspring)
if(TARGET voxspring-view)
    list(APPEND programs voxspring-view)
endif()
# Schemas, and the scripts of results, among them those of `voxspring report` and `voxspring diff`.
file(GLOB schemas CONFIGURE_DEPENDS results/*schema.json)
file(GLOB result_scripts CONFIGURE_DEPENDS results/*.py)
list(FILTER result_scripts EXCLUDE REGEX "/(paper|auto_rules|continuum)\\.py$")

# --- The program --------------------------------------------------------------------------------------
set(data_folder ${CMAKE_INSTALL_DATADIR}/voxspring)
install(TARGETS ${programs} RUNTIME COMPONENT runtime)
install(FILES README.md LICENSE DESTINATION ${CMAKE_INSTALL_DOCDIR} COMPONENT runtime)
install(DIRECTORY harness/scenes harness/studies DESTINATION ${data_folder}/harness COMPONENT runtime)
install(FILES ${schemas} ${result_scripts} results/requirements.txt DESTINATION ${data_folder}/results COMPONENT runtime)
install(DIRECTORY results/page DESTINATION ${data_folder}/results COMPONENT runtime PATTERN __pycache__ EXCLUDE)
install(FILES harness/cli/completion.bash RENAME voxspring
    DESTINATION ${CMAKE_INSTALL_DATADIR}/bash-completion/completions COMPONENT runtime)
install(FILES harness/cli/completion.zsh RENAME _voxspring
    DESTINATION ${CMAKE_INSTALL_DATADIR}/zsh/site-functions COMPONENT runtime)

# --- The library, as voxspring::harness ---------------------------------------------------------------
# Headers include each other by the same paths as in the source tree.
set(include_folder ${CMAKE_INSTALL_INCLUDEDIR}/voxspring)
target_include_directories(voxspring_harness INTERFACE $<INSTALL_INTERFACE:${include_folder}>)
install(DIRECTORY backends harness DESTINATION ${include_folder} COMPONENT development
    FILES_MATCHING PATTERN *.h
    PATTERN kernel.h EXCLUDE PATTERN tiles.h EXCLUDE PATTERN padded_state.h EXCLUDE PATTERN parallel_options.h EXCLUDE
    PATTERN simd EXCLUDE PATTERN backends/gl EXCLUDE PATTERN backends/glsl EXCLUDE PATTERN backends/vulkan EXCLUDE
    PATTERN backends/layout EXCLUDE
    # Excluded because it is a program.
    PATTERN harness/viewer EXCLUDE
    # Excluded because it includes backends/layout, for cutting a body into parts.
    PATTERN harness/ranks EXCLUDE
    PATTERN scenes EXCLUDE PATTERN studies EXCLUDE)
# A program that draws, such as voxspring-view, needs an OpenGL context and what a painter keeps in it.
install(FILES backends/gl/context.h backends/gl/handles.h backends/gl/program.h
    backends/gl/storage_buffer.h DESTINATION ${include_folder}/backends/gl COMPONENT development)
install(FILES backends/glsl/terms.h backends/glsl/uniforms.h DESTINATION ${include_folder}/backends/glsl COMPONENT development)

# The archive needs the libraries of the backends that it contains.
set(backend_libraries PkgConfig::EPOXY PkgConfig::HWY OpenMP::OpenMP_CXX)
if(NOT VOXSPRING_NO_CUDA)
    # voxspring-config.cmake finds the runtime by its file, so that users of the archive need no CUDA toolkit.
    list(APPEND backend_libraries voxspring::cudart)
    get_target_property(cudart_file CUDA::cudart_static IMPORTED_LOCATION)
    get_filename_component(cudart_folder ${cudart_file} DIRECTORY)
endif()
target_link_libraries(voxspring_harness PRIVATE $<INSTALL_INTERFACE:${backend_libraries}>)
set_target_properties(voxspring_whole PROPERTIES EXPORT_NAME harness)
set_target_properties(voxspring_harness PROPERTIES EXPORT_NAME archive)
set(config_folder ${CMAKE_INSTALL_LIBDIR}/cmake/voxspring)
install(TARGETS voxspring_harness voxspring_whole EXPORT voxspring ARCHIVE COMPONENT development)
install(EXPORT voxspring NAMESPACE voxspring:: FILE voxspring-targets.cmake DESTINATION ${config_folder} COMPONENT development)
configure_package_config_file(cmake/voxspring-config.cmake.in voxspring-config.cmake INSTALL_DESTINATION ${config_folder})
write_basic_package_version_file(voxspring-config-version.cmake COMPATIBILITY SameMinorVersion)
install(FILES ${PROJECT_BINARY_DIR}/voxspring-config.cmake ${PROJECT_BINARY_DIR}/voxspring-config-version.cmake
    DESTINATION ${config_folder} COMPONENT development)
