# Which architectures nvcc compiles for unless the user says so (CMAKE_CUDA_ARCHITECTURES, CUDAARCHS).
#
# NVRTC compiles a step for the card at hand when it runs. What nvcc compiles is little and need not be the fastest: it
# has to run. Machine code of compute capability X.y runs on X.z with z >= y.

# voxspring_cuda_architectures(RESULT NVCC [NVIDIA_SMI]): those of this machine's cards; where it has none, or one that
# NVCC does not know, the first of every generation from Turing on, and PTX of the newest for cards to come.
function(voxspring_cuda_architectures result nvcc)
    set(oldest 75)  # kernels/exchange.h loads 16 bytes at once
    execute_process(COMMAND ${nvcc} --list-gpu-arch OUTPUT_VARIABLE known ERROR_QUIET)
    string(REGEX MATCHALL "[0-9]+" known "${known}")
    list(SORT known COMPARE NATURAL)

    set(native "")
    if(ARGC GREATER 2)
        execute_process(COMMAND ${ARGV2} --query-gpu=compute_cap --format=csv,noheader
            OUTPUT_VARIABLE cards ERROR_QUIET RESULT_VARIABLE failed)
        if(failed EQUAL 0)
            string(REGEX MATCHALL "[0-9]+\\.[0-9]+" native "${cards}")
            list(TRANSFORM native REPLACE "\\." "")
            list(REMOVE_DUPLICATES native)
        endif()
    endif()
    set(missing ${native})
    list(REMOVE_ITEM missing ${known})
    if(native AND NOT missing)
        list(TRANSFORM native APPEND -real)
        set(${result} ${native} PARENT_SCOPE)
        return()
    endif()

    set(first "")
    set(generation "")
    foreach(architecture IN LISTS known)
        string(REGEX REPLACE ".$" "" major ${architecture})
        if(architecture GREATER_EQUAL oldest AND NOT major STREQUAL generation)
            list(APPEND first ${architecture}-real)
            set(generation ${major})
        endif()
    endforeach()
    if(NOT first)
        message(FATAL_ERROR "${nvcc} lists no GPU architecture from ${oldest} on (--list-gpu-arch)")
    endif()
    list(GET known -1 newest)
    list(APPEND first ${newest}-virtual)
    set(${result} ${first} PARENT_SCOPE)
endfunction()
