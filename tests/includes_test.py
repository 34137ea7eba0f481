"""What the project's own sources include, a room those below it and itself and never one above it, and what they may not call."""

import pathlib
import re
import unittest

from folder import InTemporaryFolder

# From the lowest room to the highest. Rooms on one line may not include each other.
ROOMS = [
    ["backends/physics"],
    ["backends"],
    ["backends/layout"],
    ["backends/glsl"],
    ["backends/cpu", "backends/gl", "backends/vulkan", "cuda/kernels"],
    ["cuda/device"],
    ["cuda/common"],
    ["cuda"],
    ["harness/base"],
    ["harness/volume"],
    ["harness/mesh"],
    ["harness/scene"],
    ["harness/device"],
    ["harness/verification"],
    ["harness/results"],
    ["harness/choice"],
    ["harness/drawing"],
    ["harness/export"],
    ["harness/simulation"],
    ["harness/process"],
    ["harness/ranks"],
    ["harness/study"],
    ["harness/cli"],
    ["harness/viewer", "python"],
]
LEVEL = {room: level for level, rooms in enumerate(ROOMS) for room in rooms}
INCLUDE = re.compile(r'^\s*#include "([^"]+)"', re.MULTILINE)


def room_of(path):
    """The room in which a file lies, by its path from the root; None for a generated header."""
    for folder in pathlib.PurePosixPath(path).parents:
        if str(folder) in LEVEL:
            return str(folder)
    return None


def includes_of(root):
    """Pairs (file, included file) of all sources below `root`, by their paths from it."""
    for top in ("backends", "cuda", "harness", "python"):
        for path in sorted((root / top).rglob("*")):
            if path.suffix in (".h", ".cpp", ".cu"):
                for included in INCLUDE.findall(path.read_text()):
                    beside = path.parent / included
                    yield (path.relative_to(root).as_posix(),
                           beside.relative_to(root).as_posix() if beside.exists() else included)


def upward(root):
    """The includes that point up or sideways, as lines of text."""
    found = []
    for source, included in includes_of(root):
        here, there = room_of(source), room_of(included)
        if there and here != there and LEVEL[there] >= LEVEL[here]:
            found.append(f"{source} includes {included}: {there} is not below {here}")
    return found


def circles(root):
    """Files that include themselves through others."""
    graph = {}
    for source, included in includes_of(root):
        graph.setdefault(source, set()).add(included)
    found, done = [], set()

    def visit(file, path):
        if file in path:
            found.append(" -> ".join(path[path.index(file):] + [file]))
        elif file not in done:
            for included in sorted(graph.get(file, ())):
                visit(included, path + [file])
            done.add(file)

    for source in sorted(graph):
        visit(source, [])
    return found


def installed_headers(root):
    """The project's headers that CMake installs, by its rules install(DIRECTORY backends harness ...) and install(FILES X.h ...)."""
    files = [root / "CMakeLists.txt", *root.glob("cmake/*.cmake"), *root.glob("*/CMakeLists.txt")]
    rules = re.findall(r"^\s*install\(([^()]*)\)", "\n".join(re.sub(r"#.*", "", file.read_text()) for file in files if file.exists()), re.M)
    by_name = {header for rule in rules if rule.startswith("FILES") for header in re.findall(r"\S+\.h\b", rule)}
    (rule,) = (rule for rule in rules if rule.split()[:3] == ["DIRECTORY", "backends", "harness"])
    left_out = re.findall(r"PATTERN (\S+) EXCLUDE", rule)
    headers = {path.relative_to(root).as_posix() for top in ("backends", "harness") for path in (root / top).rglob("*.h")}

    def is_left_out(header):
        parts = header.split("/")
        return any(("/" + "/".join(parts[:n])).endswith("/" + pattern) for n in range(1, len(parts) + 1) for pattern in left_out)

    return by_name | {header for header in headers if not is_left_out(header)}


def not_installed(root, room):
    """What files of a room include, or headers that they include, and nothing installs; headers of the room itself left out."""
    includes, installed = {}, installed_headers(root)
    for source, included in includes_of(root):
        includes.setdefault(source, set()).add(included)
    found, reached = [], {source for source in includes if room_of(source) == room}
    waiting = sorted(reached)
    while waiting:
        source = waiting.pop()
        for included in sorted(includes.get(source, set()) - reached):
            if included not in installed and room_of(included) != room:
                found.append(f"{source} includes {included}, which is not installed")
            reached.add(included)
            waiting.append(included)
    return found


class Includes(InTemporaryFolder):
    def test_every_source_lies_in_a_room(self):
        self.assertEqual([source for source, _ in includes_of(pathlib.Path()) if not room_of(source)], [])

    def test_no_include_points_up(self):
        self.assertEqual(upward(pathlib.Path()), [])

    def test_no_header_includes_itself(self):
        self.assertEqual(circles(pathlib.Path()), [])

    def test_the_viewer_is_a_program_on_installed_headers(self):
        self.assertEqual(not_installed(pathlib.Path(), "harness/viewer"), [])
        self.assertIn("backends/gl/context.h", installed_headers(pathlib.Path()))

    def test_the_python_module_is_a_program_on_installed_headers(self):
        self.assertEqual(not_installed(pathlib.Path(), "python"), [])

    def tree(self, files):
        """A folder with these files."""
        for name, text in files.items():
            self.write(name, text)
        return self.folder

    def test_finds_a_header_that_is_not_installed(self):
        root = self.tree({"CMakeLists.txt": "install(DIRECTORY backends harness DESTINATION x\n    FILES_MATCHING PATTERN *.h\n"
                                            "    PATTERN backends/gl EXCLUDE PATTERN harness/viewer EXCLUDE)\n"
                                            "install(FILES backends/gl/open.h DESTINATION x)\n",
                          "backends/gl/open.h": "", "backends/gl/closed.h": "", "backends/backend.h": "",
                          "harness/export/picture.h": '#include "backends/gl/closed.h"\n#include "backends/gl/open.h"\n',
                          "harness/viewer/main.cpp": '#include "backends/backend.h"\n#include "harness/export/picture.h"\n'
                                                     '#include "generated.h"\n'})
        self.assertEqual(sorted(not_installed(root, "harness/viewer")),
                         ["harness/export/picture.h includes backends/gl/closed.h, which is not installed",
                          "harness/viewer/main.cpp includes generated.h, which is not installed"])

    def test_finds_an_upward_include_and_a_circle(self):
        root = self.tree({"harness/base/low.h": '#include "harness/cli/high.h"\n',
                          "harness/cli/high.h": '#include "harness/base/low.h"\n',
                          "cuda/kernels/a.h": '#include "b.h"\n', "cuda/kernels/b.h": '#include <map>\n'})
        self.assertEqual(upward(root), ["harness/base/low.h includes harness/cli/high.h: harness/cli is not below harness/base"])
        self.assertEqual(circles(root), ["harness/base/low.h -> harness/cli/high.h -> harness/base/low.h"])

    @staticmethod
    def sources_with(pattern):
        """The sources of this tree, without its tests, in which a regular expression matches."""
        return {path.as_posix() for folder in ("backends", "cuda", "harness", "python") for path in pathlib.Path(folder).rglob("*")
                if path.suffix in (".h", ".cpp") and re.search(pattern, path.read_text())}

    def test_what_joins_includes_its_header(self):
        """From fmt 11 on fmt::join is in <fmt/ranges.h>; before, it was in <fmt/format.h> as well."""
        joining = self.sources_with(r"fmt::join\(")
        self.assertIn("backends/registry.cpp", joining)
        self.assertEqual(joining - self.sources_with(r"#include <fmt/ranges\.h>"), set())

    def test_signals_are_sent_by_signal_process(self):
        """kill() with -1, the number of a process that has ended, would signal every process of the user."""
        self.assertEqual(self.sources_with(r"\bkill\([^ )]"), {"harness/process/signal_process.cpp"})

    def test_no_source_changes_the_umask(self):
        """The umask holds for all threads: a file that another thread creates meanwhile would be open to everybody."""
        self.assertEqual(self.sources_with(r"\bumask\("), set())

    def test_json_is_written_by_json_text(self):
        """nlohmann::json::dump() throws if a name is not UTF-8, which would lose everything that was measured."""
        self.assertEqual(self.sources_with(r"\.dump\("), {"harness/base/json.cpp"})


if __name__ == "__main__":
    unittest.main()
