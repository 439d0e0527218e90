"""Accelerations, speed errors and jumps in recorded traffic, and refusal of impossible motion."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from trackbench.base.errors import InputError, counted
from trackbench.base.types import Array
from trackbench.base.units import wrap_angle
from trackbench.truth.frames import Frames, overlaps
from trackbench.truth.jumps import IMPOSSIBLE_MPS2
from trackbench.truth.smoothing import GridTrack

#: Largest acceleration of a tyre, m/s^2: a coefficient of friction of 0.9 on dry asphalt (Wong, Theory of Ground
#: Vehicles, section 1.3) gives 8.8.
POSSIBLE_MPS2 = 9.0
#: Speed above which a vehicle points where it drives, m/s, and largest slip angle then, rad.
ROLLING_MPS, LARGEST_SLIP = 3.0, np.radians(30.0)
#: Largest shift by smoothing, m; a larger one hides a jump. A vehicle that brakes at its limit is shifted by 1 m.
LARGEST_SHIFT_M = 1.5
#: Largest RMS difference of stated speeds and motion, m/s; a larger one shows a wrong unit or a jump.
LARGEST_SPEED_ERROR_MPS = 3.0
#: Overlap of boxes above which two vehicles are in one place, m.
OVERLAP_M = 0.5
SMOOTHER = "smooth it, such as smoothing: {window_s: 2.1, order: 2}"


class MotionFigures(NamedTuple):
    """Accelerations, speed errors and jumps implied by the positions and speeds of a recording."""

    recorded_acceleration_mps2: float
    """Largest change of the stated speed over a step, divided by the step's time."""
    recorded_vehicle: str
    recorded_speed_error_mps: float
    """RMS, over all steps of all vehicles, of the difference between the displacement's speed and the stated speed."""
    recorded_jumps: int
    """Number of instants at which the velocity by displacement changes by more than 40 m/s^2."""
    acceleration_mps2: float
    """Largest acceleration of any vehicle, after smoothing if positions are smoothed."""
    vehicle: str
    time_s: float
    impossible: int
    """Number of vehicles whose acceleration ever exceeds the largest possible one, ``POSSIBLE_MPS2``."""


def motion_figures(tracks: Sequence[GridTrack], dt: float, start: float) -> MotionFigures:
    """Return accelerations, speed errors and jumps of all vehicles; steps of ``dt`` s, times from ``start`` s."""
    used = [np.hypot(np.diff(track.vx), np.diff(track.vy)) / dt for track in tracks]
    recorded = np.array([np.abs(np.diff(track.raw_speed)).max() / dt for track in tracks])
    peaks = np.array([values.max() for values in used])
    worst, worst_recorded = int(np.argmax(peaks)), int(np.argmax(recorded))
    errors = [_displacement_error(track.raw_x, track.raw_y, track.raw_speed, dt) for track in tracks]
    turns = [np.hypot(np.diff(track.raw_x, 2), np.diff(track.raw_y, 2)) / dt for track in tracks]
    return MotionFigures(
        recorded_acceleration_mps2=float(recorded[worst_recorded]),
        recorded_vehicle=tracks[worst_recorded].track.id,
        recorded_speed_error_mps=float(np.sqrt(np.mean(np.concatenate(errors) ** 2))),
        recorded_jumps=int((np.concatenate(turns) > 2 * IMPOSSIBLE_MPS2 * dt).sum()),
        acceleration_mps2=float(peaks[worst]),
        vehicle=tracks[worst].track.id,
        time_s=float((tracks[worst].first + int(np.argmax(used[worst]))) * dt - start),
        impossible=int((peaks > POSSIBLE_MPS2).sum()),
    )


def _displacement_error(x: Array, y: Array, speed: Array, dt: float) -> Array:
    """Return in each step, ``(steps - 1,)`` m/s, the speed of the displacement minus the mean stated speed."""
    return np.asarray(np.hypot(np.diff(x) / dt, np.diff(y) / dt) - (speed[1:] + speed[:-1]) / 2)


def _slip(track: GridTrack, dt: float) -> float:
    """Return the median angle between stated heading and displacement, rad, while the vehicle rolls."""
    dx, dy = np.diff(track.x), np.diff(track.y)
    is_rolling = np.hypot(dx, dy) > ROLLING_MPS * dt
    if track.track.heading is None or not is_rolling.any():
        return 0.0
    return float(np.median(np.abs(wrap_angle(np.arctan2(dy, dx) - track.heading[:-1])[is_rolling])))


def _speed_error(track: GridTrack, dt: float) -> float:
    """Return the RMS difference of the stated speed and the displacement's speed, m/s; 0 if no speed is stated."""
    if track.track.speed is None:
        return 0.0
    return float(np.sqrt(np.mean(_displacement_error(track.x, track.y, np.abs(track.raw_speed), dt) ** 2)))


def _largest_shift(track: GridTrack, _: float) -> float:
    return float(np.hypot(track.raw_x - track.x, track.raw_y - track.y).max())


def refuse_impossible(
    used: MotionFigures, tracks: Sequence[GridTrack], frames: Frames | None, dt: float, smooths: bool
) -> None:
    """Refuse motion that is impossible for a vehicle.

    Args:
        used: accelerations and jumps of the motion, after smoothing if any.
        tracks: all vehicles.
        frames: motion of all vehicles; None if they did not drive at the same time.
        dt: time of a step, s.
        smooths: whether positions were smoothed.

    Raises:
        InputError: a vehicle's motion is impossible; the message has the value and the option that accepts it.
    """
    smoother = "smooth longer" if smooths else SMOOTHER

    def refuse(problem: str, remedy: str, key: str = "audit") -> None:
        override = "audit: repair takes the recording as it is, but cuts tracks where they jump"
        raise InputError(f"{problem}: {remedy}; {override}", key=f"truth.{key}")

    def largest(figure: Callable[[GridTrack, float], float]) -> tuple[float, str]:
        return max((figure(track, dt), track.track.id) for track in tracks)

    if used.impossible:
        most = f"{used.impossible} of {counted(len(tracks), 'vehicle')} by more than {POSSIBLE_MPS2:g}"
        what = f"{used.vehicle} accelerates by {used.acceleration_mps2:.3g} m/s^2 at {used.time_s:.2f} s"
        key = "smoothing" if smooths else "audit"
        refuse(f"{what} ({most}), which no vehicle does", f"check the units; {smoother}", key)
    slip, name = largest(_slip)
    if slip > LARGEST_SLIP:
        where = f"the heading of {name} is {np.degrees(slip):.0f}° off the way it drives (median)"
        refuse(where, "check its unit, and that it counts counter-clockwise from the x axis")
    off, name = largest(_speed_error)
    if off > LARGEST_SPEED_ERROR_MPS:
        what = f"the speeds that the file states of {name} are {off:.2g} m/s (RMS) off its motion"
        refuse(what, f"check their unit, such as speed: v:kmph; {smoother}")
    shift, name = largest(_largest_shift)
    if shift > LARGEST_SHIFT_M:
        what = f"{name} jumps: smoothing moves it by {shift:.2g} m, and at most {LARGEST_SHIFT_M:g} m is noise"
        refuse(what, "smooth a shorter time", "smoothing")
    if frames is not None and len(pairs := np.argwhere(np.triu(overlaps(frames, -OVERLAP_M)))):
        first, second = (frames.ids[body] for body in pairs[0])
        what = f"{counted(len(pairs), 'pair')} of vehicles are in one place at one time, such as {first} and {second}"
        refuse(what, "check the units of length and width")
