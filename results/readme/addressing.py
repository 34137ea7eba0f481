"""Explicit against implicit addressing, by size and by sparsity: the paper's first question."""

from readme.rows import PAPER, fastest_of, medians
from result_files import groups, listed

# Positions (48 bytes per particle) and lists (72 bytes) of more particles exceed the 60 MB of an H200's L2.
LARGE = 500_000
# A body that fills less of its grid than this is sparse.
SPARSE = 0.5
KINDS = ("small sparse", "small full", "large sparse", "large full")
# Two times that differ by less than this share are called the same.
ALIKE = 0.03


def of_paper(kind):
    """The paper's CUDA strategies with a kind of addressing, in the paper's order."""
    found = {row["backend"] for row in medians("table1") if row["family"] == "CUDA" and row["addressing"] == kind}
    return tuple(name for name in PAPER if name in found)


IMPLICIT, EXPLICIT = of_paper("implicit"), of_paper("explicit")


class Dataset:
    """What the paper's CUDA strategies take on a scene, each with the tuning that suits it best, and later lists."""

    def __init__(self, rows):
        self.scene, self.particles = rows[0]["scene"], rows[0]["particles"]
        self.active = rows[0]["particles"] / rows[0]["voxels"]
        self.implicit = [row for row in rows if row["backend"] in IMPLICIT]
        self.explicit = [row for row in rows if row["backend"] in EXPLICIT]
        self.later = [row for row in rows if row["family"] == "CUDA" and row["addressing"] == "explicit" and row["backend"] not in PAPER]

    @property
    def ratio(self):
        """The best explicit time over the best implicit one."""
        return fastest_of(self.explicit)["real_time"] / fastest_of(self.implicit)["real_time"]

    @property
    def kind(self):
        return ("large" if self.particles > LARGE else "small") + (" sparse" if self.active < SPARSE else " full")


def datasets(formulation="position"):
    """The datasets of the study fastest on which both kinds of addressing ran without edits, small ones first."""
    rows = [row for row in medians("fastest")
            if row["formulation"] == formulation and row["precision"] == "float32" and not row.get("edits")]
    found = map(Dataset, groups(rows, "scene").values())
    return sorted((one for one in found if one.implicit and one.explicit), key=lambda one: (one.particles, one.active))


def winner(ratios):
    """What ratios of explicit over implicit times say together: "holds" if explicit wins, "inverts" if implicit does."""
    if all(ratio < 1 - ALIKE for ratio in ratios):
        return "holds"
    return "inverts" if all(ratio > 1 + ALIKE for ratio in ratios) else "is undecided"


def verdict():
    """`holds for small sparse bodies, inverts for large sparse and large full bodies`."""
    by_kind = groups(datasets(), lambda one: one.kind)
    ratios = {kind: winner([one.ratio for one in by_kind[kind,]]) for kind in KINDS if (kind,) in by_kind}
    if len(set(ratios.values())) == 1:
        return next(iter(ratios.values()))
    said = {word: [kind for kind, verdict_of in ratios.items() if verdict_of == word] for word in ("holds", "is undecided", "inverts")}
    return ", ".join(f"{word} for {listed(kinds)} bodies" for word, kinds in said.items() if kinds)
