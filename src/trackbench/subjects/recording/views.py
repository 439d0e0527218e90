"""The views of the scene: the observer or a vehicle with its surroundings, and vehicles close up, all following.

And maps of the recorded run: the estimates of each contender over the true paths.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import rerun as rr
import rerun.blueprint as rrb

from trackbench.base.types import Array
from trackbench.document.palette import TRUTH_COLOUR
from trackbench.report.figures.map import path_of
from trackbench.results import Tables
from trackbench.results.columns import split
from trackbench.subjects.recording.focus import Focus
from trackbench.subjects.recording.scene import FRAMES, LABEL_COLOUR, LABELS, MEASUREMENTS, ROADS, WORLD
from trackbench.subjects.recording.stream import TIMELINE, Stream, path, pixels, rgba
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


ESTIMATES, FRAME = "estimates_map", "map_frame"
#: Estimates that are this far apart at most are joined, s.
GAP_S = 3.0
#: A map this many times as wide as high has the whole width.
ELONGATED = 4.0


class EstimateMap:
    """A map for each contender: its estimates over the true paths.

    Args:
        tables: of the recorded run, whose identities are known.
        colours: by name of the contender.
    """

    def __init__(self, tables: Tables, colours: Mapping[str, str]) -> None:
        self._colours = colours
        self._truth = [
            path_of(rows) for (_, role), rows in split(tables.truth, "object", "role").items() if role == "target"
        ]
        self._estimates: dict[str, list[Array]] = {}
        for (tracker, _), rows in split(tables.if_there("estimates"), "tracker", "object").items():
            if tracker in colours:
                self._estimates.setdefault(tracker, []).extend(_strips(rows))

    def send(self, stream: Stream) -> None:
        """Send the true paths, broad and grey, and the estimates of each contender, thin and in its colour."""
        stream.turn_y_down(FRAME)
        broad: dict[str, Any] = {"colors": rgba(TRUTH_COLOUR), "radii": pixels(2.5), "draw_order": 1.0}
        truth = [np.stack(of, axis=1) for of in self._truth]
        stream.static(path(ESTIMATES, "truth"), rr.LineStrips2D(truth, **broad))
        for tracker, strips in self._estimates.items():
            thin: dict[str, Any] = {"colors": rgba(self._colours[tracker]), "radii": pixels(0.75), "draw_order": 2.0}
            stream.static(path(ESTIMATES, tracker), rr.LineStrips2D(strips, **thin))

    def view(self) -> rrb.Container:
        """Return the maps, each in a view."""
        x, y = (np.concatenate([of[axis] for of in self._truth]) for axis in (0, 1))
        left, right, low, high = x.min() - MARGIN, x.max() + MARGIN, y.min() - MARGIN, y.max() + MARGIN
        shown = f"+ {path(*ROADS)}", f"+ {path(ESTIMATES, 'truth')}"
        views = (
            from_above(
                FRAME,
                f"Estimates of {tracker}",
                [*shown, f"+ {path(ESTIMATES, tracker)}"],
                ((left, right), (-high, -low)),
                {},
            )
            for tracker in self._estimates
        )
        columns = 1 if right - left > ELONGATED * (high - low) else min(3, len(self._estimates))
        return rrb.Grid(*views, grid_columns=columns, name="Map of estimates")

    def __bool__(self) -> bool:
        return bool(self._estimates)


def _strips(rows: Mapping[str, Array]) -> list[Array]:
    """Return the estimates of an object in pieces ``(points, 2)``, m, that end where there are none."""
    there = np.isfinite(rows["px_m"] + rows["py_m"])
    at, time = np.stack([rows["px_m"], rows["py_m"]], axis=1)[there], rows["time_s"][there]
    return [strip for strip in np.split(at, np.flatnonzero(np.diff(time) > GAP_S + 1e-9) + 1) if len(strip) > 1]
