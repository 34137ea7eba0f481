"""Sentences that outsiders stumble over: the patterns that CONTRIBUTING's section on prose ends, in comments, messages and pages.

    tests/prose_test.py [FILE...]     these files, or all of the tree; prints FILE:LINE: the words, and what to write
"""
import pathlib
import re
import subprocess
import sys
import unittest

ROOT = pathlib.Path(__file__).resolve().parent.parent
COUNTED = (r"one|two|three|four|\d+|us|ns|ms|seconds?|bytes?|numbers?|elements?|values?|words?|bits?|lines?|rows?|columns?|planes?|"
           r"points?|particles?|springs?|voxels?|steps?|threads?|lanes?|warps?|blocks?|registers|instructions?|launch(?:es)?|"
           r"kernels?|operations?|pictures?|exchanges?|folders?|files?|contexts?|processes|messages?|entries|rest lengths?|masks?|loads?|"
           r"stores?")
PER = (r"particle|voxel|spring|step|second|thread|lane|warp|block|row|line|plane|column|joule|rank|part|reason|label|launch|card|"
       r"device|scene|file|case|tile|brick|folder|group|kind|direction|frame|border|neighbour|slot|run|study|target|"
       r"processor|core|material|edit|tick|sample|axis|item|repetition|batch")
# What it finds, and what to write. Comments begin with //, /// or #.
PATTERNS = [
    (re.compile(r"(?://[/!]?<?|#) Of "), "begin with the subject, not with 'Of'"),
    (re.compile(rf"\b(?!steps? a part\b)(?:{COUNTED}) an? (?:{PER})\b"), "'per': one element per particle"),
    (re.compile(rf"\b(?!test_)[a-z_]*s_an?_(?:{PER}|byte|call|fence|round|decade)_?\b"), "'per': steps_per_call"),
    (re.compile(r"\b[Ww]hoever\b"), "name who: the caller, the user"),
    (re.compile(r"\bof (?:its|their|his|one's) own\b"), "leave it out, or say whose"),
    (re.compile(r"(?://[/!]?<?|#) (?:Nothing|Null|Empty|None|Not? [a-z]+) where\b"), "a sentence with a subject and a verb"),
    (re.compile(r"(?://[/!]?<?|#) (?:The same|That of|Those of|The same of)\b"), "repeat the noun: a comment stands alone"),
    (re.compile(r"///< (?:it|those|after it|before it)(?: |$)"), "name it: a comment stands alone"),
    (re.compile(r"(?://[/!]?<?|#) .*\b(?:of|than|at least|after) so (?:many|long|full)\b"), "'this many', or the parameter's name"),
]
TEXTS = (".h", ".cpp", ".cu", ".py", ".md", ".json", ".glsl", ".comp", ".frag", ".vert", ".cmake", ".txt", ".sh")
# A record of what was, the page whose sentences come with its figures, and tests that quote such phrases.
LEFT_OUT = ("tests/pages_test.py", "tests/prose_test.py",
            "tests/readme_test.py")


def all_files():
    listed = subprocess.run(["git", "-c", f"safe.directory={ROOT}", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True)
    for name in listed.stdout.splitlines():
        if name not in LEFT_OUT and (name.endswith(TEXTS) or name in ("run", "package/run")) and (ROOT / name).is_file():
            yield name


def findings(name):
    for number, line in enumerate((ROOT / name).read_text(encoding="utf-8").splitlines(), start=1):
        for pattern, advice in PATTERNS:
            for found in pattern.finditer(line):
                yield f"{name}:{number}: {found.group().strip()!r}: {advice}"


class Prose(unittest.TestCase):
    def test_patterns_find_what_they_are_for(self):
        for line in ("    // Of a part of a body.", "int steps_a_call = 0;", "one element a particle", "whoever waits", "a folder of its own",
                     "/// Null where there is none", "/// The same of words", "int a;  ///< it rests", "std::vector<int> b;  ///< those of the mesh",
                     "// a sample of so many layers"):
            self.assertTrue(any(pattern.search(line) for pattern, _ in PATTERNS), line)
        for line in ("one element per particle", "// Offsets of a thread", "test_a_study_is_a_row", "which gives a thread one tile",
                     "int c;  ///< its tile rests", "so many that a launch costs 1%"):
            self.assertFalse(any(pattern.search(line) for pattern, _ in PATTERNS), line)

    def test_no_sentence_has_them(self):
        found = [finding for name in all_files() for finding in findings(name)]
        self.assertEqual(found, [], "\n".join(["", *found]))


if __name__ == "__main__":
    if sys.argv[1:] and not sys.argv[1].startswith("-"):
        lines = [finding for name in sys.argv[1:] for finding in findings(name)]
        print("\n".join(lines))
        sys.exit(1 if lines else 0)
    unittest.main()
