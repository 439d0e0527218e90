"""The checks of motion models and sensors: Jacobians against finite differences, batches against loops."""

from __future__ import annotations

import pickle
from collections.abc import Callable, Iterator

import numpy as np

from trackbench.base.types import Array, Gaussian, Scan
from trackbench.base.units import difference
from trackbench.models.motion import InitialSigmas, MotionModel
from trackbench.models.motion.base import MOTION_MODELS
from trackbench.models.sensors import SENSOR_MODELS, Sensor

#: Step of central differences to either side, and allowed relative error of a derivative.
STEP, CLOSE = 1e-5, 1e-6
DT = (0.05, 0.7)
#: Targets in the common state, away from rest and from the sensor.
TARGETS = np.array([[30.0, -12.0, 8.0], [7.0, 40.0, -25.0], [9.0, -6.0, 4.0], [-3.0, 5.0, 11.0]])
POSE, VELOCITY = np.array([2.0, -1.0, 0.3]), np.array([4.0, -0.5])


class ModelCheckError(AssertionError):
    """Contradiction between a model's equations; the text lists all contradictions."""


def check_motion_model(model: MotionModel) -> None:
    """Check that a motion model's equations agree with each other.

    Raises:
        ModelCheckError: a Jacobian is not the derivative, a step of zero time moves the state, a batch differs from its
            members, a first covariance is not positive definite, or a shape is wrong; the text lists all problems.
    """
    _raise(type(model).__name__, _motion_problems(model))


def check_sensor(sensor: Sensor) -> None:
    """Check that a sensor's equations agree with each other.

    Raises:
        ModelCheckError: the Jacobian is not the derivative, a noise-free measurement does not lead back to the target,
            a batch differs from its members, or a shape is wrong; the text lists all problems.
    """
    _raise(type(sensor).__name__, _sensor_problems(sensor))


def derivative(function: Callable[[Array], Array], x: Array, angular: tuple[int, ...] = ()) -> Array:
    """Return the derivative ``(m, n)`` of a function at a state ``(n,)`` from central differences.

    ``angular`` has the indices of outputs that are angles; their differences are wrapped.
    """
    steps = STEP * np.eye(len(x))
    return np.stack([difference(function(x + h), function(x - h), angular) for h in steps], axis=1) / (2 * STEP)


def _raise(name: str, problems: Iterator[str]) -> None:
    result = list(problems)
    if result:
        raise ModelCheckError(f"the equations of {name} do not fit:\n" + "\n".join(f"- {text}" for text in result))


def _motion_problems(model: MotionModel) -> Iterator[str]:
    lacking = MOTION_MODELS.lacks(type(model))
    if lacking is not None:
        yield lacking
        return
    size, noises = len(model.components), len(model.driving_noise)
    belief = Gaussian(TARGETS, np.repeat(np.diag([1.0, 1.0, 4.0, 4.0])[..., None], TARGETS.shape[1], axis=2))
    first = model.from_cartesian(belief, InitialSigmas(acceleration=2.0, yaw_rate=0.2))
    if first.mean.shape != (size, TARGETS.shape[1]):
        yield f"from_cartesian gives a mean of shape {first.mean.shape}, not {(size, TARGETS.shape[1])}"
        return
    if not np.allclose(model.to_cartesian(first.mean), TARGETS):
        yield "to_cartesian does not lead back from from_cartesian"
    smallest = np.linalg.eigvalsh(np.moveaxis(first.covariance, -1, 0)).min()
    if not smallest > 0:
        yield f"the first covariance of from_cartesian is not positive definite (smallest eigenvalue {smallest:.1e})"
    # Components that position and velocity do not determine get values other than zero.
    states = first.mean + np.linspace(0.1, 0.4, size)[:, None]
    for x in states.T:
        still = model.transition(x, 0.0)
        if not np.allclose(difference(still, x, model.angular), 0.0):
            yield "transition moves the state in a step of no time"
            break
    for dt in DT:
        batch = model.transition(states, dt)
        for i, x in enumerate(states.T):
            if not np.allclose(model.transition(x, dt), batch[:, i]):
                yield f"transition of a batch differs from that of its members (dt {dt:g} s)"
                break
        jacobian, transition = (lambda x, dt=dt, call=call: call(x, dt) for call in (model.jacobian, model.transition))
        yield from _compare("jacobian", "transition", states, jacobian, transition, model.angular)
        gain = model.noise_gain(states[:, 0], dt)
        if gain.shape != (size, noises):
            yield f"noise_gain has the shape {gain.shape}, not {(size, noises)}"
    yield from _compare("cartesian_jacobian", "to_cartesian", states, model.cartesian_jacobian, model.to_cartesian)
    if pickle.loads(pickle.dumps(model)) != model or hash(model) != hash(model.model_copy()):
        yield "it does not survive pickling, or its copies have another hash"


def _sensor_problems(sensor: Sensor) -> Iterator[str]:
    lacking = SENSOR_MODELS.lacks(type(sensor))
    if lacking is not None:
        yield lacking
        return
    size = len(sensor.components)
    batch = sensor.measure(TARGETS, POSE, VELOCITY)
    if batch.shape != (size, TARGETS.shape[1]):
        yield f"measure gives the shape {batch.shape}, not {(size, TARGETS.shape[1])}"
        return
    for i, target in enumerate(TARGETS.T):
        if not np.allclose(sensor.measure(target, POSE, VELOCITY), batch[:, i]):
            yield "measure of a batch differs from that of its members"
            break
    yield from _compare(
        "jacobian", "measure", TARGETS, lambda x: sensor.jacobian(x, POSE, VELOCITY),
        lambda x: sensor.measure(x, POSE, VELOCITY), sensor.angular,
    )  # fmt: skip
    exact = np.eye(size) * 1e-12
    valid = np.ones(TARGETS.shape[1], dtype=bool)
    scan = Scan(0.0, "sensor", sensor.type, batch, valid, exact, POSE, VELOCITY, 0.0)
    position = sensor.position(scan)
    if not np.allclose(position.mean, TARGETS[:2], atol=1e-6):
        yield "position does not lead back from a measurement without noise to where the target is"
    if position.covariance.shape != (2, 2, TARGETS.shape[1]) and position.covariance.shape != (2, 2):
        yield f"position has a covariance of shape {position.covariance.shape}"
    if sensor.radial_velocity(scan).shape != (2, TARGETS.shape[1]):
        yield f"radial_velocity has the shape {sensor.radial_velocity(scan).shape}, not {(2, TARGETS.shape[1])}"


def _compare(
    name: str,
    of_function: str,
    states: Array,
    jacobian: Callable[[Array], Array],
    function: Callable[[Array], Array],
    angular: tuple[int, ...] = (),
) -> Iterator[str]:
    for x in states.T:
        stated, expected = np.asarray(jacobian(x)), derivative(function, x, angular)
        if stated.shape != expected.shape:
            yield f"{name} has the shape {stated.shape}, not {expected.shape}"
            return
        wrong = np.abs(stated - expected) > CLOSE * (1.0 + np.abs(expected))
        if wrong.any():
            row, column = (int(i) for i in np.argwhere(wrong)[0])
            yield (
                f"{name} is not the derivative of {of_function}: entry {row}, {column} is {stated[row, column]:.6g}, "
                f"by finite differences {expected[row, column]:.6g}"
            )
            return
