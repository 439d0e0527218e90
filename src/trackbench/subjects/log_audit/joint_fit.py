"""All errors of time, mounting and bias of a sensor in one robust fit, and which of them a log can show."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from trackbench.base.types import Array, Mask
from trackbench.base.units import wrap_angle
from trackbench.metrics.blocks import BlockInterval, Blocks, blocks_of
from trackbench.subjects.log_audit.sensor_log import BODY_POINT, SensorLog
from trackbench.truth.recorded.robust import residual_scale

#: Rows with a residual beyond this many standard deviations are outliers and not used.
OUTLIER = 4.0
#: An error of which the others leave less than this share of the information cannot be told from them.
LEAST_INFORMATION = 0.01
#: Time offsets that are tried before the fit, s.
OFFSETS = np.linspace(-2.0, 2.0, 101)
#: Rows that they are tried on.
TRIED = 2000
#: A time offset is started from if it makes the spread of the residuals smaller by this share.
WORTH = 0.1
STEPS = 15
#: Another point of the body is estimated with the other errors, whose intervals it makes wider, if it differs from zero
#: with this probability.
SURE = 0.999
FEWEST_ROWS = 20


@dataclass(frozen=True)
class ErrorEstimate:
    """An error of a sensor."""

    name: str
    unit: str
    interval: BlockInterval
    effect: float
    """RMS of what it does to a measurement, in standard deviations of its noise."""
    rivals: dict[str, float] = field(default_factory=dict)
    """Errors that explain this log as well in its place, with the value that each would have."""


@dataclass(frozen=True)
class JointFit:
    """What the fit found."""

    estimates: dict[str, ErrorEstimate]
    unidentified: dict[str, tuple[str, ...]]
    """Errors that this log does not show, with those that they cannot be told from (none: without any effect)."""
    residual: Array
    """``(m, rows)`` what remains."""
    reference: Array
    """``(m, rows)`` variance of the residual that the noise of the reference makes."""
    scale: Array
    """``(m, rows)`` standard deviation of the residual."""
    derivatives: Array
    """``(p, m, rows)`` of the estimates, in their order."""
    inlier: Mask
    """``(rows,)``."""
    outlier: Mask
    """``(rows,)``; rows at the edge of the truth's time are neither."""
    blocks: Blocks
    """Of the inliers."""

    @property
    def errors(self) -> dict[str, float]:
        """The estimates by name."""
        return {name: estimate.interval.value for name, estimate in self.estimates.items()}


def joint_fit(log: SensorLog) -> JointFit:
    """Estimate the errors of a sensor together.

    The residual is linearised in the errors around the best ones so far and solved by least squares, weighted by the
    noise that is estimated with them, without outliers, until nothing changes (Gauss-Newton). Of errors that the log
    cannot tell apart, one is estimated as if the others were zero, and named with them. The measured point of a body is
    taken as that of the truth unless the log shows another.

    The estimates are those at which derivatives and residuals are orthogonal, not those with the least squares: between
    two rows of the reference its noise is smaller, so the least squares lie there whatever the clock. The derivatives
    have other noise than the residuals (instrumental variables; Fuller 1987, "Measurement Error Models").
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
    errors = {name: start.get(name, 0.0) for name in names}
    for round_number in range(2):
        errors = converged(log, names, errors)
        identifiable = _identifiable(log, errors, with_body_point)
        if round_number or identifiable[0] == names:
            break
        names, unidentified = identifiable
        errors = {name: errors.get(name, 0.0) for name in names}
    return _finished(log, names, errors, unidentified)


def _best_offset(log: SensorLog) -> float:
    """The time offset from which the fit starts: zero unless another makes the residuals clearly smaller, s."""
    rows = log.rows(np.unique(np.linspace(0, len(log.log.time) - 1, TRIED).astype(np.intp)))
    longest = 0.2 * float(log.log.time[-1] - log.log.time[0])
    offsets = OFFSETS[np.abs(OFFSETS) <= longest]

    def spread(offset: float) -> float:
        residual = rows.residual({"time_offset": offset})
        finite = np.isfinite(residual).all(axis=0)
        if finite.mean() < 0.5:
            return np.inf
        kept = residual[:, finite]
        away = np.median(np.abs(kept - np.median(kept, axis=1, keepdims=True)), axis=1)
        return float(np.log(np.maximum(away, 1e-12)).sum())

    spreads = [spread(offset) for offset in offsets.tolist()]
    best = int(np.argmin(spreads)) if spreads else 0
    return float(offsets[best]) if spreads and spreads[best] < spread(0.0) - WORTH else 0.0


def _identifiable(
    log: SensorLog, errors: Mapping[str, float], with_body_point: bool
) -> tuple[list[str], dict[str, tuple[str, ...]]]:
    """Return the errors that can be estimated together, and those that cannot, with what hides them."""
    every = list(log.errors)
    residual = log.residual(errors)
    columns = log.derivatives(errors, every) / residual_scale(residual, log.reference_variance(errors))
    finite = np.isfinite(columns).all(axis=(0, 1)) & np.isfinite(residual).all(axis=0)
    flat = columns[:, :, finite].reshape(len(every), -1)
    size = np.sqrt((flat**2).sum(axis=1))
    unit = flat / np.where(size > 0, size, 1.0)[:, None]
    alike = unit @ unit.T
    # A bias before the place of the mount, which is measured with a tape.
    biases = [name for name in every if name.startswith("bias_")]
    order = ["time_offset", "mount_yaw", *biases, "mount_x", "mount_y", BODY_POINT]
    kept: list[int] = []
    hidden: dict[str, tuple[str, ...]] = {}
    for i in map(every.index, order):
        if size[i] < 1e-9 * np.sqrt(max(finite.sum(), 1)):
            hidden[every[i]] = ()
            continue
        share, left = explained_share(alike, i, kept)
        if every[i] == BODY_POINT and left >= LEAST_INFORMATION and not with_body_point:
            continue
        if left < LEAST_INFORMATION:
            strong = np.abs(share) > 0.2 * np.abs(share).max()
            hidden[every[i]] = tuple(every[j] for j, by in zip(kept, strong, strict=True) if by)
        else:
            kept.append(i)
    return [every[i] for i in kept], hidden


def explained_share(alike: Array, error: int, others: list[int]) -> tuple[Array, float]:
    """Return how the derivatives of some errors add up to those of another, and the share of its information left.

    Args:
        alike: cosines of the angles between the derivatives of all errors.
        error: number of the error.
        others: numbers of the others.
    """
    if not others:
        return np.empty(0), 1.0
    share = np.linalg.lstsq(alike[np.ix_(others, others)], alike[others, error], rcond=None)[0]
    return np.asarray(share, dtype=float), 1.0 - float(alike[others, error] @ share)


def converged(log: SensorLog, names: list[str], start: Mapping[str, float]) -> dict[str, float]:
    """The best values of some of the errors, were all others zero."""
    errors = dict(start)
    for _ in range(STEPS):
        derivatives, residual, _, scale, inlier = _linearised(log, names, errors)
        columns = (derivatives / scale)[:, :, inlier].reshape(len(names), -1)
        step = np.linalg.lstsq(columns.T, (residual / scale)[:, inlier].reshape(-1), rcond=None)[0]
        if "time_offset" in names:
            # Further than this the truth is no straight line.
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
    """Derivatives ``(p, m, rows)``, residuals, their variance from the reference, their standard deviation (each
    ``(m, rows)``), and which rows are known and no outliers.
    """
    residual, reference = log.residual(errors), log.reference_variance(errors)
    derivatives = log.derivatives(errors, names) if names else np.zeros((0, *residual.shape))
    scale = residual_scale(residual, reference)
    finite = np.isfinite(residual + scale).all(axis=0) & np.isfinite(derivatives).all(axis=(0, 1))
    away = np.abs(residual - np.nanmedian(residual, axis=1, keepdims=True))
    inlier = finite & np.where(finite, away <= OUTLIER * scale, False).all(axis=0)
    return derivatives, residual, reference, scale, np.asarray(inlier)


def _finished(
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
    """Return what least squares make of ``columns`` ``(p, m, rows)`` for ``target`` ``(m, rows)``, with intervals."""
    size = len(columns)
    squares = np.einsum("pmr,qmr->pqr", columns, columns).reshape(size * size, -1)
    products = np.einsum("pmr,mr->pr", columns, target)

    def solved(sums: Array) -> Array:
        matrix = np.moveaxis(sums[: size * size].reshape(size, size, -1), -1, 0)
        right = np.moveaxis(sums[size * size :].reshape(size, -1), -1, 0)
        # Blocks that were drawn may not determine every error: the least of the solutions.
        solution = np.asarray((np.linalg.pinv(matrix, hermitian=True) @ right[:, :, None])[:, :, 0].T)
        return solution[:, 0] if sums.ndim == 1 else solution

    return blocks.intervals(np.concatenate([squares, products]), solved)
