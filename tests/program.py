"""The voxspring executable, which VOXSPRING names, for the tests that run it. The current directory is the source tree."""

import json
import os

from folder import InTemporaryFolder, new_folder, nrrd, run  # noqa: F401

VOXSPRING = os.environ["VOXSPRING"]


def voxspring(*arguments, **options):
    return run(VOXSPRING, *arguments, **options)


def succeeds(*arguments, **options):
    ran = voxspring(*arguments, **options)
    assert ran.returncode == 0, f"{ran.returncode}: {ran.stdout}{ran.stderr}"
    return ran


def json_of(*arguments):
    return json.loads(succeeds(*arguments).stdout)
