"""The equations of a fit to the first measurements, of each object."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from trackbench.base import linalg
from trackbench.base.types import Array
from trackbench.base.units import difference
from trackbench.engine.equations import Equations, Values
from trackbench.engine.options import form, numbers, with_numbers, within
from trackbench.engine.user_equations import form_of, is_traced, settled
from trackbench.models.motion import InitialSigmas, MotionModel
from trackbench.models.motion.base import POSITION, VELOCITY, YAW, first_sigma
from trackbench.models.sensors import Sensor
from trackbench.trackers.fit_search import index

Kinds = Sequence[type[Sensor]]

#: Number of component axes of what equations take of a measurement.
MEASURED = {"value": 1, "whitener": 2, "pose": 1, "velocity": 1, "of_kind": 1}
#: Places of the lower triangle of the information of a straight line.
LOWER = [(i, j) for i in range(4) for j in range(i + 1)]


def first_state(motion: MotionModel, kinds: Kinds) -> Equations:
    """What is assumed of the first state ``x``, and its measurement.

    ``cost``: the squares of the residuals, and ``least``: what they can be if all were linear. ``mean`` and
    ``covariance``: of what is to be added, damped; and where that is ``definite``. ``prior``: the standard deviation
    of a velocity, and InitialSigmas.
    """

    def function(model: MotionModel, values: Values) -> Values:
        x, sigmas = values["x"], InitialSigmas(*values["prior"][1:])
        residual, slope = _compared(model, kinds, x, values)
        velocity = model.to_cartesian(x)[2:]
        by_state, slow = linalg.expand(model.cartesian_jacobian(x)[2:], x[None]), 1.0 / values["prior"][0] ** 2
        information = linalg.gram(slope) + slow * linalg.gram(by_state)
        gradient = linalg.apply_transposed(slope, residual) - slow * linalg.apply_transposed(by_state, velocity)
        cost = (residual**2).sum(axis=0) + slow * (velocity**2).sum(axis=0)
        for i, name in enumerate(model.components):
            if name in YAW:
                # Nothing pulls at the course, but no more is unknown of it than of any angle.
                information[i, i] += 1.0 / sigmas.yaw**2
            elif name not in (*POSITION, *VELOCITY):
                weight = 1.0 / first_sigma(model, name, sigmas) ** 2
                information[i, i] += weight
                gradient[i] -= weight * x[i]
                cost = cost + weight * x[i] ** 2
        return {"cost": cost, **_solved(information, gradient, cost, values["damping"])}

    ranks = {"x": 1, "damping": 0, "prior": 1, **MEASURED}
    return _equations("fit: first state", motion, kinds, function, ranks)


def forth(motion: MotionModel, kinds: Kinds) -> Equations:
    """One measurement further: the state ``x`` there, the sums, and the Kalman filter of what is to be added.

    The next state is driven by ``noise``, in standard deviations, over ``dt``. The way back is ``added`` and ``way``:
    of what comes back ``(n, ...)`` it makes what goes on back, and below it what is to be added to the noise.
    """

    def function(model: MotionModel, values: Values) -> Values:
        x, dt, noise, covariance = (values[name] for name in ("x", "dt", "noise", "covariance"))
        if not is_traced(values) and np.ndim(dt) > 0:
            return _by_interval(function, model, values)
        sigma = linalg.expand(linalg.vector(model.noise_sigma), x)
        a, b = linalg.expand(model.jacobian(x, dt), x[None]), linalg.expand(model.noise_gain(x, dt), x[None]) * sigma
        x = model.transition(x, dt) + linalg.apply(b, noise)
        z, h = _compared(model, kinds, x, values)
        rest = 1.0 / (1.0 + values["damping"])
        mean = linalg.apply(a, values["mean"]) - rest * linalg.apply(b, noise)
        covariance = linalg.quadratic(a, covariance) + rest * linalg.matmul_transposed(b, b)
        across = linalg.matmul(h, covariance)
        factor = linalg.cholesky(linalg.matmul_transposed(across, h) + linalg.expand(np.eye(len(z)), across))
        innovation = factor.whiten(z - linalg.apply(h, mean))
        white, by_state = factor.whiten(across), factor.whiten(h)
        back = linalg.apply_transposed(by_state, innovation)
        # With the gain K: (I - K H) A, and (I - K H) B.
        by_last, by_noise = (m - linalg.matmul(np.swapaxes(white, 0, 1), linalg.matmul(by_state, m)) for m in (a, b))
        added = [linalg.apply_transposed(a, back), rest * (linalg.apply_transposed(b, back) - noise)]
        squares = (noise**2).sum(axis=0)
        return {
            "x": x,
            "cost": values["cost"] + (z**2).sum(axis=0) + squares,
            "least": values["least"] + (innovation**2).sum(axis=0) + (1.0 - rest) * squares,
            "mean": mean + linalg.apply_transposed(white, innovation),
            "covariance": linalg.symmetrise(covariance - linalg.gram(white)),
            "added": np.concatenate(added),
            "way": np.concatenate([by_last, rest * by_noise], axis=1),
        }

    sums = {"cost": 0, "least": 0, "mean": 1, "covariance": 2}
    ranks = {"x": 1, "dt": 0, "noise": 1, "damping": 0, **sums, **MEASURED}
    return _equations("fit: filter", motion, kinds, function, ranks)


def _back(values: Values) -> Values:
    return {"back": values["added"] + linalg.apply_transposed(values["way"], values["back"])}


#: One measurement back, as ``forth`` says.
BACK = Equations("fit: smoother", _back, {"back": 1, "added": 1, "way": 2})


def on_line(kinds: Kinds) -> Equations:
    """What a measurement tells of the straight line from ``first`` that it was taken ``elapsed`` seconds after.

    It is added to what was ``told``: the square of its residual, the gradient by the first state, downhill, and the
    lower triangle of the information.
    """

    def function(_: None, values: Values) -> Values:
        first, elapsed = values["first"], values["elapsed"]
        x = linalg.vector([first[0] + elapsed * first[2], first[1] + elapsed * first[3], first[2], first[3]])
        residual, now = _compared_in_cartesian(kinds, x, values)
        slope = np.concatenate([now[:, :2], now[:, 2:] + elapsed * now[:, :2]], axis=1)
        gradient, information = linalg.apply_transposed(slope, residual), linalg.gram(slope)
        square = (residual**2).sum(axis=0)
        return {"told": values["told"] + linalg.vector([square, *gradient, *(information[at] for at in LOWER)])}

    of_kinds = settled(function, None, lambda none, _: none, lambda _: (), kinds)
    ranks = {"told": 1, "first": 1, "elapsed": 0, **MEASURED}
    return Equations("fit: straight line", of_kinds, ranks, key=tuple(map(form_of, kinds)))


def _along(values: Values) -> Values:
    told, first, elapsed = values["told"], values["first"], values["elapsed"]
    lower = dict(zip(LOWER, told[5:], strict=True))
    information = linalg.matrix([[lower[max(i, j), min(i, j)] for j in range(4)] for i in range(4)])
    step = _solved(information, told[1:5], told[0], values["damping"])
    reach = linalg.matrix([[1, 0, elapsed, 0], [0, 1, 0, elapsed], [0, 0, 1, 0], [0, 0, 0, 1]])
    latest = linalg.symmetrise(linalg.quadratic(reach, step["covariance"]))
    return {**step, "covariance": latest, "x": linalg.apply(reach, first)}


#: The step that measurements tell of a straight line, as ``first_state`` has it; ``x``: the state ``elapsed`` seconds
#: after the first, and its covariance.
ALONG = Equations("fit: along the line", _along, {"told": 1, "first": 1, "elapsed": 0, "damping": 0})


def _solved(information: Array, gradient: Array, cost: Array, damping: Array) -> dict[str, Array]:
    """The step of an information ``(n, n, ...)`` and a gradient ``(n, ...)``.

    The damping is added to the weights of what is sought, as a share of them.
    """
    own = linalg.expand(np.eye(len(information)), information)
    known = linalg.cholesky(information * (1.0 + damping * own))
    covariance = linalg.gram(known.whiten(own))
    mean = linalg.apply(covariance, gradient)
    least = cost - (gradient * mean).sum(axis=0)
    return {"mean": mean, "covariance": covariance, "least": least, "definite": known.positive}


def _compared(model: MotionModel, kinds: Kinds, x: Array, values: Values) -> tuple[Array, Array]:
    """The residual ``(m, ...)`` of a measurement in the state ``x``, the slope ``(m, n, ...)`` of what is expected."""
    residual, by_target = _compared_in_cartesian(kinds, model.to_cartesian(x), values)
    return residual, linalg.matmul(by_target, linalg.expand(model.cartesian_jacobian(x), x[None]))


def _compared_in_cartesian(kinds: Kinds, x: Array, values: Values) -> tuple[Array, Array]:
    """The same by px, py, vx, vy, in standard deviations; zero of an object that has no measurement of the kinds."""
    at = x, values["pose"], values["velocity"]
    residual = linalg.vector([np.zeros_like(x[0])] * len(values["value"]))
    slope = linalg.matrix([[np.zeros_like(x[0])] * 4] * len(residual))
    for here, sensor in zip(values["of_kind"], kinds, strict=True):
        own = slice(len(sensor.components))
        whitener = values["whitener"][own, own]
        off = linalg.apply(whitener, difference(values["value"][own], sensor.measure(*at), sensor.angular))
        by_target = linalg.matmul(whitener, linalg.expand(sensor.jacobian(*at), x[None]))
        residual[own] = np.where(here, off, residual[own])
        slope[own] = np.where(here, by_target, slope[own])
    return residual, slope


def _by_interval(function: Callable[[MotionModel, Values], Values], model: MotionModel, values: Values) -> Values:
    """What a function of one interval ``dt`` gives where each object has its own: of those with the same at once."""
    interval = values["dt"]
    found: dict[str, Array] = {}
    for dt in np.unique(interval):
        here = index(interval == dt)
        own = {name: value[..., here] for name, value in values.items() if np.shape(value)[-1:] == interval.shape}
        for name, part in function(model.part(here), {**values, **own, "dt": float(dt)}).items():
            whole = found.setdefault(name, np.empty((*part.shape[:-1], *interval.shape)))
            whole[..., here] = part
    return found


def _equations(
    title: str,
    motion: MotionModel,
    kinds: Kinds,
    function: Callable[[MotionModel, Values], Values],
    ranks: dict[str, int],
) -> Equations:
    """Those of a motion model and of kinds of sensors, with the numbers among the model's options as inputs."""

    def with_values(model: MotionModel, values: Values) -> MotionModel:
        return with_numbers(model, "motion", values)

    of_values = settled(function, motion, with_values, within, kinds)
    inputs = ranks | dict.fromkeys(own_numbers(motion), 0)
    key = form(motion), *map(form_of, kinds)
    return Equations(title, of_values, inputs, frozenset({"covariance"} & ranks.keys()), key=key)


def own_numbers(motion: MotionModel) -> dict[str, Any]:
    """The numbers among a motion model's options, named as the equations take them."""
    return numbers(motion, "motion")
