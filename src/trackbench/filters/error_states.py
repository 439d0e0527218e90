"""Errors of sensors as components of the state, in addition to any motion model's."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from trackbench.base import linalg
from trackbench.base.types import Array, Gaussian, Scan
from trackbench.models.motion import InitialSigmas, MotionModel
from trackbench.models.motion.base import SensorErrors, WrappedMotion
from trackbench.models.sensors import SENSOR_MODELS


@dataclass(frozen=True)
class ErrorState:
    """Error of one component of a sensor's measurements, as part of a filter's state.

    The state counts it in units of its standard deviation. It is a stationary Gauss-Markov process, or a constant.
    """

    sensor: str
    """Name of the sensor whose measurements have the error."""
    component: str
    """Measurement component with the error, such as "azimuth"."""
    rate: float
    """Inverse of the time constant, 1/s; 0 for a constant error."""
    share: float = 0.0
    """Share of the stated measurement variance that is due to this error."""
    sigma: float = 0.0
    """Standard deviation of the error on top of the stated variance, in SI units and radians."""


class MotionWithErrors(WrappedMotion):
    """Motion model whose state ends with the errors e of sensors: measurement ``z = h(x) + E e + w`` with white ``w``.

    Each error has ``e_k+1 = a e_k + sqrt(1 - a^2) v_k`` with ``a = exp(-dt rate)`` and white ``v`` of unit variance.
    Source: Bar-Shalom, Li and Kirubarajan (2001), section 8.2 for noise that is autocorrelated, by augmentation of the
    state; a constant error is the limit of an infinite time constant.
    """

    errors: tuple[ErrorState, ...]

    def model_post_init(self, context: Any) -> None:
        names = tuple(f"{e.sensor} {e.component} {'error' if e.rate else 'bias'}" for e in self.errors)
        object.__setattr__(self, "components", (*self.motion.components, *names))
        object.__setattr__(self, "first_sigmas", {**self.motion.first_sigmas, **dict.fromkeys(names, 1.0)})
        for name in ("angular", "linear"):
            object.__setattr__(self, name, getattr(self.motion, name))

    @property
    def noise_sigma(self) -> tuple[float, ...]:
        return (*self.motion.noise_sigma, *(1.0 for error in self.errors if error.rate))

    def transition(self, x: Array, dt: float) -> Array:
        decays = linalg.expand(linalg.vector(self._decays(dt)), x)
        return np.concatenate([self.motion.transition(self._inner_state(x), dt), decays * x[self._inner_size :]])

    def jacobian(self, x: Array, dt: float) -> Array:
        return _block_diagonal(
            self.motion.jacobian(self._inner_state(x), dt), np.diag(np.ones(len(self.errors))), self._decays(dt)
        )

    def noise_gain(self, x: Array, dt: float) -> Array:
        decays = self._decays(dt)
        pushes = [np.sqrt(1.0 - a * a) for a in decays]
        moving = np.diag([1.0 if error.rate else 0.0 for error in self.errors])
        columns = moving[:, [bool(error.rate) for error in self.errors]]
        return _block_diagonal(self.motion.noise_gain(self._inner_state(x), dt), columns, pushes)

    def cartesian_jacobian(self, x: Array) -> Array:
        slope = super().cartesian_jacobian(x)
        return np.concatenate([slope, np.zeros((4, len(self.errors), *slope.shape[2:]))], axis=1)

    def from_cartesian(self, belief: Gaussian, sigmas: InitialSigmas) -> Gaussian:
        return self.padded(self.motion.from_cartesian(belief, sigmas))

    @property
    def sensors_with_errors(self) -> frozenset[str]:
        return frozenset(error.sensor for error in self.errors)

    def sensor_errors(self, scan: Scan) -> SensorErrors | None:
        if scan.sensor not in self.sensors_with_errors:
            return None
        names, noise = SENSOR_MODELS[scan.kind].components, scan.noise_covariance
        white, zero = [1.0] * len(names), 0.0 * noise[0, 0]
        rows: list[list[Any]] = [[zero] * len(self.components) for _ in names]
        for column, error in enumerate(self.errors, start=self._inner_size):
            if error.sensor == scan.sensor:
                i = names.index(error.component)
                rows[i][column] = np.sqrt(error.share * noise[i, i] + error.sigma**2)
                white[i] -= error.share
        root = np.sqrt(white)
        return SensorErrors(linalg.matrix(rows), linalg.expand(root[:, None] * root, noise) * noise)

    def padded(self, belief: Gaussian, cross: Array | None = None) -> Gaussian:
        """Append sensor errors of unit variance to a belief in the state of the inner motion model.

        Args:
            belief: ``(n, ...)``.
            cross: ``(n, e, ...)`` covariance of that state and the errors; None for zero.
        """
        count, batch = len(self.errors), belief.mean.shape[1:]
        if cross is None:
            cross = np.zeros((len(belief.mean), count, *batch))
        unit = np.broadcast_to(linalg.expand(np.eye(count), cross), (count, count, *batch))
        upper = np.concatenate([belief.covariance, cross], axis=1)
        lower = np.concatenate([np.swapaxes(cross, 0, 1), unit], axis=1)
        mean = np.concatenate([belief.mean, np.zeros((count, *batch))])
        return Gaussian(mean, linalg.rounded_up(np.concatenate([upper, lower])))

    def started(self, scan: Scan, state_of: Callable[[MotionModel, Scan], Gaussian]) -> Gaussian:
        """Return the state ``(n + e, ...)``, with sensor errors, that each single measurement of a scan implies.

        The inner state is computed from the measurement, so it contains the measurement's error. With D the inner
        state's derivative with respect to the measurement and E the covariance of the sensor errors, the
        cross-covariance is ``-D E``. D is a difference quotient over a standard deviation to either side.

        Args:
            scan: scan with the noise that the sensor states.
            state_of: function from the inner motion model and a scan to a state ``(n, ...)``.
        """
        errors = self.sensor_errors(scan)
        if errors is None:
            return self.padded(state_of(self.motion, scan))
        gain = errors.gain[:, self._inner_size :]
        noise = linalg.expand(errors.noise, gain) + linalg.matmul_transposed(gain, gain)
        scan = scan._replace(noise_covariance=noise)
        slopes = []
        for i in range(len(gain)):
            step = np.zeros_like(scan.measurement)
            step[i] = np.sqrt(noise[i, i])
            above, below = (
                state_of(self.motion, scan._replace(measurement=scan.measurement + sign * step)) for sign in (1.0, -1.0)
            )
            slopes.append((above.mean - below.mean) / (2.0 * step[i]))
        slope = np.stack(slopes, axis=1)
        return self.padded(state_of(self.motion, scan), -linalg.matmul(slope, linalg.expand(gain, slope)))

    def _decays(self, dt: float) -> list[Any]:
        return [np.exp(-error.rate * dt) if error.rate else 1.0 for error in self.errors]


def _block_diagonal(first: Array, pattern: Array, scales: Sequence[Any]) -> Array:
    upper = [[*row, *[0.0] * pattern.shape[1]] for row in first]
    lower = [
        [*[0.0] * first.shape[1], *(scale * entry if entry else 0.0 for entry in row)]
        for row, scale in zip(pattern, scales, strict=True)
    ]
    return linalg.matrix([*upper, *lower])
