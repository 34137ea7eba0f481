"""The parts of results/report.py: they read results, make figures of them, and write the page around the figures."""

import importlib.resources


def text_of(name):
    """The text of a file in this package."""
    return (importlib.resources.files(__package__) / name).read_text(encoding="utf-8")
