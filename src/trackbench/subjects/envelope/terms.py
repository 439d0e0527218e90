"""The envelope's terms for ``trackbench explain``."""

from __future__ import annotations

from collections.abc import Iterator

from trackbench.base.subjects import TermPage

_PAGES = {
    "envelope": (
        ("a map", "The points at which a tracker meets its requirement, over the axes of the `envelope:` block."),
        (
            "confidence",
            "The error is spent over all cells, trackers and looks: with 95 % confidence no cell of the whole map is "
            "decided wrongly, if no kind of run is rarer than the runs can show. Nothing is claimed between cells: the "
            "border there is interpolated.",
        ),
    ),
    "cell": (
        (
            "in a map",
            "A point that was run, and is holds, fails or undecided. Runs are added until it is decided or its budget "
            "is spent; new cells are put between neighbours that differ.",
        ),
    ),
    "claim": (("file", "`claim.json`: every cell of a map, and what is needed to make it again."),),
    "undecided": (
        (
            "a state of a cell",
            "The bounds of the value, at the error that is spent, lie on both sides of the limit after the last look, "
            "or there is no value. It is neither holds nor fails; the headline says which share of cells is so.",
        ),
        (
            "every run is the same",
            "There is no bound where all runs have the same value, and further runs decide nothing. Limits on a share "
            "or a rate, such as `missed_warnings`, are decided there too.",
        ),
    ),
    "margin": (
        (
            "along one axis",
            "How far the axis may go, all else as in the scenario, or as in the line of cells that is nearest to it, "
            "until the requirement is no longer met.",
        ),
        (
            "its band",
            "From the last cell that holds to the first that fails; the cells between them are undecided. The border "
            "within it is where the interpolated value meets the limit. `2.1 ± 0.1`: it is the middle of its band.",
        ),
    ),
}


def map_terms() -> Iterator[TermPage]:
    """The words of a map."""
    return (TermPage(name, page) for name, page in _PAGES.items())
