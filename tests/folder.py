"""Programs and scripts that tests run, what they say that refuse their input, and temporary folders with files."""

import contextlib
import io
import json
import pathlib
import subprocess
import tempfile
import unittest


def run(*command, **options):
    """Runs a command to its end. Its output is captured as text unless `options` of subprocess.run say otherwise."""
    return subprocess.run(list(map(str, command)), **{"capture_output": True, "text": True, "timeout": 300} | options)


def called(function):
    """What run() would return of a script with this main function, which is called in this process."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            code = function()
        except SystemExit as end:
            code = end.code
    return subprocess.CompletedProcess([], code or 0, out.getvalue(), err.getvalue())


def new_folder(add_cleanup):
    """A folder that is removed by what is passed to `add_cleanup`, of a test or of a class."""
    folder = tempfile.TemporaryDirectory()
    add_cleanup(folder.cleanup)
    return pathlib.Path(folder.name)


def nrrd(sizes, voxels, more=""):
    """A volume file of bytes."""
    fields = f"NRRD0004\ntype: uint8\ndimension: {len(sizes.split())}\nsizes: {sizes}\nencoding: raw\n{more}\n"
    return fields.encode() + bytes(voxels)


class InTemporaryFolder(unittest.TestCase):
    def setUp(self):
        self.folder = new_folder(self.addCleanup)

    def write(self, name, content):
        """The path of a file of that name with these bytes, with this text, or with this document as JSON."""
        path = self.folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        if not isinstance(content, (bytes, str)):
            content = json.dumps(content)
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return path

    def assert_refused(self, result, *words):
        """Exit code 2 and one line that has every word; nothing on standard output."""
        self.assertEqual(result.returncode, 2, result.stderr)
        self.assertEqual(result.stdout, "")
        self.assertEqual(result.stderr.count("\n"), 1, result.stderr)
        for word in words:
            self.assertIn(str(word), result.stderr)
