# voxspring_backend(NAME SOURCE [FEATURE]) adds the backend NAME, which is the file SOURCE of this folder. A build without FEATURE
# (CUDA or VULKAN) leaves the backend out.
function(voxspring_backend name source)
    set(reason "${VOXSPRING_NO_${ARGV2}}")
    if(ARGC GREATER 2 AND reason)
        set_property(GLOBAL APPEND_STRING PROPERTY voxspring_left_out "    {\"${name}\", \"${reason}\"},\n")
    else()
        target_sources(voxspring_backends PRIVATE ${source})
        set_property(GLOBAL APPEND PROPERTY voxspring_backend_names ${name})
    endif()
endfunction()

# Adds the sources that backends of this folder share: the files that match the patterns and that voxspring_backend() has not added.
function(voxspring_shared_sources)
    list(TRANSFORM ARGN PREPEND ${CMAKE_CURRENT_SOURCE_DIR}/ OUTPUT_VARIABLE patterns)
    file(GLOB sources CONFIGURE_DEPENDS ${patterns})
    get_target_property(roster voxspring_backends SOURCES)
    list(REMOVE_ITEM sources ${roster})
    target_sources(voxspring_backends PRIVATE ${sources})
endfunction()

# Writes generated/roster.h, which says why backends were left out.
function(voxspring_write_roster)
    get_property(left_out GLOBAL PROPERTY voxspring_left_out)
    voxspring_write_header(roster "#include <map>
#include <string>
inline const std::map<std::string, std::string> left_out_backends = {
${left_out}};
")
endfunction()
