"""Warnings are errors where this project's own tests ask for it, and not for somebody who only builds it.

The current directory is the source tree.
"""

import json
import pathlib
import subprocess
import tempfile
import unittest


def warnings_are_errors(*arguments):
    """Whether each file of a tree that is configured so compiles with -Werror."""
    with tempfile.TemporaryDirectory() as folder:
        configure = ["cmake", "-B", folder, "-DVOXSPRING_CUDA=OFF", "-DVOXSPRING_TESTS=OFF",
                     "-DCMAKE_EXPORT_COMPILE_COMMANDS=ON", *arguments]
        done = subprocess.run(configure, capture_output=True, text=True, check=False)
        if done.returncode != 0:
            raise RuntimeError(done.stderr)
        commands = json.loads((pathlib.Path(folder) / "compile_commands.json").read_text())
    return {"-Werror" in command["command"].split() for command in commands}


class Presets(unittest.TestCase):
    def test_warnings_are_errors_where_they_are_asked_for(self):
        # By name, since machines whose default is Make have Ninja only if `run` installed what is needed.
        self.assertEqual(warnings_are_errors("-S", ".", "-G", "Ninja"), {False})
        self.assertEqual(warnings_are_errors("--preset", "release"), {False})
        self.assertEqual(warnings_are_errors("--preset", "ci"), {True})

    def test_every_preset_but_those_of_users_asks_for_it(self):
        presets = {preset["name"]: preset for preset in json.loads(pathlib.Path("CMakePresets.json").read_text())["configurePresets"]}

        def value(name):
            own = presets[name].get("cacheVariables", {}).get("VOXSPRING_WERROR")
            return own if own is not None else value(presets[name]["inherits"])
        asking = {name for name in presets if value(name) == "ON"}
        self.assertEqual(set(presets) - asking, {"release", "package"})


if __name__ == "__main__":
    unittest.main()
