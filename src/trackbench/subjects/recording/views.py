"""The views of the scene: the observer or a vehicle with its surroundings, and vehicles close up, all following.

And where the errors are: the true paths of the recorded run in the colour of the position error of each contender.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import rerun as rr
import rerun.blueprint as rrb

from trackbench.base.types import Array, Indices
from trackbench.document.palette import ERROR_COLOURS, error_labels, error_limits
from trackbench.document.replay import NamedColour
from trackbench.results import Tables
from trackbench.results.columns import Columns, split
from trackbench.subjects.recording.focus import Focus
from trackbench.subjects.recording.scene import FRAMES, LABEL_COLOUR, LABELS, MEASUREMENTS, ROADS, WORLD
from trackbench.subjects.recording.stream import TIMELINE, Stream, path, pixels, rgba, rgba_of
from trackbench.subjects.recording.tracks import trails

#: How long a measurement stays in the picture, s.
RECENT_S = 0.3
#: The most that the wide view shows around the observer unless even the nearest target is farther, and its margin, m.
REACH, MARGIN = 55.0, 7.0
#: Half the size of a close-up, m.
CLOSE = 3.0
#: Half the size of a view of a vehicle and its neighbours, m.
NEAR = 9.0
#: About the size of the wide view on a screen, pixels.
WIDE_PIXELS = (750.0, 360.0)
BACKGROUND = (16, 18, 22)


class Window(NamedTuple):
    """A view around a frame; x to the right and y down from the frame's origin, m."""

    frame: str
    kind: str
    across: tuple[float, float]
    down: tuple[float, float]
    scale: float
    """Length of its scale bar, m."""

    @property
    def metres_per_pixel(self) -> float:
        """About how much a pixel of the wide view shows."""
        sides = (self.across[1] - self.across[0], self.down[1] - self.down[0])
        return max(side / pixels for side, pixels in zip(sides, WIDE_PIXELS, strict=True))

    def around(self, vehicle: str) -> Window:
        """Return a view of this size with a vehicle in the middle."""
        half = [(high - low) / 2 for low, high in (self.across, self.down)]
        return Window(vehicle, "around", (-half[0], half[0]), (-half[1], half[1]), self.scale)

    def closer(self, beside: tuple[float, float] = (0.0, 0.0)) -> Window:
        """Return the view up to ``NEAR`` from the middle, or from a place ``beside`` it, m to the right and up."""
        (left, right), (top, bottom) = self.across, self.down
        x, y = (left + right) / 2 + beside[0], (top + bottom) / 2 - beside[1]
        return self._replace(across=(x - NEAR, x + NEAR), down=(y - NEAR, y + NEAR))


def wide_window(truth: pa.Table) -> Window:
    """Return the observer's view, which has the vehicles nearby most of the time, or else the surroundings."""
    vehicles = split(truth, "role", "object")
    observer, at = next((name, rows) for (role, name), rows in vehicles.items() if role == "observer")
    targets = [rows for (role, _), rows in vehicles.items() if role == "target"]
    alive = np.array([rows["alive"] for rows in targets], dtype=bool)
    if not alive.any():
        side = REACH + MARGIN
        return Window(observer, "wide", (-side, side), (-side / 2, side / 2), 10.0)
    x = np.array([rows["px_m"] - at["px_m"] for rows in targets])
    y_down = np.array([at["py_m"] - rows["py_m"] for rows in targets])
    nearest = np.where(alive, np.hypot(x, y_down), np.inf).min(axis=0)
    reach = max(REACH, float(np.percentile(nearest[np.isfinite(nearest)], 90)))

    def extent(offsets: Any) -> tuple[float, float]:
        low, high = np.clip(np.percentile(offsets[alive], [5, 95]), -reach, reach)
        return float(min(low, 0.0)) - MARGIN, float(max(high, 0.0)) + MARGIN

    return Window(observer, "wide", extent(x), extent(y_down), 10.0)


def close_up(vehicle: str) -> Window:
    """Return a view of a vehicle and little else."""
    return Window(vehicle, "close", (-CLOSE, CLOSE), (-CLOSE, CLOSE), 1.0)


def send_scales(stream: Stream, wide: Window, vehicles: Iterable[str]) -> None:
    """Send a scale bar at the lower left of each view that may be opened."""
    for window in (wide, *(each for name in vehicles for each in (wide.around(name), close_up(name)))):
        top, bottom = window.down
        x, y = window.across[0] + window.scale / 2, bottom - 0.08 * (bottom - top)
        bar = rr.LineStrips2D(
            [[(x, y), (x + window.scale, y)]],
            colors=rgba(LABEL_COLOUR),
            radii=pixels(1.0),
            labels=f"{window.scale:g} m",
            show_labels=True,
        )
        stream.static(path(*FRAMES, window.frame, window.kind), bar)


def scene_views(
    wide: Window,
    vehicles: list[str],
    sensors: Iterable[str],
    trackers: Iterable[str],
    focus: Focus,
    first: str | None = None,
) -> rrb.Container:
    """Return the wide view beside tabs with a close-up of each of ``vehicles``, ``first`` in front.

    The one in focus is also in the middle of the wide view.
    """
    shown = {path(*MEASUREMENTS, sensor): RECENT_S for sensor in sensors} | trails(trackers)
    name = "Seen from above"
    if focus.vehicle is not None:
        wide, name = wide.around(focus.vehicle), f"{name}, around {focus.vehicle}"
    tabs = [scene_view(close_up(each), each, shown, f"- {path(*LABELS)}") for each in vehicles]
    front = focus.vehicle or first
    tab = vehicles.index(front) if front in vehicles else 0
    return rrb.Horizontal(scene_view(wide, name, shown), rrb.Tabs(*tabs, active_tab=tab), column_shares=[2, 1])


def scene_view(window: Window, name: str, shown: Mapping[str, float], *without: str) -> rrb.Spatial2DView:
    frame = path(*FRAMES, window.frame)
    contents = [f"+ {path(*WORLD)}/**", f"- {path(*FRAMES)}/**", f"+ {frame}"]
    contents += [f"+ {path(*FRAMES, window.frame, window.kind)}", *without]
    return from_above(frame, name, contents, (window.across, window.down), shown)


def from_above(
    frame: str,
    name: str,
    contents: list[str],
    bounds: tuple[tuple[float, float], tuple[float, float]],
    shown: Mapping[str, float],
) -> rrb.Spatial2DView:
    """Return a view of a scene.

    Args:
        frame: entity whose frame is the view's own; y is down in it.
        name: above the view.
        contents: Rerun's queries for what is in it.
        bounds: left and right, top and bottom in the frame, m.
        shown: entities that are shown for a while: for how long, s.
    """
    overrides: Any = {
        entity: rrb.VisibleTimeRanges(
            timeline=TIMELINE,
            start=rrb.TimeRangeBoundary.cursor_relative(seconds=-duration),
            end=rrb.TimeRangeBoundary.cursor_relative(),
        )
        for entity, duration in shown.items()
    }
    return rrb.Spatial2DView(
        origin=frame,
        contents=contents,
        name=name,
        visual_bounds=rrb.VisualBounds2D(x_range=bounds[0], y_range=bounds[1]),
        background=BACKGROUND,
        overrides=overrides,
    )


ERRORS, FRAME = "errors", "errors_frame"
#: Pieces of a path end this far apart at most, s.
GAP_S = 3.0
#: A map this many times as wide as high has the whole width.
ELONGATED = 4.0


class ErrorMap:
    """A map for each contender.

    Args:
        tables: of the recorded run, whose identities are known.
        trackers: the contenders.
    """

    def __init__(self, tables: Tables, trackers: list[str]) -> None:
        truth = {name: rows for (name,), rows in split(tables.truth, "object").items()}
        self._pieces: dict[str, list[tuple[Array, Array]]] = {}
        for (tracker, name), rows in split(tables.if_there("estimates"), "tracker", "object").items():
            if tracker in trackers:
                self._pieces.setdefault(tracker, []).append(_pieces(truth[name], rows))

    @cached_property
    def limits(self) -> Array:
        """Between the colours, m."""
        return error_limits([error for pieces in self._pieces.values() for _, error in pieces])

    @property
    def legend(self) -> list[NamedColour]:
        """What the colours stand for."""
        labels = (label.replace("under", "error <") for label in error_labels(self.limits))
        return [NamedColour(label, colour) for label, colour in zip(labels, ERROR_COLOURS, strict=False)]

    def send(self, stream: Stream) -> None:
        """Send the pieces of all paths, the largest errors on top."""
        stream.turn_y_down(FRAME)
        palette = rgba_of(ERROR_COLOURS)
        for tracker, pieces in self._pieces.items():
            strips, error = (np.concatenate(part) for part in zip(*pieces, strict=True))
            level: Indices = np.digitize(error, self.limits)
            order = np.argsort(level, kind="stable")
            lines = rr.LineStrips2D(strips[order], colors=palette[level[order]], radii=pixels(1.5), draw_order=2.0)
            stream.static(path(ERRORS, tracker), lines)

    def view(self) -> rrb.Container:
        """Return the maps, each in a view."""
        at = np.concatenate([strips.reshape(-1, 2) for pieces in self._pieces.values() for strips, _ in pieces])
        (left, low), (right, high) = at.min(axis=0) - MARGIN, at.max(axis=0) + MARGIN
        views = (
            from_above(
                FRAME,
                f"Position error of {tracker}",
                [f"+ {path(*ROADS)}", f"+ {path(ERRORS, tracker)}"],
                ((left, right), (-high, -low)),
                {},
            )
            for tracker in self._pieces
        )
        columns = 1 if right - left > ELONGATED * (high - low) else min(3, len(self._pieces))
        return rrb.Grid(*views, grid_columns=columns, name="Map of errors")

    def __bool__(self) -> bool:
        return bool(len(self.limits))


def _pieces(truth: Columns, rows: Mapping[str, Array]) -> tuple[Array, Array]:
    """Return the pieces from each estimate to the next, ``(pieces, 2, 2)`` m, and the larger error at their ends, m."""
    time, error = rows["time_s"], rows["position_error_m"]
    step = np.searchsorted(truth["time_s"], time - 1e-9)
    at = np.stack([truth["px_m"][step], truth["py_m"][step]], axis=1)
    joined = np.isfinite(error[1:] + error[:-1]) & (np.diff(time) <= GAP_S + 1e-9)
    return np.stack([at[:-1], at[1:]], axis=1)[joined], np.maximum(error[1:], error[:-1])[joined]
