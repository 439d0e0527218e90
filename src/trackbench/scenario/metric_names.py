"""Every metric that an expectation can name and that a result holds, with its unit and meaning."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass


@dataclass(frozen=True)
class Metric:
    """One metric of a tracker."""

    path: str
    """Dotted path in the tracker's ``metrics`` (or ``health``); ``<sensor>`` stands for a sensor's name."""
    unit: str
    """"1" for a number without a unit, "" for a word."""
    meaning: str
    words: tuple[str, ...] = ()
    """The values of a verdict; empty for a number."""
    paired: bool = False
    """Whether two trackers are compared by it, run by run (``better_than``)."""


CONSISTENCY = ("consistent", "optimistic", "pessimistic", "undecided")
WHITENESS = ("white", "coloured", "undecided")

METRICS = (
    Metric("position_rmse", "m", "root mean square error of the position", paired=True),
    Metric("velocity_rmse", "m/s", "root mean square error of the velocity", paired=True),
    Metric("course_rmse", "deg", "root mean square error of the course", paired=True),
    Metric("rmse.px", "m", "root mean square error along x", paired=True),
    Metric("rmse.py", "m", "root mean square error along y", paired=True),
    Metric("rmse.vx", "m/s", "root mean square error of the velocity along x", paired=True),
    Metric("rmse.vy", "m/s", "root mean square error of the velocity along y", paired=True),
    Metric("nees.mean", "1", "normalised estimation error squared, mean over runs; 4 when consistent"),
    Metric("nees.steps_inside_bounds", "1", "share of the steps at which its mean is inside the 95 % bounds"),
    Metric("nees.verdict", "", "whether the errors are as large as claimed", words=CONSISTENCY),
    Metric("nis.<sensor>.mean", "1", "normalised innovation squared of one sensor, mean over runs"),
    Metric("nis.<sensor>.inside95", "1", "share of its innovations under the 95 % point"),
    Metric("nis.<sensor>.steps_inside_bounds", "1", "share of the steps at which its mean is inside the bounds"),
    Metric("nis.<sensor>.verdict", "", "whether the innovations are as large as predicted", words=CONSISTENCY),
    Metric("whiteness.<sensor>", "1", "correlation of successive normalised innovations of one sensor"),
    Metric("whiteness.<sensor>.verdict", "", "whether they are uncorrelated", words=WHITENESS),
    Metric("position_bound", "m", "posterior Cramer-Rao bound of the position error"),
    Metric("velocity_bound", "m/s", "posterior Cramer-Rao bound of the velocity error"),
    Metric("position_efficiency", "1", "position RMSE over its bound; 1 is the best possible"),
    Metric("velocity_efficiency", "1", "velocity RMSE over its bound; 1 is the best possible"),
    Metric("coverage", "1", "share of the steps with a vehicle present at which there is an estimate"),
    Metric("step_time", "us", "time of one predict and update of one run"),
    Metric("health.diverged_runs", "1", "runs whose position error exceeded score.divergence_m"),
    Metric("health.repaired_covariances", "1", "covariances that had to be made positive definite again"),
    Metric("health.repaired_runs", "1", "runs in which that happened"),
    Metric("health.non_finite_estimates", "1", "estimates with NaN or infinity"),
)


def metrics_by_path(sensors: Iterable[str]) -> dict[str, Metric]:
    """Every path that an expectation may name in a scenario with these sensors."""
    names = list(sensors)
    return {
        path: metric
        for metric in METRICS
        for path in (
            [metric.path.replace("<sensor>", name) for name in names] if "<sensor>" in metric.path else [metric.path]
        )
    }
