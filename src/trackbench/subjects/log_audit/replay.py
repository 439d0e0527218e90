"""The replay of a log around the largest error of a sensor, as a scene for a page."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np

from trackbench.base.types import Array, Gaussian, Scan
from trackbench.document import TrackerStyle
from trackbench.document.palette import OBSERVER_COLOUR, TRUTH_COLOUR, sensor_colours
from trackbench.document.replay import Chart, ChartLine, ReplayEvent, ReplayPath, ReplayScene, ReplayStart, extent_of
from trackbench.sensing.view import sensor_motion
from trackbench.subjects.log_audit.sensor_log import SensorLog
from trackbench.truth.recorded.drive import Motion

#: Time before and after the largest error that the replay shows, s.
AROUND_S = 10.0


class MeasuredPositions(NamedTuple):
    """Measured positions of labelled objects, and their errors, for one sensor."""

    log: SensorLog
    position: Gaussian
    """Measured positions in the fixed frame, ``(2, rows)``, m, with covariance."""
    error: Array
    """Distance from the truth, ``(rows,)``, m; NaN outside the time of the truth."""

    @property
    def worst(self) -> tuple[float, float, str]:
        """Largest error (m), its time (s) and its object."""
        row = int(np.nanargmax(self.error))
        name = [*self.log.drive.motions][int(self.log.log.object[row])]
        return float(self.error[row]), float(self.log.log.time[row]), name


def replay_of_log(logs: Iterable[SensorLog]) -> ReplayScene | None:
    """Return a scene with the measured positions of each object beside its true path, opening at the largest error.

    None where no sensor has measured a position of an object within the time of the truth.
    """
    sensors = [measured_positions(log) for log in logs if log.config.measures_position()]
    sensors = [item for item in sensors if np.isfinite(item.error).any()]
    if not sensors:
        return None
    _, time, name = max(item.worst for item in sensors)
    span = time - AROUND_S, time + AROUND_S
    drive, colours = sensors[0].log.drive, sensor_colours(item.log.name for item in sensors)
    paths = [*_body_path("observer", drive.observer, span)] if drive.observer else []
    for vehicle, motion in drive.motions.items():
        paths += _body_path(vehicle, motion, span)
    lines, events = list[ChartLine](), list[ReplayEvent]()
    for (log, position, error), (sensor, colour) in zip(sensors, colours.items(), strict=True):
        inside = np.isfinite(error) & (log.log.time >= span[0]) & (log.log.time <= span[1])
        lines.append(ChartLine((sensor,), sensor, colour, log.log.time[inside], error[inside]))
        for number in np.unique(log.log.object[inside]):
            rows = inside & (log.log.object == number)
            at, covariance = position.mean[:, rows], position.covariance[:, :, rows]
            paths.append(ReplayPath(sensor, colour, log.log.time[rows], at, covariance, tracker=sensor))
        if inside.any():
            row = int(np.argmax(np.where(inside, error, -1.0)))
            text = f"largest error {error[row]:.2f} m at {log.log.time[row]:.2f} s"
            x, y = position.mean[:, row].tolist()
            events.append(ReplayEvent(sensor, "worst", float(log.log.time[row]), x, y, text))
    return ReplayScene(
        "log",
        tuple(paths),
        (),
        *extent_of(paths),
        beside=(Chart(("error",), "Distance of the measured position from the truth", "m", tuple(lines)),),
        trackers=tuple(
            TrackerStyle(f"sensor-{n}", sensor, colour) for n, (sensor, colour) in enumerate(colours.items())
        ),
        shown=tuple(colours),
        events=tuple(events),
        start=ReplayStart(time, name),
    )


def measured_positions(log: SensorLog) -> MeasuredPositions:
    """Return the positions that a sensor measured, converted with its stated mount."""
    time = log.log.time
    motion = sensor_motion(log.observer(time), log.config.mount)
    noise, valid = log.config.noise_covariance()[:, :, None], np.ones(len(time), dtype=bool)
    scan = Scan(0.0, log.name, log.config.type, log.measurement, valid, noise, motion.pose, motion.velocity, 0.0)
    position = log.config.position(scan)
    return MeasuredPositions(log, position, np.hypot(*(position.mean - log.target(time, log.log.object)[:2])))


def _body_path(name: str, motion: Motion, span: tuple[float, float]) -> Iterator[ReplayPath]:
    inside = (motion.time >= span[0]) & (motion.time <= span[1])
    if inside.any():
        heading = np.arctan2(motion.vy, motion.vx) if motion.heading is None else motion.heading
        length, width = (1.0 if side is None else float(np.nanmax(side)) for side in (motion.length, motion.width))
        yield ReplayPath(
            name,
            OBSERVER_COLOUR if name == "observer" else TRUTH_COLOUR,
            motion.time[inside],
            np.stack([motion.px, motion.py])[:, inside],
            heading=np.unwrap(heading[inside]),
            size=(length, width),
            is_observer=name == "observer",
        )
