"""The joint fit of a sensor's errors of time, mounting and bias, and which of them a log can show."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from trackbench.base.errors import InputError
from trackbench.base.types import Array, Mask
from trackbench.base.units import wrap_angle
from trackbench.metrics.blocks import BlockInterval, Blocks, blocks_of
from trackbench.subjects.log_audit.sensor_log import BODY_POINT, SensorLog
from trackbench.truth.recorded.robust import residual_scale

#: Residual beyond which a row is an outlier and is not used, in standard deviations.
OUTLIER = 4.0
#: Share of an error's information, left over by the other errors, below which it cannot be told from them.
LEAST_INFORMATION = 0.01
#: Time offsets among which the fit's start is chosen, s.
OFFSETS = np.linspace(-2.0, 2.0, 101)
#: Number of rows on which they are compared.
TRIED = 2000
#: Share by which a time offset must reduce the spread of the residuals to become the fit's start.
WORTH = 0.1
STEPS = 15
#: Probability with which another measured point of the body must differ from zero to be estimated with the other
#: errors, whose intervals it makes wider.
SURE = 0.999
FEWEST_ROWS = 20


@dataclass(frozen=True)
class ErrorEstimate:
    """Estimate of one systematic error of a sensor, such as a time offset or a bias."""

    name: str
    unit: str
    interval: BlockInterval
    effect: float
    """RMS change of a measurement by the error, in standard deviations of the measurement's noise."""
    rivals: dict[str, float] = field(default_factory=dict)
    """Other errors that would explain the log equally well in place of this error, each with its value."""


@dataclass(frozen=True)
class JointFit:
    """A sensor's time offset, mounting and biases, estimated together from one log."""

    estimates: dict[str, ErrorEstimate]
    unidentified: dict[str, tuple[str, ...]]
    """Errors that the log does not show, with the errors that hide them; empty for an error without any effect."""
    residual: Array
    """Measurement minus expected measurement at the estimates, ``(m, rows)``."""
    reference: Array
    """Variance of the residual due to noise of the reference, ``(m, rows)``."""
    scale: Array
    """Standard deviation of the residual, ``(m, rows)``."""
    derivatives: Array
    """Derivatives of the expected measurement by the estimated errors, ``(p, m, rows)``."""
    inlier: Mask
    """Whether the fit uses each row, ``(rows,)``."""
    outlier: Mask
    """Whether each row is an outlier, ``(rows,)``; False as well for rows at the edge of the truth's time."""
    blocks: Blocks
    """Division of the inliers into blocks, which the bootstrap resamples."""

    @property
    def errors(self) -> dict[str, float]:
        """Values of the estimated errors by name, SI units and rad."""
        return {name: estimate.interval.value for name, estimate in self.estimates.items()}


def joint_fit(log: SensorLog) -> JointFit:
    """Estimate the errors of a sensor together.

    The fit is Gauss-Newton: the residual is linearised around the latest errors and solved by least squares without
    outliers, weighted by the noise that is estimated as well. Among errors that the log cannot tell apart, one is
    estimated as if the others were zero. The measured point of a body is assumed to be the truth's unless the log
    shows another.

    The estimates make derivatives and residuals orthogonal; they do not minimise the squares. Interpolated between two
    rows, the reference has less noise, so that the smallest squares lie there whatever the clock. The derivatives have
    other noise than the residuals (instrumental variables; Fuller 1987, "Measurement Error Models").
    """
    start = {"time_offset": _best_offset(log)}
    fit = _fit_from(log, start, with_body_point=False)
    if BODY_POINT in fit.unidentified:
        return fit
    with_point = _fit_from(log, start, with_body_point=True)
    point = with_point.estimates.get(BODY_POINT)
    return with_point if point is not None and point.interval.excludes(0.0, SURE) else fit


def _fit_from(log: SensorLog, start: Mapping[str, float], *, with_body_point: bool) -> JointFit:
    names, unidentified = _identifiable(log, start, with_body_point)
    if not names:
        problem = "its measurements show none of its errors: is their time, and that of the truth, in the stated unit?"
        raise InputError(problem, key=f"sensors.{log.name}")
    errors = {name: start.get(name, 0.0) for name in names}
    for round_number in range(2):
        errors = solve_errors(log, names, errors)
        identifiable = _identifiable(log, errors, with_body_point)
        if round_number or identifiable[0] == names:
            break
        names, unidentified = identifiable
        errors = {name: errors.get(name, 0.0) for name in names}
    return _result_at(log, names, errors, unidentified)


def _best_offset(log: SensorLog) -> float:
    """Return the time offset from which the fit starts, s: zero unless another makes the residuals clearly smaller."""
    rows = log.rows(np.unique(np.linspace(0, len(log.log.time) - 1, TRIED).astype(np.intp)))
    longest = 0.2 * float(log.log.time[-1] - log.log.time[0])
    offsets = OFFSETS[np.abs(OFFSETS) <= longest]

    def spread(offset: float) -> float:
        residual = rows.residual({"time_offset": offset})
        finite = np.isfinite(residual).all(axis=0)
        if finite.mean() < 0.5:
            return np.inf
        values = residual[:, finite]
        away = np.median(np.abs(values - np.median(values, axis=1, keepdims=True)), axis=1)
        return float(np.log(np.maximum(away, 1e-12)).sum())

    spreads = [spread(offset) for offset in offsets.tolist()]
    best = int(np.argmin(spreads)) if spreads else 0
    return float(offsets[best]) if spreads and spreads[best] < spread(0.0) - WORTH else 0.0


def _identifiable(
    log: SensorLog, errors: Mapping[str, float], with_body_point: bool
) -> tuple[list[str], dict[str, tuple[str, ...]]]:
    """Return the errors that can be estimated together, and the other errors with the errors that hide them."""
    names = list(log.errors)
    residual = log.residual(errors)
    columns = log.derivatives(errors, names) / residual_scale(residual, log.reference_variance(errors))
    finite = np.isfinite(columns).all(axis=(0, 1)) & np.isfinite(residual).all(axis=0)
    flat = columns[:, :, finite].reshape(len(names), -1)
    size = np.sqrt((flat**2).sum(axis=1))
    unit = flat / np.where(size > 0, size, 1.0)[:, None]
    cosines = unit @ unit.T
    # A bias comes before the mount's position, which is known from a tape measure.
    biases = [name for name in names if name.startswith("bias_")]
    order = ["time_offset", "mount_yaw", *biases, "mount_x", "mount_y", BODY_POINT]
    chosen: list[int] = []
    hidden: dict[str, tuple[str, ...]] = {}
    for i in map(names.index, order):
        if size[i] < 1e-9 * np.sqrt(max(finite.sum(), 1)):
            hidden[names[i]] = ()
            continue
        share, remaining = explained_share(cosines, i, chosen)
        if names[i] == BODY_POINT and remaining >= LEAST_INFORMATION and not with_body_point:
            continue
        if remaining < LEAST_INFORMATION:
            strong = np.abs(share) > 0.2 * np.abs(share).max()
            hidden[names[i]] = tuple(names[j] for j, by in zip(chosen, strong, strict=True) if by)
        else:
            chosen.append(i)
    return [names[i] for i in chosen], hidden


def explained_share(cosines: Array, error: int, others: list[int]) -> tuple[Array, float]:
    """Return coefficients ``(others,)`` that express one error by others, and its share of information that is left.

    Args:
        cosines: cosines of the angles between the derivatives of all errors, ``(p, p)``.
        error: index of the error in ``cosines``.
        others: indices of the other errors in ``cosines``.
    """
    if not others:
        return np.empty(0), 1.0
    share = np.linalg.lstsq(cosines[np.ix_(others, others)], cosines[others, error], rcond=None)[0]
    return np.asarray(share, dtype=float), 1.0 - float(cosines[others, error] @ share)


def solve_errors(log: SensorLog, names: list[str], start: Mapping[str, float]) -> dict[str, float]:
    """Return the least-squares values of the errors ``names``, by name, with all other errors zero."""
    errors = dict(start)
    for _ in range(STEPS):
        derivatives, residual, _, scale, inlier = _linearised(log, names, errors)
        columns = (derivatives / scale)[:, :, inlier].reshape(len(names), -1)
        step = np.linalg.lstsq(columns.T, (residual / scale)[:, inlier].reshape(-1), rcond=None)[0]
        if "time_offset" in names:
            # The truth is no straight line over a longer time.
            step[names.index("time_offset")] = np.clip(step[names.index("time_offset")], -0.5, 0.5)
        errors = {name: errors[name] + float(change) for name, change in zip(names, step, strict=True)}
        if "mount_yaw" in errors:
            errors["mount_yaw"] = float(wrap_angle(np.array(errors["mount_yaw"])))
        if np.abs(columns.T @ step).max(initial=0.0) < 1e-4:
            break
    return errors


def _linearised(
    log: SensorLog, names: list[str], errors: Mapping[str, float]
) -> tuple[Array, Array, Array, Array, Mask]:
    """Return derivatives, residual, reference variance, scale and inliers, with the shapes of :class:`JointFit`."""
    residual, reference = log.residual(errors), log.reference_variance(errors)
    derivatives = log.derivatives(errors, names) if names else np.zeros((0, *residual.shape))
    scale = residual_scale(residual, reference)
    finite = np.isfinite(residual + scale).all(axis=0) & np.isfinite(derivatives).all(axis=(0, 1))
    away = np.abs(residual - np.nanmedian(residual, axis=1, keepdims=True))
    inlier = finite & np.where(finite, away <= OUTLIER * scale, False).all(axis=0)
    return derivatives, residual, reference, scale, np.asarray(inlier)


def _result_at(
    log: SensorLog,
    names: list[str],
    errors: Mapping[str, float],
    unidentified: dict[str, tuple[str, ...]],
) -> JointFit:
    derivatives, residual, reference, scale, inlier = _linearised(log, names, errors)
    columns, rest = (derivatives / scale)[:, :, inlier], (residual / scale)[:, inlier]
    blocks = blocks_of(log.log.time[inlier], log.log.object[inlier], rest)
    squares = np.einsum("pmr,pmr->p", columns, columns) / max(int(inlier.sum()), 1)
    estimates = {
        name: ErrorEstimate(
            name=name,
            unit=log.errors[name],
            interval=interval._replace(value=errors[name]),
            effect=float(abs(errors[name]) * np.sqrt(square)),
        )
        for name, interval, square in zip(names, block_intervals(columns, rest, blocks), squares, strict=True)
    }
    return JointFit(
        estimates,
        unidentified,
        residual,
        reference,
        scale,
        derivatives,
        inlier,
        ~inlier & np.isfinite(residual).all(axis=0) & np.isfinite(derivatives).all(axis=(0, 1)),
        blocks,
    )


def block_intervals(columns: Array, target: Array, blocks: Blocks) -> list[BlockInterval]:
    """Return intervals of the coefficients that fit ``columns`` ``(p, m, rows)`` to ``target`` ``(m, rows)``."""
    size = len(columns)
    squares = np.einsum("pmr,qmr->pqr", columns, columns).reshape(size * size, -1)
    products = np.einsum("pmr,mr->pr", columns, target)

    def solve(sums: Array) -> Array:
        matrix = np.moveaxis(sums[: size * size].reshape(size, size, -1), -1, 0)
        right = np.moveaxis(sums[size * size :].reshape(size, -1), -1, 0)
        # A draw of blocks may not determine every error; the pseudo-inverse then gives the smallest solution.
        solution = np.asarray((np.linalg.pinv(matrix, hermitian=True) @ right[:, :, None])[:, :, 0].T)
        return solution[:, 0] if sums.ndim == 1 else solution

    return blocks.intervals(np.concatenate([squares, products]), solve)
