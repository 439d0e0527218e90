"""Run a scenario: truth, measurements, trackers, scores, verdicts."""

from __future__ import annotations

import hashlib
import logging
import platform
import time
from collections.abc import Mapping
from importlib.metadata import version
from itertools import combinations
from typing import Any

import numpy as np

from trackbench.metrics.bound import Prior, cramer_rao, typical_acceleration
from trackbench.metrics.breakdown import breakdown
from trackbench.metrics.intervals import Interval, holm, paired
from trackbench.metrics.scores import Scores, merge
from trackbench.metrics.summary import (
    ROOT_MEAN_SQUARES,
    Bound,
    error_intervals,
    health,
    metrics,
    no_metrics,
    rms_bound,
)
from trackbench.results import SCHEMA_VERSION, Result
from trackbench.runner import tables
from trackbench.runner.block import Block, Failure, Observer, Work
from trackbench.runner.expectations import judge
from trackbench.runner.pool import run_blocks
from trackbench.scenario import LoadedScenario
from trackbench.scenario.config import BoundConfig, Scenario
from trackbench.sensing.scans import ideal_sensors
from trackbench.trackers.answers import NOT_FINITE
from trackbench.trackers.config import FilterConfig, PluginConfig
from trackbench.truth import LoadedTruth
from trackbench.types import Array, Progress, no_progress
from trackbench.words import counted

Json = dict[str, Any]

log = logging.getLogger(__name__)

#: The errors whose differences between trackers the result lists.
COMPARED = ("position_rmse", "velocity_rmse")
PACKAGES = ("trackbench", "highway-env", "gymnasium", "numpy", "scipy", "rerun-sdk")


def run(
    loaded: LoadedScenario,
    truth: LoadedTruth,
    *,
    workers: int = 1,
    command: str = "",
    progress: Progress = no_progress,
    observer: Observer | None = None,
) -> Result:
    """The result of a scenario.

    The same for any number of workers, to the last bit, but for the times.

    Args:
        loaded: the scenario.
        truth: its truth.
        workers: number of processes.
        command: what reproduces the result.
        progress: called with the number of runs done and of all.
        observer: called with what is found of the recorded run, as it is found; it should return at once.
    """
    work = work_of(loaded, truth)
    begin = time.perf_counter()
    blocks = list(run_blocks(work, workers, progress, observer))
    _log_times(work, blocks, min(workers, len(blocks)), time.perf_counter() - begin)
    return assemble(loaded, truth, work, blocks, command)


def work_of(loaded: LoadedScenario, truth: LoadedTruth) -> Work:
    """What every block of a run of the scenario needs."""
    scenario = loaded.config
    return Work(
        scenario=scenario.name,
        seed=scenario.monte_carlo.seed,
        runs=scenario.monte_carlo.runs,
        truth=truth.truth,
        sensors=ideal_sensors(truth.truth, scenario.sensors, truth.measurements),
        trackers=scenario.trackers,
        folder=loaded.path.resolve().parent,
        settle=scenario.score.settle_s,
        divergence=scenario.score.divergence_m,
        recorded_run=scenario.recording.run,
    )


def assemble(loaded: LoadedScenario, truth: LoadedTruth, work: Work, blocks: list[Block], command: str) -> Result:
    """The result of all blocks of a run."""
    return _Assembly(loaded, truth, work, blocks).result(command)


def _log_times(work: Work, blocks: list[Block], processes: int, seconds: float) -> None:
    shared = f"{counted(len(blocks), 'block')} by {processes} process{'es' * (processes > 1)}"
    log.info("%s: %s in %.1f s, %s", work.scenario, counted(work.runs, "run"), seconds, shared)
    spent = {name: [block.scores[name] for block in blocks] for name in work.trackers}
    for name, outcomes in spent.items():
        scores = [outcome for outcome in outcomes if isinstance(outcome, Scores)]
        if len(scores) == len(blocks):
            log.info("%s: %s took %.2f s", work.scenario, name, sum(score.seconds for score in scores))


class _Assembly:
    """Puts the blocks of a run together."""

    def __init__(self, loaded: LoadedScenario, truth: LoadedTruth, work: Work, blocks: list[Block]) -> None:
        self._loaded = loaded
        self._scenario: Scenario = loaded.config
        self._truth = truth
        self._work = work
        self._blocks = blocks
        self._instants = work.instants()
        self._scores: dict[str, Scores] = {}
        self._failures: dict[str, Failure] = {}
        for name in work.trackers:
            outcomes = [block.scores[name] for block in blocks]
            failure = next((outcome for outcome in outcomes if isinstance(outcome, Failure)), None)
            if failure is None:
                self._scores[name] = merge([outcome for outcome in outcomes if isinstance(outcome, Scores)])
            else:
                self._failures[name] = failure

    def result(self, command: str) -> Result:
        work, scenario, truth = self._work, self._scenario, self._work.truth
        bounds = self._bounds()
        rms = {name: rms_bound(bounds[name], item.weight) for name, item in self._scores.items()}
        intervals = {name: error_intervals(item) for name, item in self._scores.items()}
        entries = {name: self._entry(name, rms.get(name)) for name in work.trackers}
        expectations = judge(scenario.expect, entries, intervals)
        summary: Json = {
            "schema_version": SCHEMA_VERSION,
            "scenario": {
                "name": scenario.name,
                "description": scenario.description,
                "file": self._loaded.path.name,
                "text": self._loaded.text,
                "overrides": list(self._loaded.overrides),
            },
            "seed": work.seed,
            "runs": work.runs,
            "versions": {"python": platform.python_version(), **{name: version(name) for name in PACKAGES}},
            "command": command,
            "fingerprint": self._fingerprint(),
            "truth": {
                **truth.source,
                "objects": list(truth.ids),
                "steps": len(truth.time),
                "dt": float(truth.time[1] - truth.time[0]) if len(truth.time) > 1 else None,
                "duration_s": float(truth.time[-1]),
                "audit": truth.audit,
                "cached": self._truth.cached,
            },
            "sensors": self._sensors(),
            "bound": {
                "motion": "cv",
                "acceleration_sigma_mps2": self._acceleration(),
                "velocity_sigma_mps": scenario.score.bound.velocity_sigma_mps,
            },
            "score": {"settle_s": work.settle, "divergence_m": work.divergence},
            "recorded_run": work.recorded_run,
            "trackers": list(entries.values()),
            "ranking": self._ranking(intervals),
            "differences": _differences(intervals),
            "expectations": expectations,
            "passed": all(item["passed"] for item in expectations),
            "artifacts": {},
        }
        return Result.from_json(summary, self._tables(bounds))

    def _entry(self, name: str, bound: Bound | None) -> Json:
        entry: Json = {"name": name, "describe": describe(self._work.trackers[name]), "failed": None}
        failure = self._failures.get(name)
        if failure is not None:
            found = {"non_finite_estimates": int(failure.cause == NOT_FINITE)}
            return {**entry, "failed": vars(failure), "metrics": no_metrics("the tracker failed"), "health": found}
        scores = self._scores[name]
        assert bound is not None
        found = metrics(scores, bound, self._work.runs)
        return {**entry, "metrics": found, "health": health(scores), "breakdown": breakdown(scores.classes)}

    def _bounds(self) -> dict[str, Array]:
        """Variances of the bound by tracker, computed once for all that read the same sensors from the same start."""
        work, rates, acceleration = self._work, self._rates(), self._acceleration()
        known: dict[tuple[tuple[str, ...], Prior], Array] = {}
        found = {}
        for name in self._scores:
            tracker = work.trackers[name]
            sensors = [item for item in work.sensors if tracker.sensors is None or item.name in tracker.sensors]
            prior = _prior(tracker, self._scenario.score.bound)
            case = tuple(sensor.name for sensor in sensors), prior
            if case not in known:
                known[case] = cramer_rao(work.truth, sensors, rates, acceleration, prior, self._instants)
            found[name] = known[case]
        return found

    def _rates(self) -> dict[str, Array]:
        """Share of the runs in which each object was detected, at each measurement of each sensor."""
        return {
            sensor.name: np.sum([block.detections[sensor.name] for block in self._blocks], axis=0) / self._work.runs
            for sensor in self._work.sensors
        }

    def _acceleration(self) -> float:
        stated = self._scenario.score.bound.acceleration_sigma_mps2
        return typical_acceleration(self._work.truth) if stated is None else stated

    def _sensors(self) -> Json:
        rates = self._rates()
        found = {}
        for sensor in self._work.sensors:
            visible = np.broadcast_to(sensor.visible.mean(axis=-1), rates[sensor.name].shape)
            seen = visible.sum()
            found[sensor.name] = {
                "kind": sensor.config.type,
                "dof": len(sensor.noise_covariance),
                "rate_hz": sensor.config.rate_hz,
                "preset": sensor.config.preset,
                "detection_rate": float(rates[sensor.name].sum() / seen) if seen > 0 else None,
            }
        return found

    def _fingerprint(self) -> str:
        """Of every measurement of every run: equal fingerprints mean equal measurements."""
        whole = hashlib.sha256()
        for block in self._blocks:
            for digest in block.digests:
                whole.update(digest)
        return f"sha256:{whole.hexdigest()}"

    def _ranking(self, intervals: Mapping[str, Mapping[str, Interval]]) -> list[str]:
        """By position error, the failed ones last."""
        scored = [name for name in intervals if "position_rmse" in intervals[name]]
        ranked = sorted(scored, key=lambda name: intervals[name]["position_rmse"].value)
        return ranked + [name for name in self._work.trackers if name not in ranked]

    def _tables(self, bounds: Mapping[str, Array]) -> dict[str, Any]:
        work, truth = self._work, self._work.truth
        shown = next(block for block in self._blocks if block.scans is not None)
        assert shown.scans is not None
        times = {sensor.name: sensor.time for sensor in work.sensors}
        recorded = {name: recorded for name, recorded in shown.recorded.items() if name in self._scores}
        return {
            "steps": tables.steps_table(self._scores, bounds, truth.time[self._instants]),
            "nis": tables.nis_table(self._scores, times),
            "runs": tables.runs_table(self._scores),
            "breakdown": tables.breakdown_table(self._scores),
            "autocorrelation": tables.autocorrelation_table(self._scores),
            "truth": tables.truth_table(truth, work.recorded_run),
            "measurements": tables.measurements_table(shown.scans, truth.ids),
            "estimates": tables.estimates_table(recorded, truth, self._instants, work.recorded_run),
            "recorded_nis": tables.recorded_nis_table(recorded, work, times),
            "roads": tables.roads_table(truth),
        }


def describe(tracker: FilterConfig | PluginConfig) -> str:
    """A tracker in a few words."""
    if isinstance(tracker, PluginConfig):
        options = ", ".join(f"{key} {value}" for key, value in tracker.options.items())
        parts = [tracker.use, options]
    else:
        parts = [tracker.filter, *tracker.motion_in_words]
        if tracker.process_noise_diag is not None:
            parts.append(f"constant Q diag({', '.join(f'{v:g}' for v in tracker.process_noise_diag)})")
        parts += [f"{sensor} taken for a {kind}" for sensor, kind in tracker.sensor_models.items()]
    parts.append("all sensors" if tracker.sensors is None else " + ".join(tracker.sensors))
    return ", ".join(part for part in parts if part)


def _prior(tracker: FilterConfig | PluginConfig, config: BoundConfig) -> Prior:
    if isinstance(tracker, FilterConfig) and tracker.initial.source == "truth":
        return Prior(tracker.initial.velocity_sigma_mps, tracker.initial.position_sigma_m)
    return Prior(config.velocity_sigma_mps)


def _differences(intervals: Mapping[str, Mapping[str, Interval]]) -> list[Json]:
    """Every pair of trackers, paired over the runs, the p-values of each metric corrected for their number."""
    found = []
    for metric in COMPARED:
        pairs = [(a, b) for a, b in combinations(intervals, 2) if metric in intervals[a] and metric in intervals[b]]
        differences = [paired(intervals[a][metric], intervals[b][metric]) for a, b in pairs]
        corrected = holm([difference.p_value for difference in differences])
        for (a, b), difference, p_value in zip(pairs, differences, corrected, strict=True):
            better = "a better" if difference.value < 0 else "b better"
            found.append(
                {
                    "a": a,
                    "b": b,
                    "metric": metric,
                    "unit": ROOT_MEAN_SQUARES[metric][2],
                    "value": difference.value,
                    "ci95": None if difference.ci95 is None else list(difference.ci95),
                    "p_value": p_value,
                    "verdict": better if p_value < 0.05 else "no difference shown",
                }
            )
    return found
