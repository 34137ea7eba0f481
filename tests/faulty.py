"""Studies by the program with tests/faulty_backends.cpp in it, which FAULTY names. The current directory is the source tree."""

import json
import os
import pathlib
import time

import jsonschema

from program import InTemporaryFolder

FAULTY = os.environ["FAULTY"]
PATIENCE = 300  # seconds that no operation of the tests takes, however busy the machine is

with open("results/schema.json", encoding="utf-8") as file:
    SCHEMA = jsonschema.Draft202012Validator(json.load(file))


def processes():
    """All live processes of the program, even if this test did not start them."""
    found = []
    for folder in pathlib.Path("/proc").glob("[0-9]*"):
        try:
            if os.path.samefile(folder / "exe", FAULTY) and "State:\tZ" not in (folder / "status").read_text():
                found.append(int(folder.name))
        except OSError:
            pass
    return found


class FaultyStudies(InTemporaryFolder):
    defaults = {"steps": 4, "repetitions": 2}

    def setUp(self):
        super().setUp()
        self.out = self.folder / "result.json"
        self.journal = self.folder / "result.json.journal"
        self.before = set(processes())

    def study(self, **study):
        self.write("study.json", self.defaults | study)

    def result(self):
        result = json.loads(self.out.read_text())
        SCHEMA.validate(result)
        return result

    def wait_for(self, condition, what):
        until = time.monotonic() + PATIENCE
        while not condition():
            self.assertLess(time.monotonic(), until, what)
            time.sleep(0.01)

    def assert_nothing_runs(self):
        """The processes that a process leaves behind die with it, which takes the kernel a moment."""
        self.wait_for(lambda: not set(processes()) - self.before, "a process is left")
