"""Assembly of a scenario's result from its blocks, the groups of Monte-Carlo runs that are made together."""

from __future__ import annotations

import hashlib
import logging
import math
import platform
from collections.abc import Mapping, Sequence
from dataclasses import replace
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

import numpy as np

from trackbench.base.config.key_units import SPELLINGS
from trackbench.base.errors import counted
from trackbench.base.subjects import collected
from trackbench.base.types import Array, Truth
from trackbench.engine.equations import EngineUsed, joined_engines
from trackbench.metrics import BUILT_IN, Metric
from trackbench.metrics.differences import MOST_PAIRED, Family, tracker_differences
from trackbench.metrics.evaluate import log_broken
from trackbench.models.sensors import Sensor
from trackbench.results import Result, Summary, Tables, difference_table
from trackbench.results.columns import table_of
from trackbench.results.scenario_summary import (
    MarginSummary,
    MetricSummary,
    ReferenceSummary,
    ScenarioSummary,
    SceneSummary,
    ScoreSummary,
    SensorSummary,
    TruthSummary,
    sentence_on_point,
)
from trackbench.runner.block import Block
from trackbench.runner.estimate_records import records_of_estimates
from trackbench.runner.evaluated import Evaluated, evaluate_trackers, judge
from trackbench.runner.shared_records import other_truth, road_records, truth_records
from trackbench.runner.track_records import records_of_tracks
from trackbench.runner.tracker_entry import headline_sums, tracker_entry
from trackbench.runner.work import Work
from trackbench.scenario import Scenario
from trackbench.scenario.worlds import MEANING
from trackbench.sensing.scans import fingerprint_of, scan_rate
from trackbench.truth import LoadedTruth
from trackbench.truth.base import Recorded

if TYPE_CHECKING:
    import pyarrow as pa

log = logging.getLogger(__name__)


def log_left_to_numpy(where: str, name: str, used: EngineUsed) -> None:
    """Log that the fused engine left a tracker, or a part of it, to NumPy, and why; ``where``: scenario or task."""
    if used.why_numpy:
        how = "computed by NumPy" if used.engine == "numpy" else "computed by NumPy in part"
        # The author of a pure model expects machine code.
        level = logging.WARNING if used.of_pure else logging.INFO
        log.log(level, "%s: %s was %s: %s", where, name, how, used.why_numpy)
    if used.again:
        members = counted(used.again, "member")
        log.info("%s: %s: %s of batches computed again by NumPy, where the trace did not hold", where, name, members)


PACKAGES = ("trackbench", "highway-env", "gymnasium", "numpy", "scipy", "rerun-sdk")


def versions() -> dict[str, str]:
    """Return the versions of Python and of the packages that numbers may depend on."""
    return {"python": platform.python_version(), **{name: version(name) for name in PACKAGES}}


def assemble(
    loaded: Scenario, truths: Sequence[LoadedTruth], work: Work, blocks: Sequence[Block], command: str
) -> Result:
    """Return the result of a run from its blocks; ``command`` is the command line that reproduces it."""
    scenario = loaded.config
    scores = evaluate_trackers(work, blocks)
    margin = MarginSummary(**scenario.score.margin.model_dump())
    engines: dict[str, EngineUsed] = {}
    for name in work.trackers:
        used = joined_engines([block.engines[name] for block in blocks if name in block.engines])
        if used is not None:
            engines[name] = used
            log_left_to_numpy(work.scenario, name, used)
    every_engine = joined_engines(engines.values())
    log_broken(evaluation.broken for evaluation in scores.evaluations.values())
    random = frozenset[str]().union(*(block.random for block in blocks))
    trackers = [
        tracker_entry(work, name, scores, engines.get(name), place=place, random=name in random)
        for name, place in loaded.places.items()
        if name in work.trackers
    ]
    reference = _reference(scenario.score.reference.acceleration_sigma_mps2, work)
    suspect = {tracker.name for tracker in trackers if tracker.beats_bound(reference)}
    scores = replace(scores, ranked=[name for name in scores.ranked if name not in suspect])
    references = {tracker.name for tracker in trackers if tracker.is_reference}
    baseline = scenario.score.baseline if scenario.score.baseline in scores.ranked else None
    contenders = [name for name in scores.ranked if name not in references | work.unpaired]
    best = contenders[0] if baseline is None and len(contenders) > MOST_PAIRED else None
    expected = {
        (item.metric, frozenset((item.tracker, item.better_than))) for item in scenario.expect if item.better_than
    }
    family = Family(baseline or best, best is not None, expected)
    pairs = []
    if work.has_truth:
        names = [name for name in scores.evaluations if name in scores.ranked and name not in work.unpaired]
        names = [name for name in names if best is None or name not in references]
        intervals, values = (
            {name: getattr(scores.evaluations[name], field) for name in names} for field in ("intervals", "values")
        )
        pairs = tracker_differences(intervals, work.metrics, margin, values, family)
    expectations = judge(scenario.expect, trackers, pairs, work.min_coverage)
    instants = [scene.truth.time[scene.instants()] for scene in work.scenes]
    summary = Summary(
        identities=scenario.sensing.identities,
        scenario=ScenarioSummary(
            name=scenario.full_name,
            world=scenario.world,
            description=_description(loaded),
            file=loaded.path.name,
            text=loaded.text,
            overrides=list(loaded.overrides),
        ),
        seed=work.seed,
        runs=len(work.scene_of_run),
        versions=versions(),
        # Without built-in trackers: the engine that computed the scores.
        engine=work.engine if every_engine is None else every_engine.engine,
        command=command,
        fingerprints=[text for block in blocks for digest in block.digests for text in _fingerprints(work, digest)],
        truth=_truth(loaded, truths, work, scores),
        sensors=_sensors(work, blocks),
        reference=reference,
        score=ScoreSummary(
            settle_s=work.settle,
            divergence_m=scenario.score.divergence_m,
            point=scenario.score.point,
            min_coverage=work.min_coverage,
            cutoff_m=work.track_score and work.track_score.cutoff,
            from_s=min(float(time[0]) for time in instants),
            to_s=max(float(time[-1]) for time in instants),
            margin=margin,
            baseline=baseline,
            best=best,
            metrics=[
                _summary_of_metric(metric)
                for metric in work.metrics
                if metric not in BUILT_IN and (metric.columns or metric.per_sensor)
            ],
        ),
        recorded_run=work.number(work.recorded_scene, work.recorded_run),
        trackers=trackers,
        ranking=[*scores.ranked, *(name for name in work.trackers if name not in scores.ranked)],
        expectations=expectations,
        passed=all(item.passed for item in expectations) and not suspect,
        artifacts={},
    )
    tables = _tables(work, blocks, scores)
    return Result(summary, Tables({**tables, "differences": difference_table(pairs)}))


def _description(loaded: Scenario) -> str:
    scenario = loaded.config
    world = MEANING[scenario.world] if scenario.world is not None else ""
    return "; ".join(filter(None, (scenario.description, world, sentence_on_point(scenario.score.point))))


def _reference(stated_acceleration: float | None, work: Work) -> ReferenceSummary | None:
    if work.reference is None:
        return None
    affected = any(sensor.config.effects for sensor in work.scenes[0].sensors) or work.scenes[0].point != "centre"
    return ReferenceSummary(
        kind="bound" if work.reference.as_drawn and not affected else "reference",
        acceleration_sigma_mps2=work.reference.acceleration,
        acceleration_from="truth" if stated_acceleration is None else "scenario",
    )


def _fingerprints(work: Work, digest: bytes) -> list[str]:
    """Return the fingerprint of a run's measurements, from their ``digest``; one per stretch of a log cut in time."""
    if not work.stretches:
        return [fingerprint_of(digest)]
    parts = (hashlib.sha256(digest + b"%d of %d" % (n, work.stretches)) for n in range(work.stretches))
    return [fingerprint_of(part.digest()) for part in parts]


def _summary_of_metric(metric: Metric) -> MetricSummary:
    return MetricSummary(
        name=metric.name,
        unit=metric.unit,
        meaning=metric.meaning,
        better=metric.better,
        compared=metric.compared and metric.better is not None,
        per_sensor=metric.per_sensor,
        options=metric.model_dump(mode="json", fallback=str),
    )


def _sensors(work: Work, blocks: Sequence[Block]) -> dict[str, SensorSummary]:
    """Return a summary of each sensor, with its detections per object in view, over instants, objects and runs."""
    summaries = {}
    for number, sensor in enumerate(work.scenes[0].sensors):
        detected = sum(block.detections.get(sensor.name, 0) for block in blocks)
        in_view = sum(float(scene.sensors[number].visible.mean(axis=-1).sum() * work.runs) for scene in work.scenes)
        config = sensor.config
        summaries[sensor.name] = SensorSummary(
            kind=config.type,
            sigmas=_sigmas(config),
            fov_deg=config.fov_deg,
            max_range_m=config.max_range_m,
            rate_hz=scan_rate(sensor),
            preset=config.preset,
            detection_rate=float(detected / in_view) if in_view > 0 and sensor.detections is None else None,
            latency_s=config.latency,
            effects=tuple(effect.model_dump(mode="json", fallback=str) for effect in config.effects),
        )
    return summaries


def _sigmas(sensor: Sensor) -> dict[str, float]:
    """Return the standard deviation of each component by name and unit, such as ``azimuth_deg``."""
    sigmas = {}
    for name, unit, sigma in zip(sensor.components, sensor.units, sensor.sigmas(), strict=True):
        value, unit = (math.degrees(sigma), "deg") if unit == "rad" else (sigma, SPELLINGS.get(unit, unit))
        sigmas[f"{name}_{unit}"] = float(f"{value:.4g}")
    return sigmas


def scene_fingerprint(truth: Truth, measurements: Mapping[str, Recorded] | None = None) -> str:
    """Return a text that identifies traffic, also if it is recorded for a shorter time or at another rate.

    Each whole second adds six digits: a hash of all objects' positions, to a millimetre and in any order. The text of
    a shorter record is therefore the start of the text of a longer one. Without a truth, hash all measurements.
    """
    if not truth.known:
        digest = hashlib.sha256()
        for name, record in sorted((measurements or {}).items()):
            digest.update(name.encode() + truth.time[record.steps].tobytes() + record.measurement.tobytes())
        return digest.hexdigest()[:16]
    elapsed = truth.time - truth.time[0]
    whole = np.round(elapsed)
    elapsed = np.where(np.abs(elapsed - whole) < 1e-6, whole, elapsed)
    # Where the motion is drawn anew in each run, the first run stands for all.
    x, y = (path if path.ndim == 2 else path[..., 0] for path in (truth.px, truth.py))
    seconds = np.arange(math.floor(elapsed[-1]) + 1)
    at = [[np.interp(seconds, elapsed, path) for path in paths.T] for paths in (x, y)]
    # Adding 0.0 turns -0.0 into 0.0.
    places = np.round(np.array(at).reshape(2, x.shape[1], len(seconds)), 3) + 0.0
    texts = []
    for place in places.transpose(2, 1, 0):
        positions = sorted(each.tobytes() for each in place[np.isfinite(place).all(axis=1)])
        texts.append(hashlib.sha256(b"".join(positions)).hexdigest()[:6])
    return "".join(texts)


def _truth(loaded: Scenario, truths: Sequence[LoadedTruth], work: Work, scores: Evaluated) -> TruthSummary:
    truth, scenes = truths[work.recorded_scene].truth, list[SceneSummary]()
    if len(truths) > 1 or work.stretches:
        errors: dict[str, Array] = {}
        for name in scores.ranked:
            total, count = (
                np.bincount(work.scene_of_run, sums) for sums in headline_sums(work, scores.evaluations[name])
            )
            errors[name] = np.sqrt(total / np.where(count > 0, count, np.nan))
        cuts = max(work.stretches, 1)
        for item, source in zip(truths, loaded.config.truth.scenes(), strict=True):
            for place in range(cuts):
                scene, name = len(scenes), source.scene_name
                name = f"{name or 'stretch'} {place + 1}" if work.stretches else name
                scenes.append(
                    SceneSummary(
                        name=name or f"scene {scene + 1}",
                        objects=list(item.truth.ids),
                        duration_s=float(item.truth.time[-1]) / cuts,
                        audit=item.truth.audit,
                        error={name: float(each[scene]) for name, each in errors.items() if np.isfinite(each[scene])},
                    )
                )
    entries = {
        "objects": list(truth.ids),
        "known": truth.known,
        "steps": len(truth.time),
        "dt": float(truth.time[1] - truth.time[0]) if len(truth.time) > 1 else None,
        "duration_s": float(truth.time[-1]),
        "audit": truth.audit,
        "cached": all(item.cached for item in truths),
        "scenes": scenes,
        "few_scenes_decide": work.few_scenes_decide,
        **({"stretches": work.stretches} if work.stretches else {}),
        "motion": [scene_fingerprint(item.truth, item.measurements) for item in truths],
    }
    return TruthSummary.model_validate({**truth.source, **entries})


def _tables(work: Work, blocks: Sequence[Block], evaluated: Evaluated) -> dict[str, pa.Table]:
    """Return all tables of a result, such as ``steps`` and ``runs``, by name."""
    truth = work.scenes[work.recorded_scene].truth
    block = next(block for block in blocks if block.recorded_scans is not None)
    assert block.recorded_scans is not None
    recorded: dict[str, Any] = {name: item for name, item in block.recorded.items() if name in evaluated.evaluations}
    if work.hidden:
        records = records_of_tracks(work, blocks, evaluated, block.recorded_scans, recorded)
    else:
        records = records_of_estimates(work, evaluated, block.recorded_scans, recorded)
    records |= {
        "truth": truth_records(truth, work.recorded_run),
        **other_truth(work),
        "roads": road_records(truth),
        **dict(collected("records", work, evaluated, recorded)),
        **({"answers": [record for block in blocks for record in block.answers]} if work.keeps_answers else {}),
    }
    return {name: table_of(parts) for name, parts in records.items()}
