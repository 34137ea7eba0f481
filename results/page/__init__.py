"""What results/report.py makes its page of: results as they are read, figures, and the document around them."""

import importlib.resources


def text_of(name):
    """The text of a file in this package."""
    return (importlib.resources.files(__package__) / name).read_text(encoding="utf-8")
