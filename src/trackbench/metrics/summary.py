"""The sums of a tracker's scores as metrics: value, unit, interval, verdict."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from trackbench.metrics.consistency import mean_bounds, verdict, whiteness_verdict
from trackbench.metrics.intervals import Interval, ratio, root, scaled
from trackbench.metrics.scores import ERROR_FIELDS, NIS_RUN_FIELDS, NIS_STEP_FIELDS, NisScores, Scores
from trackbench.types import Array

ERROR = {name: row for row, name in enumerate(ERROR_FIELDS)}
NIS_STEP = {name: row for row, name in enumerate(NIS_STEP_FIELDS)}
NIS_RUN = {name: row for row, name in enumerate(NIS_RUN_FIELDS)}

#: The errors that are compared between trackers: rows whose sums of squares they are the root mean of, and the unit.
ROOT_MEAN_SQUARES: dict[str, tuple[tuple[str, ...], str, str]] = {
    "position_rmse": (("px", "py"), "count", "m"),
    "velocity_rmse": (("vx", "vy"), "count", "m/s"),
    "course_rmse": (("course",), "course_count", "deg"),
    "rmse.px": (("px",), "count", "m"),
    "rmse.py": (("py",), "count", "m"),
    "rmse.vx": (("vx",), "count", "m/s"),
    "rmse.vy": (("vy",), "count", "m/s"),
}

Json = dict[str, Any]


@dataclass(frozen=True)
class Bound:
    """Root mean square of the Cramer-Rao bound over the scored instants and objects; NaN where there is none."""

    position: float
    """m"""
    velocity: float
    """m/s"""


def rms_bound(variances: Array, weight: Array) -> Bound:
    """The bound of the RMSE, from variances ``(instants, objects, 4)`` and the number of estimates at each."""
    use = (weight > 0) & np.isfinite(variances).all(axis=2)
    if not use.any():
        return Bound(float("nan"), float("nan"))
    mean = (variances[use] * weight[use][:, None]).sum(axis=0) / weight[use].sum()
    return Bound(float(np.sqrt(mean[:2].sum())), float(np.sqrt(mean[2:].sum())))


def error_intervals(scores: Scores) -> dict[str, Interval]:
    """Each root mean square error with its interval; those that no estimate bears on are left out."""
    found = {}
    for name, (rows, count_row, unit) in ROOT_MEAN_SQUARES.items():
        count = scores.per_run[ERROR[count_row]]
        if count.sum() == 0:
            continue
        total = sum(scores.per_run[ERROR[row]] for row in rows)
        interval = root(ratio(np.asarray(total), count))
        found[name] = scaled(interval, math.degrees(1.0)) if unit == "deg" else interval
    return found


def metrics(scores: Scores, bound: Bound, runs: int) -> Json:
    """The ``metrics`` of one tracker, as they go into the result."""
    errors = error_intervals(scores)
    named = {name: _error(errors, name) for name in ROOT_MEAN_SQUARES}
    return {
        "position_rmse": named["position_rmse"],
        "velocity_rmse": named["velocity_rmse"],
        "course_rmse": named["course_rmse"],
        "rmse": {axis: named[f"rmse.{axis}"] for axis in ("px", "py", "vx", "vy")},
        "nees": _nees(scores, runs),
        "nis": {name: _nis(nis, runs) for name, nis in scores.nis.items()},
        "whiteness": {name: _whiteness(nis) for name, nis in scores.nis.items()},
        "position_bound": value(bound.position, "m", "no measurement bears on it"),
        "velocity_bound": value(bound.velocity, "m/s", "no measurement bears on it"),
        "position_efficiency": _efficiency(errors.get("position_rmse"), bound.position),
        "velocity_efficiency": _efficiency(errors.get("velocity_rmse"), bound.velocity),
        "coverage": value(_share(scores.per_run[0].sum(), scores.present.sum()), "1", "no object was ever seen"),
        "step_time": value(_share(scores.seconds * 1e6, scores.steps), "us", "no step was taken"),
    }


def no_metrics(reason: str) -> Json:
    """The ``metrics`` of a tracker that has no scores."""

    def nothing(unit: str) -> Json:
        return {"value": None, "unit": unit, "reason": reason}

    units = {name: unit for name, (_, _, unit) in ROOT_MEAN_SQUARES.items()}
    return {
        **{name: nothing(unit) for name, unit in units.items() if "." not in name},
        "rmse": {name.removeprefix("rmse."): nothing(unit) for name, unit in units.items() if "." in name},
        "nees": {"mean": None, "dof": 4, "unit": "1", "reason": reason},
        "nis": {},
        "whiteness": {},
        "position_bound": nothing("m"),
        "velocity_bound": nothing("m/s"),
        "position_efficiency": nothing("1"),
        "velocity_efficiency": nothing("1"),
        "coverage": nothing("1"),
        "step_time": nothing("us"),
    }


def health(scores: Scores) -> Json:
    """The ``health`` of one tracker, as it goes into the result."""
    return {
        "diverged_runs": int(scores.diverged.sum()),
        "repaired_covariances": int(scores.repaired.sum()),
        "repaired_runs": int((scores.repaired > 0).sum()),
        "non_finite_estimates": 0,
    }


def value(number: float, unit: str, reason: str) -> Json:
    """A metric without an interval; null with the reason where it is not a number."""
    if not np.isfinite(number):
        return {"value": None, "unit": unit, "reason": reason}
    return {"value": float(number), "unit": unit}


def with_interval(interval: Interval, unit: str) -> Json:
    """A metric with its interval; null with the reason where one run gives none."""
    if interval.ci95 is None:
        return {"value": interval.value, "unit": unit, "ci95": None, "reason": "one run gives no interval"}
    return {"value": interval.value, "unit": unit, "ci95": list(interval.ci95)}


def _error(errors: dict[str, Interval], name: str) -> Json:
    unit = ROOT_MEAN_SQUARES[name][2]
    if name not in errors:
        what = "an object that moves" if name == "course_rmse" else "any object"
        return {"value": None, "unit": unit, "reason": f"there is no estimate of {what} to score"}
    return with_interval(errors[name], unit)


def _efficiency(error: Interval | None, bound: float) -> Json:
    if error is None or not bound > 0:
        return {"value": None, "unit": "1", "reason": "there is no bound to compare with"}
    return with_interval(scaled(error, 1.0 / bound), "1")


def _nees(scores: Scores, runs: int) -> Json:
    count, total = scores.per_run[ERROR["count"]], scores.per_run[ERROR["nees"]]
    if count.sum() == 0:
        return {"mean": None, "dof": 4, "unit": "1", "reason": "no estimate was scored"}
    inside = _inside(scores.per_step[ERROR["count"]], scores.per_step[ERROR["nees"]], 4)
    return _chi_square(ratio(total, count), 4, runs, inside)


def _nis(nis: NisScores, runs: int) -> Json | None:
    count, total = nis.per_run[NIS_RUN["count"]], nis.per_run[NIS_RUN["nis"]]
    if count.sum() == 0:
        return {"mean": None, "unit": "1", "reason": "the tracker gives no innovation of this sensor"}
    inside = _inside(nis.per_step[NIS_STEP["count"]], nis.per_step[NIS_STEP["nis"]], nis.dof)
    share = float(nis.per_run[NIS_RUN["inside"]].sum() / count.sum())
    return {**_chi_square(ratio(total, count), nis.dof, runs, inside), "inside95": share}


def _chi_square(mean: Interval, dof: int, runs: int, steps_inside: float) -> Json:
    low, high = (float(bound) for bound in mean_bounds(dof, runs))
    return {
        "mean": mean.value,
        "dof": dof,
        "unit": "1",
        "bounds95": [low, high],
        "ci95": None if mean.ci95 is None else list(mean.ci95),
        "steps_inside_bounds": steps_inside,
        "verdict": verdict(mean.ci95, dof),
    }


def _whiteness(nis: NisScores) -> Json:
    """Lag-one autocorrelation of whitened innovations (Bar-Shalom, Li and Kirubarajan 2001, section 5.4.2)."""
    product, square = nis.per_run[NIS_RUN["product"]], nis.per_run[NIS_RUN["square"]]
    pairs = nis.per_run[NIS_RUN["pairs"]].sum()
    if pairs == 0:
        return {"value": None, "unit": "1", "reason": "there are no two innovations in a row"}
    if square.sum() == 0:
        return {"value": None, "unit": "1", "reason": "every innovation is zero"}
    correlation = ratio(product, square)
    bound = float(1.96 / np.sqrt(pairs * nis.dof))
    return {
        **with_interval(correlation, "1"),
        "bounds95": [-bound, bound],
        "verdict": whiteness_verdict(correlation.ci95),
    }


def _inside(count: Array, total: Array, dof: int) -> float:
    """Share of the steps at which the mean over runs and objects is within its own bounds."""
    some = count > 0
    low, high = mean_bounds(dof, count[some])
    mean = total[some] / count[some]
    return float(((mean >= low) & (mean <= high)).mean())


def _share(part: float, whole: float) -> float:
    return float(part / whole) if whole > 0 else float("nan")
