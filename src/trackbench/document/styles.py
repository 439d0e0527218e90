"""How trackers look: one colour and line style for each, in every figure, page and recording of a batch."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from trackbench.document.model import LegendEntry, TrackerStyle
from trackbench.document.palette import TRACKER_COLOURS

_LINES = ("solid", (0, (6, 1.5, 1.5, 1.5)), (0, (1.5, 1.5)))


def tracker_styles(colours: Mapping[str, str]) -> dict[str, TrackerStyle]:
    """By name, from :func:`~trackbench.document.palette.tracker_colours`; a repeated colour has another line."""
    return {
        name: TrackerStyle(f"t{i}", name, colour, _LINES[i // len(TRACKER_COLOURS) % len(_LINES)])
        for i, (name, colour) in enumerate(colours.items())
    }


def legend_of(styles: Iterable[TrackerStyle]) -> tuple[LegendEntry, ...]:
    """Legend lines for trackers."""
    return tuple(
        LegendEntry(style.name, style.colour, "line" if style.line == "solid" else "dash", style.key)
        for style in styles
    )


def tooltips_of(styles: Iterable[TrackerStyle]) -> dict[str, str]:
    """The tooltip of all that is drawn of a tracker: its name."""
    return {style.key: style.name for style in styles}
