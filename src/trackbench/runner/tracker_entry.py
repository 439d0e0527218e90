"""Description, failure and metrics of one tracker, as a result lists them."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from pathlib import PurePath
from typing import Any

import numpy as np

from trackbench.base.config.key_units import option_in_words
from trackbench.base.errors import counted
from trackbench.base.types import Array
from trackbench.engine.equations import EngineUsed
from trackbench.metrics import Evaluation, health, no_metrics
from trackbench.metrics.breakdown import breakdown
from trackbench.metrics.covariance_words import verdict_in_words
from trackbench.metrics.sums import ERROR
from trackbench.metrics.traffic import TRACKS, run_sums
from trackbench.results import FiledRows, Health, TrackerResult
from trackbench.runner.evaluated import Evaluated
from trackbench.runner.external_run import offset_of, remarks_on_files
from trackbench.runner.recorded import Outcome
from trackbench.runner.work import Work
from trackbench.scenario.keys import TrackerEntry
from trackbench.trackers.answers import NOT_FINITE
from trackbench.trackers.config import FilterConfig, PluginConfig
from trackbench.trackers.initial import InitialConfig
from trackbench.trackers.raw import BASELINE
from trackbench.truth.config.traffic import TracksConfig, files_in
from trackbench.truth.tracks import TrackRows


def tracker_entry(work: Work, name: str, scores: Evaluated, engine: EngineUsed | None, **fields: Any) -> TrackerResult:
    """Return the description, failure and metrics of one tracker for a result; ``fields`` are added to them."""
    config, failure = work.trackers[name], scores.failures.get(name)
    associate, use = getattr(config, "associate", None), getattr(config, "use", None)
    entry = {
        "name": name,
        "describe": describe_tracker(config, work.late_sensors),
        "use": getattr(use, "command", use),
        "association": None if associate is None else associate.method,
        "baseline": use == BASELINE,
        "sensors": config.sensors_used,
        "confirmation": None if associate is None else associate.confirmation,
        "smoother": getattr(config, "smoother", None),
        "offline": name in work.external_tracks,
        "paired": name not in work.unpaired,
        "engine": None if engine is None else engine.engine,
        **fields,
        "failed": failure,
    }
    if failure is not None:
        values = no_metrics("the tracker failed", work.reported_metrics)
        return TrackerResult(
            **entry, metrics=values, health=Health(non_finite_estimates=int(failure.cause == NOT_FINITE))
        )
    evaluation = scores.evaluations[name]
    entry["metrics"] = evaluation.values
    if name in scores.scores:
        conditions = breakdown(evaluation.scores)
        entry["metrics"] = {
            path: metric.model_copy(update={"words": verdict_in_words(metric, conditions) or None})
            if metric.dof
            else metric
            for path, metric in evaluation.values.items()
        }
        return TrackerResult(**entry, health=health(scores.scores[name]), conditions=conditions)
    if name in work.external_tracks:
        pairs = [block.offset for block in scores.outcomes[name] if block.offset is not None]
        offset = offset_of(np.concatenate(pairs, axis=1))
        entry |= {"time_offset": offset.time, "offset_shown": offset.shown}
        remarks = remarks_on_files(work, name, evaluation.values["matched_share"].value or 0.0)
        entry["filed"] = _external_rows(work.external_tracks[name], scores.outcomes[name], remarks)
    reused = sum(block.timeline.reused_ids for block in scores.outcomes[name])
    return TrackerResult(**entry, health=Health(reused_ids=reused))


def _external_rows(files: Sequence[TrackRows], blocks: Sequence[Outcome], remarks: tuple[str, ...]) -> FiledRows:
    counts = [block.external_rows for block in blocks if block.external_rows is not None]
    read, inside, silent = np.sum(counts, axis=0).tolist()
    total = sum(map(len, files))
    # Without a column run, all scenes of one file share its rows.
    outside = (read if any(rows.run is not None for rows in files) else total) - inside
    return FiledRows(rows=total, outside=max(outside, 0), silent_runs=silent, remarks=remarks)


def headline_sums(work: Work, evaluation: Evaluation) -> tuple[Array, Array]:
    """Return the sums ``(runs,)`` of the squared metric that ranks trackers, and the numbers of their terms."""
    if TRACKS.name in evaluation.sums:
        total, count = run_sums(evaluation.sums[TRACKS.name], work.headline)
        return total, count
    sums = evaluation.scores.per_run
    return sums[ERROR["px"]] + sums[ERROR["py"]], sums[ERROR["count"]]


def describe_tracker(tracker: TrackerEntry, late: Collection[str]) -> str:
    """Describe a tracker in a few words; ``late`` has the names of the sensors whose scans arrive late."""
    if isinstance(tracker, TracksConfig):
        moved = f", time offset {tracker.time_offset_s:g} s" if tracker.time_offset_s else ""
        files = files_in(tracker.path)
        what = PurePath(files[0]).name if len(files) == 1 else counted(len(files), "file")
        return f"made elsewhere, {what}{moved}"
    if isinstance(tracker, PluginConfig):
        options = ", ".join(f"{key} {value}" for key, value in tracker.options.items())
        parts = [str(tracker.use), options]
    else:
        parts = [tracker.filter, *([f"{tracker.smoother} smoother"] if tracker.smoother else [])]
        parts += tracker.motion_in_words
        if tracker.process_noise_diag is not None:
            parts.append(f"constant Q {_diagonal(tracker.process_noise_diag)}")
        parts += [f"{sensor} taken for a {kind}" for sensor, kind in tracker.sensor_models.items()]
        for sensor, sigmas in tracker.measurement_noise.items():
            parts += [f"{sensor} with {option_in_words(key, value)}" for key, value in sigmas.items()]
        for sensor, effects in tracker.assume.items():
            parts.append(f"{sensor} with {' and '.join(effects.names)} assumed")
        parts += [_initial(tracker), _late(tracker, late)]
    parts.append("all sensors" if tracker.sensors is None else " + ".join(tracker.sensors))
    return ", ".join(part for part in parts if part)


def _initial(tracker: FilterConfig) -> str:
    """Say how tracks start: "initial: two_measurements with skip 3"; empty for the default."""
    initial, default = tracker.initial, InitialConfig()
    changed = {name: value for name, value in initial if value != getattr(default, name)}
    if not changed:
        return ""
    changed.pop("source", None)
    words = [_option(name, value) for name, value in changed.items()]
    return f"initial: {initial.source}" + (f" with {' and '.join(words)}" if words else "")


def _late(tracker: FilterConfig, late: Collection[str]) -> str:
    read = late if tracker.sensors_used is None else set(late) & set(tracker.sensors_used)
    if not read or tracker.smoother is not None:
        return ""
    lag = f" within {tracker.lag_s:g} s" if "lag_s" in tracker.model_fields_set else ""
    return f"late: {tracker.late}{lag}"


def _option(name: str, value: Any) -> str:
    if name == "covariance_diag":
        return f"covariance {_diagonal(value)}"
    return option_in_words(name, " + ".join(value) if name == "sensors" else value)


def _diagonal(variances: Sequence[float]) -> str:
    return f"diag({', '.join(f'{variance:g}' for variance in variances)})"
