#!/usr/bin/env python3
"""Compresses results that are to be kept: RESULT.json becomes RESULT.json.gz, a twentieth of the size.

Usage: compact.py RESULT.json...

RESULT.json.gz holds every byte of RESULT.json, which is removed once the compressed file has been read back. The same result
gives the same bytes. `zcat RESULT.json.gz` prints the result; every script here and `voxspring advise --results` read both forms.
"""

import argparse
import gzip
import pathlib

import result_files


def compact(path):
    """Replaces a result by its compressed form. Returns the path of that."""
    if not path.name.endswith(".json"):
        raise result_files.BadInput(f"{path}: expected a result whose name ends in .json")
    result_files.load(path)
    data, compressed = path.read_bytes(), path.with_name(path.name + ".gz")
    part = path.with_name(path.name + ".part")
    try:
        # The gzip header has neither date nor file name, so that equal results give equal bytes.
        part.write_bytes(gzip.compress(data, mtime=0))
        if gzip.decompress(part.read_bytes()) != data:
            raise result_files.BadInput(f"{part}: the compressed file does not read back as it was written; {path} is unchanged")
        part.replace(compressed)
    finally:
        part.unlink(missing_ok=True)
    path.unlink()
    return compressed


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("results", type=pathlib.Path, nargs="+", metavar="RESULT.json")
    try:
        for path in parser.parse_args().results:
            print(compact(path))
    except (result_files.BadInput, OSError) as error:
        result_files.refuse(__file__, error)


if __name__ == "__main__":
    main()
