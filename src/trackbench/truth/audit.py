"""Audit of a ground truth: velocities against displacements, and jumps.

A velocity that contradicts the motion corrupts every Doppler measurement, velocity error and NEES. So the audit
compares each step's displacement with the stated velocity.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

import numpy as np

from trackbench.base.errors import InputError
from trackbench.base.types import KINEMATICS, Array, Mask, Truth
from trackbench.base.units import wrap_angle
from trackbench.results.scenario_summary import EndedEarly, PositionJump, Repairs, TruthAudit, VelocityMismatch
from trackbench.truth import jumps
from trackbench.truth.jumps import IMPOSSIBLE_MPS2

#: Largest velocity error that passes, m/s: half the range-rate sigma of a good automotive radar.
TOLERANCE_MPS = 0.05
#: Steps on each side in the median that predicts a body's displacement.
NEIGHBOURS = 2


def audited_truth(
    truth: Truth,
    mode: Literal["repair", "refuse"],
    *,
    collided: tuple[Mask, Mask] | None = None,
    ended_early: EndedEarly | None = None,
    remedy: str = "",
) -> Truth:
    """Return the truth with its faults repaired; the field ``audit`` of the result lists faults and repairs.

    A velocity that contradicts the motion is replaced by the displacement over time. A track is cut where its body
    jumps, and the whole truth where the observer jumps: after a collision a simulator does not move vehicles
    realistically. Velocity jumps are counted but kept.

    Args:
        truth: ground truth to audit.
        mode: whether to repair or to refuse a truth with faults.
        collided: whether each object has collided, ``(steps, objects)``, and whether the observer has, ``(steps,)``;
            None for no collisions.
        ended_early: reason why the truth is too short, if it is.
        remedy: further remedy for contradicting velocities, for the error message.

    Raises:
        InputError: in mode "refuse", if anything needs a repair.
    """
    if len(truth.time) < 2:
        raise InputError("the truth has less than two steps", key="truth.duration_s")
    no_collisions = np.zeros_like(truth.alive), np.zeros(len(truth.time), dtype=bool)
    objects_collided, observer_collided = no_collisions if collided is None else collided
    truth, cut = _without_observer_jump(truth, observer_collided)
    jumped = _jumps(_displacement(truth), _velocity(truth), _is_present_over_step(truth.alive), truth.time)
    jumped |= _rising_edges(objects_collided[: len(truth.time)]) & _is_present_over_step(truth.alive)
    ends = [_jump(truth, step, body) for body in range(len(truth.ids)) for step in np.flatnonzero(jumped[:, body])[:1]]
    # All steps from the end of a jump on.
    cut_off = np.concatenate([np.zeros_like(truth.alive[:1]), np.logical_or.accumulate(jumped, axis=0)])
    repaired = replace(truth, alive=truth.alive & ~cut_off)

    is_moving = _is_present_over_step(repaired.alive)
    before = _errors(_displacement(truth), _velocity(truth), is_moving)
    wrong_bodies = np.flatnonzero(np.nanmax(before, axis=0, initial=0.0) > TOLERANCE_MPS).tolist()
    repaired = _velocity_from_displacement(repaired, wrong_bodies)
    after = _errors(_displacement(truth), _velocity(repaired), is_moving)

    repairs = Repairs(
        velocity_from_displacement=[truth.ids[i] for i in wrong_bodies],
        cut_at_jump=[jump.object for jump in (*cut, *ends)],
    )
    result = TruthAudit(
        mode=mode,
        verdict="repaired" if repairs.any else "consistent",
        velocity_error_before=_summary(before, truth),
        velocity_error_after=_summary(after, truth),
        jumps=[*cut, *ends],
        velocity_jumps=jumps.summarised(repaired),
        repaired=repairs,
        ended_early=EndedEarly(time_s=float(truth.time[-1]), reason="the observer collides or jumps")
        if cut
        else ended_early,
    )
    if mode == "refuse" and result.verdict != "consistent":
        raise InputError(f"{_complaint(result, remedy)}; audit: repair corrects it", key="truth.audit")
    return replace(repaired, audit=result.model_dump(mode="json"))


def exact(truth: Truth) -> Truth:
    """Return the truth marked as exact without an audit: positions and velocities are from the same formulas."""
    no_mismatch = VelocityMismatch(max_mps=0.0, mean_mps=0.0, object=None, time_s=None)
    result = TruthAudit(
        mode="by construction",
        verdict="exact",
        velocity_error_before=no_mismatch,
        velocity_error_after=no_mismatch,
        jumps=[],
        velocity_jumps=jumps.summarised(truth),
        repaired=Repairs(),
    )
    return replace(truth, audit=result.model_dump(mode="json"))


def _velocity(truth: Truth) -> Array:
    return np.stack([truth.vx, truth.vy])


def _displacement(truth: Truth) -> Array:
    """Return the displacement over each step divided by its time, ``(2, steps - 1, objects, runs)`` m/s."""
    dt = np.diff(truth.time)[:, None, None]
    return np.stack([np.diff(truth.px, axis=0), np.diff(truth.py, axis=0)]) / dt


def _is_present_over_step(alive: Mask) -> Mask:
    return alive[:-1] & alive[1:]


def _errors(displacement: Array, velocity: Array, moving: Mask) -> Array:
    """Return the size of stated velocity minus displacement over time, ``(steps - 1, objects)`` m/s; NaN if absent.

    For each body the velocity is integrated by Euler's or the trapezoidal rule, whichever fits better.
    """
    euler, trapezoid = _errors_by_rule(displacement, velocity, moving)
    return np.where(_median_errors(euler) <= _median_errors(trapezoid), euler, trapezoid)


def by_euler(truth: Truth) -> Mask:
    """Return which bodies move over a step with its first velocity, not with its mean velocity, ``(objects,)``."""
    euler, trapezoid = _errors_by_rule(_displacement(truth), _velocity(truth), _is_present_over_step(truth.alive))
    return np.asarray(_median_errors(euler) <= _median_errors(trapezoid))


def _errors_by_rule(displacement: Array, velocity: Array, moving: Mask) -> tuple[Array, Array]:
    """Return velocity errors, m/s, by Euler's rule (highway-env's, but for its dynamic bicycle) and the trapezoidal."""
    euler = np.hypot(*(displacement - velocity[:, :-1])).max(axis=-1)
    trapezoid = np.hypot(*(displacement - 0.5 * (velocity[:, :-1] + velocity[:, 1:]))).max(axis=-1)
    return np.where(moving, euler, np.nan), np.where(moving, trapezoid, np.nan)


def _median_errors(errors: Array) -> Array:
    return np.array(
        [np.median(column[np.isfinite(column)]) if np.isfinite(column).any() else 0.0 for column in errors.T]
    )


def _jumps(displacement: Array, velocity: Array, moving: Mask, time: Array) -> Mask:
    """Return which displacements neither velocity nor neighbouring steps explain, ``(steps - 1, objects)``.

    A wrong velocity along a smooth path is not a jump, because the displacement continues smoothly.
    """
    unexplained = _errors(displacement, velocity, moving)
    path = np.where(moving[..., None], displacement, np.nan)
    padded = np.pad(path, ((0, 0), (NEIGHBOURS, NEIGHBOURS), (0, 0), (0, 0)), constant_values=np.nan)
    window = np.lib.stride_tricks.sliding_window_view(padded, 2 * NEIGHBOURS + 1, axis=1)
    is_absent = np.isnan(window).all(axis=-1, keepdims=True)
    expected = np.nanmedian(np.where(is_absent, 0.0, window), axis=-1)
    deviation = np.hypot(*(displacement - expected)).max(axis=-1)
    limit = TOLERANCE_MPS + IMPOSSIBLE_MPS2 * np.diff(time)[:, None]
    result: Mask = (unexplained > TOLERANCE_MPS) & (deviation > limit)
    return result


def _rising_edges(state: Mask) -> Mask:
    return state[1:] & ~state[:-1]


def _jump(truth: Truth, step: int, body: int) -> PositionJump:
    across = np.hypot(*(_displacement(truth) - _velocity(truth)[:, :-1]))[step, body].max()
    end = float(truth.time[step + 1])
    return PositionJump(object=truth.ids[body], time_s=end, distance_m=float(across * (end - truth.time[step])))


def _without_observer_jump(truth: Truth, collided: Mask) -> tuple[Truth, list[PositionJump]]:
    carrier = truth.observer
    px, py, vx, vy = (a[:, None, None] for a in (carrier.px, carrier.py, carrier.vx, carrier.vy))
    displacement = np.stack([np.diff(px, axis=0), np.diff(py, axis=0)]) / np.diff(truth.time)[:, None, None]
    is_moving = np.ones((len(truth.time) - 1, 1), dtype=bool)
    is_jump = _jumps(displacement, np.stack([vx, vy]), is_moving, truth.time)[:, 0] | _rising_edges(collided)
    jumps_at = np.flatnonzero(is_jump)
    if not jumps_at.size:
        return truth, []
    end = int(jumps_at[0]) + 1
    if end < 2:
        if not collided.any():
            raise InputError("the observer jumps at the start: check the units of positions and speeds", key="truth")
        raise InputError("the observer collides at the start; choose another truth.seed", key="truth.seed")
    distance = np.hypot(*(displacement[:, end - 1, 0, 0] - np.array([carrier.vx[end - 1], carrier.vy[end - 1]])))
    jump_m = float(distance * (truth.time[end] - truth.time[end - 1]))
    jump = PositionJump(object="observer", time_s=float(truth.time[end]), distance_m=jump_m)
    return _cut_at(truth, end), [jump]


def _cut_at(truth: Truth, end: int) -> Truth:
    carrier = {name: getattr(truth.observer, name)[:end] for name in ("px", "py", "yaw", "vx", "vy", "yaw_rate")}
    return replace(
        truth,
        **{name: getattr(truth, name)[:end] for name in ("time", *KINEMATICS, "alive")},
        observer=replace(truth.observer, **carrier),
    )


def _velocity_from_displacement(truth: Truth, bodies: Sequence[int]) -> Truth:
    if not bodies:
        return truth
    course, speed, acceleration = truth.course.copy(), truth.speed.copy(), truth.acceleration.copy()
    vx, vy = _displacement(truth)
    dt = np.diff(truth.time)[:, None]
    for i in bodies:
        last = np.flatnonzero(truth.alive[:, i])[-1]
        course[:-1, i] = np.arctan2(vy[:, i], vx[:, i])
        speed[:-1, i] = np.hypot(vx[:, i], vy[:, i])
        course[last:, i], speed[last:, i] = course[last - 1, i], speed[last - 1, i]
        acceleration[:-1, i] = np.diff(speed[:, i], axis=0) / dt
        acceleration[last:, i] = 0.0
    return replace(truth, course=wrap_angle(course), speed=speed, acceleration=acceleration)


def _summary(errors: Array, truth: Truth) -> VelocityMismatch:
    """Return largest and mean velocity error, with time and object of the largest; None if nothing moves."""
    if not np.isfinite(errors).any():
        return VelocityMismatch(max_mps=None, mean_mps=None, object=None, time_s=None)
    step, body = np.unravel_index(np.nanargmax(errors), errors.shape)
    return VelocityMismatch(
        max_mps=float(errors[step, body]),
        mean_mps=float(np.nanmean(errors)),
        object=truth.ids[int(body)],
        time_s=float(truth.time[step]),
    )


def _complaint(result: TruthAudit, remedy: str) -> str:
    worst = result.velocity_error_before
    parts = []
    if worst.max_mps is not None and worst.max_mps > TOLERANCE_MPS:
        parts.append(
            f"the velocity contradicts the motion, by up to {worst.max_mps:.2g} m/s "
            f"({worst.object} at {worst.time_s:.2f} s){remedy}"
        )
    parts += [f"{jump.object} jumps by {jump.distance_m:.2g} m at {jump.time_s:.2f} s" for jump in result.jumps]
    return "; ".join(parts)
