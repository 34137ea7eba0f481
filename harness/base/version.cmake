# Run at each build: makes OUTPUT (version.h) from INPUT (version.h.in). OUTPUT is rewritten only if its content changes.
execute_process(COMMAND git rev-parse --short=12 HEAD WORKING_DIRECTORY ${SOURCE} OUTPUT_VARIABLE commit
                OUTPUT_STRIP_TRAILING_WHITESPACE ERROR_QUIET RESULT_VARIABLE failed)
if(failed)
    set(commit unknown)
endif()
execute_process(COMMAND git status --porcelain WORKING_DIRECTORY ${SOURCE} OUTPUT_VARIABLE changes ERROR_QUIET)
if(changes OR commit STREQUAL unknown)
    set(clean false)
else()
    set(clean true)
endif()
configure_file(${INPUT} ${OUTPUT} @ONLY)
