"""The one legend of a recording: every colour with its name, in a view of its own that covers nothing."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from trackbench.document.palette import BOUND_COLOUR, IDENTITY_COLOURS, OBSERVER_COLOUR, sensor_colours
from trackbench.document.replay import NamedColour
from trackbench.subjects.recording.stream import Stream, path, pixels, rgba
from trackbench.subjects.recording.track_scene import ASSOCIATION_COLOUR, MARKED, MISSED
from trackbench.subjects.recording.views import BACKGROUND

LEGEND = "legend"
#: Pixels of the view, of a letter and of the room around a name.
WIDTH, LETTER, AROUND = 380.0, 7.0, 26.0
ROW, MARK, RING = 40.0, 22.0, 6.0


def entries(trackers: Mapping[str, str], sensors: list[str]) -> list[NamedColour]:
    """Trackers by their colours, measurements of each sensor, truth with the bounds, and the observer."""
    return [
        *(NamedColour(name, colour) for name, colour in trackers.items()),
        *(NamedColour(name, colour, "dot") for name, colour in sensor_colours(sensors).items()),
        NamedColour("truth, bounds", BOUND_COLOUR),
        NamedColour("observer", OBSERVER_COLOUR),
    ]


def send_legend(stream: Stream, shown: list[NamedColour]) -> None:
    """A line, dots or a ring above each name, in rows."""
    for number, (entry, x, y) in enumerate(_placed(shown)):
        style: dict[str, Any] = {"colors": rgba(entry.colour), "labels": entry.name, "show_labels": True}
        if entry.mark == "line":
            mark: rr.AsComponents = rr.LineStrips2D(
                [[(x - MARK / 2, y), (x + MARK / 2, y)]], radii=pixels(1.5), **style
            )
        elif entry.mark == "ring":
            angle = np.linspace(0, 2 * np.pi, 25)
            ring = np.stack([x + RING * np.cos(angle), y + RING * np.sin(angle)], axis=1)
            mark = rr.LineStrips2D([ring], radii=pixels(1.5), **style)
        else:
            mark = rr.Points2D([(x, y)], radii=pixels(5.0 if entry.mark == "mark" else 3.0), **style)
        stream.static(path(LEGEND, str(number)), mark)
        if entry.others:
            beside = [(x + (MARK / 2) * (-1) ** i * (i // 2 + 1), y) for i in range(len(entry.others))]
            colours = np.array([rgba(colour) for colour in entry.others], dtype=np.uint32)
            stream.static(path(LEGEND, str(number), "others"), rr.Points2D(beside, colors=colours, radii=pixels(3.0)))


def legend_view(shown: list[NamedColour]) -> rrb.Spatial2DView:
    """The view, as wide as the names take."""
    return rrb.Spatial2DView(
        origin=LEGEND,
        name="Legend",
        visual_bounds=rrb.VisualBounds2D(x_range=(0.0, WIDTH), y_range=(0.0, height(shown))),
        background=BACKGROUND,
    )


def height(shown: list[NamedColour]) -> float:
    """Pixels that the rows take."""
    return max(y for _, _, y in _placed(shown)) + 0.9 * ROW


def _placed(shown: list[NamedColour]) -> Iterator[tuple[NamedColour, float, float]]:
    """Each entry with the middle of its mark, in columns as wide as the longest name."""
    longest = max(len(entry.name) for entry in shown)
    columns = max(1, min(len(shown), int(WIDTH / (LETTER * longest + AROUND))))
    row, column = np.divmod(np.arange(len(shown)), columns)
    for entry, i, k in zip(shown, row, column, strict=True):
        yield entry, float((k + 0.5) * WIDTH / columns), float((i + 0.25) * ROW)


#: The first identity's on the dark ground, at an existence probability of 0.4.
FAINT_COLOUR = "#85863F"


def track_entries(trackers: Mapping[str, str], sensors: list[str]) -> list[NamedColour]:
    """What is in the scene, and the trackers, whose colours are those of the plots."""
    return [
        NamedColour("tracks", IDENTITY_COLOURS[0], "dot", IDENTITY_COLOURS[1:]),
        NamedColour("faint: unsure", FAINT_COLOUR, "dot"),
        NamedColour("due, no track", MISSED, "ring"),
        NamedColour("false track", MARKED["false"], "mark"),
        NamedColour("lost, merged", MARKED["lost"], "mark"),
        NamedColour("switch", MARKED["switched"], "mark"),
        *(NamedColour(name, colour, "dot") for name, colour in sensor_colours(sensors).items()),
        NamedColour("association", ASSOCIATION_COLOUR, "line"),
        NamedColour("truth", BOUND_COLOUR),
        NamedColour("observer", OBSERVER_COLOUR),
        *(NamedColour(f"{name} (plots)", colour) for name, colour in trackers.items()),
    ]
