#compdef voxspring
# Completion of voxspring's command line in zsh. `voxspring completion words` lists the words.
_voxspring() {
    compadd -- ${(f)"$("${words[1]}" completion words "${(@)words[2,CURRENT]}" 2> /dev/null)"}
    _files
}
if [ "$funcstack[1]" = _voxspring ]; then _voxspring "$@"; else compdef _voxspring voxspring; fi
