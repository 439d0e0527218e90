"""The records that the tables of a result are made of; ``results.declared`` has the columns of each table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import product
from typing import Any

import numpy as np
import pyarrow as pa

from trackbench.base.subjects import collected
from trackbench.base.types import Array, Indices, Scan, Truth, of_runs
from trackbench.metrics import BlockScores, Evaluation, Metric, evaluate
from trackbench.metrics.consistency import mean_bounds, normalised_square
from trackbench.metrics.estimates import ESTIMATES
from trackbench.metrics.evaluate import MetricSums
from trackbench.metrics.sums import ERROR, NIS
from trackbench.metrics.traffic import TRACKS, run_sums
from trackbench.models.sensors import SENSOR_MODELS
from trackbench.results.columns import Record, mean
from trackbench.results.declared import LABELLED
from trackbench.results.folder import OBSERVER
from trackbench.runner.block import Block
from trackbench.runner.evaluated import Evaluated
from trackbench.runner.recorded import Outcome, RecordedEstimates
from trackbench.runner.work import Work
from trackbench.trackers.config import FilterConfig, ImmConfig

#: By table, the records that it is made of.
Records = dict[str, list[Record]]


def labelled_tables(work: Work, blocks: Sequence[Block], evaluated: Evaluated) -> dict[str, pa.Table]:
    """Every table of a run with known identities, by name."""
    scene = work.scenes[work.recorded_scene]
    truth, instants = scene.truth, scene.instants()
    # Recorded scenes differ in how many measurements each sensor took.
    times = {
        each[0].name: max((sensor.time for sensor in each), key=len)
        for each in zip(*(other.sensors for other in work.scenes), strict=True)
    }
    evaluations, scores = evaluated.evaluations, evaluated.scores
    own_columns = list(dict.fromkeys(name for item in evaluations.values() for name in item.run_columns))
    block = next(block for block in blocks if block.recorded_scans is not None)
    assert block.recorded_scans is not None
    recorded = {
        name: item
        for name, item in block.recorded.items()
        if name in evaluations and isinstance(item, RecordedEstimates)
    }
    records: Records = {
        "steps": [_step_record(name, item, work.longest_time) for name, item in evaluations.items()],
        "nis": _nis_records(scores, times),
        "runs": [
            {**run_keys(name, work), **run_sums_record(item, scores[name], own_columns)}
            for name, item in evaluations.items()
        ],
        "truth": truth_records(truth, work.recorded_run),
        **other_truth(work),
        "measurements": measurement_records(block.recorded_scans.scans, truth.ids),
        "estimates": estimate_records(recorded, scene.scored, instants, work.recorded_run),
        "recorded_nis": [
            {"tracker": name, "sensor": sensor.name, "object": target, "time_s": sensor.time, "nis": nis}
            for name, estimates in recorded.items()
            for sensor in scene.sensors
            if sensor.name in estimates.nis
            for target, nis in zip(truth.ids, np.stack(estimates.nis[sensor.name]).T, strict=True)
        ],
        "roads": road_records(truth),
        **_mode_records(work, blocks, list(evaluations)),
        **dict(collected("records", work, evaluated, recorded)),
    }
    if work.over_stretches:
        records["stretches"] = [_stretch_record(name, item, scores[name]) for name, item in evaluations.items()]
    more = {"runs": own_columns}
    return {name: LABELLED[name].written(parts, more.get(name, ())) for name, parts in records.items()}


def other_truth(work: Work) -> Records:
    """The motion in the other scenes, in the run of the recorded run's number; no table where there is one scene."""
    records: list[Record] = [
        {**record, "scene": float(number)}
        for number, scene in enumerate(work.scenes)
        if number != work.recorded_scene and scene.truth.known
        for record in truth_records(scene.truth, work.recorded_run)
    ]
    return {"other_truth": records} if records else {}


def truth_records(truth: Truth, run: int) -> list[Record]:
    """The motion of every target and of the observer in one run."""
    names = ("px", "py", "heading", "course", "speed", "vx", "vy", "acceleration", "yaw_rate")
    # Some are computed, of all objects at once.
    fields = {name: of_runs(getattr(truth, name), range(run, run + 1))[..., 0] for name in names}
    records: list[Record] = [
        {
            "object": name,
            "role": "target",
            "time_s": truth.time,
            "alive": truth.alive[:, i],
            **{field: values[:, i] for field, values in fields.items()},
            "length": float(truth.length[i]),
            "width": float(truth.width[i]),
        }
        for i, name in enumerate(truth.ids)
    ]
    observer, steps = truth.observer, len(truth.time)
    speed = np.hypot(observer.vx, observer.vy)
    records.append(
        {
            "object": OBSERVER,
            "role": OBSERVER,
            "time_s": truth.time,
            "alive": np.ones(steps, dtype=bool),
            **{field: getattr(observer, field) for field in ("px", "py", "vx", "vy", "yaw_rate")},
            "heading": observer.yaw,
            "course": np.where(speed > 0, np.arctan2(observer.vy, observer.vx), observer.yaw),
            "speed": speed,
            "acceleration": np.gradient(speed, truth.time) if steps > 1 else np.zeros(steps),
            "length": float(observer.length),
            "width": float(observer.width),
        }
    )
    return records


def measurement_records(scans: Sequence[Scan], ids: Sequence[str]) -> list[Record]:
    """Every measurement of a run with known identities."""
    return [{**scan_record(scan), "object": list(ids), "valid": scan.valid} for scan in scans]


def estimate_records(
    recorded: Mapping[str, RecordedEstimates], truth: Truth, instants: Indices, run: int
) -> list[Record]:
    """Every tracker's estimates of one run at some steps of the truth, with their errors."""
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
                "mean": estimates.mean[:, :, i],
                "covariance": estimates.covariance[:, :, :, i],
                "error": error[:, :, i],
                "nees": nees[:, i],
                "due": estimates.due[:, i].astype(float),
            }
            for i, target in enumerate(truth.ids)
        ]
    return records


def road_records(truth: Truth) -> list[Record]:
    """Lane edges to draw."""
    lines = truth.roads or [np.zeros((0, 2))]
    return [{"line": float(i), "x_m": line[:, 0], "y_m": line[:, 1]} for i, line in enumerate(lines)]


def _step_record(name: str, evaluation: Evaluation, time: Array) -> Record:
    """Errors at each instant over runs and objects, with the reference."""
    sums = dict(zip(ERROR, evaluation.scores.per_step, strict=True))
    return {"tracker": name, "time_s": time, **sums, **_bounds("nees", 4, sums["given"])}


def _bounds(name: str, dof: int, count: Array) -> Record:
    """Where the mean of a chi-square statistic is expected."""
    low, high = mean_bounds(dof, count)
    return {f"{name}_low": np.where(count > 0, low, np.nan), f"{name}_high": np.where(count > 0, high, np.nan)}


def run_sums_record(evaluation: Evaluation, scores: BlockScores, own_columns: Sequence[str]) -> Record:
    """Errors in each run, for paired comparisons, and what it adds to each metric of a plug-in."""
    missing = np.full(len(scores.due), np.nan)
    nis, nis_count = (
        sum((item.per_run[NIS[row]] for item in scores.nis.values()), np.zeros_like(scores.due))
        for row in ("nis", "count")
    )
    return {
        **dict(zip(ERROR, scores.per_run, strict=True)),
        "nis": nis,
        "nis_count": nis_count,
        "due": scores.due,
        "diverged": scores.diverged,
        "repaired": scores.repaired,
        **{name: evaluation.run_columns.get(name, missing) for name in own_columns},
    }


def _stretch_record(name: str, evaluation: Evaluation, scores: BlockScores) -> Record:
    """Errors in each stretch of time of a single run, or of few logs."""
    sums = evaluation.scores.per_part
    run = np.concatenate([[number] * count for number, count in enumerate(scores.stretches or ())])
    keys = {"tracker": name, "run": run.astype(float), "stretch": np.arange(len(run), dtype=float)}
    return {**keys, **dict(zip(ERROR, sums, strict=True))}


def run_keys(name: str, work: Work) -> Record:
    scene = work.scene_of_run
    return {"tracker": name, "run": np.arange(len(scene), dtype=float), "scene": scene.astype(float)}


def _nis_records(scores: Mapping[str, BlockScores], times: Mapping[str, Array]) -> list[Record]:
    records: list[Record] = []
    for name, item in scores.items():
        for sensor, nis in item.nis.items():
            if nis.dof > 0:
                sums = dict(zip(NIS, nis.per_step, strict=True))
                keys = {"tracker": name, "sensor": sensor, "time_s": times[sensor], "dof": float(nis.dof)}
                records.append({**keys, **sums, **_bounds("nis", nis.dof, sums["count"])})
    return records


def _mode_records(work: Work, blocks: Sequence[Block], trackers: Sequence[str]) -> Records:
    """The mode probabilities: mean over runs and objects, and the recorded run; no tables where no tracker has any."""
    scene, time = work.scenes[work.recorded_scene], work.longest_time
    means: list[Record] = []
    single: list[Record] = []
    for tracker in trackers:
        config, outcomes = work.trackers[tracker], [block.outcomes[tracker] for block in blocks]
        sums = [item.modes for item in outcomes if isinstance(item, Outcome) and item.modes is not None]
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


def scan_record(scan: Scan) -> dict[str, Any]:
    """A scan with the position in the fixed frame that each of its measurements ``(m, rows)`` states."""
    components, rows = scan.measurement.shape
    return {
        "sensor": scan.sensor,
        "kind": scan.kind,
        "time_s": float(scan.time),
        "arrival_time_s": float(scan.arrival_time),
        "measurement": np.concatenate([scan.measurement, np.full((max(0, 3 - components), rows), np.nan)]),
        "position": SENSOR_MODELS[scan.kind].position(scan).mean,
        "sensor_pose": scan.sensor_pose,
    }


def run_values(metric: Metric, sums: MetricSums, runs: int) -> Array | None:
    """``(runs,)`` in the unit of the metric, NaN in a run without a value; None where runs do not tell it.

    Args:
        metric: the metric.
        sums: of all runs, merged.
        runs: how many there are.
    """
    if not metric.columns:
        return None
    evaluation = evaluate(sums, np.zeros(runs, dtype=np.intp), [metric])
    if metric.columns[0] in evaluation.run_columns:
        columns = [evaluation.run_columns[name] for name in metric.columns]
    elif "tracks" in metric.needs:
        columns = [*run_sums(evaluation.sums[TRACKS.name], metric.name)]
    else:
        record = run_sums_record(evaluation, sums[ESTIMATES.name], ())
        declared = {column.name: column for column in LABELLED["runs"].columns}
        columns = [np.asarray(declared[name].values(record)) for name in metric.columns]
    intervals = [metric.of_runs(*(column[run : run + 1] for column in columns)) for run in range(runs)]
    return np.array([np.nan if interval is None else interval.value for interval in intervals])
