"""The views of the scene and the maps.

A view of the scene follows the observer, or a vehicle with its surroundings or close up. A map has each tracker's
estimated paths over the true ones.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import rerun as rr
import rerun.blueprint as rrb

from trackbench.base.types import Array
from trackbench.document.palette import TRUTH_COLOUR
from trackbench.results import Tables
from trackbench.results.columns import split
from trackbench.subjects.recording.focus import Focus
from trackbench.subjects.recording.scene import FRAMES, LABEL_COLOUR, LABELS, MEASUREMENTS, ROADS, WORLD
from trackbench.subjects.recording.stream import TIMELINE, Stream, path, pixels, rgba
from trackbench.subjects.recording.tracks import trails

#: Time for which a measurement stays visible, s.
RECENT_S = 0.3
#: Largest reach of the wide view around the observer, unless the nearest target is farther, and its margin, m.
REACH, MARGIN = 55.0, 7.0
#: Half the size of a close-up, m.
CLOSE = 3.0
#: Half the size of a view of a vehicle and its neighbours, m.
NEAR = 9.0
#: About the size of the wide view on a screen, pixels.
WIDE_PIXELS = (750.0, 360.0)
BACKGROUND = (16, 18, 22)


class Window(NamedTuple):
    """Rectangle of a view around a frame's origin; x points to the right and y down, m."""

    frame: str
    kind: str
    across: tuple[float, float]
    down: tuple[float, float]
    scale: float
    """Length of the scale bar, m."""

    @property
    def metres_per_pixel(self) -> float:
        """Approximate size of a pixel of the wide view, m."""
        sides = (self.across[1] - self.across[0], self.down[1] - self.down[0])
        return max(side / pixels for side, pixels in zip(sides, WIDE_PIXELS, strict=True))

    def around(self, vehicle: str) -> Window:
        """Return a view of equal size with a vehicle in the middle."""
        half = [(high - low) / 2 for low, high in (self.across, self.down)]
        return Window(vehicle, "around", (-half[0], half[0]), (-half[1], half[1]), self.scale)

    def closer(self, offset: tuple[float, float] = (0.0, 0.0)) -> Window:
        """Return a view up to ``NEAR`` from its middle, which is moved by ``offset``, m to the right and up."""
        (left, right), (top, bottom) = self.across, self.down
        x, y = (left + right) / 2 + offset[0], (top + bottom) / 2 - offset[1]
        return self._replace(across=(x - NEAR, x + NEAR), down=(y - NEAR, y + NEAR))


def wide_window(truth: pa.Table) -> Window:
    """Return the observer's view, large enough for nearby vehicles most of the time; a fixed size without vehicles."""
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
    return Window(vehicle, "close", (-CLOSE, CLOSE), (-CLOSE, CLOSE), 1.0)


def send_scales(stream: Stream, wide: Window, vehicles: Iterable[str]) -> None:
    """Send a scale bar for the lower left of each view."""
    for window in (wide, *(view for name in vehicles for view in (wide.around(name), close_up(name)))):
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
    """Return the wide view beside tabs with a close-up of each vehicle.

    The tab of the vehicle in focus is in front; without a focus, that of the vehicle ``first``. The wide view is
    centred on the vehicle in focus.
    """
    shown = {path(*MEASUREMENTS, sensor): RECENT_S for sensor in sensors} | trails(trackers)
    name = "Seen from above"
    if focus.vehicle is not None:
        wide, name = wide.around(focus.vehicle), f"{name}, around {focus.vehicle}"
    tabs = [scene_view(close_up(vehicle), vehicle, shown, f"- {path(*LABELS)}") for vehicle in vehicles]
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
    """Return a view of a scene from above.

    Args:
        frame: entity of the view's frame, in which y points down.
        name: title of the view.
        contents: Rerun's queries for the entities in the view.
        bounds: left and right, top and bottom in the frame, m.
        shown: time for which an entity stays visible, s, by entity.
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


MAPS, FRAME = "maps", "maps_frame"
#: Ratio of width to height above which a map takes the whole width.
ELONGATED = 4.0


def send_maps(stream: Stream, tables: Tables, trackers: Mapping[str, str]) -> None:
    """Send the true paths, and each tracker's estimated paths in the tracker's colour."""
    stream.turn_y_down(FRAME)
    wide = rr.LineStrips2D(_paths(tables.truth), colors=rgba(TRUTH_COLOUR), radii=pixels(2.0), draw_order=1.0)
    stream.static(path(MAPS, "truth"), wide)
    for tracker, colour in trackers.items():
        estimates = tables.estimates.filter(pc.equal(tables.estimates["tracker"], tracker))
        lines = rr.LineStrips2D(_paths(estimates), colors=rgba(colour), radii=pixels(0.75), draw_order=2.0)
        stream.static(path(MAPS, "estimates", tracker), lines)


def maps_view(tables: Tables, trackers: Iterable[str]) -> rrb.Container:
    """Return a view with a map for each tracker: estimated paths over the true paths."""
    at = np.concatenate(_paths(tables.truth))
    (left, low), (right, high) = at.min(axis=0) - MARGIN, at.max(axis=0) + MARGIN
    views = [
        from_above(
            FRAME,
            f"Estimates of {tracker}",
            [f"+ {path(*ROADS)}", f"+ {path(MAPS, 'truth')}", f"+ {path(MAPS, 'estimates', tracker)}"],
            ((left, right), (-high, -low)),
            {},
        )
        for tracker in trackers
    ]
    columns = 1 if right - left > ELONGATED * (high - low) else min(3, len(views))
    return rrb.Grid(*views, grid_columns=columns, name="Maps")


def _paths(table: pa.Table) -> list[Array]:
    """Return the path of each object, ``(points, 2)``, m, at the instants at which it is present with a position."""
    paths = []
    for rows in split(table, "object").values():
        at = np.stack([rows["px_m"], rows["py_m"]], axis=1)
        paths.append(at[np.isfinite(at).all(axis=1) & (rows.get("alive", np.ones(len(at))) > 0)])
    return paths
