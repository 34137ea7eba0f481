#!/usr/bin/env python3
"""Makes one self-contained page of results: which strategy is the fastest on each dataset, what it costs in error, and
the figures behind that.

Usage: report.py [RESULTS...] [-o report.html] [--pictures FOLDER [--program VOXSPRING]] [--figures FOLDER]

RESULTS are results of `voxspring study` (RESULT.json, or compressed RESULT.json.gz), or folders, which are searched for such
files; the folder of this script unless some are named. Several files of one study on one machine add its history. --pictures
shows the datasets: VOXSPRING draws the pictures that FOLDER lacks or that are older than the program; without --program those
in FOLDER are shown. --figures writes every chart of the page into FOLDER as an SVG file as well. The page needs no network. It is
replaced in one step, and its path is printed. An error names file, key and value, exits with 2 and leaves the old page unchanged.
report.py takes Python 3.11 and the packages in requirements.txt, which `./run report` installs in the source tree.
"""

import argparse
import os
import pathlib
import tempfile

from result_files import BadInput, refuse

HERE = pathlib.Path(__file__).resolve().parent


def write_whole(path, text):
    """Replaces a file in one step: after a failure the old file is unchanged."""
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    try:
        with os.fdopen(handle, "w", encoding="utf-8", errors="replace") as file:
            file.write(text)
            file.flush()
            os.fsync(file.fileno())
        # mkstemp() creates the file readable by its owner only.
        os.chmod(name, 0o644)
        os.replace(name, path)
    except BaseException:
        os.unlink(name)
        raise


def main(arguments=None):
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("results", type=pathlib.Path, nargs="*", default=[HERE], metavar="RESULTS")
    parser.add_argument("-o", "--out", type=pathlib.Path, metavar="report.html", help="the page")
    parser.add_argument("--pictures", type=pathlib.Path, metavar="FOLDER", help="folder with the pictures of the datasets")
    parser.add_argument("--program", type=pathlib.Path, metavar="VOXSPRING", help="the program that draws missing pictures")
    parser.add_argument("--figures", type=pathlib.Path, metavar="FOLDER", help="folder for the charts as SVG files")
    options = parser.parse_args(arguments)
    if not options.out and not options.figures:
        parser.error("expected --out for the page, or --figures for its charts, or both")
    if options.program and not options.pictures:
        parser.error("--program needs --pictures, the folder that it draws into")
    # Imported here, so that --help needs no package.
    try:
        from page import document, export, pictures, reading  # pylint: disable=import-outside-toplevel
    except ModuleNotFoundError as error:
        in_tree = "`./run report` installs it, or " if (HERE.parent / "CMakeLists.txt").exists() else ""
        refuse(__file__, f"the Python package {error.name} is missing: {in_tree}pip install -r {HERE / 'requirements.txt'}")
    try:
        results = reading.read_all(options.results)
        shown = pictures.gather(results, options.pictures, options.program) if options.pictures else ({}, [])
        text = document.page(results, *shown) if options.out else ""
    except BadInput as error:
        refuse(__file__, error)
    option = f"--figures {options.figures}"
    try:
        if options.figures:
            options.figures.mkdir(parents=True, exist_ok=True)
            for name, chart in export.files(results):
                write_whole(options.figures / name, chart)
                print(options.figures / name)
        if options.out:
            option = f"--out {options.out}"
            write_whole(options.out, text)
            print(options.out)
    except OSError as error:
        refuse(__file__, f"{option}: {error.strerror}")


if __name__ == "__main__":
    main()
