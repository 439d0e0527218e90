"""The views of the scene: the observer with its surroundings, and each target close up, all following."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import rerun as rr
import rerun.blueprint as rrb

from trackbench.recording.scene import FRAMES, LABELS, MEASUREMENTS, WORLD
from trackbench.recording.stream import TIMELINE, Stream, path, pixels, rgba
from trackbench.recording.tables import split

#: How long a measurement stays in the picture, s.
TRAIL = 0.3
#: The most that the wide view shows around the observer unless even the nearest target is farther, and its margin, m.
REACH, MARGIN = 55.0, 7.0
#: Half the size of a close-up, m, and how many targets have one.
CLOSE, MOST_CLOSE = 3.0, 6
#: Names in a row of the legend, and the share of a view's height that a row takes.
WIDE_ROW, CLOSE_ROW, LEGEND_ROW = 6, 3, 0.1
BACKGROUND = (16, 18, 22)
SCALE_COLOUR = "#C8CDD4"


class Window(NamedTuple):
    """A view around a frame; x to the right and y down from the frame's origin, m."""

    frame: str
    across: tuple[float, float]
    down: tuple[float, float]
    scale: float
    """Length of its scale bar, m."""


def windows(truth: pa.Table) -> list[Window]:
    """The wide view first, then the close-ups."""
    vehicles = split(truth, "role", "object")
    observer, at = next((name, rows) for (role, name), rows in vehicles.items() if role == "observer")
    targets = {name: rows for (role, name), rows in vehicles.items() if role == "target"}
    alive = np.array([rows["alive"] for rows in targets.values()], dtype=bool)
    x = np.array([rows["px_m"] - at["px_m"] for rows in targets.values()])
    y_down = np.array([at["py_m"] - rows["py_m"] for rows in targets.values()])
    nearest = np.where(alive, np.hypot(x, y_down), np.inf).min(axis=0)
    reach = max(REACH, float(np.percentile(nearest[np.isfinite(nearest)], 90)))

    def extent(offsets: Any) -> tuple[float, float]:
        low, high = np.clip(np.percentile(offsets[alive], [5, 95]), -reach, reach)
        return float(min(low, 0.0)) - MARGIN, float(max(high, 0.0)) + MARGIN

    wide = Window(observer, extent(x), extent(y_down), 10.0)
    return [wide, *(Window(name, (-CLOSE, CLOSE), (-CLOSE, CLOSE), 1.0) for name in list(targets)[:MOST_CLOSE])]


def send_scales(stream: Stream, all_windows: list[Window]) -> None:
    """A scale bar at the lower left of each view."""
    for window in all_windows:
        top, bottom = window.down
        x, y = window.across[0] + window.scale / 2, bottom - 0.08 * (bottom - top)
        bar = rr.LineStrips2D(
            [[(x, y), (x + window.scale, y)]],
            colors=rgba(SCALE_COLOUR),
            radii=pixels(1.0),
            labels=f"{window.scale:g} m",
            show_labels=True,
        )
        stream.static(path(*FRAMES, window.frame, "scale"), bar)


def send_legends(stream: Stream, all_windows: list[Window], colours: Mapping[str, str]) -> None:
    """The trackers' names in their colours, in rows at the top of each view."""
    wide, *close = all_windows
    for window, in_row in ((wide, WIDE_ROW), *((each, CLOSE_ROW) for each in close)):
        (left, right), (top, bottom) = window.across, window.down
        row, place = np.divmod(np.arange(len(colours)), in_row)
        x, y = left + (place + 0.5) / in_row * (right - left), top + (row + 0.3) * LEGEND_ROW * (bottom - top)
        names = rr.Points2D(
            np.stack([x, y], axis=1),
            labels=list(colours),
            colors=np.array([rgba(colour) for colour in colours.values()], dtype=np.uint32),
            radii=pixels(2.5),
            show_labels=True,
            draw_order=50.0,
        )
        stream.static(path(*FRAMES, window.frame, "legend"), names)


def scene_views(all_windows: list[Window], sensors: list[str]) -> rrb.Container:
    """The wide view beside tabs of the close-ups."""
    wide, *close = all_windows
    around = _view(wide, "Seen from above", sensors)
    tabs = [_view(window, window.frame, sensors, f"- {path(*LABELS)}") for window in close]
    return rrb.Horizontal(around, rrb.Tabs(*tabs, active_tab=0), column_shares=[2, 1])


def _view(window: Window, name: str, sensors: list[str], *without: str) -> rrb.Spatial2DView:
    frame = path(*FRAMES, window.frame)
    contents = [f"+ {path(*WORLD)}/**", f"- {path(*FRAMES)}/**", f"+ {frame}/**", *without]
    measurements = [path(*MEASUREMENTS, sensor) for sensor in sensors]
    return from_above(frame, name, contents, (window.across, window.down), measurements, TRAIL)


def from_above(
    frame: str,
    name: str,
    contents: list[str],
    bounds: tuple[tuple[float, float], tuple[float, float]],
    measurements: list[str],
    trail: float,
) -> rrb.Spatial2DView:
    """A view of a scene.

    Args:
        frame: entity whose frame is the view's own; y is down in it.
        name: above the view.
        contents: what is in it, as Rerun's queries.
        bounds: left and right, top and bottom in the frame, m.
        measurements: entities of which the last ones are shown, and not only the latest.
        trail: for how long, s.
    """
    recent = rrb.VisibleTimeRanges(
        timeline=TIMELINE,
        start=rrb.TimeRangeBoundary.cursor_relative(seconds=-trail),
        end=rrb.TimeRangeBoundary.cursor_relative(),
    )
    overrides: Any = dict.fromkeys(measurements, recent)
    return rrb.Spatial2DView(
        origin=frame,
        contents=contents,
        name=name,
        visual_bounds=rrb.VisualBounds2D(x_range=bounds[0], y_range=bounds[1]),
        background=BACKGROUND,
        overrides=overrides,
    )
