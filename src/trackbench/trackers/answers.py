"""What a tracker is, what its ``step`` may return, and what is wrong with anything else."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np

from trackbench.base.types import Array, Estimate, Scan

NOT_FINITE = "the estimate is not finite"
NOT_DEFINITE = "the covariance is not positive definite"
TOO_LARGE = "the error, or its ratio to the covariance, is too large for any score"
GIVEN_UP = "it gave None after an estimate: where a measurement is missed, the estimate is to be predicted"

#: Largest difference of mirrored entries of a covariance, relative to its largest entry.
ASYMMETRY = 1e-6
#: How far the sum of mode probabilities may be from one.
PROBABILITY_ROUNDING = 1e-6


class Tracker(Protocol):
    """Estimates one object (or, with a class attribute ``batched = True``, a batch of them) from its measurements.

    One that draws random numbers, such as a particle filter, says so by a class attribute ``stochastic = True``.
    """

    def step(self, state: Any, scan: Scan) -> tuple[Any, Estimate | tuple[Array, Array] | None]:
        """The state and the estimate after a scan.

        ``state`` is None at the first measurement and is never changed in place. The estimate is None while there is
        none; a batched tracker gives NaN where an object has none yet.
        """
        ...


class TrackerFault(Exception):
    """What a tracker gave cannot be an estimate."""


def unpack(answer: Any, what: str = "estimate") -> tuple[Any, Any]:
    """State and estimate, or tracks, from what ``step`` returned."""
    if not isinstance(answer, tuple) or len(answer) != 2:
        raise TrackerFault(f"step must return (state, {what}), not {described(answer)}")
    return answer


def checked(answer: Any, scan: Scan) -> Estimate | None:
    """An estimate of the right shapes, its covariance symmetric.

    Raises:
        TrackerFault: it is not a mean (4, ...) with a symmetric covariance (4, 4, ...).
    """
    estimate = shaped(answer, scan)
    if estimate is None:
        return None
    covariance = estimate.covariance
    with np.errstate(invalid="ignore"):
        gap = np.abs(covariance - np.swapaxes(covariance, 0, 1)).max(axis=(0, 1))
    if np.any(gap > ASYMMETRY * np.abs(covariance).max(axis=(0, 1))):
        raise TrackerFault(f"the covariance is not symmetric: mirrored entries differ by up to {np.nanmax(gap):.3g}")
    return estimate


def shaped(answer: Any, scan: Scan) -> Estimate | None:
    """An estimate of the right shapes.

    Raises:
        TrackerFault: it is not a mean (4, ...) with a covariance (4, 4, ...).
    """
    if answer is None:
        return None
    if not isinstance(answer, Estimate):
        if not isinstance(answer, tuple) or len(answer) != 2:
            raise TrackerFault(f"the estimate must be (mean, covariance) or None, not {described(answer)}")
        answer = Estimate(*answer)
    batch = np.shape(scan.valid)
    mean = array_of("mean", answer.mean, (4, *batch))
    covariance = array_of("covariance", answer.covariance, (4, 4, *batch))
    innovation, innovation_covariance = answer.innovation, answer.innovation_covariance
    if innovation is not None and innovation_covariance is not None:
        size = len(np.atleast_1d(innovation))
        innovation = array_of("innovation", innovation, (size, *batch))
        innovation_covariance = array_of("innovation covariance", innovation_covariance, (size, size, *batch))
    probabilities = answer.mode_probabilities
    if probabilities is not None:
        size = len(np.atleast_1d(probabilities))
        probabilities = array_of("array of mode probabilities", probabilities, (size, *batch))
        there = np.isfinite(mean[0])
        total = np.where(there, probabilities.sum(axis=0), 1.0)
        if np.any(there & (probabilities < 0.0)) or not np.all(np.abs(total - 1.0) < PROBABILITY_ROUNDING):
            raise TrackerFault("the mode probabilities are not numbers from 0 to 1 whose sum is 1")
    repaired = answer.repaired
    if repaired is not None and np.shape(repaired) != batch:
        raise TrackerFault(f"repaired has the shape {np.shape(repaired)}, where {batch} is needed")
    # The whitened innovation is left out: it is computed here, rather than believed.
    return Estimate(
        mean,
        covariance,
        answer.state,
        answer.state_covariance,
        innovation,
        innovation_covariance,
        None,
        repaired,
        probabilities,
    )


def array_of(what: str, value: Any, shape: tuple[int, ...]) -> Array:
    try:
        if np.iscomplexobj(value):
            raise TypeError
        array = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        raise TrackerFault(f"the {what} is not an array of numbers: {described(value)}") from None
    if array.shape != shape:
        raise TrackerFault(f"the {what} has the shape {array.shape}, where {shape} is needed")
    return array


def described(value: Any) -> str:
    text = " ".join(repr(value).split())
    return f"{type(value).__name__} {text if len(text) <= 60 else text[:57] + '...'}"
