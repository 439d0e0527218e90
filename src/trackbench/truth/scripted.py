"""Ground truth from a script: closed forms, and motion models driven by random noise."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from trackbench.base import linalg
from trackbench.base.errors import InputError
from trackbench.base.streams import stream
from trackbench.base.types import Array, Observer, Truth
from trackbench.base.units import wrap_angle
from trackbench.models.motion import ConstantTurnRateAcceleration, ConstantVelocity, Kinematics, MotionModel
from trackbench.truth.audit import exact
from trackbench.truth.config.recording import MovingObserver
from trackbench.truth.config.scripted import Piece, ScriptedBody, ScriptedObserver, ScriptedOptions, ScriptedStart

Generators = Sequence[np.random.Generator]

#: Largest product of steps, objects and runs that fits the memory of a small machine (400 bytes each in a run).
LARGEST = 20_000_000

#: Model of steady pieces, which have no noise, so that the sigmas have no effect.
STEADY = ConstantTurnRateAcceleration(jerk_sigma_mps3=1.0, yaw_acceleration_sigma_radps2=1.0)


def script(config: ScriptedOptions, seed: int, scenario: str, runs: int) -> Truth:
    """Return the scripted truth of all objects; with random motion, of every run.

    Raises:
        InputError: an object stands still at its waypoints, or random motion in so many runs exceeds the memory.
    """
    steps, largest = _steps(config), most_runs(config)
    if config.random and runs > largest:
        raise InputError(f"random motion is kept for all runs at once; at most {largest} fit", key="monte_carlo.runs")
    time = np.arange(steps + 1) / config.rate_hz
    paths = []
    for name, body in config.objects.items():
        random = [stream(seed, scenario, run, f"motion of {name}") for run in range(runs)] if body.random else []
        paths.append(_path(body, f"truth.objects.{name}", steps, config.rate_hz, random))
    size = max(path.px.shape[1] for path in paths)
    px, py, speed, heading, acceleration, yaw_rate = (
        np.stack([np.broadcast_to(field, (steps + 1, size)) for field in fields], axis=1)
        for fields in zip(*paths, strict=True)
    )
    is_backward = speed < 0.0
    truth = Truth(
        time=time,
        ids=tuple(config.objects),
        px=px,
        py=py,
        heading=wrap_angle(heading),
        course=wrap_angle(heading + np.where(is_backward, np.pi, 0.0)),
        speed=np.abs(speed),
        acceleration=np.where(is_backward, -acceleration, acceleration),
        yaw_rate=yaw_rate,
        alive=np.ones((steps + 1, len(paths)), dtype=bool),
        length=np.array([body.length_m for body in config.objects.values()]),
        width=np.array([body.width_m for body in config.objects.values()]),
        observer=_observer(config.observer, time, config.rate_hz),
        target=np.array([body.target for body in config.objects.values()]),
        source={**config.model_dump(mode="json", exclude={"objects"}), "random": config.random},
    )
    return exact(truth)


def most_runs(config: ScriptedOptions) -> int:
    """Return the largest number of runs whose random motion fits the memory."""
    return LARGEST // ((_steps(config) + 1) * len(config.objects))


def _steps(config: ScriptedOptions) -> int:
    return int(config.duration_s * config.rate_hz + 1e-6)


def _path(body: ScriptedBody, key: str, steps: int, rate: int, random: Generators) -> Kinematics:
    """Return the motion of one body, arrays ``(steps + 1, runs or 1)``; the speed is negative in reverse."""
    state = _start(body.start, max(1, len(random)))
    parts: list[Kinematics] = []
    steps_left = steps
    for index, piece in enumerate(body.pieces):
        count = steps_left if piece.for_s is None else min(steps_left, round(piece.for_s * rate))
        steps_left -= count
        if piece.waypoints is not None and piece.speed_mps is None and not np.all(state.speed):
            option = f"{key}.pieces.{index}.speed_mps"
            raise InputError("missing: it stands still when this piece starts", key=option)
        part, state = _follow(piece, state, count, 1.0 / rate, random)
        # The next piece starts at the end of this piece.
        parts.append(part if index == len(body.pieces) - 1 else Kinematics(*(field[:-1] for field in part)))
    return Kinematics(*(np.concatenate(fields) for fields in zip(*parts, strict=True)))


def _follow(
    piece: Piece, state: Kinematics, count: int, dt: float, random: Generators
) -> tuple[Kinematics, Kinematics]:
    """Return the motion at the ``count + 1`` instants of a piece, and the state from which the next piece starts."""
    elapsed = np.arange(count + 1, dtype=np.float64) * dt
    if piece.waypoints is not None:
        return _polyline(np.array(piece.waypoints), piece.speed_mps, state, elapsed)
    if piece.white is not None:
        model = piece.white.motion
        return _driven_by_noise(model, np.array(model.noise_sigma), state, count, dt, random)
    if piece.white_acceleration is not None:
        sigma = np.array([piece.white_acceleration.x_sigma_mps2, piece.white_acceleration.y_sigma_mps2])
        return _driven_by_noise(ConstantVelocity(acceleration_sigma_mps2=1.0), sigma, state, count, dt, random)
    return _steady(piece, state, elapsed)


def _steady(piece: Piece, state: Kinematics, elapsed: Array) -> tuple[Kinematics, Kinematics]:
    """Move with constant turn rate and acceleration along the path, stopping if the piece ends in a standstill."""
    begin = STEADY.from_kinematics(
        state._replace(
            acceleration=np.full_like(state.px, piece.acceleration_mps2),
            yaw_rate=np.full_like(state.px, np.deg2rad(piece.turn_rate_degps)),
        )
    )
    stop = np.full_like(state.px, np.inf)
    if piece.until_stop:
        stop = np.where(state.speed >= 0.0, state.speed / -piece.acceleration_mps2, np.inf)
    # Each step is computed from the start of the piece, so that rounding does not add up.
    driven = np.minimum(elapsed[:, None], stop)
    px, py, speed, heading, yaw_rate, acceleration = STEADY.transition(begin[:, None], driven)
    is_standing = elapsed[:, None] >= stop
    speed, acceleration, yaw_rate = (np.where(is_standing, 0.0, rate) for rate in (speed, acceleration, yaw_rate))
    path = Kinematics(px, py, speed, heading, acceleration, yaw_rate)
    return path, _last(path)


def _driven_by_noise(
    model: MotionModel, sigma: Array, state: Kinematics, count: int, dt: float, random: Generators
) -> tuple[Kinematics, Kinematics]:
    draws = [generator.standard_normal((count + 1, len(sigma))) for generator in random]
    noise = sigma[:, None] * np.stack(draws, axis=-1)
    states = [model.from_kinematics(state)]
    for drive in noise[:-1]:
        x = states[-1]
        states.append(model.transition(x, dt) + linalg.matvec(model.noise_gain(x, dt), drive))
    path = model.to_kinematics(np.stack(states, axis=1), np.swapaxes(noise, 0, 1), state.course)
    return path, model.to_kinematics(states[-1], np.zeros_like(noise[0]), path.course[-1])


def _polyline(points: Array, speed: float | None, state: Kinematics, elapsed: Array) -> tuple[Kinematics, Kinematics]:
    """Return the motion at the times ``elapsed``, s, along straight legs, and the state at the last of these times.

    The legs lead from ``state`` through ``points`` ``(points, 2)``, m, and straight on after the last of them.
    ``speed`` None keeps the speed of ``state``.
    """
    pace = np.abs(state.speed) if speed is None else np.full_like(state.px, speed)
    waypoints = np.broadcast_to(points[:, :, None], (*points.shape, len(state.px)))
    corners = np.concatenate([np.stack([state.px, state.py])[None], waypoints])
    legs = np.diff(corners, axis=0)
    length = np.hypot(legs[:, 0], legs[:, 1])
    reached = np.concatenate([np.zeros_like(length[:1]), np.cumsum(length, axis=0)])
    course = np.arctan2(legs[:, 1], legs[:, 0])
    distance = pace * elapsed[:, None]
    # The leg with a length that begins at the last passed corner.
    has_begun = (distance[:, None] >= reached[:-1] * (1.0 - 1e-12)) & (length > 0.0)
    leg = np.where(has_begun.any(axis=1), len(legs) - 1 - np.argmax(has_begun[:, ::-1], axis=1), -1)
    runs = np.arange(len(state.px))
    heading = np.where(leg < 0, state.course, course[leg, runs])
    rest = distance - np.where(leg < 0, 0.0, reached[leg, runs])
    px = np.where(leg < 0, state.px, corners[leg, 0, runs]) + rest * np.cos(heading)
    py = np.where(leg < 0, state.py, corners[leg, 1, runs]) + rest * np.sin(heading)
    zeros = np.zeros_like(distance)
    path = Kinematics(px, py, pace + zeros, heading, zeros, zeros)
    return path, _last(path)


def _last(path: Kinematics) -> Kinematics:
    return Kinematics(*(field[-1] for field in path))


def _start(start: ScriptedStart, runs: int) -> Kinematics:
    if start.vx_mps is None and start.vy_mps is None:
        speed, course = start.speed_mps or 0.0, np.deg2rad(start.course_deg or 0.0)
    else:
        vx, vy = start.vx_mps or 0.0, start.vy_mps or 0.0
        speed, course = np.hypot(vx, vy), np.arctan2(vy, vx)
    return Kinematics(*(np.full(runs, float(value)) for value in (start.x, start.y, speed, course, 0.0, 0.0)))


def _observer(config: MovingObserver | ScriptedObserver, time: Array, rate: int) -> Observer:
    if isinstance(config, ScriptedObserver):
        path = _path(config, "truth.observer", len(time) - 1, rate, ())
        px, py, speed, heading, _, yaw_rate = (field[:, 0] for field in path)
        vx, vy = speed * np.cos(heading), speed * np.sin(heading)
        return Observer(px, py, wrap_angle(heading), vx, vy, yaw_rate, config.length_m, config.width_m)
    turn = np.deg2rad(config.turn_rate_degps)
    return Observer(
        px=config.x + config.vx_mps * time,
        py=config.y + config.vy_mps * time,
        yaw=wrap_angle(np.deg2rad(config.yaw_deg) + turn * time),
        vx=np.full_like(time, config.vx_mps),
        vy=np.full_like(time, config.vy_mps),
        yaw_rate=np.full_like(time, turn),
    )
