"""Records (columns by name) of which the tables of a result with hidden identities consist."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from trackbench.base.types import UNKNOWN_ORIGIN, Array, Indices, Scan, Truth
from trackbench.metrics import Evaluation
from trackbench.metrics.traffic import DETECTION_METRICS, TRACK_METRICS, TRACKS, run_sums
from trackbench.metrics.traffic.events import STATES
from trackbench.metrics.traffic.scorer import RecordedTracks
from trackbench.metrics.traffic.timeline import Timeline, dearest
from trackbench.models.sensors import SENSOR_MODELS
from trackbench.results.columns import Record, mean
from trackbench.results.folder import FALSE_ALARM, NO_OBJECT
from trackbench.runner.block import Block
from trackbench.runner.evaluated import Evaluated
from trackbench.runner.recorded import RecordedScans, state_columns
from trackbench.runner.shared_records import Records, run_keys, scan_record
from trackbench.runner.work import Work
from trackbench.trackers.answers import NO_TRACK
from trackbench.trackers.config import FilterConfig
from trackbench.trackers.multi.association import gate_threshold

#: Number of points of a gate's outline; the last point equals the first.
CORNERS = 17
_GOSPA_COLUMNS = ("gospa_m", "gospa_localisation_m", "gospa_missed_m", "gospa_false_m")


def records_of_tracks(
    work: Work,
    blocks: Sequence[Block],
    evaluated: Evaluated,
    scans: RecordedScans,
    recorded: Mapping[str, RecordedTracks],
) -> Records:
    """Return the records of each table of a result with hidden identities, by name of the table.

    ``recorded`` has each tracker's tracks in the run that is kept for plots.
    """
    scene = work.scenes[work.recorded_scene]
    ids, time = scene.truth.ids, scene.truth.time[scene.instants()]
    sums = {name: [block.timeline for block in blocks] for name, blocks in evaluated.outcomes.items()}
    assert scans.status is not None
    return {
        "steps": [_gospa_record(name, blocks, work.longest_time) for name, blocks in sums.items()],
        "runs": _run_records(evaluated.evaluations, work),
        "measurements": _detection_records(scene.truth, scans.scans, scans.origins),
        "tracks": [_tracks_record(name, item, time) for name, item in recorded.items()],
        **({"other_tracks": _other_tracks(work, blocks, recorded)} if len(work.scenes) > 1 else {}),
        "taken": [_taken_record(name, item, scans.scans) for name, item in recorded.items()],
        "gates": [each for name, item in recorded.items() for each in _gate_records(work, name, item, scans.scans)],
        "events": [_events_record(name, blocks, work) for name, blocks in sums.items()],
        "objects": [record for name, blocks in sums.items() for record in _stretch_records(name, blocks, ids, time)],
        "due": [
            {"object": name, "time_s": time, "status": scans.status[:, number].astype(float)}
            for number, name in enumerate(ids)
        ],
    }


def gate_outlines(scan: Scan, mean: Array, covariance: Array, threshold: float) -> Array:
    """Return the edge of each gate over a measurement's first two components: x and y ``(2, K, CORNERS)``, m.

    The measurement equation is linearised at the track. A gate is an ellipsoid; its projection on two components is the
    ellipse of their covariance with the same threshold. NaN for a sensor that measures no position.

    Args:
        scan: scan of the sensor; its pose may be ``(3, K)`` and its velocity ``(2, K)``.
        mean: ``(4, K)`` means of the predicted tracks.
        covariance: ``(4, 4, K)`` covariances of the predicted tracks.
        threshold: largest squared Mahalanobis distance in the gate.
    """
    model = SENSOR_MODELS[scan.kind]
    if not model.measures_position():
        return np.full((2, mean.shape[1], CORNERS), np.nan)
    pose, velocity = scan.sensor_pose.reshape(3, -1), scan.sensor_velocity.reshape(2, -1)
    slope = model.jacobian(mean, pose, velocity)
    spread = np.einsum("iak,abk,jbk->ijk", slope, covariance, slope) + scan.noise_covariance[..., None]
    expected = model.measure(mean, pose, velocity)
    angle = np.linspace(0, 2 * np.pi, CORNERS)
    circle = np.sqrt(threshold) * np.stack([np.cos(angle), np.sin(angle)])
    factor = np.linalg.cholesky(np.moveaxis(spread[:2, :2], 2, 0))
    edge = expected[:, :, None] * np.ones(CORNERS)
    edge[:2] += np.einsum("kij,jc->ikc", factor, circle)
    flat = edge.reshape(len(edge), -1)
    pose = np.repeat(np.broadcast_to(pose, (3, mean.shape[1])), CORNERS, axis=1)
    flat_scan = scan._replace(measurement=flat, valid=np.ones(flat.shape[1], dtype=bool), sensor_pose=pose)
    return model.position(flat_scan).mean.reshape(2, -1, CORNERS)


def _detection_records(truth: Truth, scans: Sequence[Scan], origins: Sequence[Indices]) -> list[Record]:
    """Return one record per scan of its detections, with the object that caused each one.

    In a recording without a truth the cause is unknown. Its records have instead the track that the sensor itself
    assigned to each detection.
    """
    # A false alarm has the origin -1: the last name.
    names = [*truth.ids, FALSE_ALARM]
    return [
        {
            **scan_record(scan),
            "object": [names[caused] if truth.known and caused != UNKNOWN_ORIGIN else NO_OBJECT for caused in origin],
            "scan": float(number),
            "detection": np.arange(len(origin), dtype=float),
            "valid": np.ones(len(origin), dtype=bool),
            **({} if truth.known else {"own_track": np.where(origin >= 0, origin, np.nan)}),
        }
        for number, (scan, origin) in enumerate(zip(scans, origins, strict=True))
    ]


def _gospa_record(name: str, blocks: Sequence[Timeline], time: Array) -> Record:
    sums, count, recorded = np.zeros((4, len(time))), np.zeros(len(time)), np.full(len(time), np.nan)
    for block in blocks:
        parts = np.stack([block.gospa.sum(axis=0), *block.gospa])
        sums[:, : parts.shape[1]] += parts
        count[: parts.shape[1]] += block.runs
        if block.recorded_gospa is not None:
            recorded[: parts.shape[1]] = np.sqrt(block.recorded_gospa)
    of_runs = dict(zip(_GOSPA_COLUMNS, np.sqrt(mean(sums, count)), strict=True))
    return {"tracker": name, "time_s": time, **of_runs, "recorded_gospa_m": recorded}


def _run_records(evaluations: Mapping[str, Evaluation], work: Work) -> list[Record]:
    built_in = TRACK_METRICS | DETECTION_METRICS
    paths = dict.fromkeys(path for item in evaluations.values() for path in item.intervals)
    plugin_columns = dict.fromkeys(column for item in evaluations.values() for column in item.run_columns)
    records: list[Record] = []
    for name, evaluation in evaluations.items():
        record = {**run_keys(name, work), "count": 1.0}
        for path in (path for path in paths if path in built_in):
            record |= zip(built_in[path].columns, run_sums(evaluation.sums[TRACKS.name], path), strict=True)
        missing = np.full(len(work.scene_of_run), np.nan)
        record |= {column: evaluation.run_columns.get(column, missing) for column in plugin_columns}
        records.append(record)
    return records


def _other_tracks(work: Work, blocks: Sequence[Block], names: Iterable[str]) -> list[Record]:
    """Return the tracks of every scene but the recorded one, each in the run with the recorded run's number."""
    records: list[Record] = []
    for block in (block for block in blocks if block.piece.scene != work.recorded_scene):
        scene = work.scenes[block.piece.scene]
        for name in names:
            item = block.recorded.get(name)
            if isinstance(item, RecordedTracks):
                record = _tracks_record(name, item, scene.truth.time[scene.instants()])
                records.append({**record, "scene": float(block.piece.scene)})
    return records


def _tracks_record(name: str, recorded: RecordedTracks, time: Array) -> Record:
    history = recorded.history
    instant, column = np.nonzero(history.ids != NO_TRACK)
    return {
        "tracker": name,
        "time_s": time[instant],
        "track": history.ids[instant, column].astype(float),
        **state_columns(history.mean[:, instant, column], history.covariance[:, :, instant, column]),
        "existence": np.nan if history.existence is None else history.existence[instant, column],
    }


def _taken_record(name: str, recorded: RecordedTracks, scans: Sequence[Scan]) -> Record:
    rows = recorded.taken
    assert rows is not None
    numbers = dict(zip(("scan", "track", "detection"), rows.T.astype(float), strict=True))
    return {"tracker": name, "time_s": np.array([scan.time for scan in scans])[rows[:, 0]], **numbers}


def _gate_records(work: Work, name: str, recorded: RecordedTracks, scans: Sequence[Scan]) -> list[Record]:
    config = work.trackers[name]
    if not isinstance(config, FilterConfig) or config.associate is None or config.associate.method == "oracle":
        return []
    if not recorded.predicted:
        return []
    ids, mean, covariance = (
        np.concatenate(part, axis=-1) for part in zip(*(t[:3] for t in recorded.predicted.values()), strict=False)
    )
    number = np.repeat(list(recorded.predicted), [len(tracks.ids) for tracks in recorded.predicted.values()])
    pose, velocity = (
        np.stack(part, axis=-1)[:, number]
        for part in zip(*((s.sensor_pose, s.sensor_velocity) for s in scans), strict=False)
    )
    sensor, time = np.array([scan.sensor for scan in scans])[number], np.array([scan.time for scan in scans])[number]
    edges = np.empty((2, len(number), CORNERS))
    for scan in {scan.sensor: scan for scan in scans}.values():
        of_sensor = np.flatnonzero(sensor == scan.sensor)
        threshold = gate_threshold(config.associate.gate, len(scan.measurement))
        scan = scan._replace(sensor_pose=pose[:, of_sensor], sensor_velocity=velocity[:, of_sensor])
        edges[:, of_sensor] = gate_outlines(scan, mean[:, of_sensor], covariance[..., of_sensor], threshold)
    keys = {"time_s": time, "scan": number.astype(float), "track": ids.astype(float)}
    points = {key: np.repeat(values, CORNERS) for key, values in keys.items()}
    return [{"tracker": name, **points, "x_m": edges[0].ravel(), "y_m": edges[1].ravel()}]


def _events_record(name: str, blocks: Sequence[Timeline], work: Work) -> Record:
    """Return a tracker's errors as events: all of the run that is kept, and ``MOST_EVENTS`` costliest of other runs."""
    recorded = work.number(work.recorded_scene, work.recorded_run)
    rows = dearest([event for block in blocks for event in block.events], recorded)
    ids = [work.scenes[scene // max(work.stretches, 1)].truth.ids for scene in work.scene_of_run]

    def number(field: str) -> Array:
        return np.array([getattr(event, field) for _, event in rows], dtype=float)

    def track(field: str) -> Array:
        return np.where(number(field) >= 0, number(field), np.nan)

    def objects(field: str) -> list[str]:
        numbers = ((run, getattr(event, field)) for run, event in rows)
        return [ids[run][item] if item >= 0 else NO_OBJECT for run, item in numbers]

    return {
        "tracker": name,
        "kind": [event.kind for _, event in rows],
        "object": objects("object"),
        "other_object": objects("other_object"),
        "why": [event.why for _, event in rows],
        "run": np.array([run for run, _ in rows], dtype=float),
        "time_s": number("time"),
        "track": track("track"),
        "other_track": track("other_track"),
        "x_m": number("x"),
        "y_m": number("y"),
        "cost_m2": number("cost"),
    }


def _stretch_records(name: str, blocks: Sequence[Timeline], ids: Sequence[str], time: Array) -> list[Record]:
    """Return each object's stretches of time in one state, such as tracked or lost, in the run that is kept."""
    until = np.append(time[1:], 2 * time[-1] - time[-2] if len(time) > 1 else time[-1])
    strips = next(block.strips for block in blocks if block.strips is not None)
    records: list[Record] = []
    for item, strip in enumerate(strips.T):
        starts = np.flatnonzero(np.diff(strip, prepend=-1))
        ends = np.append(starts[1:], len(strip)) - 1
        states = [STATES[code] for code in strip[starts]]
        keys = {"tracker": name, "object": ids[item], "state": states}
        records.append({**keys, "time_s": time[starts], "until_s": until[ends]})
    return records
