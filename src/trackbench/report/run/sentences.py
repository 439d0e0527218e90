"""The sentences of a run's report, also those on the truth audit."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from trackbench.base.errors import counted
from trackbench.metrics.differences import SILENCE
from trackbench.metrics.verdict_words import MEANING, conditions_off, mean_text
from trackbench.report.numbers import decimals, fixed, half_width, interval, joined, margin_words, percent
from trackbench.report.run.calibration import calibration_clauses
from trackbench.report.run.pairs import Pairs
from trackbench.report.run.scenes import runs_in_words
from trackbench.results import (
    MOST_DRAWN,
    ExpectationResult,
    Health,
    PrecisionReached,
    Result,
    TrackerResult,
    TruthAudit,
    TruthSummary,
)


def facts(result: Result) -> tuple[str, ...]:
    """The run in a few words."""
    summary, truth = result.summary, result.summary.truth
    options = truth.model_extra or {}
    source = " ".join(str(part) for part in (truth.source, options.get("env")) if part)
    return (
        f"{source}, other motion in each run" if options.get("random") else source,
        runs_in_words(result),
        truth.vehicles,
        duration(result),
        counted(len(summary.sensors), "sensor"),
        counted(len(summary.trackers), "tracker"),
        f"seed {summary.seed}",
        summary.engine_in_words,
    )


def duration(result: Result) -> str:
    """How long the truth is, and which part of it is scored where the sensors do not look all the time."""
    length, score = result.summary.truth.duration_s, result.summary.score
    period = max((1 / sensor.rate_hz for sensor in result.summary.sensors.values() if sensor.rate_hz), default=0.0)
    whole = score.from_s <= period and length - score.to_s <= period
    part = "" if whole else f" ({fixed(score.from_s, 1)} to {fixed(score.to_s, 1)} s scored)"
    return f"{fixed(length, 1)} s{part}"


def verdict(tracker: TrackerResult, runs: int, reference: str) -> str:
    """One sentence on a tracker's accuracy, consistency and health, without its name.

    For example "0.412 m position RMSE, 1.38 times the reference; mixed: the errors are larger or smaller than its
    covariance states, depending on the condition (NEES 4.2, turning 39.7, straight 2.9 where 4 is right); optimistic
    about velocity in turns (errors 3.1 times as large as stated)". ``reference`` is what the reference is called.
    """
    rmse, nees = tracker.position_rmse.value, tracker.metrics.get("nees")
    over = tracker.metrics.get("position_over_reference")
    times = "" if over is None or over.value is None else f", {fixed(over.value, 2)} times the {reference}"
    parts = [f"{fixed(rmse, decimals([rmse]))} m position RMSE{times}"]
    if nees is None or nees.mean is None or nees.verdict is None:
        parts.append(f"NEES n/a: {nees.reason}" if nees is not None and nees.reason else "no covariance to judge")
    else:
        found = f"NEES {mean_text(nees.mean)} where {nees.dof} is right"
        off = conditions_off(nees)
        parts.append(f"{nees.verdict}: {MEANING[nees.verdict]} ({found}{f'; by condition: {off}' if off else ''})")
        if tracker.breakdown is not None:
            parts += calibration_clauses(tracker.breakdown)
    return "; ".join(parts + _complaints(tracker.health, runs))


def _complaints(health: Health, runs: int) -> list[str]:
    found = []
    if health.diverged_runs:
        found.append(f"diverged in {health.diverged_runs} of {counted(runs, 'run')}")
    if health.repaired_covariances:
        found.append(f"covariance repaired {counted(health.repaired_covariances, 'time')}")
    if health.non_finite_estimates:
        found.append(counted(health.non_finite_estimates, "non-finite estimate"))
    return found


def common(result: Result) -> str:
    """Which estimates count, where some trackers gave more than others."""
    share = result.summary.score.common_share
    if share is None or share > 1 - SILENCE:
        return ""
    return f" Errors count where every ranked tracker gave an estimate: {percent(share, 1)} of all."


def not_called_better(result: Result) -> list[str]:
    """Whose smaller errors do not count as better, since it gave fewer estimates, and what helps; empty of none.

    For example "but own, kf: smaller errors than raw, not called better: 5 % fewer estimates".
    """
    shares = Pairs(result.summary).fewer_estimates([tracker.name for tracker in result.contenders])
    alike: dict[tuple[str, ...], list[str]] = {}
    for name, by_other in shares.items():
        alike.setdefault(tuple(by_other), []).append(name)
    found = []
    for others, names in alike.items():
        fewer = _from_to([shares[name][other] for name in names for other in others])
        found.append(
            f"but {', '.join(names)}: smaller errors than {joined(others)}, not called better: {fewer} fewer estimates"
        )
    if found and result.summary.score.settle_s == 0:
        found.append("score.settle_s leaves the time after a track's start out of the scores")
    return found


def _from_to(shares: Sequence[float]) -> str:
    """ "5 %", "2 % to 5 %"."""
    return " to ".join(dict.fromkeys(percent(end(shares)) for end in (min, max)))


def failure(result: Result, tracker: TrackerResult) -> str:
    """Why a tracker is not ranked; where it failed, the cause and where it happened."""
    return result.why_unscored(tracker) if tracker.failed is None else str(tracker.failed)


def headline(result: Result) -> str:
    """Which tracker is the most accurate, by how much, and whether the difference was shown.

    One that knows the true origin of each detection is not held against the others.
    """
    order = result.contenders
    if not order:
        return _why_nobody(result)
    summary, names = result.summary, [tracker.name for tracker in order]
    metric, known = order[0].metrics[summary.headline], summary.identities == "known"
    places = decimals([metric.value, half_width(metric)], 1)
    bounds = f" (95 % interval {interval(metric.ci95, places)} m)" if metric.ci95 else ""
    value = fixed(metric.value, places)
    lead = f"is the most accurate in position: {value} m RMSE" if known else f"has the smallest GOSPA: {value} m"
    text = f"{names[0]} {lead}{bounds}"
    if len(names) == 1:
        return text + "."
    pairs = Pairs(result.summary)
    found = {name: pair.verdict for name in names[1:] if (pair := pairs.get(names[0], name))}
    equivalent, undecided = ([name for name in found if found[name] == what] for what in ("equivalent", "undecided"))
    if equivalent:
        margin = margin_words(result.summary.score.margin, "m")
        text += f"; equivalent to {_named(equivalent)} (within {margin})"
    if undecided:
        text += f"; whether it is better than {_named(undecided)} is undecided"
    if fewer := pairs.fewer_estimates(names).get(names[0], {}):
        share = _from_to([*fewer.values()])
        text += f"; it is not called better than {_named([*fewer])}, since it gave {share} fewer estimates"
    if equivalent or undecided or fewer:
        return text + "."
    second = pairs.get(names[1], names[0])
    if second is None:
        return text + "."
    gap = decimals([(second.ci95[1] - second.ci95[0]) / 2] if second.ci95 else [second.value], 1)
    bounds = f" (95 % interval {interval(second.ci95, gap)} m)" if second.ci95 else ""
    of_next = f"The {'RMSE' if known else 'GOSPA'} of the next, {names[1]},"
    return f"{text}. {of_next} is {fixed(second.value, gap)} m larger{bounds}."


def _why_nobody(result: Result) -> str:
    """Why no tracker is ranked: where all finished and identities are hidden, there was nothing to track."""
    reasons = {failure(result, tracker) for tracker in result.unscored if tracker.failed is None}
    if result.summary.identities == "hidden" and len(reasons) == 1:
        (reason,) = reasons
        return f"{reason[0].upper()}{reason[1:]}."
    return "No tracker finished."


def _named(trackers: Sequence[str]) -> str:
    return joined(trackers) if len(trackers) <= MOST_DRAWN else counted(len(trackers), "tracker")


def precision_reached(precision: PrecisionReached, runs: int) -> str:
    """Whether the precision that was asked for was reached, and after how many runs."""
    wanted = f"{percent(precision.target, 2)} wanted"
    if precision.half_width is None:
        return f"precision: no two trackers to compare after {counted(runs, 'run')}; {wanted}"
    pair = f"{precision.best} against {precision.second}"
    found = f"{pair} ±{percent(precision.half_width, 2)} after {counted(runs, 'run')}"
    return f"precision: {found}; {wanted}" + ("" if precision.reached else ", not reached")


def expectations_met(expectations: Sequence[ExpectationResult]) -> str:
    """ "All 3 expectations met", "1 of 3 expectations failed", "No expectations stated"."""
    total, failed = len(expectations), sum(not item.passed for item in expectations)
    if not total:
        return "No expectations stated"
    if failed:
        return f"{failed} of {counted(total, 'expectation')} failed"
    return f"All {total} expectations met" if total > 1 else "The expectation is met"


#: m/s or m; what is smaller is not worth its digits.
_NEGLIGIBLE = 0.001

#: By scene; a single one has no name.
Audits = Mapping[str, TruthAudit]


def audit_sentences(truth: TruthSummary) -> list[str]:
    """The findings of ``trackbench.truth.audit`` in all scenes as sentences, the conclusion first."""
    of_scenes = {scene.name: scene.audit for scene in truth.scenes} or {"": truth.audit}
    audits = {name: audit for name, audit in of_scenes.items() if audit is not None}
    if not audits:
        return ["The truth was not audited."]
    return [_conclusion(audits), *_velocity(audits), *_velocity_jumps(audits), *_cuts(audits), *_clock(audits)]


def _conclusion(audits: Audits) -> str:
    repaired = [name for name, audit in audits.items() if audit.verdict == "repaired"]
    if len(repaired) == 1 == len(audits):
        return "The truth had faults, which were repaired before anything was scored."
    if repaired:
        share = f"{len(repaired)} of {len(audits)} scenes"
        return f"The truth of {share} had faults, which were repaired before anything was scored."
    if all(audit.verdict == "exact" for audit in audits.values()):
        return "The truth is exact: its velocities come from the same formulas as its positions."
    return "The truth is consistent: velocity agrees with displacement, no position jumps."


def _velocity(audits: Audits) -> Iterator[str]:
    scene, audit = max(audits.items(), key=lambda item: item[1].velocity_error_before.max_mps or 0.0)
    before, after, repaired = audit.velocity_error_before, audit.velocity_error_after, audit.repaired
    left = [item.velocity_error_after.max_mps for item in audits.values()]
    most = max((error for error in left if error is not None), default=None)
    if not before.max_mps or after.max_mps is None or most is None:
        return
    sources = {
        "course and slip angle": repaired.velocity_from_course_and_slip,
        "displacement": repaired.velocity_from_displacement,
    }
    if not any(sources.values()):
        yield f"The stated velocity differs from the displacement by {_at_most(most)} m/s."
        return
    how = joined([f"from {source} for {joined(names)}" for source, names in sources.items() if names])
    yield (
        f"The simulator's velocity contradicted the motion by up to {_two_digits(before.max_mps)} m/s "
        f"({_place(before.object, before.time_s, scene)}); it was computed {how}, which leaves {_at_most(most)} m/s."
    )


def _velocity_jumps(audits: Audits) -> Iterator[str]:
    found = {name: audit.velocity_jumps for name, audit in audits.items()}
    peak = max((jumps.peak_acceleration_mps2 or 0.0 for jumps in found.values()), default=0.0)
    count = sum(jumps.count for jumps in found.values())
    scene, worst = max(found.items(), key=lambda item: item[1].largest_mps or 0.0)
    if worst.largest_mps is None:
        if peak > 0:
            yield f"No velocity jumps: the largest acceleration is {_two_digits(peak)} m/s\N{SUPERSCRIPT TWO}."
        return
    yield (
        f"{counted(count, 'velocity jump')}: in one step the velocity changes by more than a car can do, which is put "
        f"at {worst.limit_mps2:g} m/s\N{SUPERSCRIPT TWO}, twice the grip of a tyre. The largest is "
        f"{_two_digits(worst.largest_mps)} m/s ({_place(worst.object, worst.time_s, scene)}), the peak acceleration "
        f"{fixed(peak, 0)} m/s\N{SUPERSCRIPT TWO}."
    )


def _cuts(audits: Audits) -> Iterator[str]:
    for scene, audit in audits.items():
        for jump in audit.jumps:
            if jump.object != "observer":
                when = f"at {fixed(jump.time_s, 2)} s{_of(scene)}"
                yield f"{jump.object} jumps by {_two_digits(jump.distance_m)} m {when}, and is left out from then on."
        if audit.ended_early is not None:
            end = fixed(audit.ended_early.time_s, 2)
            yield f"The truth{_of(scene)} ends at {end} s: {audit.ended_early.reason}."


def _clock(audits: Audits) -> Iterator[str]:
    drifts = [audit.clock_drift_s or 0.0 for audit in audits.values() if audit.repaired.own_clock]
    if drifts:
        drift = fixed(max(drifts), 3)
        yield f"The simulator's clock was off by up to {drift} s; time is counted from its steps instead."


def _place(name: str | None, time_s: float | None, scene: str) -> str:
    return f"{name} at {fixed(time_s, 2)} s{_of(scene)}"


def _of(scene: str) -> str:
    return f" of {scene}" if scene else ""


def _at_most(value: float) -> str:
    return f"less than {_NEGLIGIBLE:g}" if value < _NEGLIGIBLE else f"at most {_two_digits(value)}"


def _two_digits(value: float) -> str:
    return fixed(value, decimals([value], 2))
