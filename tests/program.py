"""The voxspring executable, which VOXSPRING names, for the tests that run it. The current directory is the source tree."""

import json
import os
import pathlib
import subprocess
import tempfile
import unittest

VOXSPRING = os.environ["VOXSPRING"]


def voxspring(*arguments, **options):
    return subprocess.run([VOXSPRING, *map(str, arguments)], capture_output=True, text=True, timeout=300, **options)


def succeeds(*arguments, **options):
    ran = voxspring(*arguments, **options)
    assert ran.returncode == 0, f"{ran.returncode}: {ran.stdout}{ran.stderr}"
    return ran


def json_of(*arguments):
    return json.loads(succeeds(*arguments).stdout)


class InTemporaryFolder(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)

    def write(self, name, document):
        """The path of a file of that name, which has the document as JSON."""
        path = self.folder / name
        path.write_text(json.dumps(document))
        return path

    def assert_refused(self, result, *words):
        """Exit code 2 and one line that has every word; nothing on disk."""
        self.assertEqual(result.returncode, 2, result.stderr)
        self.assertEqual(result.stdout, "")
        self.assertEqual(result.stderr.count("\n"), 1, result.stderr)
        for word in words:
            self.assertIn(word, result.stderr)
