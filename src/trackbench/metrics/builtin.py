"""The built-in metrics: what each makes of the sums that they share."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from trackbench.metrics.breakdown import breakdown
from trackbench.metrics.consistency import mean_bounds
from trackbench.metrics.estimates import ESTIMATES
from trackbench.metrics.intervals import ONE_RUN, Interval, ratio, root, scaled
from trackbench.metrics.protocol import Accumulator, Field, Metric, Outcome
from trackbench.metrics.sums import ERROR, NIS_RUN, NIS_STEP, NisScores, Scores
from trackbench.metrics.verdicts import (
    CONSISTENCY,
    WHITENESS,
    WHITENESS_TOLERANCE,
    judged,
    together,
    verdict,
    whiteness_verdict,
)
from trackbench.results import MetricValue
from trackbench.types import Array


class BuiltInMetric(Metric):
    """A metric that is computed from the sums of all estimates and innovations."""

    compared: ClassVar[bool] = False

    @property
    def accumulator(self) -> Accumulator:
        return ESTIMATES


class RootMeanSquare(BuiltInMetric):
    """A root mean square error."""

    better = "smaller"
    compared = True
    rows: ClassVar[tuple[str, ...]]
    """Of the sums of squared errors."""
    count: ClassVar[str] = "count"
    """Row of the number of errors."""
    column: ClassVar[str]
    """Where the table of runs holds the error of each run."""

    def finish(self, sums: Scores) -> Outcome:
        count = sums.per_run[ERROR[self.count]]
        if count.sum() == 0:
            what = "an object that moves" if self.count == "course_count" else "any object"
            return self.no_value(f"there is no estimate of {what} to score")
        total = sum(sums.per_run[ERROR[row]] for row in self.rows)
        error = root(ratio(np.asarray(total), count))
        return scaled(error, math.degrees(1.0)) if self.unit == "deg" else error

    def of_runs(self, errors: Array, count: Array) -> Interval | None:
        """The error from that of each run ``(runs,)`` and its number of terms; None where there are none."""
        if count.sum() == 0:
            return None
        return root(ratio(np.where(count > 0, np.nan_to_num(errors) ** 2 * count, 0.0), count))


class PositionRmse(RootMeanSquare):
    name, unit, meaning = "position_rmse", "m", "root mean square error of the position"
    rows, column = ("px", "py"), "position_rmse_m"


class VelocityRmse(RootMeanSquare):
    name, unit, meaning = "velocity_rmse", "m/s", "root mean square error of the velocity"
    rows, column = ("vx", "vy"), "velocity_rmse_mps"


class CourseRmse(RootMeanSquare):
    name, unit, meaning = "course_rmse", "deg", "root mean square error of the course"
    rows, count, column = ("course",), "course_count", "course_rmse_deg"


class PxRmse(RootMeanSquare):
    name, unit, meaning = "rmse.px", "m", "root mean square error along x"
    rows, column = ("px",), "px_rmse_m"


class PyRmse(RootMeanSquare):
    name, unit, meaning = "rmse.py", "m", "root mean square error along y"
    rows, column = ("py",), "py_rmse_m"


class VxRmse(RootMeanSquare):
    name, unit, meaning = "rmse.vx", "m/s", "root mean square error of the velocity along x"
    rows, column = ("vx",), "vx_rmse_mps"


class VyRmse(RootMeanSquare):
    name, unit, meaning = "rmse.vy", "m/s", "root mean square error of the velocity along y"
    rows, column = ("vy",), "vy_rmse_mps"


class Nees(BuiltInMetric):
    name, unit, value_name = "nees", "1", "mean"
    meaning = "normalised estimation error squared, mean over runs; 4 when consistent"
    fields = (
        Field("steps_inside_bounds", "share of the steps at which its mean is inside the 95 % bounds"),
        Field("verdict", "whether the errors are as large as stated, under each condition", (*CONSISTENCY, "mixed")),
    )

    def finish(self, sums: Scores) -> Outcome:
        count, total = sums.per_run[ERROR["count"]], sums.per_run[ERROR["nees"]]
        if count.sum() == 0:
            return self.no_value("no estimate was scored")
        inside = _inside(sums.per_step[ERROR["count"]], sums.per_step[ERROR["nees"]], 4)
        found = _chi_square(ratio(total, count), 4, inside)
        conditions = judged(breakdown(sums.classes))
        word = together(found.verdict or "undecided", conditions)
        return found.model_copy(update={"verdict": word, "conditions": tuple(conditions)})

    def no_value(self, reason: str) -> MetricValue:
        return MetricValue(unit=self.unit, dof=4, reason=reason)


class Nis(BuiltInMetric):
    name, unit, value_name, per_sensor = "nis", "1", "mean", True
    meaning = "normalised innovation squared of one sensor, mean over runs"
    fields = (
        Field("inside95", "share of its innovations under the 95 % point"),
        Field("steps_inside_bounds", "share of the steps at which its mean is inside the bounds"),
        Field("verdict", "whether the innovations are as large as predicted", CONSISTENCY),
    )

    def finish(self, sums: Scores) -> Mapping[str, Outcome]:
        return {sensor: self._of(nis) for sensor, nis in sums.nis.items()}

    def _of(self, nis: NisScores) -> MetricValue:
        count, total = nis.per_run[NIS_RUN["count"]], nis.per_run[NIS_RUN["nis"]]
        if count.sum() == 0:
            return self.no_value("the tracker gives no innovation of this sensor")
        inside = _inside(nis.per_step[NIS_STEP["count"]], nis.per_step[NIS_STEP["nis"]], nis.dof)
        share = float(nis.per_run[NIS_RUN["inside"]].sum() / count.sum())
        found = _chi_square(ratio(total, count), nis.dof, inside)
        return found.model_copy(update={"inside95": share})


class Whiteness(BuiltInMetric):
    """Lag-one autocorrelation of whitened innovations (Bar-Shalom, Li and Kirubarajan 2001, section 5.4.2)."""

    name, unit, per_sensor = "whiteness", "1", True
    meaning = "correlation of successive normalised innovations of one sensor"
    fields = (Field("verdict", f"whether it is within {WHITENESS_TOLERANCE} of zero", WHITENESS),)

    def finish(self, sums: Scores) -> Mapping[str, Outcome]:
        return {sensor: self._of(nis) for sensor, nis in sums.nis.items()}

    def _of(self, nis: NisScores) -> MetricValue:
        product, square = nis.per_run[NIS_RUN["product"]], nis.per_run[NIS_RUN["square"]]
        pairs = nis.per_run[NIS_RUN["pairs"]].sum()
        if pairs == 0:
            return self.no_value("there are no two innovations in a row")
        if square.sum() == 0:
            return self.no_value("every innovation is zero")
        correlation = ratio(product, square)
        bound = float(1.96 / np.sqrt(pairs * nis.dof))
        return correlation.as_value(self.unit).model_copy(
            update={"bounds95": (-bound, bound), "verdict": whiteness_verdict(correlation.ci95)}
        )


class PositionBound(BuiltInMetric):
    name, unit, meaning = "position_bound", "m", "posterior Cramer-Rao bound of the position error"

    def finish(self, sums: Scores) -> Outcome:
        return _number(self, sums.bound.position, "no measurement bears on it")


class VelocityBound(BuiltInMetric):
    name, unit, meaning = "velocity_bound", "m/s", "posterior Cramer-Rao bound of the velocity error"

    def finish(self, sums: Scores) -> Outcome:
        return _number(self, sums.bound.velocity, "no measurement bears on it")


class PositionEfficiency(BuiltInMetric):
    name, unit, better = "position_efficiency", "1", "smaller"
    meaning = "position RMSE over its bound; 1 is the best possible"

    def finish(self, sums: Scores) -> Outcome:
        return _efficiency(self, PositionRmse().finish(sums), sums.bound.position)


class VelocityEfficiency(BuiltInMetric):
    name, unit, better = "velocity_efficiency", "1", "smaller"
    meaning = "velocity RMSE over its bound; 1 is the best possible"

    def finish(self, sums: Scores) -> Outcome:
        return _efficiency(self, VelocityRmse().finish(sums), sums.bound.velocity)


class Coverage(BuiltInMetric):
    name, unit, better = "coverage", "1", "larger"
    meaning = "share of the steps with a vehicle present at which there is an estimate"

    def finish(self, sums: Scores) -> Outcome:
        share = _share(sums.per_run[ERROR["count"]].sum(), sums.present.sum())
        return _number(self, share, "no object was ever seen")


class StepTime(BuiltInMetric):
    name, unit, better = "step_time", "us", "smaller"
    meaning = "time of one predict and update of one run"

    def finish(self, sums: Scores) -> Outcome:
        return _number(self, _share(sums.seconds * 1e6, sums.steps), "no step was taken")


BUILT_IN: tuple[Metric, ...] = (
    PositionRmse(),
    VelocityRmse(),
    CourseRmse(),
    PxRmse(),
    PyRmse(),
    VxRmse(),
    VyRmse(),
    Nees(),
    Nis(),
    Whiteness(),
    PositionBound(),
    VelocityBound(),
    PositionEfficiency(),
    VelocityEfficiency(),
    Coverage(),
    StepTime(),
)


def _number(metric: Metric, value: float, reason: str) -> Outcome:
    return float(value) if np.isfinite(value) else metric.no_value(reason)


def _efficiency(metric: Metric, error: Outcome, bound: float) -> Outcome:
    if not isinstance(error, Interval) or not bound > 0:
        return metric.no_value("there is no bound to compare with")
    return scaled(error, 1.0 / bound)


def _chi_square(mean: Interval, dof: int, steps_inside: float) -> MetricValue:
    return MetricValue(
        value=mean.value,
        unit="1",
        dof=dof,
        ci95=mean.ci95,
        reason=None if mean.ci95 else ONE_RUN,
        steps_inside_bounds=steps_inside,
        verdict=verdict(mean.ci95, dof),
    )


def _inside(count: Array, total: Array, dof: int) -> float:
    """Share of the steps at which the mean over runs and objects is within its own bounds."""
    some = count > 0
    low, high = mean_bounds(dof, count[some])
    mean = total[some] / count[some]
    return float(((mean >= low) & (mean <= high)).mean())


def _share(part: float, whole: float) -> float:
    return float(part / whole) if whole > 0 else math.nan
