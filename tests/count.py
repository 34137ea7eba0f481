"""Counts what a run of CTest found, with each test of GoogleTest's programs by itself.

Usage: count.py CTEST.xml GTEST_FOLDER

Prints passed, failed and skipped tests on one line. Failed tests by name, and how many tests each backend skipped, go to standard
error. A program that ends without its results, or has run no test, has failed.
"""

import collections
import pathlib
import re
import sys
import xml.etree.ElementTree as ElementTree


def tests_of_program(path):
    """(name, "passed", "failed" or "skipped", backend or nothing) of each test in a file that GoogleTest wrote."""
    for case in ElementTree.parse(path).iter("testcase"):
        ended = "failed" if case.find("failure") is not None else "skipped" if case.get("result") == "skipped" else "passed"
        backend = re.match(r'"?([a-z0-9_]+)', case.get("value_param", ""))
        yield f"{case.get('classname')}.{case.get('name')}", ended, backend[1] if backend else ""


def tests(ctest, folder):
    """(name, outcome, backend or nothing) of each test that CTest ran."""
    for case in ElementTree.parse(ctest).iter("testcase"):
        name, status = case.get("name"), case.get("status")
        ended = {"run": "passed", "fail": "failed", "notrun": "skipped"}.get(status, "failed")
        results = folder / f"{name}.xml"
        if not results.exists():
            yield name, ended, ""
            continue
        found = list(tests_of_program(results))
        yield from found
        if not found:
            yield f"{name} ran no test", "failed", ""
        elif ended == "failed" and all(result != "failed" for _, result, _ in found):
            yield f"{name}, as a whole", "failed", ""


def main():
    found = list(tests(pathlib.Path(sys.argv[1]), pathlib.Path(sys.argv[2])))
    ends = collections.Counter(ended for _, ended, _ in found)
    print(ends["passed"], ends["failed"], ends["skipped"])
    for name, ended, _ in found:
        if ended == "failed":
            print(f"FAILED: {name}", file=sys.stderr)
    for backend, number in sorted(collections.Counter(backend for _, ended, backend in found if ended == "skipped").items()):
        print(f"{number:7} skipped: {backend or 'others'}", file=sys.stderr)


if __name__ == "__main__":
    main()
