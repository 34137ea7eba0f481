"""What the figures of results share: matplotlib, found or named, and the same small file from the same result."""

import re
import sys

import result_files
from page import reading


def refuse(message):
    """Ends the script as bad input does everywhere here."""
    print(f"{sys.argv[0].rpartition('/')[2]}: {message}", file=sys.stderr)
    sys.exit(2)


try:
    import matplotlib
except ImportError as absent:
    refuse(f"{absent}: install Debian's python3-matplotlib, or with pip matplotlib")
matplotlib.use("Agg")
# Text as text, and no random ids.
matplotlib.rcParams.update({"svg.hashsalt": "voxspring", "svg.fonttype": "none", "font.size": 9,
                            "font.sans-serif": ["DejaVu Sans"]})

# Of the points, which an SVG holds as an image: thousands of them would each take a line.
DOTS_PER_INCH = 160


def read(path, study):
    """A result that has the list which studies of a kind write; ends the script where it has none."""
    try:
        result = reading.read(path)
    except result_files.BadInput as error:
        refuse(error)
    if not result.lists[study]:
        refuse(f"{path}: {study}: has no rows; expected the result of a study of kind {study}")
    return result


def save(figure, paths):
    """Writes a figure as SVG or PNG, without date or version, so that a file changes with its result alone."""
    for path in paths:
        try:
            figure.savefig(path, dpi=DOTS_PER_INCH, metadata=dict.fromkeys(("Date", "Creator") if path.suffix == ".svg"
                                                                           else ("Software",)))
            if path.suffix == ".svg":
                # Matplotlib writes millionths of a point.
                path.write_text(re.sub(r"(\d\.\d\d)\d+", r"\1", path.read_text(encoding="utf-8")), encoding="utf-8")
        except OSError as error:
            refuse(f"--out: {error}")
