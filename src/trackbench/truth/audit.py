"""Does the truth tell the truth? Velocity against displacement, and jumps.

A velocity that contradicts the motion corrupts every Doppler measurement, velocity error and NEES. So each step's
displacement is compared with the velocity that is said to cause it.
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
#: Steps on each side of the median that says where a body ought to have gone.
NEIGHBOURS = 2


def audited_truth(
    truth: Truth,
    mode: Literal["repair", "refuse"],
    *,
    collided: tuple[Mask, Mask] | None = None,
    ended_early: EndedEarly | None = None,
    remedy: str = "",
) -> Truth:
    """The truth with its faults repaired, and what was found and done in ``Truth.audit``.

    A velocity that contradicts the motion is replaced by that of the displacement. A track is cut where its body jumps,
    and the whole truth where the observer does: what follows a collision in a simulator is no motion of a vehicle.
    Velocity jumps are counted and stay.

    Args:
        truth: the motion.
        mode: whether to repair or to refuse a truth with faults.
        collided: which objects ``(steps, objects)``, and at which steps the observer, have had a collision; none
            unless given.
        ended_early: why the truth is shorter than it should be.
        remedy: what also corrects a velocity that contradicts the motion, as a message says it.

    Raises:
        InputError: in mode "refuse", where anything would have to be repaired.
    """
    if len(truth.time) < 2:
        raise InputError("the truth has less than two steps", key="truth.duration_s")
    never = np.zeros_like(truth.alive), np.zeros(len(truth.time), dtype=bool)
    objects_collided, observer_collided = never if collided is None else collided
    truth, cut = _without_observer_jump(truth, observer_collided)
    jumped = _jumps(_displacement(truth), _velocity(truth), _together(truth.alive), truth.time)
    jumped |= _begins(objects_collided[: len(truth.time)]) & _together(truth.alive)
    ends = [_jump(truth, step, body) for body in range(len(truth.ids)) for step in np.flatnonzero(jumped[:, body])[:1]]
    # The end of a jump and all that follows.
    cut_off = np.concatenate([np.zeros_like(truth.alive[:1]), np.logical_or.accumulate(jumped, axis=0)])
    repaired = replace(truth, alive=truth.alive & ~cut_off)

    moving = _together(repaired.alive)
    before = _errors(_displacement(truth), _velocity(truth), moving)
    wrong = np.flatnonzero(np.nanmax(before, axis=0, initial=0.0) > TOLERANCE_MPS).tolist()
    repaired = _velocity_from_displacement(repaired, wrong)
    after = _errors(_displacement(truth), _velocity(repaired), moving)

    repairs = Repairs(
        velocity_from_displacement=[truth.ids[i] for i in wrong],
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
    """The same truth, whose positions and velocities come from the same formulas, with what there is to say of it."""
    none = VelocityMismatch(max_mps=0.0, mean_mps=0.0, object=None, time_s=None)
    result = TruthAudit(
        mode="by construction",
        verdict="exact",
        velocity_error_before=none,
        velocity_error_after=none,
        jumps=[],
        velocity_jumps=jumps.summarised(truth),
        repaired=Repairs(),
    )
    return replace(truth, audit=result.model_dump(mode="json"))


def _velocity(truth: Truth) -> Array:
    """``(2, steps, objects, runs)`` m/s."""
    return np.stack([truth.vx, truth.vy])


def _displacement(truth: Truth) -> Array:
    """Mean velocity of each step, ``(2, steps - 1, objects, runs)`` m/s."""
    dt = np.diff(truth.time)[:, None, None]
    return np.stack([np.diff(truth.px, axis=0), np.diff(truth.py, axis=0)]) / dt


def _together(alive: Mask) -> Mask:
    """``(steps - 1, objects)``: where a body is there at both ends of a step."""
    return alive[:-1] & alive[1:]


def _errors(displacement: Array, velocity: Array, moving: Mask) -> Array:
    """Velocity that the displacement does not bear out, ``(steps - 1, objects)`` m/s, NaN where absent.

    For each body by the rule of integration that fits it better.
    """
    euler, trapezoid = _by_rule(displacement, velocity, moving)
    return np.where(_typical(euler) <= _typical(trapezoid), euler, trapezoid)


def by_euler(truth: Truth) -> Mask:
    """``(objects,)``: those whose velocity at the start of a step moves them until its end, rather than the mean of the
    velocities at its ends."""
    euler, trapezoid = _by_rule(_displacement(truth), _velocity(truth), _together(truth.alive))
    return np.asarray(_typical(euler) <= _typical(trapezoid))


def _by_rule(displacement: Array, velocity: Array, moving: Mask) -> tuple[Array, Array]:
    """The errors by Euler's rule (the velocity at the start of a step moves the body, as highway-env does for all but
    its dynamic bicycle) and by the trapezoid."""
    euler = np.hypot(*(displacement - velocity[:, :-1])).max(axis=-1)
    trapezoid = np.hypot(*(displacement - 0.5 * (velocity[:, :-1] + velocity[:, 1:]))).max(axis=-1)
    return np.where(moving, euler, np.nan), np.where(moving, trapezoid, np.nan)


def _typical(errors: Array) -> Array:
    return np.array(
        [np.median(column[np.isfinite(column)]) if np.isfinite(column).any() else 0.0 for column in errors.T]
    )


def _jumps(displacement: Array, velocity: Array, moving: Mask, time: Array) -> Mask:
    """``(steps - 1, objects)``: steps that neither the velocity nor the steps around them account for.

    A wrong velocity along a smooth path is not a jump: there the displacement goes on as it did.
    """
    unexplained = _errors(displacement, velocity, moving)
    path = np.where(moving[..., None], displacement, np.nan)
    padded = np.pad(path, ((0, 0), (NEIGHBOURS, NEIGHBOURS), (0, 0), (0, 0)), constant_values=np.nan)
    window = np.lib.stride_tricks.sliding_window_view(padded, 2 * NEIGHBOURS + 1, axis=1)
    absent = np.isnan(window).all(axis=-1, keepdims=True)
    expected = np.nanmedian(np.where(absent, 0.0, window), axis=-1)
    strange = np.hypot(*(displacement - expected)).max(axis=-1)
    limit = TOLERANCE_MPS + IMPOSSIBLE_MPS2 * np.diff(time)[:, None]
    result: Mask = (unexplained > TOLERANCE_MPS) & (strange > limit)
    return result


def _begins(state: Mask) -> Mask:
    return state[1:] & ~state[:-1]


def _jump(truth: Truth, step: int, body: int) -> PositionJump:
    across = np.hypot(*(_displacement(truth) - _velocity(truth)[:, :-1]))[step, body].max()
    end = float(truth.time[step + 1])
    return PositionJump(object=truth.ids[body], time_s=end, distance_m=float(across * (end - truth.time[step])))


def _without_observer_jump(truth: Truth, collided: Mask) -> tuple[Truth, list[PositionJump]]:
    carrier = truth.observer
    px, py, vx, vy = (a[:, None, None] for a in (carrier.px, carrier.py, carrier.vx, carrier.vy))
    displacement = np.stack([np.diff(px, axis=0), np.diff(py, axis=0)]) / np.diff(truth.time)[:, None, None]
    moving = np.ones((len(truth.time) - 1, 1), dtype=bool)
    jumped = _jumps(displacement, np.stack([vx, vy]), moving, truth.time)[:, 0] | _begins(collided)
    result = np.flatnonzero(jumped)
    if not result.size:
        return truth, []
    end = int(result[0]) + 1
    if end < 2:
        if not collided.any():
            raise InputError("the observer jumps at the start: check the units of positions and speeds", key="truth")
        raise InputError("the observer collides at the start; choose another truth.seed", key="truth.seed")
    distance = np.hypot(*(displacement[:, end - 1, 0, 0] - np.array([carrier.vx[end - 1], carrier.vy[end - 1]])))
    far = float(distance * (truth.time[end] - truth.time[end - 1]))
    jump = PositionJump(object="observer", time_s=float(truth.time[end]), distance_m=far)
    return _until(truth, end), [jump]


def _until(truth: Truth, end: int) -> Truth:
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
    """Largest and mean error, and where it is largest; None where nothing moves."""
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
