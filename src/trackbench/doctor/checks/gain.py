"""What the tracker's gain says of the Jacobian and of the noise that it uses.

Of a Kalman filter ``P^-1 K`` is ``H^T R^-1``, and the information that a measurement adds, ``P^-1 - P_predicted^-1``,
is ``H^T R^-1 H`` (Bar-Shalom, Li and Kirubarajan 2001, section 5.2.3): together they give H and R away.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from trackbench import linalg
from trackbench.doctor.bench import Bench, Effect, Reply
from trackbench.doctor.findings import Check, Finding, Outcome
from trackbench.doctor.misreadings import DEGREE
from trackbench.models.sensors import SENSOR_MODELS
from trackbench.types import Array, Mask

#: Variance used over variance stated: a tuning within this is a matter of taste.
NOISE_BAND = 2.0
#: Share of a row of the Jacobian, in standard deviations, by which its direction may be off. Sigma points: 0.04.
DIRECTION = 0.08
#: The same of the size of a row. Sigma points: 1.25.
SIZE = 1.7
#: Second order of a measurement over the spread of the prediction, in sigma, above which gains say little of the
#: Jacobian.
CURVED = 0.3
#: Part of the change of the covariance that may lie outside what the gain can cause: 0.01 of sigma points, 0.08 and
#: more of fixed gains.
OUTSIDE = 0.05


class Row(NamedTuple):
    """What one answer says of each component of a measurement."""

    reply: Reply
    used: Mask
    noise: Array
    """``(m,)`` variance used over variance stated; NaN where the row points elsewhere."""
    direction: Array
    """``(m,)`` distance of the row from the right one, relative to its length."""
    size: Array
    """``(m,)`` length of the row along the right one, relative to it."""
    jacobian: Array
    """``(m, 4)`` as it seems to be used."""


def gain(bench: Bench) -> Outcome:
    """Work the Jacobian and the noise out of gains and covariances, and compare."""
    outcome = Outcome()
    for sensor, replies in bench.replies.items():
        name, question = f"gain.{sensor}", f"Do the gains for {sensor} fit its geometry and its stated noise?"
        straight = [reply for reply in replies if reply.curvature.max() < CURVED]
        rows = [row for reply in straight if (row := _row(reply)) is not None]
        if len(rows) < 3 or len(rows) < 0.5 * len(straight):
            why = (
                "its predictions are too uncertain"
                if len(straight) < 3
                else "it does not weigh measurements as a Kalman filter"
            )
            outcome.checks.append(Check(name, question, None, why))
            continue
        outcome.findings += _jacobian(sensor, rows)
        outcome.findings += _noise(sensor, rows)
        outcome.checks.append(Check(name, question, not outcome.findings, _result(rows)))
    return outcome


def _row(reply: Reply) -> Row | None:
    effect = reply.effect(reply.expected)
    if effect is None or effect.information is None or not effect.used.any() or not _is_kalman(effect):
        return None
    h, spread, sigma = reply.jacobian, reply.spread, reply.sigma
    scaled, seen = h * spread, effect.information.T * spread
    along, length = np.einsum("ij,ij->i", seen, scaled), np.einsum("ij,ij->i", scaled, scaled)
    noise = np.full(len(sigma), np.nan)
    direction, size = np.full(len(sigma), np.nan), np.full(len(sigma), np.nan)
    before = linalg.symmetrise(reply.predicted.covariance)
    if not np.linalg.eigvalsh(before)[0] > 0.0:
        return None
    added = np.linalg.inv(linalg.symmetrise(effect.answer.covariance)) - np.linalg.inv(before)
    jacobian = np.full_like(h, np.nan)
    used = effect.used
    jacobian[used] = np.linalg.pinv(effect.information[:, used], rcond=1e-9) @ added
    for i in np.flatnonzero(used):
        unit = seen[i] / np.linalg.norm(seen[i])
        direction[i] = np.linalg.norm(unit - scaled[i] / np.sqrt(length[i]))
        size[i] = float((jacobian[i] * spread) @ scaled[i] / length[i])
        if along[i] > 0.0:
            noise[i] = length[i] / along[i] / sigma[i] ** 2
    return Row(reply, used, noise, direction, size, jacobian)


def _is_kalman(effect: Effect) -> bool:
    """Whether the covariance changes only where the gain can reach: not so of fixed gains."""
    spread = effect.reply.spread
    change = (effect.reply.predicted.covariance - effect.answer.covariance) / np.outer(spread, spread)
    base = np.linalg.qr(effect.relative_gain[:, effect.used])[0]
    outside = change - base @ (base.T @ change)
    size = float(np.linalg.norm(change))
    return size > 1e-9 and float(np.linalg.norm(outside)) < OUTSIDE * size


def _jacobian(sensor: str, rows: Sequence[Row]) -> list[Finding]:
    model = SENSOR_MODELS[rows[0].reply.scan.kind]
    found = []
    for i, component in enumerate(model.components):
        of = [row for row in rows if row.used[i]]
        if len(of) < 3:
            continue
        direction = np.array([row.direction[i] for row in of])
        size = np.array([row.size[i] for row in of])
        # What sigma points add in second order weighs more where the variance is small, or the information is.
        noise = float(np.nanmedian([row.noise[i] for row in of]))
        keen = max(noise, 1.0 / noise) ** 0.5 if noise > 0.0 else 1.0
        turned = direction > DIRECTION * keen
        scaled = (size > SIZE * keen) | (size < 1 / (SIZE * keen))
        if np.mean(turned) < 0.12 and np.mean(scaled) < 0.4:
            continue
        worst = max(of, key=lambda row: _apart(row, i))
        gap = (worst.jacobian[i] - worst.reply.jacobian[i]) * worst.reply.spread
        j = int(np.argmax(np.abs(gap)))
        state = ("px", "py", "vx", "vy")[j]
        at = ", ".join(f"{value:.1f}" for value in worst.reply.predicted.mean)
        text = (
            f"d {component} / d {state} is {worst.jacobian[i, j]:.3g} in the gain, where "
            f"{worst.reply.jacobian[i, j]:.3g} is right (px, py, vx, vy = {at}); the row is off by "
            f"{np.median(direction):.0%} in direction and {np.median(size):.3g} in size at {len(of)} questions"
        )
        share = max(float(np.mean(turned)), float(np.mean(scaled)))
        found.append(
            Finding("jacobian_wrong", 0.8 + 0.15 * share, text, sensor=sensor, station=worst.reply.station.name)
        )
    return found[:1] if len(found) < 2 else [max(found, key=lambda finding: finding.confidence)]


def _apart(row: Row, i: int) -> float:
    gap = (row.jacobian[i] - row.reply.jacobian[i]) * row.reply.spread
    return float(np.max(np.abs(gap)) / np.linalg.norm(row.reply.jacobian[i] * row.reply.spread))


def _factors(rows: Sequence[Row]) -> Array:
    """``(m,)`` variance used over variance stated, NaN where nothing can be said."""
    noise = np.array([np.where(row.direction < 2 * DIRECTION, row.noise, np.nan) for row in rows])
    known = np.isfinite(noise).sum(axis=0) >= 3
    return np.array([np.nanmedian(noise[:, i]) if known[i] else np.nan for i in range(noise.shape[1])])


def _noise(sensor: str, rows: Sequence[Row]) -> list[Finding]:
    model = SENSOR_MODELS[rows[0].reply.scan.kind]
    factors = _factors(rows)
    found = []
    for i in model.angular:
        for words, factor in (("in degrees", DEGREE**2), ("turned into radians twice", DEGREE**-2)):
            others = np.delete(factors, i)
            alone = np.all((others < NOISE_BAND) & (others > 1 / NOISE_BAND) | ~np.isfinite(others))
            if alone and 0.7 < factors[i] / factor < 1.4:
                text = (
                    f"the variance of the {model.components[i]} that its gains imply is {factors[i]:.4g} times the "
                    f"stated one, which is (180/pi)^2 = {factor:.4g}: a standard deviation {words}"
                )
                return [Finding("degrees_for_radians", 0.95, text, sensor=sensor, factor=float(factors[i]))]
    for fault, off, words in (
        ("r_too_small", factors < 1 / NOISE_BAND, "smaller"),
        ("r_too_large", factors > NOISE_BAND, "larger"),
    ):
        if not off.any():
            continue
        factor = float(np.exp(np.mean(np.log(factors[off]))))
        parts = ", ".join(
            f"{model.components[i].replace('_', ' ')} {np.sqrt(factors[i]) * rows[0].reply.sigma[i]:.3g} for "
            f"{rows[0].reply.sigma[i]:.3g}"
            for i in np.flatnonzero(off)
        )
        text = (
            f"its gains imply a variance {max(factor, 1 / factor):.3g} times {words} than {sensor} states "
            f"(standard deviations: {parts})"
        )
        confidence = min(0.98, 0.6 + 0.2 * abs(np.log(factor)) / np.log(4))
        found.append(Finding(fault, confidence, text, sensor=sensor, factor=factor))
    return found


def _result(rows: Sequence[Row]) -> str:
    names = SENSOR_MODELS[rows[0].reply.scan.kind].components
    parts = [
        f"{name.replace('_', ' ')} {factor:.3g}"
        for name, factor in zip(names, _factors(rows), strict=True)
        if np.isfinite(factor)
    ]
    direction = np.nanmax([np.nanmax(row.direction[row.used]) for row in rows])
    return f"variance used over stated: {', '.join(parts) or 'n/a'}; rows of the Jacobian within {direction:.1%}"
