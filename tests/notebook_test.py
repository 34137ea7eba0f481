"""Executes docs/paper.ipynb with a wheel, in the environment of python/requirements.txt, whose interpreter runs this.

Usage: notebook_test.py WHEEL
"""

import os
import pathlib
import subprocess
import sys
import tempfile
import time

import nbclient
import nbformat

NOTEBOOK = pathlib.Path(__file__).resolve().parent.parent / "docs/paper.ipynb"
MOST_SECONDS = 60

with tempfile.TemporaryDirectory() as folder:
    subprocess.run([sys.executable, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--no-deps", "--target", folder,
                    sys.argv[1]], check=True)
    os.environ.update(PYTHONPATH=folder, VOXSPRING_CACHE=f"{folder}/cache", MPLBACKEND="agg", IPYTHONDIR=f"{folder}/ipython")
    notebook = nbformat.read(NOTEBOOK, as_version=4)
    nbformat.validate(notebook)
    begin = time.monotonic()
    nbclient.NotebookClient(notebook, timeout=MOST_SECONDS, kernel_name="python3").execute()
    print(f"{len(notebook.cells)} cells in {time.monotonic() - begin:.0f} s")

text = "".join(output.get("text", "") for cell in notebook.cells for output in cell.get("outputs", ()))
for expected in ("refused: ball/step/position/float64: does not agree with cpu_reference", "explicit position float64",
                 "implicit position float64", "springs cut", "springs joined again"):
    assert expected in text, f"the notebook does not say {expected!r}:\n{text}"
