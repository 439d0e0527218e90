"""Ground truth from recorded traffic, seen from one of its vehicles or from beside the road."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from decimal import Decimal
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from trackbench.base.errors import InputError, counted, nearest_choices
from trackbench.base.types import RecordedNoise, Truth
from trackbench.base.units import wrap_angle
from trackbench.truth.audit import audited_truth
from trackbench.truth.config.logs import find_log
from trackbench.truth.config.recording import FixedObserver
from trackbench.truth.config.traffic import TrafficOptions
from trackbench.truth.frames import Frames, bodies_near, fixed_observer, overlaps, target_bodies
from trackbench.truth.motion_audit import (
    SMOOTHER,
    MotionFigures,
    motion_figures,
    refuse_impossible,
)
from trackbench.truth.smoothing import GridTrack, grid_step, grid_tracks, recorded_noise
from trackbench.truth.tracks import TRAFFIC_FORMATS, moving_tracks

#: Arrays of ``Frames`` with a column for each body.
OF_BODIES = ("px", "py", "heading", "slip", "speed", "collided")
#: Least distance between vehicles put into one scene that did not drive at the same time, m.
APART_M = 0.5
#: Least time between two rows, s.
SHORTEST_STEP_S = 1e-3
#: Largest number of steps times vehicles of a scene that fits the memory of a small machine.
LARGEST = 20_000_000


class RecordedVehicles(NamedTuple):
    """Vehicles in a time window of a recording: motion, audit and noise."""

    frames: Frames
    figures: MotionFigures
    error: RecordedNoise
    vehicles: int
    """Number of vehicles in the whole file, inside and outside the time window."""
    start: float
    """Reading of the file's clock at the first instant, s."""


#: Index of the body with the observer, None for a fixed one; and indices of all bodies in the scene, with that one.
SceneBodies = tuple[int | None, list[int]]


def load_traffic(config: TrafficOptions, folder: Path) -> tuple[Truth, str]:
    """Return the truth of one scene, and a line on the recording's vehicles, accelerations and noise.

    Raises:
        InputError: the file cannot be read or is damaged, lacks a named vehicle, or has impossible motion.
    """
    traffic = _recorded_vehicles(config, folder)
    scenes = _scene_bodies(config, traffic.frames)
    truth = _truth(config, traffic, scenes[config.scene])
    for number in range(config.scene if config.format.simultaneous else 0):
        _require_apart(config, number, truth, _truth(config, traffic, scenes[number]))
    return truth, _note(traffic)


def recording_rate(config: TrafficOptions, folder: Path) -> float:
    """Return the number of instants per second in a recording, Hz.

    Raises:
        InputError: the file cannot be read or is damaged, or has impossible motion.
    """
    return round(1 / _recorded_vehicles(config, folder).frames.dt, 6)


def _recorded_vehicles(config: TrafficOptions, folder: Path) -> RecordedVehicles:
    file, version = Path(TRAFFIC_FORMATS.name_of(type(config.format))), (0, 0)
    if config.path is not None:
        file = find_log(config.path, folder, "truth.path")
        version = file.stat().st_mtime_ns, file.stat().st_size
    return _read_vehicles(config.recording, file, version)


@lru_cache(maxsize=2)
def _read_vehicles(config: TrafficOptions, file: Path, _version: tuple[int, int]) -> RecordedVehicles:
    """Return the vehicles between the scenario's start and end times, smoothed and audited."""
    smoothing = config.smoothing
    tracks, clock = moving_tracks(config.format.read(file), file)
    dt = grid_step(tracks)
    if dt < SHORTEST_STEP_S:
        raise InputError(f"rows are {dt:.2g} s apart: check the unit of time", file=file)
    if smoothing is not None and smoothing.window_s < (smoothing.order + 1) * dt:
        message = f"must be at least {(smoothing.order + 1) * dt:g}: {smoothing.order + 2} rows of the file"
        raise InputError(message, key="truth.smoothing.window_s")
    moving = grid_tracks(tracks, dt, smoothing)
    if not moving:
        raise InputError("no vehicle has two rows one step apart; there is no motion in this file", file=file)
    first = round(config.from_s / dt)
    end = last = max(track.first + len(track.x) - 1 for track in moving)
    if config.duration_s is not None:
        last = min(last, first + round(config.duration_s / dt))
    inside = [track for track in moving if track.first < last and track.first + len(track.x) - 1 > first]
    if not inside:
        raise InputError(f"no vehicle is there at that time: the file has {end * dt:g} s", key="truth.from_s")
    if (last - first + 1) * len(inside) > LARGEST:
        message = f"{counted(len(inside), 'vehicle')} in {(last - first) * dt:g} s are too many; take a shorter time"
        raise InputError(message, key="truth.duration_s")
    frames, start = _frames(inside, dt, first, last, (config.length_m, config.width_m)), first * dt
    figures = motion_figures(inside, dt, start)
    if config.audit == "refuse":
        simultaneous = frames if config.format.simultaneous else None
        refuse_impossible(figures, inside, simultaneous, dt, smoothing is not None)
    return RecordedVehicles(frames, figures, recorded_noise(inside), len(tracks), clock + start)


def _frames(tracks: Sequence[GridTrack], dt: float, first: int, last: int, size: tuple[float, float]) -> Frames:
    """Return the motion on the grid's instants ``first`` to ``last``; NaN where a vehicle is absent."""
    columns = {key: np.full((last - first + 1, len(tracks)), np.nan) for key in ("x", "y", "vx", "vy", "heading")}
    for body, track in enumerate(tracks):
        begin, end = max(track.first, first), min(track.first + len(track.x), last + 1)
        for key, values in columns.items():
            values[begin - first : end - first, body] = getattr(track, key)[begin - track.first : end - track.first]
    vx, vy, heading = columns["vx"], columns["vy"], columns["heading"]
    speed = np.hypot(vx, vy)
    slip = np.where(speed > 0, wrap_angle(np.arctan2(vy, vx) - heading), 0.0)
    return Frames(
        dt=dt,
        ids=tuple(track.track.id for track in tracks),
        px=columns["x"],
        py=columns["y"],
        heading=heading,
        slip=np.where(np.isnan(heading), np.nan, slip),
        speed=speed,
        collided=np.zeros(vx.shape, dtype=bool),
        length=np.array([track.track.length or size[0] for track in tracks]),
        width=np.array([track.track.width or size[1] for track in tracks]),
    )


def _scene_bodies(config: TrafficOptions, frames: Frames) -> list[SceneBodies]:
    """Return the bodies of each scene: all, or, if they drove at different times, as many as never overlap."""
    number = {name: body for body, name in enumerate(frames.ids)}
    for name in config.vehicles:
        if name not in number:
            message = f"there is no vehicle {name!r} in this recording; {nearest_choices(name, number)}"
            raise InputError(message, key="truth.observer.vehicle")
    carriers: list[int | None] = [number[name] for name in config.vehicles] or [None]
    if config.format.simultaneous:
        return [(carrier, list(range(len(frames.ids)))) for carrier in carriers]
    is_apart = ~overlaps(frames, APART_M)
    scenes: list[list[int]] = [[] if carrier is None else [carrier] for carrier in carriers]
    for body in range(len(frames.ids)):
        if body not in carriers:
            place = next((scene for scene in scenes if is_apart[body, scene].all()), None)
            if place is not None:
                place.append(body)
    return [(carrier, sorted(scene)) for carrier, scene in zip(carriers, scenes, strict=True)]


def _truth(config: TrafficOptions, traffic: RecordedVehicles, scene: SceneBodies) -> Truth:
    own, present_bodies = scene
    frames, carrier, first = _selected_bodies(traffic.frames, present_bodies), None, 0
    if own is None:
        assert isinstance(config.observer, FixedObserver)
        frames = _during(frames, 0, len(frames.px) - 1)
        observer = fixed_observer(config.observer, len(frames.px))
    else:
        present = np.flatnonzero(traffic.frames.alive[:, own])
        first = int(present[0])
        frames = _during(frames, first, int(present[-1]))
        carrier = frames.ids.index(traffic.frames.ids[own])
        observer = frames.carrier(carrier)
    bodies = targets = target_bodies(config.targets, frames, observer, carrier)
    if config.others_within_m is not None:
        named = [] if config.targets == "all" else targets
        bodies = bodies_near(config.others_within_m, frames, observer, named, carrier)
    if not bodies:
        raise InputError("there is no other vehicle while it drives", key="truth.observer")
    truth = replace(
        frames.truth(bodies, observer),
        target=np.isin(bodies, targets),
        source=_source(config, traffic),
        recorded_noise=traffic.error,
        start=Decimal(repr(traffic.start + first * frames.dt)),
    )
    return audited_truth(truth, config.audit, remedy="" if config.smoothing else f": {SMOOTHER}")


def _selected_bodies(frames: Frames, bodies: Sequence[int]) -> Frames:
    chosen = list(bodies)
    return replace(
        frames,
        ids=tuple(frames.ids[body] for body in chosen),
        length=frames.length[chosen],
        width=frames.width[chosen],
        **{name: getattr(frames, name)[:, chosen] for name in OF_BODIES},
    )


def _during(frames: Frames, first: int, last: int) -> Frames:
    """Return the frames with indices ``first`` to ``last``, with the bodies present in at least two of them."""
    part = replace(frames, **{name: getattr(frames, name)[first : last + 1] for name in OF_BODIES})
    return _selected_bodies(part, np.flatnonzero(part.alive.sum(axis=0) > 1).tolist())


def _require_apart(config: TrafficOptions, number: int, truth: Truth, other: Truth) -> None:
    """Raise an error if a vehicle is in both ``truth`` and ``other``, the truth of the earlier scene ``number``."""
    names = config.vehicles
    shared = {*truth.ids, names[config.scene]} & {*other.ids, names[number]}
    if shared:
        raise InputError(
            f"{names[config.scene]} and {names[number]} have {counted(len(shared), 'vehicle')} in common, such as "
            f"{min(shared)}, so that their scenes are one; take observers further apart, or fewer targets",
            key=f"truth.observer.vehicle.{config.scene}",
        )


def _source(config: TrafficOptions, traffic: RecordedVehicles) -> dict[str, Any]:
    return {
        "source": "recorded-traffic",
        "format": TRAFFIC_FORMATS.name_of(type(config.format)),
        **({} if config.path is None else {"file": Path(config.path).name}),
        "observer": config.observer.model_dump(mode="json"),
        "smoothing": config.smoothing and config.smoothing.model_dump(mode="json"),
        "vehicles": traffic.vehicles,
        "rate_hz": round(1 / traffic.frames.dt, 6),
        "recorded_motion": traffic.figures._asdict(),
        "recorded_noise": traffic.error._asdict(),
    }


def _note(traffic: RecordedVehicles) -> str:
    figures, error = traffic.figures, traffic.error
    parts = [
        f"{counted(traffic.vehicles, 'vehicle')} at {1 / traffic.frames.dt:.3g} Hz",
        f"as recorded, change of speed to {figures.recorded_acceleration_mps2:.3g} m/s^2, displacement against speed "
        f"{figures.recorded_speed_error_mps:.2g} m/s (RMS), {counted(figures.recorded_jumps, 'jump')}",
        f"as used, acceleration to {figures.acceleration_mps2:.3g} m/s^2",
    ]
    if error.position_m > 0:
        parts.append(f"smoothing took {error.position_m:.2g} m and {error.velocity_mps:.2g} m/s (RMS)")
    return "; ".join(parts)
