"""The published scene schema and the parser accept the same documents.

Usage: schema_test.py SCENE_CHECK SCHEMA CORPUS SCENE...

Judges the built-in scenes, the documents of the corpus and a few thousand seeded mutations of both by the
schema (python3-jsonschema) and by the parser (SCENE_CHECK, one document a line) and compares.
"""

import copy
import json
import random
import subprocess
import sys

import jsonschema

MUTATIONS = 4000

# Values that have confused parsers before: wrong types, both sides of every limit, empty and nested values.
ODD_VALUES = [
    None, True, False, 0, -0.0, 1, 1.0, 1.5, -1, 2, 1.9999, 255, 1e-12, 9e-13, 1e12, 1.1e12, 1e300, 1048576,
    1048577, 2**53 - 1, 2**53, 2**53 + 1, 999999999999999, 10**15, "", "x", "x-", "box", "face", "NaN", [], [1], [1, 2],
    [1, 2, 3], [1, 2, 3.5], [0, 0, 0], [1, 2, "3"], [1, 2, 3, 4], ["face"], ["face", "face"], [1, 1.0], {},
    {"1": 2}, {"01": 2}, {"-7": 2}, {"-0": 2}, {"0": 2}, {"face": 1}, {"face": 1, "1": 1}, {"side": "z-"},
    {"side": "z-", "slices": 2}, {"side": "z-", "slices": 2, "fraction": 0.5}, {"voxel": [0, 0, 0]},
    {"voxel": [0, 0, 0], "to": [1, 1, 1]}, {"from": [0, 0, 0]}, {"from": [0, 0, 0], "to": [1, 1, 1]},
    {"ball": {"centre": [1, 1, 1], "radius": 1}}, {"ball": {"centre": [1, 1, 1], "radius": 1}, "within": 1},
    {"pairs": [[[0, 0, 0], [1, 1, 1]]]}, {"plane": {"point": [1, 1, 1], "normal": [0, 0.0, 0]}}, {"times": 2, "every": 3},
    {"random": 0.1, "seed": 3}, {"random": 0.1}, {"vector": [1, 0, 0]}, {"vector": [1, 0, 0], "side": "z-", "slices": 2},
    {"vector": [1, 0, 0], "to": [1, 1, 1]}, {"random": 0.1, "seed": 3, "voxel": [0, 0, 0]}, {"fraction_of_stable": 0.5},
    {"fraction_of_limit": 0.5}, [{"side": "y+", "fraction": 1}], {"toward": "superior", "strength": 1}, {"toward": "z-"},
    {"side": "left"}, ["wall", 1], [1, "1"], {"wall": 2}, {"": 1},
]


def places(value, found=None):
    """Every (container, key) in a document."""
    found = [] if found is None else found
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, child in items:
        found.append((value, key))
        places(child, found)
    return found


def mutated(generator, seeds, keys):
    document = copy.deepcopy(generator.choice(seeds))
    for _ in range(generator.choice([1, 1, 2])):
        spots = places(document)
        if not spots:
            break
        container, key = generator.choice(spots)
        kind = generator.random()
        if kind < 0.55:
            container[key] = copy.deepcopy(generator.choice(ODD_VALUES))
        elif kind < 0.7:
            del container[key]
        elif isinstance(container, dict):
            container[generator.choice(keys)] = copy.deepcopy(generator.choice(ODD_VALUES))
        else:
            container.append(copy.deepcopy(generator.choice(ODD_VALUES)))
    return document


def main():
    scene_check, schema_file, corpus_file, *scene_files = sys.argv[1:]
    with open(schema_file, encoding="utf-8") as file:
        schema = json.load(file)
    jsonschema.Draft7Validator.check_schema(schema)
    validator = jsonschema.Draft7Validator(schema)
    with open(corpus_file, encoding="utf-8") as file:
        corpus = json.load(file)
    scenes = []
    for name in scene_files:
        with open(name, encoding="utf-8") as file:
            scenes.append(json.load(file))

    good = scenes + corpus["accepted"]
    bad = [case["scene"] for case in corpus["refused"]]
    keys = sorted({key for document in good + bad for holder, key in places(document)
                   if isinstance(holder, dict)})
    generator = random.Random(1)
    mutants = [mutated(generator, good, keys) for _ in range(MUTATIONS)]
    documents = good + bad + mutants
    answers = subprocess.run([scene_check], input="".join(json.dumps(d) + "\n" for d in documents),
                             capture_output=True, text=True, check=True).stdout.splitlines()
    assert len(answers) == len(documents), (len(answers), len(documents))

    failures = 0
    accepted = 0
    for number, (document, answer) in enumerate(zip(documents, answers)):
        valid = validator.is_valid(document)
        expected = number < len(good) if number < len(good) + len(bad) else answer == "accepted"
        accepted += number >= len(good) + len(bad) and valid
        if valid != expected or (answer == "accepted") != expected:
            failures += 1
            print(f"{json.dumps(document)}\n  schema: {'accepts' if valid else 'refuses'}, parser: {answer}")
    print(f"{len(good)} good, {len(bad)} bad, {MUTATIONS} mutated ({accepted} of them acceptable): "
          f"{failures} disagreements")
    # If all mutations were refused, or all accepted, nothing would be compared.
    assert MUTATIONS // 20 < accepted < MUTATIONS - MUTATIONS // 20, accepted
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
