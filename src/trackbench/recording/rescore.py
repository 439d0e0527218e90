"""The scores of the recorded run, computed afresh from what was recorded."""

from __future__ import annotations

from typing import Any

import numpy as np

from trackbench.errors import InputError
from trackbench.metrics import Fault, Scorer, evaluate, health
from trackbench.metrics.estimates import ESTIMATES
from trackbench.recording.shown import ShownRun
from trackbench.recording.tables import Columns, split
from trackbench.results import Result
from trackbench.results.metric_value import nested_metrics
from trackbench.types import Array, Estimate, Scan

Json = dict[str, Any]

#: Parts of a tracker's metrics that a recording cannot give: the bound needs the sensors' models, whiteness the
#: innovations themselves, a repair and the time a step took are not seen in an estimate.
NOT_RECORDED = (
    "whiteness",
    "position_bound",
    "velocity_bound",
    "position_efficiency",
    "velocity_efficiency",
    "step_time",
)


def rescored(result: Result, shown: ShownRun) -> dict[str, Json]:
    """By tracker, ``metrics`` and ``health`` of the one recorded run, in the form of a result.

    Raises:
        InputError: what was recorded cannot be scored.
    """
    nis: dict[str, dict[str, dict[str, Columns]]] = {}
    for (tracker, sensor, name), rows in split(result.tables["recorded_nis"], "tracker", "sensor", "object").items():
        nis.setdefault(tracker, {}).setdefault(sensor, {})[name] = rows
    dof = {key: int(rows["dof"][0]) for key, rows in split(result.tables["nis"], "tracker", "sensor").items()}
    found = {}
    for tracker in shown.tracks:
        measurements = {
            sensor: _measurements(rows, shown, dof.get((tracker, sensor), 1))
            for sensor, rows in nis.get(tracker, {}).items()
        }
        found[tracker] = _scores(tracker, shown, measurements)
    return found


def _measurements(rows: dict[str, Columns], shown: ShownRun, dof: int) -> dict[int, Array]:
    """By instant, ``(dof, objects)`` innovations of the recorded squared length, which is all that scoring needs."""
    found: dict[int, Array] = {}
    for name, of_object in rows.items():
        instants = np.searchsorted(shown.target.time, of_object["time_s"])
        for instant, value in zip(instants, of_object["nis"], strict=True):
            white = found.setdefault(int(instant), np.zeros((dof, len(shown.objects))))
            white[0, shown.objects.index(name)] = np.sqrt(value)
    return found


def _scores(tracker: str, shown: ShownRun, measurements: dict[str, dict[int, Array]]) -> Json:
    track = shown.tracks[tracker]
    counts = {sensor: len(items) for sensor, items in measurements.items()}
    # What the sensors could see is not recorded, so that nothing is broken down by it.
    alike = np.zeros((len(shown.target.time), len(shown.objects), 1), dtype=np.int8)
    scorer = Scorer(shown.target, alike, counts)
    try:
        for instant, time in enumerate(shown.target.time):
            estimate = Estimate(track.mean[:, instant], track.covariance[:, :, instant])
            for sensor, items in measurements.items():
                if instant in items:
                    white = items[instant]
                    scan = _scan(float(time), sensor, np.isfinite(white[0]))
                    scorer.scan(instant, scan, estimate._replace(whitened_innovation=white))
            scorer.estimate(estimate)
        sums = scorer.close()
    except Fault as fault:
        raise InputError(f"the recorded estimates of {tracker} cannot be scored: {fault.cause}") from fault
    known = {path: value.model_dump() for path, value in evaluate(sums).values.items()}
    return {
        "metrics": {name: value for name, value in nested_metrics(known).items() if name not in NOT_RECORDED},
        "health": {"diverged_runs": health(sums[ESTIMATES.name]).diverged_runs},
    }


def _scan(time: float, sensor: str, valid: Any) -> Scan:
    """As much of a scan as scoring looks at."""
    nothing = np.empty(0)
    return Scan(time, sensor, "", nothing, valid, nothing, nothing, nothing, time)
