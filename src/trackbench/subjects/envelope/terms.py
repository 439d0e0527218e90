"""The envelope's terms for ``trackbench explain``."""

from __future__ import annotations

from collections.abc import Iterator

from trackbench.base.subjects import TermPage

_PAGES = {
    "envelope": (
        (
            "a map",
            "The points at which a tracker meets its requirement, over the axes of the `envelope:` block. With 95 % "
            "confidence no cell of the whole map is decided wrongly. Nothing is claimed between cells.",
        ),
    ),
    "cell": (
        (
            "in a map",
            "A point that was run, and holds, fails or is not shown to do either, in files undecided. Runs are added "
            "until it is decided or its budget is spent; new cells are put between neighbours that differ.",
        ),
    ),
    "margin": (
        (
            "along one axis",
            "How far the axis may go, all else as in the scenario, until the requirement is no longer met. Its band is "
            "from the last cell that holds to the first that fails: `2.1 ± 0.1`.",
        ),
    ),
}


def map_terms() -> Iterator[TermPage]:
    """Return the pages of the terms `envelope`, `cell` and `margin`."""
    return (TermPage(name, page) for name, page in _PAGES.items())
