#include "harness/cli/completion.h"

#include <sstream>

#include "backends/registry.h"
#include "harness/base/bad_input.h"
#include "harness/scene/scene.h"
#include "harness/study/study.h"

namespace voxspring {
namespace {

/// The words that complete a value, separated by blanks. The shell itself completes files.
std::string words_of(ValueKind kind) {
    std::string text;
    const auto add = [&](const std::string& word) { text += (text.empty() ? "" : " ") + word; };
    switch (kind) {
        case ValueKind::scene:
            for (const auto& scene : builtin_scenes()) add(scene.name);
            break;
        case ValueKind::study:
            for (const auto& study : builtin_studies()) add(study.name);
            break;
        case ValueKind::backend:
            add("auto");
            for (const auto& [name, entry] : registry()) add(name);
            break;
        case ValueKind::colour:
            return "displacement error";
        case ValueKind::shell:
            return "bash zsh";
        case ValueKind::none:
        case ValueKind::file:
        case ValueKind::folder:
        case ValueKind::other:
            break;
    }
    return text;
}

/// A scene or a study may be a file too.
bool may_be_file(ValueKind kind) {
    return kind == ValueKind::file || kind == ValueKind::scene || kind == ValueKind::study;
}

// --- bash ----------------------------------------------------------------------------------------------

/// A line of bash that completes the current word with a value of `kind`.
std::string bash_reply(ValueKind kind) {
    if (kind == ValueKind::folder) return "COMPREPLY=($(compgen -d -- \"$current\"))";
    std::string options = "-W '" + words_of(kind) + "'";
    if (may_be_file(kind)) options += " -f";
    return "COMPREPLY=($(compgen " + options + " -- \"$current\"))";
}

void bash_command(const CommandWords& command, std::ostream& out) {
    out << "        " << command.name << ")\n            case $previous in\n";
    std::string options;
    for (const OptionWords& option : command.options) {
        options += (options.empty() ? "" : " ") + option.name;
        if (option.value != ValueKind::none)
            out << "                " << option.name << ") " << bash_reply(option.value) << "; return ;;\n";
    }
    const ValueKind argument = command.arguments.empty() ? ValueKind::other : command.arguments.front();
    out << "            esac\n"
        << "            if [[ $current == -* ]]; then\n"
        << "                COMPREPLY=($(compgen -W '" << options << "' -- \"$current\"))\n"
        << "            else\n"
        << "                " << bash_reply(argument) << "\n"
        << "            fi ;;\n";
}

std::string bash(const std::vector<CommandWords>& commands) {
    std::ostringstream out;
    std::string names;
    for (const CommandWords& command : commands) names += command.name + " ";
    // bash ends a word at a colon, which a backend's specification may contain. What follows the colon is not
    // completed.
    out << "# Completion of voxspring for bash, made by `voxspring completion bash`.\n"
        << "_voxspring() {\n"
        << "    local current=${COMP_WORDS[COMP_CWORD]} previous=${COMP_WORDS[COMP_CWORD - 1]}\n"
        << "    COMPREPLY=()\n"
        << "    if [ \"$COMP_CWORD\" -eq 1 ]; then\n"
        << "        COMPREPLY=($(compgen -W '" << names << "--help --version' -- \"$current\"))\n"
        << "        return\n"
        << "    fi\n"
        << "    case ${COMP_WORDS[1]} in\n";
    for (const CommandWords& command : commands) bash_command(command, out);
    out << "    esac\n"
        << "}\n"
        << "complete -o filenames -F _voxspring voxspring\n";
    return out.str();
}

// --- zsh -----------------------------------------------------------------------------------------------

/// `text` in single quotes, with the special characters of _arguments escaped.
std::string zsh_quoted(const std::string& text) {
    std::string out;
    for (const char c : text) {
        if (c == '\'') {
            out += "'\\''";
        } else {
            if (c == ':' || c == '[' || c == ']' || c == '\\') out += '\\';
            out += c;
        }
    }
    return out;
}

/// The part MESSAGE:ACTION of a specification for _arguments.
std::string zsh_value(ValueKind kind) {
    switch (kind) {
        case ValueKind::folder:
            return "folder:_files -/";
        case ValueKind::file:
            return "file:_files";
        case ValueKind::scene:
        case ValueKind::study:
            return "name or file:{_alternative \"names:name:(" + words_of(kind) +
                   ")\" \"files:file:_files\"}";
        case ValueKind::backend:
        case ValueKind::colour:
        case ValueKind::shell:
            return "name:(" + words_of(kind) + ")";
        case ValueKind::none:
        case ValueKind::other:
            break;
    }
    return "value: ";
}

void zsh_command(const CommandWords& command, std::ostream& out) {
    out << "        " << command.name << ")\n            _arguments";
    for (const OptionWords& option : command.options) {
        out << " \\\n                '*" << option.name << "[" << zsh_quoted(option.description) << "]"
            << (option.value == ValueKind::none ? "" : ":" + zsh_value(option.value)) << "'";
    }
    for (const ValueKind argument : command.arguments)
        out << " \\\n                '" << (argument == ValueKind::file ? "*" : "") << ":"
            << zsh_value(argument) << "'";
    out << " ;;\n";
}

std::string zsh(const std::vector<CommandWords>& commands) {
    std::ostringstream out;
    out << "#compdef voxspring\n"
        << "# Completion of voxspring for zsh, made by `voxspring completion zsh`.\n"
        << "_voxspring() {\n"
        << "    local -a commands=(\n";
    for (const CommandWords& command : commands)
        out << "        '" << command.name << ":" << zsh_quoted(command.description) << "'\n";
    out << "    )\n"
        << "    if (( CURRENT == 2 )); then\n"
        << "        _describe command commands\n"
        << "        return\n"
        << "    fi\n"
        << "    local command=$words[2]\n"
        << "    shift words\n"
        << "    (( CURRENT-- ))\n"
        << "    case $command in\n";
    for (const CommandWords& command : commands) zsh_command(command, out);
    out << "    esac\n"
        << "}\n"
        << "if [ \"$funcstack[1]\" = _voxspring ]; then _voxspring \"$@\"; else compdef _voxspring "
           "voxspring; fi\n";
    return out.str();
}

}  // namespace

std::string completion_script(const std::string& shell, const std::vector<CommandWords>& commands) {
    if (shell == "bash") return bash(commands);
    if (shell == "zsh") return zsh(commands);
    throw BadInput("command line", "completion", shell, "bash or zsh");
}

}  // namespace voxspring
