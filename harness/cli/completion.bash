# Completion of voxspring's command line in bash. `voxspring completion words` lists the words.
_voxspring() {
    local current=${COMP_WORDS[COMP_CWORD]} IFS=$'\n'
    mapfile -t COMPREPLY < <(
        compgen -f -W "$("${COMP_WORDS[0]}" completion words "${COMP_WORDS[@]:1:COMP_CWORD}" 2> /dev/null)" -- "$current")
}
complete -o filenames -F _voxspring voxspring
