"""The scores of the recorded run, computed afresh from what was recorded."""

from __future__ import annotations

import numpy as np

from trackbench.base.errors import InputError
from trackbench.base.types import Array, Estimate, Mask, Scan
from trackbench.metrics import Scorer, evaluate, health, score_together
from trackbench.metrics.estimates import ESTIMATES
from trackbench.metrics.recorded_run import RecordedRun, RecordedTrack
from trackbench.results import Health, Result, TrackerResult
from trackbench.results.columns import Columns, split

#: Metrics that a recording cannot give: the reference needs the sensors' models, whiteness the innovations themselves,
#: and the time that a step took is not seen in an estimate.
NOT_RECORDED = (
    "whiteness",
    "position_reference",
    "velocity_reference",
    "position_over_reference",
    "velocity_over_reference",
    "step_time",
)


def rescored(result: Result, recorded: RecordedRun) -> list[TrackerResult]:
    """What each tracker that did not fail reached in the one recorded run.

    As in the run, those that are ranked are scored where all of them gave an estimate.

    Raises:
        InputError: what was recorded cannot be scored.
    """
    nis: dict[str, dict[str, dict[str, Columns]]] = {}
    for (tracker, sensor, name), rows in split(result.tables.recorded_nis, "tracker", "sensor", "object").items():
        nis.setdefault(tracker, {}).setdefault(sensor, {})[name] = rows
    dof = {key: int(rows["dof"][0]) for key, rows in split(result.tables.nis, "tracker", "sensor").items()}
    innovations = {
        name: {
            sensor: _innovations(rows, recorded, dof.get((name, sensor), 1))
            for sensor, rows in nis.get(name, {}).items()
        }
        for name in recorded.tracks
    }
    # What the sensors could see is not recorded, so that nothing is broken down by it.
    alike = np.zeros((len(recorded.time), len(recorded.objects), 1), dtype=np.int16)
    scorers = {
        name: Scorer(recorded.target(name), alike, {sensor: len(items) for sensor, items in own.items()}, tracker=name)
        for name, own in innovations.items()
    }
    for instant in range(len(recorded.time)):
        for name, scorer in scorers.items():
            _take(scorer, recorded, recorded.tracks[name], innovations[name], instant)
        if instant == len(recorded.time) - 1 or any(scorer.full for scorer in scorers.values()):
            for name, fault in score_together(list(scorers.values())).items():
                raise InputError(f"the recorded estimates of {name} cannot be scored: {fault.cause}") from fault
    together = frozenset(tracker.name for tracker in result.scored) & frozenset(scorers)
    return [
        _reached(result[name], scorer, together if name in together else frozenset({name}))
        for name, scorer in scorers.items()
    ]


def _take(
    scorer: Scorer,
    recorded: RecordedRun,
    track: RecordedTrack,
    innovations: dict[str, dict[int, Array]],
    instant: int,
) -> None:
    estimate = Estimate(track.mean[:, instant], track.covariance[:, :, instant])
    for sensor, items in innovations.items():
        if instant in items:
            white = items[instant]
            scan = _scan(float(recorded.time[instant]), sensor, np.isfinite(white[0]))
            scorer.scan(instant, scan, estimate._replace(whitened_innovation=white))
    scorer.estimate(estimate)


def _reached(tracker: TrackerResult, scorer: Scorer, together: frozenset[str]) -> TrackerResult:
    sums = scorer.close()
    known = evaluate(sums, np.zeros(1, dtype=np.intp), givers=together).values
    return TrackerResult(
        name=tracker.name,
        describe=tracker.describe,
        failed=tracker.failed,
        metrics={path: value for path, value in known.items() if path.partition(".")[0] not in NOT_RECORDED},
        health=Health(diverged_runs=health(sums[ESTIMATES.name]).diverged_runs),
    )


def _innovations(rows: dict[str, Columns], recorded: RecordedRun, dof: int) -> dict[int, Array]:
    """By instant, ``(dof, objects)`` innovations of the recorded squared length, which is all that scoring needs."""
    found: dict[int, Array] = {}
    for name, of_object in rows.items():
        instants = np.searchsorted(recorded.time, of_object["time_s"])
        for instant, value in zip(instants, of_object["nis"], strict=True):
            white = found.setdefault(int(instant), np.zeros((dof, len(recorded.objects))))
            white[0, recorded.objects.index(name)] = np.sqrt(value)
    return found


def _scan(time: float, sensor: str, valid: Mask) -> Scan:
    """As much of a scan as scoring looks at."""
    nothing = np.empty(0)
    return Scan(time, sensor, "", nothing, valid, nothing, nothing, nothing, time)
