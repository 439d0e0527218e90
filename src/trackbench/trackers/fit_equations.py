"""The equations of a fit to the first measurements, of each object."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from trackbench import linalg
from trackbench.engine.elsewhere import form_of, settled
from trackbench.engine.equations import Equations, Values
from trackbench.engine.options import form, numbers, with_numbers, within
from trackbench.models.motion import MotionModel
from trackbench.models.sensors import Sensor
from trackbench.units import difference


def moved(motion: MotionModel) -> tuple[Equations, dict[str, Any]]:
    """From the state ``x`` to the one ``dt`` later: ``next``, its ``transition`` by ``x`` and ``gain`` by the noise.

    With the options of the motion model, which are inputs too.
    """
    own = numbers(motion, "motion")

    def function(model: MotionModel, values: Values) -> Values:
        x, dt = values["x"], values["dt"]
        next = model.transition(x, dt)
        transition = linalg.expand(model.jacobian(x, dt), x[None])
        sigma = linalg.expand(linalg.vector(model.noise_sigma), x)
        gain = linalg.expand(model.noise_gain(x, dt), x[None]) * sigma
        return {"next": next + linalg.apply(gain, values["noise"]), "transition": transition, "gain": gain}

    ranks = {"x": 1, "dt": 0, "noise": 1} | dict.fromkeys(own, 0)
    return Equations("fit: next state", _of(motion, function), ranks, key=(form(motion),)), own


def measured(motion: MotionModel, sensor: type[Sensor]) -> tuple[Equations, dict[str, Any]]:
    """The ``residual`` of a measurement in standard deviations; the ``slope`` of what is expected of it by ``x``."""
    own = numbers(motion, "motion")

    def function(model: MotionModel, values: Values) -> Values:
        x, whitener = values["x"], values["whitener"]
        at = model.to_cartesian(x), values["pose"], values["velocity"]
        off = difference(values["value"], sensor.measure(*at), sensor.angular)
        by_target = linalg.matmul(whitener, linalg.expand(sensor.jacobian(*at), x[None]))
        slope = linalg.matmul(by_target, linalg.expand(model.cartesian_jacobian(x), x[None]))
        return {"residual": linalg.apply(whitener, off), "slope": slope}

    ranks = {"x": 1, "value": 1, "whitener": 2, "pose": 1, "velocity": 1}
    key = form(motion), form_of(sensor)
    return Equations("fit: measurement", _of(motion, function, sensor), ranks | dict.fromkeys(own, 0), key=key), own


def _of(
    motion: MotionModel, function: Callable[[MotionModel, Values], Values], sensor: type[Sensor] | None = None
) -> Callable[[Values], Values]:
    """A function of the motion model and of values, among which are its options."""

    def with_values(model: MotionModel, values: Values) -> MotionModel:
        return with_numbers(model, "motion", values)

    return settled(function, motion, with_values, within, sensor)


#: Places of the lower triangle of the information of a straight line.
LOWER = [(i, j) for i in range(4) for j in range(i + 1)]


def on_line(sensor: type[Sensor]) -> Equations:
    """What a measurement tells of the straight line from ``first`` that it was taken ``elapsed`` seconds after.

    ``told``: the square of its residual, the gradient by the first state, downhill, and the lower triangle of the
    information.
    """

    def function(values: Values) -> Values:
        first, elapsed, whitener = values["first"], values["elapsed"], values["whitener"]
        x = linalg.vector([first[0] + elapsed * first[2], first[1] + elapsed * first[3], first[2], first[3]])
        at = x, values["pose"], values["velocity"]
        residual = linalg.apply(whitener, difference(values["value"], sensor.measure(*at), sensor.angular))
        now = linalg.matmul(whitener, linalg.expand(sensor.jacobian(*at), x[None]))
        slope = np.concatenate([now[:, :2], now[:, 2:] + elapsed * now[:, :2]], axis=1)
        gradient, information = linalg.apply_transposed(slope, residual), linalg.gram(slope)
        square = np.einsum("i...,i...->...", residual, residual)
        return {"told": linalg.vector([square, *gradient, *(information[i, j] for i, j in LOWER)])}

    ranks = {"first": 1, "elapsed": 0, "value": 1, "whitener": 2, "pose": 1, "velocity": 1}
    of_sensor = settled(lambda _, values: function(values), None, lambda none, _: none, lambda _: (), sensor)
    return Equations("fit: straight line", of_sensor, ranks, key=(form_of(sensor),))


def _begin(values: Values) -> Values:
    information = values["information"]
    own = linalg.expand(np.eye(len(information)), information)
    known = linalg.cholesky(information * (1.0 + values["damping"] * own))
    return {"covariance": linalg.gram(known.whiten(own)), "definite": known.positive}


#: The ``covariance`` of the first state, of its information with damping; and where that is positive ``definite``.
BEGIN = Equations(
    "fit: first state",
    _begin,
    {"information": 2, "damping": 0},
    symmetric=frozenset({"information"}),
)


def _forth(values: Values) -> Values:
    a, b, h, z = (values[name] for name in ("transition", "gain", "slope", "residual"))
    rest = 1.0 / (1.0 + values["damping"])
    mean = linalg.apply(a, values["mean"]) - rest * linalg.apply(b, values["noise"])
    covariance = linalg.quadratic(a, values["covariance"]) + rest * linalg.matmul_transposed(b, b)
    across = linalg.matmul(h, covariance)
    factor = linalg.cholesky(linalg.matmul_transposed(across, h) + linalg.expand(np.eye(len(z)), across))
    innovation = factor.whiten(z - linalg.apply(h, mean))
    white, by_state = factor.whiten(across), factor.whiten(h)
    return {
        "mean": mean + linalg.apply_transposed(white, innovation),
        "covariance": linalg.symmetrise(covariance - linalg.gram(white)),
        "innovation": linalg.apply_transposed(by_state, innovation),
        "kept": linalg.expand(np.eye(len(mean)), across) - linalg.matmul(np.swapaxes(white, 0, 1), by_state),
        "cost": (innovation**2).sum(axis=0),
    }


#: One measurement further: the Kalman filter's ``mean`` and ``covariance``, what they add to the ``cost``, and what the
#: way back needs of it.
FORTH = Equations(
    "fit: filter",
    _forth,
    {
        "mean": 1,
        "covariance": 2,
        "damping": 0,
        "transition": 2,
        "gain": 2,
        "noise": 1,
        "residual": 1,
        "slope": 2,
    },
    symmetric=frozenset({"covariance"}),
)


def _back(values: Values) -> Values:
    rest = 1.0 / (1.0 + values["damping"])
    back = values["innovation"] + linalg.apply_transposed(values["kept"], values["back"])
    return {
        "noise": rest * (linalg.apply_transposed(values["gain"], back) - values["noise"]),
        "back": linalg.apply_transposed(values["transition"], back),
    }


#: One measurement back: what is to be added to the ``noise`` before it, and what goes on ``back``.
BACK = Equations(
    "fit: smoother",
    _back,
    {"back": 1, "damping": 0, "innovation": 1, "kept": 2, "transition": 2, "gain": 2, "noise": 1},
)
