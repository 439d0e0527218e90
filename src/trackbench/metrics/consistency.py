"""Whether a covariance can be believed: chi-square statistics, their bounds and verdicts."""

from __future__ import annotations

from functools import cache

import numpy as np

from trackbench import linalg
from trackbench.types import Array, Estimate, Mask

#: How far the mean of a NEES or NIS may be from its degrees of freedom without consequence, as a share of them. A
#: covariance that is 10 % too large or too small is one whose standard deviations are 5 % off.
TOLERANCE = 0.1
#: How far an autocorrelation may be from zero. Predicting each innovation from the one before then saves 0.05^2, a
#: quarter of a percent, of its variance.
WHITENESS_TOLERANCE = 0.05


def normalised_square(error: Array, covariance: Array) -> tuple[Array, Array, Mask]:
    """``e^T P^-1 e``, the whitened error ``L^-1 e``, and where the covariance is positive definite.

    With the estimation error this is the NEES, with the innovation the NIS (Bar-Shalom, Li and Kirubarajan 2001,
    section 5.4.2).

    Args:
        error: ``(n, ...)``.
        covariance: ``(n, n, ...)``.
    """
    factor = linalg.cholesky(covariance)
    whitened = factor.whiten(error)
    return np.einsum("i...,i...->...", whitened, whitened), whitened, factor.positive


def whitened_innovation(estimate: Estimate, members: slice = slice(None)) -> Array | None:
    """``(m, batch)`` innovation in units of its own standard deviations: what the tracker gives, or else computed.

    None where the tracker gives no innovation; NaN where its covariance is not positive definite.
    """
    if estimate.whitened_innovation is not None:
        return estimate.whitened_innovation[:, members]
    if estimate.innovation is None or estimate.innovation_covariance is None:
        return None
    _, white, positive = normalised_square(
        estimate.innovation[:, members], estimate.innovation_covariance[:, :, members]
    )
    return np.where(positive, white, np.nan)


def mean_bounds(dof: int, count: Array | float) -> tuple[Array, Array]:
    """Two-sided 95 % bounds of the mean of ``count`` independent chi-square variables of ``dof`` degrees of freedom."""
    from scipy import stats

    n = np.maximum(np.asarray(count, dtype=float), 1.0)
    low, high = (stats.chi2.ppf(q, n * dof) / n for q in (0.025, 0.975))
    return low, high


@cache
def point95(dof: int) -> float:
    """The 95 % point of chi-square."""
    from scipy import stats

    return float(stats.chi2.ppf(0.95, dof))


def verdict(ci95: tuple[float, float] | None, dof: int) -> str:
    """What the interval of a mean NEES or NIS says of the covariance; ``TOLERANCE`` is what does not matter.

    ``consistent``: shown to be within the tolerance. ``optimistic``: shown to be above ``dof``, errors are larger than
    stated, and not shown to be within the tolerance. ``pessimistic``: the same below. ``undecided``: none of these is
    shown. So a lack of runs never looks like consistency, and a difference without consequence is not held against a
    tracker because there were many: the logic of an equivalence test (Schuirmann 1987, "A comparison of the two
    one-sided tests procedure and the power approach").

    Args:
        ci95: None with a single run.
        dof: what the mean of a consistent tracker is.
    """
    names = {None: "undecided", 0: "consistent", 1: "optimistic", -1: "pessimistic"}
    return names[_shown(ci95, dof, TOLERANCE * dof)]


def whiteness_verdict(ci95: tuple[float, float] | None) -> str:
    """What the interval of an autocorrelation says: ``white``, ``coloured`` or ``undecided``, as in ``verdict``."""
    return {None: "undecided", 0: "white"}.get(_shown(ci95, 0.0, WHITENESS_TOLERANCE), "coloured")


def _shown(ci95: tuple[float, float] | None, expected: float, tolerance: float) -> int | None:
    """0 where the value is as expected, 1 and -1 where it is above and below, None where none of these is shown."""
    if ci95 is None:
        return None
    low, high = ci95
    if expected - tolerance <= low and high <= expected + tolerance:
        return 0
    return 1 if low > expected else -1 if high < expected else None
