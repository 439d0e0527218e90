"""Built-in metrics of estimates (RMSE, NEES, NIS, whiteness, coverage), computed from sums that they share."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from trackbench.base.types import Array
from trackbench.metrics.breakdown import breakdown
from trackbench.metrics.consistency import mean_bounds
from trackbench.metrics.estimates import ESTIMATES
from trackbench.metrics.intervals import Interval, ratio, root
from trackbench.metrics.protocol import Accumulator, Field, Metric, Outcome
from trackbench.metrics.sums import ERROR, NIS, BlockScores, NisScores
from trackbench.metrics.verdicts import (
    CONSISTENCY,
    LEAST_COVERAGE,
    TRUST,
    WHITENESS,
    WHITENESS_TOLERANCE,
    condition_verdicts,
    doubtless_verdict,
    heavy_beside,
    judged_parts,
    mean_verdict,
    overall_verdict,
    whiteness_verdict,
)
from trackbench.results import MetricValue


class EstimateMetric(Metric):
    """Metric computed by ``finish`` from ``BlockScores``, the sums over all estimates and innovations."""

    compared: ClassVar[bool] = False
    shared: ClassVar[Accumulator | None] = ESTIMATES


class RootMeanSquare(EstimateMetric):
    """Root mean square error: ``sqrt(sum(e^2) / count)`` over the scored estimates of all objects and runs."""

    better = "smaller"
    compared = True
    rows: ClassVar[tuple[str, ...]]
    """Names of the squared errors that are added, such as ``px`` and ``py``."""
    column: ClassVar[str]
    """Column of the table of runs that holds the error of each run."""

    @property
    def columns(self) -> tuple[str, ...]:
        return self.column, "count"

    def finish(self, sums: BlockScores) -> Outcome:
        count = sums.per_part[ERROR["count"]]
        if count.sum() == 0:
            return self.no_value("there is no estimate of any object to score")
        total = sum(sums.per_part[ERROR[row]] for row in self.rows)
        return root(ratio(np.asarray(total), count, scenes=sums.scenes))

    def without_charged(self, sums: BlockScores) -> tuple[float, float] | None:
        total, charged = (
            sum(float(part[ERROR[row]].sum()) for row in self.rows) for part in (sums.per_part, sums.charged)
        )
        count = sums.charged[ERROR["count"]]
        given = float((sums.per_part[ERROR["count"]] - count).sum())
        if not count.any() or not given or not total:
            return None
        return charged / total, math.sqrt(max(total - charged, 0.0) / given)

    def of_runs(self, *columns: Array) -> Interval | None:
        errors, count = columns
        if count.sum() == 0:
            return None
        return root(ratio(np.where(count > 0, np.nan_to_num(errors) ** 2 * count, 0.0), count))


class PositionRmse(RootMeanSquare):
    name, unit = "position_rmse", "m"
    meaning = "root mean square error of the position, of estimates or matched tracks"
    rows, column, ranks = ("px", "py"), "position_rmse_m", True


class VelocityRmse(RootMeanSquare):
    name, unit = "velocity_rmse", "m/s"
    meaning = "root mean square error of the velocity, of estimates or matched tracks"
    rows, column = ("vx", "vy"), "velocity_rmse_mps"


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


class Nees(EstimateMetric):
    name, unit, value_name = "nees", "1", "mean"
    meaning = "mean normalised estimation error squared of estimates or matched tracks; 4 when consistent"
    fields = (
        Field("steps_inside_bounds", "share of the steps at which the mean NEES is inside its 95 % bounds"),
        Field(
            "verdict",
            "whether the errors are as large as stated; mixed: larger or smaller, depending on the condition; "
            "heavy-tailed: too many are large",
            TRUST,
        ),
    )

    @property
    def columns(self) -> tuple[str, ...]:
        return "nees_mean", "given"

    def of_runs(self, *columns: Array) -> Interval | None:
        mean, count = columns
        return ratio(np.nan_to_num(mean) * count, count, at_least=0.0) if count.sum() > 0 else None

    def finish(self, sums: BlockScores) -> Outcome:
        count, total = sums.per_part[ERROR["given"]], sums.per_part[ERROR["nees"]]
        if count.sum() == 0:
            return self.no_value("no estimate was scored")
        per_step = sums.per_step
        inside = _inside(per_step[ERROR["given"]], per_step[ERROR["nees"]], 4)
        value = _chi_square(total, count, 4, inside, sums.scenes, len(sums.due))
        scores = breakdown(sums)
        conditions, parts = condition_verdicts(scores), judged_parts(scores[""])
        whole = value.verdict if sums.coverage >= LEAST_COVERAGE else "undecided"
        if whole is None or (whole == "consistent" and not parts):
            # Too few estimates to judge the tails.
            whole = "undecided"
        assert value.value is not None
        word = overall_verdict(value.value, whole, conditions, parts)
        also = heavy_beside(word, value.value, conditions, parts)
        judgement = {"verdict": word, "also": also, "conditions": tuple(conditions), "parts": tuple(parts)}
        return value.model_copy(update=judgement)

    def no_value(self, reason: str) -> MetricValue:
        return MetricValue(unit=self.unit, dof=4, reason=reason)


class Nis(EstimateMetric):
    name, unit, value_name, per_sensor = "nis", "1", "mean", True
    meaning = "normalised innovation squared of one sensor, mean over runs"
    fields = (
        Field("coverage", "share of the measurements of a known object that have an innovation"),
        Field("inside95", "share of the innovations below the 95 % point of chi-square"),
        Field("steps_inside_bounds", "share of the steps at which the mean NIS is inside its 95 % bounds"),
        Field("verdict", "whether the innovations are as large as predicted", CONSISTENCY),
    )

    def finish(self, sums: BlockScores) -> Mapping[str, Outcome]:
        runs = len(sums.due)
        return {sensor: self._of(nis, sums.scenes, runs) for sensor, nis in sums.nis.items()}

    def _of(self, nis: NisScores, scenes: bool, runs: int) -> MetricValue:
        count, total = nis.per_part[NIS["count"]], nis.per_part[NIS["nis"]]
        if count.sum() == 0:
            return self.no_value("the tracker gives no innovation of this sensor")
        inside = _inside(nis.per_step[NIS["count"]], nis.per_step[NIS["nis"]], nis.dof)
        share = float(nis.per_part[NIS["inside"]].sum() / count.sum())
        value = _chi_square(total, count, nis.dof, inside, scenes, runs)
        expected = count.sum() + nis.per_part[NIS["missing"]].sum()
        coverage = float(count.sum() / expected)
        # The innovations that are missing may be the large ones.
        word = value.verdict if coverage >= LEAST_COVERAGE else "undecided"
        return value.model_copy(update={"inside95": share, "coverage": coverage, "verdict": word})


class Whiteness(EstimateMetric):
    """Lag-one autocorrelation of whitened innovations (Bar-Shalom, Li and Kirubarajan 2001, section 5.4.2)."""

    name, unit, per_sensor = "whiteness", "1", True
    meaning = "correlation of successive normalised innovations of one sensor"
    fields = (Field("verdict", f"whether the correlation is within {WHITENESS_TOLERANCE} of zero", WHITENESS),)

    def finish(self, sums: BlockScores) -> Mapping[str, Outcome]:
        return {sensor: self._of(nis, sums.scenes) for sensor, nis in sums.nis.items()}

    def _of(self, nis: NisScores, scenes: bool) -> MetricValue:
        product, square = nis.per_part[NIS["product"]], nis.per_part[NIS["square"]]
        if nis.per_part[NIS["pairs"]].sum() == 0:
            return self.no_value("there are no two innovations in a row")
        if square.sum() == 0:
            return self.no_value("every innovation is zero")
        correlation = ratio(product, square, scenes=scenes)
        verdict = whiteness_verdict(correlation.ci95)
        return correlation.as_value(self.unit).model_copy(update={"verdict": verdict})


class OverReference(EstimateMetric):
    """Ratio of an RMSE to the error of the Cramér-Rao reference, both over the same estimates."""

    unit, better = "1", "smaller"
    rows: ClassVar[tuple[str, ...]]
    row: ClassVar[str]
    column: ClassVar[str]
    """Column of the table of runs that holds the error of each run."""
    over: ClassVar[str]
    """Column of the table of runs that holds the reference error of each run."""

    @property
    def columns(self) -> tuple[str, ...]:
        return self.column, "count", self.over

    def of_runs(self, *columns: Array) -> Interval | None:
        errors, count, reference = columns
        squares, over = (np.nan_to_num(each) ** 2 * count for each in (errors, reference))
        return root(ratio(squares, over)) if over.sum() > 0 else None

    def finish(self, sums: BlockScores) -> Outcome:
        reference = sums.per_part[ERROR[self.row]]
        if not reference.sum() > 0:
            return self.no_value("there is no reference to compare with")
        squares = np.asarray(sum(sums.per_part[ERROR[row]] for row in self.rows))
        return root(ratio(squares, reference, scenes=sums.scenes))


class PositionOverReference(OverReference):
    name, meaning = "position_over_reference", "position RMSE divided by that of the reference"
    rows, row = ("px", "py"), "position_reference"
    column, over = PositionRmse.column, "position_reference_m"


class VelocityOverReference(OverReference):
    name, meaning = "velocity_over_reference", "velocity RMSE divided by that of the reference"
    rows, row = ("vx", "vy"), "velocity_reference"
    column, over = VelocityRmse.column, "velocity_reference_mps"


class Coverage(EstimateMetric):
    name, unit, better = "coverage", "1", "larger"
    meaning = "share of the due estimates that the tracker gave"

    def finish(self, sums: BlockScores) -> Outcome:
        return sums.coverage if sums.due.any() else self.no_value("no object was ever seen")


def _chi_square(total: Array, count: Array, dof: int, steps_inside: float, scenes: bool, runs: int) -> MetricValue:
    """Return the mean, with its verdict, of chi-square variables with sums ``(parts,)`` in all ``runs``."""
    mean = ratio(total, count, at_least=0.0, scenes=scenes)
    value = mean.as_value("1")
    # Innovations that are zero in every run are surely too small, though their mean has no interval.
    certain = (mean.value, mean.value) if mean.constant and len(mean.influence) > 1 else value.ci95
    word = mean_verdict(certain, dof)
    if word == "undecided":
        # Stretches of one run may share a lasting error, so parts count as no more than the runs.
        parts = min(runs, float(count.sum() ** 2 / (count**2).sum()))
        word = doubtless_verdict(mean.value, parts, dof)
    return value.model_copy(update={"dof": dof, "steps_inside_bounds": steps_inside, "verdict": word})


def _inside(count: Array, total: Array, dof: int) -> float:
    """Return the share of the steps at which the mean NEES or NIS over runs and objects is within its 95 % bounds."""
    counted = count > 0
    low, high = mean_bounds(dof, count[counted])
    mean = total[counted] / count[counted]
    return float(((mean >= low) & (mean <= high)).mean())
