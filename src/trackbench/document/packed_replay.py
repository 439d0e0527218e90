"""A replay's scene as text inside a page: rounded values, their differences as JSON, deflated."""

from __future__ import annotations

import json
import zlib
from base64 import b64encode
from typing import Any

import numpy as np

from trackbench.base.types import Array, Mask
from trackbench.document.replay import ReplayScene

#: Quanta of times (s), of positions and half axes (m), of headings (rad) and of the chart's values.
TIME, POSITION, HEADING, VALUE = 0.001, 0.01, 0.002, 0.001
#: Characters of a packed scene; a longer one is thinned in time.
LIMIT = 300_000
#: Limit of the packed numbers, in quanta; estimates that diverged may exceed it.
_LARGEST = 1e11
#: Half axis of the 95 % ellipse of a Gaussian in the plane, standard deviations.
SIGMAS = float(np.sqrt(-2 * np.log(0.05)))


def packed_replay(scene: ReplayScene, limit: int = LIMIT) -> tuple[str, int]:
    """Return a scene as base64 of deflated JSON, and the n of which only every n-th instant is kept.

    The n is about the smallest for which the text has at most ``limit`` characters.
    """
    instants = np.unique(np.concatenate([_ticks(path.time) for path in scene.paths]))
    first = instants[0] if scene.start is None else _ticks(np.array([scene.start.time_s]))
    # A character never holds eight numbers, and a path has up to six numbers an instant.
    every = max(1, 6 * sum(len(path.time) for path in scene.paths) // (8 * limit))
    while True:
        text = _text(scene, np.union1d(instants[::every], first), every)
        if len(text) <= limit or every >= len(instants):
            return text, every
        every = max(every + 1, int(every * len(text) / limit))


def series(values: Array, quantum: float) -> dict[str, Any]:
    """Return values as integer multiples of ``quantum``, differenced once or twice, whichever gives smaller numbers."""
    counts = np.rint(np.clip(np.asarray(values, dtype=float) / quantum, -_LARGEST, _LARGEST)).astype(np.int64)
    differences = {order: np.diff(counts, order, prepend=[0] * order) for order in (1, 2)}
    order = min(differences, key=lambda order: int(np.abs(differences[order]).sum()))
    return {"quantum": quantum, "order": order, "differences": differences[order].tolist()}


def _text(scene: ReplayScene, instants: Array, every: int) -> str:
    content = json.dumps(_content(scene, instants, every), separators=(",", ":"), allow_nan=False)
    return b64encode(zlib.compress(content.encode(), 9)).decode()


def _content(scene: ReplayScene, instants: Array, every: int) -> dict[str, Any]:
    """Return the scene for JSON: paths at ``instants``, measurements of one scan in ``every``, events and charts."""
    paths, measurements = [], []
    for path in scene.paths:
        is_packed = np.isin(_ticks(path.time), instants)
        if not is_packed.any():
            continue
        name = path.label if path.tracker else path.name
        body: dict[str, Any] = {"name": name, "tracker": path.tracker, "colour": path.colour, "size": path.size}
        heading = {} if path.heading is None else {"heading": series(path.heading[is_packed], HEADING)}
        paths.append(body | heading | _places(path.time, path.position, path.covariance, is_packed))
    for sensor in scene.measurements:
        is_packed = np.unique(_ticks(sensor.time), return_inverse=True)[1] % every == 0
        false = np.zeros(len(is_packed)) if sensor.false is None else sensor.false
        of_sensor = {"colour": sensor.colour, "false": series(false[is_packed], 1)}
        measurements.append(of_sensor | _places(sensor.time, sensor.position, sensor.covariance, is_packed))
    lines = []
    for line in scene.beside[0].lines if scene.beside else ():
        finite = np.isfinite(line.value)
        lines.append(
            {"tracker": line.name, "time": series(line.time[finite], TIME), "value": series(line.value[finite], VALUE)}
        )
    return {
        "trackers": [
            {"name": style.name, "colour": style.colour, "dashed": style.line != "solid"} for style in scene.trackers
        ],
        "lanes": [{"x": series(x, POSITION), "y": series(y, POSITION)} for x, y in scene.lanes],
        "paths": paths,
        "measurements": measurements,
        "lines": lines,
        "quantity": scene.beside[0].quantity if scene.beside else "",
        "unit": scene.beside[0].unit if scene.beside else "",
        "events": [event._asdict() for event in scene.events],
        "range": [scene.x_range, scene.y_range],
        "start": scene.start and scene.start._asdict(),
    }


def _places(time: Array, position: Array, covariance: Array | None, is_packed: Mask) -> dict[str, Any]:
    x, y = position[:, is_packed]
    places = {"time": series(time[is_packed], TIME), "x": series(x, POSITION), "y": series(y, POSITION)}
    if covariance is None:
        return places
    (xx, xy), (_, yy) = np.clip(np.nan_to_num(covariance[:, :, is_packed]), -_LARGEST, _LARGEST)
    # The ellipse is x = a cos(u), y = b cos(u) + c sin(u).
    a = np.sqrt(np.maximum(xx, 0.0))
    b = np.divide(xy, a, out=np.zeros_like(a), where=a > 1e-6)
    axes = {"a": a, "b": b, "c": np.sqrt(np.maximum(yy - b * b, 0.0))}
    return places | {name: series(SIGMAS * values, POSITION) for name, values in axes.items()}


def _ticks(time: Array) -> Array:
    return np.rint(time / TIME).astype(np.int64)
