"""Pictures of the datasets: which to draw, drawing them with the program, and reading them back.

A dataset has two pictures of the body after a run in the formulation and precision that are the fastest in its results: one
is coloured by displacement, one by the error against float64. If a dataset has several sizes, one size is drawn. The PNG file has
a text with the key "voxspring", JSON that says what the picture shows, so that a wrong picture is noticed.
"""

import collections
import io
import json
import re
import subprocess
from dataclasses import dataclass

import PIL.Image

import result_files

from . import reading

# The last bytes of a complete PNG file.
END = b"IEND\xaeB`\x82"
COLOURED_BY = ("displacement", "error")
SIZE = "560x420"
# The largest number of particle updates of a run (about two seconds of float64 on one core), and of its steps.
UPDATES = 30_000_000
MAX_STEPS = 2000
# A dataset is drawn in its largest size with at most this many particles, for which UPDATES allows some hundred
# steps. If all sizes have more particles, the smallest size is drawn.
FAMILIAR = 100_000
# Bodies of more particles are not drawn.
MAX_PARTICLES = 4_000_000
SECONDS = 120
ANOTHER_SIZE = "as those shown, in another size"
# The name of a built-in scene, perhaps with a size. No other text of a result file gets onto the program's command line.
NAME = re.compile(r"\w+(@\w+)?")


@dataclass
class Wanted:
    """How a dataset is to be drawn."""

    scene: str
    particles: int
    formulation: str
    precision: str

    @property
    def steps(self):
        steps = max(1, min(MAX_STEPS, UPDATES // self.particles))
        return steps if steps < 100 else steps // 100 * 100

    def name(self, coloured_by):
        words = (self.scene, self.formulation, self.precision, str(self.steps), SIZE, coloured_by)
        return "-".join(re.sub(r"[^\w@]", "_", word) for word in words) + ".png"

    def command(self, program, path, coloured_by):
        return [program, "run", self.scene, "--steps", str(self.steps), "--size", SIZE, "--colour", coloured_by,
                "--backend", f"auto:formulation={self.formulation},precision={self.precision}", "--out", path]


# about: what the picture shows, from the text "voxspring" in its file. data: the bytes of the file.
Picture = collections.namedtuple("Picture", "about data width height")


def choose(results):
    """Returns what is to be drawn of the timed datasets, the heart first and the others by name, and [(scenes, reason)] for scenes
    that are left out."""
    runs = [{**run, "microseconds": run["seconds"] / run["steps"] * 1e6} for run in reading.pareto(results)
            if run["particles"]]
    best = {scene: min(own, key=lambda row: row["microseconds"])
            for (scene,), own in result_files.groups(reading.measured(results) + runs, "scene").items()}
    others = [scene for scene in best if not NAME.fullmatch(scene)]
    shown = sorted((row for row in best.values() if row["scene"] not in others), key=lambda row: row["particles"])
    chosen, sizes, large = [], [], []
    for group in result_files.groups(shown, lambda row: row["scene"].split("@")[0]).values():
        drawable = [row for row in group if row["particles"] <= MAX_PARTICLES]
        large += [row["scene"] for row in group if row["particles"] > MAX_PARTICLES]
        if not drawable:
            continue
        row = ([row for row in drawable if row["particles"] <= FAMILIAR] or drawable[:1])[-1]
        chosen.append(Wanted(row["scene"], row["particles"], row["formulation"], row["precision"]))
        sizes += [other["scene"] for other in drawable if other is not row]
    reasons = ((sizes, ANOTHER_SIZE), (others, "no built-in scene has such a name"),
               (large, f"more than {MAX_PARTICLES // 1_000_000} million particles"))
    # The heart comes first, since readers remember it best.
    chosen.sort(key=lambda wanted: (not wanted.scene.startswith("heart"), reading.natural(wanted.scene)))
    return chosen, [(scenes, reason) for scenes, reason in reasons if scenes]


def read(path):
    """Reads a PNG file whose text with the key "voxspring" says what it shows. Refuses one that lacks the text or is cut off."""
    try:
        data = path.read_bytes()
    except OSError as error:
        raise reading.BadInput(f"{path}: {error.strerror}") from None
    try:
        with PIL.Image.open(io.BytesIO(data), formats=["PNG"]) as image:
            text = image.info["voxspring"]
            image.verify()
        if not data.endswith(END):
            raise SyntaxError
    except (KeyError, OSError, SyntaxError):
        raise reading.BadInput(f"{path}: begins with {data[:8]!r}, is cut off or has no text voxspring: expected a PNG file that "
                               "voxspring run --out drew") from None
    try:
        about = json.loads(text)
    except ValueError:
        about = None
    reading.check(path, about, "picture", "voxspring")
    return Picture(about, data, *image.size)


def draw(program, path, wanted, coloured_by):
    """Draws a picture, unless its file exists and is newer than the program. Returns why it could not, or an empty text."""
    try:
        if path.exists() and path.stat().st_mtime > program.stat().st_mtime:
            return ""
        # The picture is from an older program.
        path.unlink(missing_ok=True)
        done = subprocess.run(wanted.command(program, path, coloured_by), capture_output=True, text=True, timeout=SECONDS)
    except OSError as error:
        raise reading.BadInput(f"--program {program}: {error.strerror}") from None
    except subprocess.TimeoutExpired:
        return f"not drawn within {SECONDS} seconds"
    lines = done.stderr.strip().splitlines() or [f"exit code {done.returncode}"]
    reason = lines[-1].removeprefix("voxspring: ")
    return "" if done.returncode == 0 else reason if len(reason) <= 120 else reason[:117] + "..."


def gather(results, folder, program):
    """Returns {dataset: its two pictures in the folder} and [(scenes, reason)] for scenes without pictures. The program, if given,
    draws missing pictures."""
    chosen, left_out = choose(results)
    if program:
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise reading.BadInput(f"--pictures {folder}: {error.strerror}") from None
    found, missing = {}, {}
    for wanted in chosen:
        paths = {coloured_by: folder / wanted.name(coloured_by) for coloured_by in COLOURED_BY}
        reasons = (draw(program, path, wanted, coloured_by) for coloured_by, path in paths.items() if program)
        reason = next(filter(None, reasons), "")
        if not reason and not all(path.exists() for path in paths.values()):
            reason = "no program was there to draw it"
        drawn = [] if reason else [read(path) for path in paths.values()]
        if any(picture.about["particles"] != wanted.particles for picture in drawn):
            reason = "the built-in scene of that name is another body"
        if reason:
            missing.setdefault(reason, []).append(wanted.scene)
        else:
            found[wanted.scene] = drawn
    # The reason ANOTHER_SIZE refers to pictures that are shown, so it is left out if there are none.
    return found, [(scenes, reason) for scenes, reason in left_out if found or reason != ANOTHER_SIZE] + [
        (scenes, reason) for reason, scenes in missing.items()]
