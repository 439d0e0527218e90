"""Records (columns by name) of which the tables of a result with known identities consist."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import product

import numpy as np

from trackbench.base.types import Array, Indices, Scan, Truth
from trackbench.metrics import BlockScores, Evaluation
from trackbench.metrics.consistency import mean_bounds, normalised_square
from trackbench.metrics.sums import ERROR, NIS
from trackbench.results.columns import Record, mean
from trackbench.runner.evaluated import Evaluated
from trackbench.runner.recorded import Outcome, RecordedEstimates, RecordedScans, state_columns
from trackbench.runner.shared_records import Records, run_keys, scan_record
from trackbench.runner.work import Work
from trackbench.trackers.config import FilterConfig, ImmConfig


def records_of_estimates(
    work: Work, evaluated: Evaluated, scans: RecordedScans, recorded: Mapping[str, RecordedEstimates]
) -> Records:
    """Return the records of each table of a result with known identities, by name of the table.

    ``recorded`` has each tracker's estimates in the run that is kept for plots.
    """
    scene = work.scenes[work.recorded_scene]
    # Recorded scenes differ in their number of measurements: the longest gives the times.
    times = {
        each[0].name: max((sensor.time for sensor in each), key=len)
        for each in zip(*(other.sensors for other in work.scenes), strict=True)
    }
    evaluations, scores = evaluated.evaluations, evaluated.scores
    plugin_columns = list(dict.fromkeys(name for item in evaluations.values() for name in item.run_columns))
    records: Records = {
        "steps": [_step_record(name, item, work.longest_time) for name, item in evaluations.items()],
        "nis": _nis_records(scores, times),
        "runs": [
            {**run_keys(name, work), **run_sums_record(item, scores[name], plugin_columns)}
            for name, item in evaluations.items()
        ],
        "measurements": measurement_records(scans.scans, scene.truth.ids),
        "estimates": estimate_records(recorded, scene.scored, scene.instants(), work.recorded_run),
        "recorded_nis": [
            {"tracker": name, "sensor": sensor.name, "object": target, "time_s": sensor.time, "nis": nis}
            for name, estimates in recorded.items()
            for sensor in scene.sensors
            if sensor.name in estimates.nis
            for target, nis in zip(scene.truth.ids, np.stack(estimates.nis[sensor.name]).T, strict=True)
        ],
        **_mode_records(work, evaluated.outcomes),
    }
    if work.over_stretches:
        records["stretches"] = [_stretch_record(name, item, scores[name]) for name, item in evaluations.items()]
    return records


def measurement_records(scans: Sequence[Scan], ids: Sequence[str]) -> list[Record]:
    """Return one record per scan of a run with known identities: measurement columns with a row per object."""
    return [
        {**scan_record(scan), "arrival_time_s": float(scan.arrival_time), "object": list(ids), "valid": scan.valid}
        for scan in scans
    ]


def estimate_records(
    recorded: Mapping[str, RecordedEstimates], truth: Truth, instants: Indices, run: int
) -> list[Record]:
    """Return the estimates of every tracker in one run, with errors; ``instants`` are indices of the truth's steps."""
    state = truth.state_of_run(run)[:, instants]
    records: list[Record] = []
    for name, estimates in recorded.items():
        error = estimates.mean - state
        nees = normalised_square(error, estimates.covariance)[0]
        records += [
            {
                "tracker": name,
                "object": target,
                "time_s": truth.time[instants],
                **state_columns(estimates.mean[:, :, i], estimates.covariance[:, :, :, i]),
                "position_error_m": np.hypot(error[0, :, i], error[1, :, i]),
                "velocity_error_mps": np.hypot(error[2, :, i], error[3, :, i]),
                "nees": nees[:, i],
                "due": estimates.due[:, i].astype(float),
            }
            for i, target in enumerate(truth.ids)
        ]
    return records


def _step_record(name: str, evaluation: Evaluation, time: Array) -> Record:
    sums = evaluation.scores.per_step
    return {"tracker": name, "time_s": time, **_error_columns(sums), **_bounds_of_mean("nees", 4, sums[ERROR["given"]])}


def _error_columns(sums: Array) -> Record:
    sum_of = dict(zip(ERROR, sums, strict=True))
    count = sum_of["count"]

    def root(total: Array) -> Array:
        return np.sqrt(mean(total, count))

    def reference(name: str) -> Array:
        return root(np.where(sum_of[name] > 0, sum_of[name], np.nan))

    return {
        "count": count,
        "given": sum_of["given"],
        "position_rmse_m": root(sum_of["px"] + sum_of["py"]),
        "velocity_rmse_mps": root(sum_of["vx"] + sum_of["vy"]),
        **{f"{name}_rmse_m": root(sum_of[name]) for name in ("px", "py")},
        **{f"{name}_rmse_mps": root(sum_of[name]) for name in ("vx", "vy")},
        "nees_mean": mean(sum_of["nees"], sum_of["given"]),
        "position_reference_m": reference("position_reference"),
        "velocity_reference_mps": reference("velocity_reference"),
    }


def _bounds_of_mean(name: str, dof: int, count: Array) -> Record:
    low, high = mean_bounds(dof, count)
    return {f"{name}_low": np.where(count > 0, low, np.nan), f"{name}_high": np.where(count > 0, high, np.nan)}


def run_sums_record(evaluation: Evaluation, scores: BlockScores, plugin_columns: Sequence[str]) -> Record:
    """Return a tracker's errors and counts in each run, with the columns of metrics from plug-ins."""
    missing = np.full(len(scores.due), np.nan)
    nis, nis_count = (
        sum((item.per_run[NIS[row]] for item in scores.nis.values()), np.zeros_like(scores.due))
        for row in ("nis", "count")
    )
    return {
        **_error_columns(scores.per_run),
        "nis_mean": mean(nis, nis_count),
        "due": scores.due,
        "diverged": scores.diverged,
        "repaired": scores.repaired,
        **{name: evaluation.run_columns.get(name, missing) for name in plugin_columns},
    }


def _stretch_record(name: str, evaluation: Evaluation, scores: BlockScores) -> Record:
    run = np.concatenate([[number] * count for number, count in enumerate(scores.stretches or ())])
    keys = {"tracker": name, "run": run.astype(float), "stretch": np.arange(len(run), dtype=float)}
    return {**keys, **_error_columns(evaluation.scores.per_part)}


def _nis_records(scores: Mapping[str, BlockScores], times: Mapping[str, Array]) -> list[Record]:
    records: list[Record] = []
    for name, item in scores.items():
        for sensor, nis in item.nis.items():
            if nis.dof > 0:
                sums = dict(zip(NIS, nis.per_step, strict=True))
                count = sums["count"]
                keys = {"tracker": name, "sensor": sensor, "time_s": times[sensor], "dof": float(nis.dof)}
                means = {"nis_mean": mean(sums["nis"], count), "inside95": mean(sums["inside"], count)}
                records.append({**keys, "count": count, **means, **_bounds_of_mean("nis", nis.dof, count)})
    return records


def _mode_records(work: Work, outcomes: Mapping[str, Sequence[Outcome]]) -> Records:
    """Return tables of mode probabilities: means over runs and objects, and values in the run that is kept."""
    scene, time = work.scenes[work.recorded_scene], work.longest_time
    means: list[Record] = []
    single: list[Record] = []
    for tracker, of_blocks in outcomes.items():
        config, sums = work.trackers[tracker], [item.modes for item in of_blocks if item.modes is not None]
        if not sums:
            continue
        names = [f"mode {number}" for number in range(1, len(sums[0].total) + 1)]
        if isinstance(config, FilterConfig) and isinstance(config.motion, ImmConfig):
            names = config.motion.names
        total, count = np.zeros((len(names), len(time))), np.zeros(len(time))
        for part in sums:
            total[:, : len(part.count)] += part.total
            count[: len(part.count)] += part.count
        means += [
            {"tracker": tracker, "mode": mode, "time_s": time, "probability": probability}
            for mode, probability in zip(names, mean(total, count), strict=True)
        ]
        for recorded in (part.recorded for part in sums if part.recorded is not None):
            for (m, mode), (i, target) in product(enumerate(names), enumerate(scene.truth.ids)):
                keys = {"tracker": tracker, "mode": mode, "object": target}
                time_s = scene.truth.time[scene.instants()]
                single.append({**keys, "time_s": time_s, "probability": recorded[m, :, i]})
    return {"modes": means, "recorded_modes": single} if means else {}
