"""What a run of unlabelled detections leaves, as tables with a unit in each column's name."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from trackbench.base.types import Array, Indices, Scan, Truth
from trackbench.metrics.protocol import run_column
from trackbench.metrics.traffic import DETECTION_METRICS, TRACK_METRICS, TrackHistory
from trackbench.metrics.traffic.events import STATES
from trackbench.metrics.traffic.track_quality import BINS
from trackbench.results.table_check import FALSE_ALARM, NO_OBJECT
from trackbench.runner.block import Block
from trackbench.runner.columns import Columns, measurement_columns, stacked, state_columns
from trackbench.runner.hidden_run import TrafficScores
from trackbench.runner.recorded_gates import gates_table
from trackbench.runner.recorded_tables import roads_table, truth_table
from trackbench.runner.traffic_sums import TrafficEvaluation, dearest, summed
from trackbench.runner.work import Work
from trackbench.trackers.answers import NO_TRACK

ASSOCIATIONS = ("right", "wrong_object", "clutter", "missed")
PARTS = ("localisation", "missed", "false")


def tables(work: Work, blocks: Sequence[Block], found: Mapping[str, TrafficEvaluation]) -> dict[str, pa.Table]:
    """Every table by name."""
    scene = work.scenes[work.recorded_scene]
    block = next(block for block in blocks if block.recorded_scans is not None)
    scans = block.recorded_scans
    assert scans is not None
    assert scans.status is not None
    ids, time = scene.truth.ids, scene.truth.time[scene.instants()]
    longest = max(work.scenes, key=lambda item: len(item.instants()))
    kept = {name: item for name, item in block.outcomes.items() if name in found and isinstance(item, TrafficScores)}
    recorded = {name: scores.recorded for name, scores in kept.items() if scores.recorded is not None}
    taken = {name: scores.taken for name, scores in kept.items() if scores.taken is not None}
    return {
        "steps": _steps(found, longest.truth.time[longest.instants()]),
        "runs": _runs(work, found),
        "truth": truth_table(scene.truth, work.recorded_run),
        "measurements": _measurements(scene.truth, scans.scans, scans.origins),
        "tracks": _tracks(recorded, time),
        "taken": _taken(taken, scans.scans),
        "gates": gates_table(work.trackers, {name: scores.predicted for name, scores in kept.items()}, scans.scans),
        "events": events_table(work, found),
        "objects": objects_table(work, found, time),
        "association": association_table(found),
        "existence": existence_table(found),
        "due": _due(scans.status, ids, time),
        "roads": roads_table(scene.truth),
    }


def _steps(found: Mapping[str, TrafficEvaluation], time: Array) -> pa.Table:
    """Root mean square over runs of GOSPA and its parts at each instant, m."""
    parts: list[Columns] = []
    for name, evaluation in found.items():
        columns: dict[str, Array] = {}
        for part in ("total", *PARTS):
            total, count = np.zeros(len(time)), np.zeros(len(time))
            for block in evaluation.blocks:
                values = block.gospa.sum(axis=0) if part == "total" else block.gospa[PARTS.index(part)]
                total[: len(values)] += values
                count[: len(values)] += block.runs
            columns["gospa_m" if part == "total" else f"gospa_{part}_m"] = np.sqrt(
                total / np.where(count > 0, count, np.nan)
            )
        parts.append({"tracker": [name] * len(time), "time_s": time, **columns})
    return stacked(parts)


def _runs(work: Work, found: Mapping[str, TrafficEvaluation]) -> pa.Table:
    """Of each run the total and the count of each metric, for paired comparisons."""
    scene = work.scene_of_run.astype(float)
    rows = len(scene)
    metrics = TRACK_METRICS | DETECTION_METRICS
    known = dict.fromkeys(path for item in found.values() for path in item.metrics.intervals)
    paths, own = [path for path in known if path in metrics], [path for path in known if path not in metrics]
    parts: list[Columns] = []
    for name, item in found.items():
        values = {
            column: sums for path in paths for column, sums in zip(metrics[path].columns, item.sums(path), strict=True)
        }
        for path in own:
            values[run_column(path)] = item.metrics.per_run(path, rows)
        run = np.arange(rows, dtype=float)
        parts.append({"tracker": [name] * rows, "run": run, "scene": scene, "count": np.ones(rows), **values})
    return stacked(parts)


def _measurements(truth: Truth, scans: Sequence[Scan], origins: Sequence[Indices]) -> pa.Table:
    """Every detection of the recorded run, with what caused it, which no tracker knows.

    Without a truth nobody knows, and there is the number of the sensor's own track.
    """
    # The last one is also that of -1, which is the origin of a false alarm.
    names = [*truth.ids, FALSE_ALARM]
    parts: list[Columns] = []
    for number, (scan, origin) in enumerate(zip(scans, origins, strict=True)):
        rows = len(origin)
        parts.append(
            {
                "sensor": [scan.sensor] * rows,
                "kind": [scan.kind] * rows,
                "object": [names[one] if truth.known else NO_OBJECT for one in origin],
                "scan": np.full(rows, float(number)),
                "detection": np.arange(rows, dtype=float),
                "time_s": np.full(rows, scan.time),
                "valid": np.ones(rows, dtype=bool),
                **measurement_columns(scan),
                **({} if truth.known else {"own_track": np.where(origin >= 0, origin, np.nan)}),
            }
        )
    return stacked(parts)


def _tracks(recorded: Mapping[str, TrackHistory], time: Array) -> pa.Table:
    """Every confirmed track of the recorded run at each instant."""
    parts: list[Columns] = []
    for name, history in recorded.items():
        instant, column = np.nonzero(history.ids != NO_TRACK)
        existence = history.existence
        rows = len(instant)
        parts.append(
            {
                "tracker": [name] * rows,
                "time_s": time[instant],
                "track": history.ids[instant, column].astype(float),
                **state_columns(history.mean[:, instant, column], history.covariance[:, :, instant, column]),
                "existence": np.full(rows, np.nan) if existence is None else existence[instant, column],
            }
        )
    return stacked(parts)


def _taken(taken: Mapping[str, Indices], scans: Sequence[Scan]) -> pa.Table:
    """The detection that each track took in each scan of the recorded run."""
    times = np.array([scan.time for scan in scans])
    return stacked(
        [
            {
                "tracker": [name] * len(rows),
                "time_s": times[rows[:, 0]],
                **dict(zip(("scan", "track", "detection"), rows.T.astype(float), strict=True)),
            }
            for name, rows in taken.items()
        ]
    )


def _due(status: npt.NDArray[np.int8], ids: Sequence[str], time: Array) -> pa.Table:
    """What each object was at each instant of the recorded run: 0 absent, 1 optional, 2 due."""
    rows = len(time)
    return stacked(
        [
            {"object": [name] * rows, "time_s": time, "status": status[:, number].astype(float)}
            for number, name in enumerate(ids)
        ]
    )


def events_table(work: Work, found: Mapping[str, TrafficEvaluation]) -> pa.Table:
    """All events of the recorded run, and those of the others: of more than ``MOST_EVENTS`` the dearest."""
    return stacked([_events(work, name, item) for name, item in found.items()])


def _events(work: Work, name: str, evaluation: TrafficEvaluation) -> Columns:
    recorded = work.number(work.recorded_scene, work.recorded_run)
    rows = dearest([event for block in evaluation.blocks for event in block.events], recorded)
    ids = [work.scenes[scene].truth.ids for scene in work.scene_of_run]

    def number(field: str) -> Array:
        return np.array([getattr(event, field) for _, event in rows], dtype=float)

    def objects(field: str) -> list[str]:
        numbers = ((run, getattr(event, field)) for run, event in rows)
        return [ids[run][item] if item >= 0 else NO_OBJECT for run, item in numbers]

    return {
        "tracker": [name] * len(rows),
        "kind": [event.kind for _, event in rows],
        "object": objects("object"),
        "other_object": objects("other_object"),
        "why": [event.why for _, event in rows],
        "run": np.array([run for run, _ in rows], dtype=float),
        "time_s": number("time"),
        "track": _known(number("track")),
        "other_track": _known(number("other_track")),
        "x_m": number("x"),
        "y_m": number("y"),
        "cost_m2": number("cost"),
    }


def objects_table(work: Work, found: Mapping[str, TrafficEvaluation], time: Array) -> pa.Table:
    """What each object's time was spent on in the recorded run, stretch by stretch."""
    ids = work.scenes[work.recorded_scene].truth.ids
    until = np.append(time[1:], 2 * time[-1] - time[-2] if len(time) > 1 else time[-1])
    parts: list[Columns] = []
    for name, evaluation in found.items():
        strips = next(block.strips for block in evaluation.blocks if block.strips is not None)
        for item, strip in enumerate(strips.T):
            starts = np.flatnonzero(np.diff(strip, prepend=-1))
            ends = np.append(starts[1:], len(strip)) - 1
            parts.append(
                {
                    "tracker": [name] * len(starts),
                    "object": [ids[item]] * len(starts),
                    "state": [STATES[code] for code in strip[starts]],
                    "time_s": time[starts],
                    "until_s": until[ends],
                }
            )
    return stacked(parts)


def association_table(found: Mapping[str, TrafficEvaluation]) -> pa.Table:
    """How often each tracker's tracks took a detection of their own object, another's, a false alarm or none."""
    parts: list[Columns] = []
    for name, evaluation in found.items():
        totals = {outcome: float(evaluation.sums(f"association_{outcome}")[0].sum()) for outcome in ASSOCIATIONS}
        if any(totals.values()):
            parts.append({"tracker": [name], **{outcome: np.array([total]) for outcome, total in totals.items()}})
    return stacked(parts)


def existence_table(found: Mapping[str, TrafficEvaluation]) -> pa.Table:
    """Tracks by the existence probability that they state, and how many of them are on an object."""
    parts: list[Columns] = []
    for name, evaluation in found.items():
        bins = summed([block.existence for block in evaluation.blocks])
        if bins is None:
            continue
        stated, real, number = (np.asarray(each, dtype=float) for each in bins)
        parts.append(
            {
                "tracker": [name] * BINS,
                "from": np.arange(BINS) / BINS,
                "to": np.arange(1, BINS + 1) / BINS,
                "count": number,
                "stated": stated / np.where(number > 0, number, np.nan),
                "real": real / np.where(number > 0, number, np.nan),
            }
        )
    return stacked(parts)


def _known(ids: Array) -> Array:
    """NaN where there is none."""
    return np.where(ids >= 0, ids, np.nan)
