"""What a recording implies of its vehicles' motion, before and after it is smoothed, and what no vehicle does."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from trackbench.base.errors import InputError, counted
from trackbench.base.types import Array, Mask, RecordedNoise
from trackbench.base.units import wrap_angle
from trackbench.truth.frames import Frames
from trackbench.truth.jumps import IMPOSSIBLE_MPS2
from trackbench.truth.smoothing import GridTrack

#: No tyre holds more, m/s^2: a coefficient of friction of 0.9 on dry asphalt (Wong, Theory of Ground Vehicles, section
#: 1.3) is 8.8.
POSSIBLE_MPS2 = 9.0
#: Brakes take this long to build their pressure up, s (Bosch, Automotive Handbook, "Braking response"): acceleration
#: changes by no more than ``POSSIBLE_MPS2`` meanwhile.
PEDAL_S = 0.1
#: Faster than this a vehicle points where it drives, m/s, but for a slip of less than so much, rad.
ROLLING_MPS, LARGEST_SLIP = 3.0, np.radians(30.0)
#: Smoothing that moves a vehicle further hides a jump, m: it moves one that brakes as hard as it can by 1.
LARGEST_SHIFT_M = 1.5
#: Speeds that a file states are so far off the motion, m/s (RMS of a vehicle), in another unit, or where it jumps.
LARGEST_SPEED_ERROR_MPS = 3.0
#: Boxes that are this far inside each other are two vehicles in one place, m.
OVERLAP_M = 0.5
#: How often boxes are compared, s.
OFTEN_S = 0.2
SMOOTHER = "smooth it, such as smoothing: {window_s: 2.1, order: 2}"


class MotionFigures(NamedTuple):
    """Of all vehicles of a recording."""

    acceleration_p99_mps2: float
    acceleration_max_mps2: float
    vehicle: str
    """Whose it is."""
    time_s: float
    """When."""
    impossible: int
    """Vehicles that ever accelerate by more than ``POSSIBLE_MPS2``."""
    jerk_max_mps3: float
    displacement_rms_mps: float
    """Speed minus displacement over the step: root mean square."""
    displacement_max_mps: float
    jumps: int
    """Steps in which the displacement changes by more than ``IMPOSSIBLE_MPS2`` would do."""


def motion_figures(tracks: Sequence[GridTrack], dt: float, start: float, *, raw: bool) -> MotionFigures:
    """Of the motion as recorded, by the file's speeds, or as it is used, by the velocity vector.

    Args:
        tracks: all vehicles.
        dt: time of a step, s.
        start: of the scene, s: times count from there.
        raw: which of the two.
    """
    accelerations, jerks, errors, jumps = [], [0.0], [], 0
    for track in tracks:
        x, y = (track.raw_x, track.raw_y) if raw else (track.x, track.y)
        speed = track.raw_speed if raw else np.hypot(track.vx, track.vy)
        steps = np.stack([np.diff(x), np.diff(y)]) / dt
        velocity = np.hypot(np.diff(track.vx), np.diff(track.vy))
        accelerations.append((np.abs(np.diff(speed)) if raw else velocity) / dt)
        jerks.append(float(np.abs(np.diff(speed, 2)).max(initial=0.0)) / dt**2)
        errors.append(_displacement_error(x, y, speed, dt))
        jumps += int((np.hypot(*np.diff(steps, axis=1)) > 2 * IMPOSSIBLE_MPS2 * dt).sum())
    peaks = np.array([values.max() for values in accelerations])
    worst = int(np.argmax(peaks))
    error, every = np.concatenate(errors), np.concatenate(accelerations)
    return MotionFigures(
        acceleration_p99_mps2=float(np.quantile(every, 0.99)),
        acceleration_max_mps2=float(peaks[worst]),
        vehicle=tracks[worst].track.id,
        time_s=float((tracks[worst].first + int(np.argmax(accelerations[worst]))) * dt - start),
        impossible=int((peaks > POSSIBLE_MPS2).sum()),
        jerk_max_mps3=max(jerks),
        displacement_rms_mps=float(np.sqrt(np.mean(error**2))),
        displacement_max_mps=float(np.abs(error).max()),
        jumps=jumps,
    )


def _displacement_error(x: Array, y: Array, speed: Array, dt: float) -> Array:
    """``(steps - 1,)`` of the displacement over each step from the mean speed, m/s."""
    return np.asarray(np.hypot(np.diff(x) / dt, np.diff(y) / dt) - (speed[1:] + speed[:-1]) / 2)


class JerkyMotion(NamedTuple):
    """Where the acceleration of a vehicle changes most within ``PEDAL_S``."""

    vehicle: str
    time_s: float
    change_mps2: float


def jerkiest(tracks: Sequence[GridTrack], dt: float, start: float) -> JerkyMotion:
    """Of the motion as it is used; see :func:`motion_figures`."""
    worst = JerkyMotion(tracks[0].track.id, 0.0, 0.0)
    for track in tracks:
        acceleration = np.stack([np.diff(track.vx), np.diff(track.vy)]) / dt
        for lag in range(1, max(1, round(PEDAL_S / dt)) + 1):
            change = np.hypot(*(acceleration[:, lag:] - acceleration[:, :-lag]))
            if change.max(initial=0.0) > worst.change_mps2:
                step = int(np.argmax(change))
                worst = JerkyMotion(track.track.id, (track.first + step + 1) * dt - start, float(change[step]))
    return worst


def slip_of(track: GridTrack, dt: float) -> float:
    """Median angle between the heading that the file states and the displacement, rad, while the vehicle rolls."""
    dx, dy = np.diff(track.x), np.diff(track.y)
    rolling = np.hypot(dx, dy) > ROLLING_MPS * dt
    if track.track.heading is None or not rolling.any():
        return 0.0
    return float(np.median(np.abs(wrap_angle(np.arctan2(dy, dx) - track.heading[:-1])[rolling])))


def _speed_error(track: GridTrack, dt: float) -> float:
    """Root mean square of the speed that the file states minus that of the displacement; 0 where it states none."""
    if track.track.speed is None:
        return 0.0
    return float(np.sqrt(np.mean(_displacement_error(track.x, track.y, np.abs(track.raw_speed), dt) ** 2)))


def recorded_noise(tracks: Sequence[GridTrack]) -> RecordedNoise:
    """What smoothing took away, root mean square: from the positions per axis, and from the speeds."""
    shift = np.concatenate([np.concatenate([t.raw_x - t.x, t.raw_y - t.y]) for t in tracks])
    change = np.concatenate([t.raw_speed - np.hypot(t.vx, t.vy) for t in tracks])
    return RecordedNoise(float(np.sqrt(np.mean(shift**2))), float(np.sqrt(np.mean(change**2))))


def overlaps(frames: Frames, margin: float) -> Mask:
    """``(bodies, bodies)``: whether the boxes of two bodies ever come nearer than ``margin``, m; if it is negative,
    whether they are so far inside each other, along and across."""
    bodies = len(frames.ids)
    result = np.zeros((bodies, bodies), dtype=bool)
    for step in range(0, len(frames.px), max(1, round(OFTEN_S / frames.dt))):
        there = np.flatnonzero(frames.alive[step])
        x, y, heading = frames.px[step, there], frames.py[step, there], frames.heading[step, there]
        dx, dy = x - x[:, None], y - y[:, None]
        c, s = np.cos(heading)[:, None], np.sin(heading)[:, None]
        half_length, half_width = frames.length[there] / 2, frames.width[there] / 2
        # What the other body takes along and across this one.
        even, turned = np.abs(c * c.T + s * s.T), np.abs(c * s.T - s * c.T)
        along = half_length[:, None] + even * half_length + turned * half_width
        across = half_width[:, None] + turned * half_length + even * half_width
        near = (np.abs(c * dx + s * dy) < along + margin) & (np.abs(c * dy - s * dx) < across + margin)
        result[np.ix_(there, there)] |= near & near.T
    np.fill_diagonal(result, False)
    return result


def refuse_impossible(
    used: MotionFigures, tracks: Sequence[GridTrack], frames: Frames | None, dt: float, start: float, smooths: bool
) -> None:
    """Refuse what no vehicle does.

    Args:
        used: figures of the motion as it is used.
        tracks: all vehicles.
        frames: the same, where they drove at the same time.
        dt: time of a step, s.
        start: of the scene, s.
        smooths: whether positions were smoothed.

    Raises:
        InputError: with the figure, and how to override.
    """
    remedy = "audit: repair takes the recording as it is, but cuts tracks where they jump"
    smoother = "smooth longer" if smooths else SMOOTHER
    if used.impossible:
        raise InputError(
            f"{used.vehicle} accelerates by {used.acceleration_max_mps2:.3g} m/s^2 at {used.time_s:.2f} s "
            f"({used.impossible} of {counted(len(tracks), 'vehicle')} by more than {POSSIBLE_MPS2:g}), which no "
            f"vehicle does: check the units; {smoother}; {remedy}",
            key="truth.smoothing" if smooths else "truth.audit",
        )
    jerky = jerkiest(tracks, dt, start)
    if jerky.change_mps2 > POSSIBLE_MPS2:
        raise InputError(
            f"the acceleration of {jerky.vehicle} changes by {jerky.change_mps2:.3g} m/s^2 within {PEDAL_S:g} s at "
            f"{jerky.time_s:.2f} s, and no pedal changes it by more than {POSSIBLE_MPS2:g}: {smoother}; {remedy}",
            key="truth.smoothing" if smooths else "truth.audit",
        )
    slip, turned = max((slip_of(track, dt), track.track.id) for track in tracks)
    if slip > LARGEST_SLIP:
        raise InputError(
            f"the heading of {turned} is {np.degrees(slip):.0f}° off the way it drives "
            f"(median): check its unit, and that it counts counter-clockwise from the x axis; {remedy}",
            key="truth.audit",
        )
    off, stated = max((_speed_error(track, dt), track.track.id) for track in tracks)
    if off > LARGEST_SPEED_ERROR_MPS:
        raise InputError(
            f"the speeds that the file states of {stated} are {off:.2g} m/s (RMS) off its "
            f"motion: check their unit, such as units: {{speed: kmph}}; {smoother}; {remedy}",
            key="truth.audit",
        )
    shifts = [np.hypot(track.raw_x - track.x, track.raw_y - track.y) for track in tracks]
    far = int(np.argmax([shift.max() for shift in shifts]))
    if shifts[far].max() > LARGEST_SHIFT_M:
        when = (tracks[far].first + int(np.argmax(shifts[far]))) * dt - start
        raise InputError(
            f"{tracks[far].track.id} jumps: smoothing moves it by {shifts[far].max():.2g} m at {when:.2f} s, and at "
            f"most {LARGEST_SHIFT_M:g} m is noise; smooth a shorter time; {remedy}",
            key="truth.smoothing",
        )
    if frames is None:
        return
    pairs = np.argwhere(np.triu(overlaps(frames, -OVERLAP_M)))
    if len(pairs):
        first, second = (frames.ids[body] for body in pairs[0])
        raise InputError(
            f"{counted(len(pairs), 'pair')} of vehicles are in one place at one time, such as {first} and {second}: "
            f"simultaneous: false keeps them apart; {remedy}",
            key="truth.audit",
        )
