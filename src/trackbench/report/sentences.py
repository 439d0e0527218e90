"""Sentences about a run: what went wrong, which tracker is best and how surely, facts, expectations and remarks."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC

from trackbench.base.errors import counted
from trackbench.base.subjects import collected
from trackbench.metrics.differences import MOST_CHARGED
from trackbench.report.numbers import decimals, joined_names, meaningful_decimals, percent, rounded
from trackbench.report.pairs import Pairs
from trackbench.report.scenes import runs_in_words
from trackbench.report.tables import metric_of, value_text
from trackbench.report.verdicts import ANSWERS, EXPECTATIONS, REMARKS
from trackbench.results import (
    ExpectationResult,
    MetricValue,
    Result,
    TrackerResult,
)
from trackbench.results.tracker_result import BEATS_BOUND


def facts(result: Result, trackers: int) -> tuple[str, ...]:
    """Return facts about a run, such as its seed, a few words each; ``trackers``: number of trackers."""
    summary, truth = result.summary, result.summary.truth
    options = truth.model_extra or {}
    source = " ".join(str(part) for part in (truth.source, options.get("env")) if part)
    return (
        f"{source}, different motion in each run" if options.get("random") else source,
        runs_in_words(result),
        truth.vehicles,
        duration(result),
        counted(len(summary.sensors), "sensor"),
        counted(trackers, "tracker"),
        f"seed {summary.seed}",
        summary.engine_in_words,
    )


def provenance(result: Result) -> list[tuple[str, str]]:
    """Return time, commit and code hashes of a run as pairs of label and text; an empty list if not recorded."""
    origin = result.summary.provenance
    if origin is None:
        return []
    reason = f": {origin.no_commit}" if origin.no_commit else ""
    return [
        ("made", f"{origin.made_at.astimezone(UTC):%Y-%m-%d %H:%M:%S} UTC"),
        ("commit of the scenario", f"{origin.commit_in_words}{reason}"),
        *((f"code of {name}", f"sha256 {code[:16]}" if code else "not found") for name, code in origin.code.items()),
    ]


def duration(result: Result) -> str:
    """Return the length of the truth as text, with the scored time if that is shorter by more than a scan period."""
    length, score = result.summary.truth.duration_s, result.summary.score
    period = max((1 / sensor.rate_hz for sensor in result.summary.sensors.values() if sensor.rate_hz), default=0.0)
    is_whole = score.from_s <= period and length - score.to_s <= period
    part = "" if is_whole else f" ({rounded(score.from_s, 1)} to {rounded(score.to_s, 1)} s scored)"
    return f"{rounded(length, 1)} s{part}"


def divergence(tracker: TrackerResult, runs: int) -> str:
    """Return how often a tracker diverged, as the words "diverged in 1 of 10 runs"; empty if it never did."""
    number = tracker.health.diverged_runs
    return f"diverged in {number} of {counted(runs, 'run')}" if number else ""


def others_ignored(result: Result) -> list[str]:
    """Return a list with a remark that tracks on no object are ignored; an empty list if they are scored."""
    return [REMARKS["others ignored"]] * ("others" in (result.summary.truth.model_extra or {}))


def reused_identities(result: Result) -> list[str]:
    """Return a list with a remark on trackers that used a track id for two tracks; empty if none did."""
    reuses = [(tracker.name, tracker.health.reused_ids) for tracker in result.scored]
    trackers = ", ".join(f"{name} {counted(number, 'time')}" for name, number in reuses if number)
    return [REMARKS["used again"].format(trackers=trackers)] if trackers else []


def external_tracks(result: Result) -> list[str]:
    """Return remarks on tracks read from files: their origin, ignored rows, and the offset of their time stamps."""
    trackers = [tracker for tracker in result.scored if tracker.offline]
    sentences = [REMARKS["elsewhere"].format(names=joined_names([t.name for t in trackers]))] if trackers else []
    for tracker in trackers:
        name, file, offset = tracker.name, tracker.filed, tracker.time_offset
        if not tracker.paired:
            sentences.append(REMARKS["not paired"].format(name=name))
        if file is not None and (file.outside or file.silent_runs):
            rows, runs = f"{file.outside} of {counted(file.rows, 'row')}", counted(file.silent_runs, "run")
            sentences.append(REMARKS["left out"].format(name=name, rows=rows, runs=runs))
        sentences += [f"{name}: {remark}" for remark in (file.remarks if file else ())]
        if tracker.offset_shown and offset and offset.value is not None and offset.ci95:
            low, high = (1e3 * end for end in offset.ci95)
            shift = f"{1e3 * offset.value:+.1f} ms (95 %: {low:+.1f} to {high:+.1f})"
            sentences.append(REMARKS["clock"].format(name=name, shift=shift, seconds=f"{offset.value:.3g}"))
    return sentences


def missing_estimates(result: Result) -> list[str]:
    """Return remarks on large charges for missing estimates, and on pairs undecided because of these charges."""
    sentences = []
    for tracker in result.scored:
        for path, error in (("position_rmse", "position error"), ("velocity_rmse", "velocity error")):
            metric = tracker.metrics.get(path)
            if metric is not None and metric.charged_share is not None and metric.charged_share > MOST_CHARGED:
                without = f"{rounded(metric.without_charged, decimals([metric.without_charged]))} {metric.unit}"
                share = percent(metric.charged_share)
                text = REMARKS["charged"].format(name=tracker.name, share=share, error=error, without=without)
                sentences.append(text)
    smaller = Pairs(result).only_by_charges([tracker.name for tracker in result.contenders])
    return sentences + [
        REMARKS["not called better"].format(name=name, others=joined_names(others)) for name, others in smaller.items()
    ]


def below_the_bound(result: Result) -> list[str]:
    """Return a remark on each competing tracker whose error is shown to be below the reference bound."""
    below = [tracker.name for tracker in result.contenders if tracker.below_reference]
    return [REMARKS["below"].format(name=name, label=result.summary.held_against.label) for name in below]


def expectations_met(expectations: Sequence[ExpectationResult]) -> str:
    """Return in words whether all expectations are met, or how many failed and are undecided."""
    failed, undecided = (sum(item.outcome == word for item in expectations) for word in ("failed", "undecided"))
    kind = "not met" if failed or undecided else ("none", "one met", "met")[min(len(expectations), 2)]
    stated = counted(len(expectations), "expectation")
    return EXPECTATIONS[kind].format(failed=failed, undecided=undecided, stated=stated).removesuffix(", 0 undecided")


def remarks(result: Result) -> list[str]:
    """Return remarks on trackers, such as large charges, errors below a bound, ignored tracks and reused identities."""
    competing = {tracker.name for tracker in result.contenders}
    kinds = {tracker.reference_kind for tracker in result.scored if tracker.name not in competing}
    return [
        *missing_estimates(result),
        *below_the_bound(result),
        *others_ignored(result),
        *reused_identities(result),
        *external_tracks(result),
        *(REMARKS[kind] for kind in ("reference", "offline") if kind in kinds),
    ]


def value_and_limit(item: ExpectationResult) -> str:
    """Return an expectation's value and limit: "ekf position_rmse 0.273, wanted below 0.25"."""
    subject = f"{item.tracker} {item.metric} "
    wanted = item.text.removeprefix(subject).removeprefix("is ")
    return f"{subject}{value_text(item.value)}, wanted {wanted}"


def why_not_ranked(result: Result, tracker: TrackerResult) -> str:
    """Return why a tracker is not ranked, then its errors: "...; position RMSE 0.123 m, velocity RMSE 1.23 m/s"."""
    errors = [
        f"{path.replace('_rmse', ' RMSE')} {rounded(metric.value, decimals([metric.value]))} {metric.unit}"
        for path in ("position_rmse", "velocity_rmse")
        if (metric := metric_of(tracker, path)).value is not None
    ]
    return "; ".join(filter(None, [result.why_unscored(tracker), ", ".join(errors)]))


#: Names that a sentence lists; more are counted.
NAMED = 3


def verdict_of_run(result: Result) -> str:
    """Return the answer of a run in one line: what went wrong, and which tracker is best, how surely.

    For example "highway: imm_three has the smallest position error, 0.0708 m; the same as imm_cv_ca within 5 mm; all
    8 expectations met".
    """
    expectations = result.summary.expectations
    outcome = expectations_met(expectations)
    outcome = outcome[0].lower() + outcome[1:]
    if not expectations:
        return f"{result.name}: {answer_of_run(result)}"
    if all(item.passed for item in expectations):
        return f"{result.name}: {answer_of_run(result)}; {outcome}"
    return f"{result.name}: {answer_of_run(result, outcome)}"


def answer_of_run(result: Result, not_met: str = "") -> str:
    """Return the answer of a run as text: what went wrong, then which tracker is best and how surely.

    Args:
        result: the run.
        not_met: clause on failed expectations, placed among what went wrong; empty for none.
    """
    failed = some_names([tracker.name for tracker in result.unscored if tracker.failed])
    went_wrong = [beaten_bound(result), failed and f"{failed} failed", _diverged(result), not_met]
    return "; ".join(filter(None, [*went_wrong, *collected("clauses", result), _best(result)]))


def beaten_bound(result: Result) -> str:
    """Return a sentence that names the trackers with errors below a Cramér-Rao bound that holds; empty without any."""
    names = [tracker.name for tracker in result.summary.trackers if tracker.beats_bound(result.summary.reference)]
    return "; ".join(f"{name} {BEATS_BOUND}" for name in names)


def _verdicts(names: Sequence[str], pairs: Pairs) -> dict[str, str]:
    """Return the verdict on tracker ``names[0]`` against each later tracker, by the later tracker's name."""
    return {name: pair.verdict for name in names[1:] if (pair := pairs.get(names[0], name))}


def _diverged(result: Result) -> str:
    """Return which filters diverged, or how many did: "div diverged in 1 of 10 runs"; empty if none did."""
    divergences = [(t.name, words) for t in result.filtering if (words := divergence(t, result.summary.runs))]
    if len(divergences) > NAMED:
        return f"{counted(len(divergences), 'tracker')} diverged in some runs"
    return joined_names([" ".join(words) for words in divergences])


def _marked(result: Result, names: Sequence[str]) -> list[str]:
    """Return the names, each with "(diverged)" if its tracker diverged in any run."""
    return [f"{name} (diverged)" if result[name].health.diverged_runs else name for name in names]


def some_names(names: Sequence[str]) -> str:
    return joined_names(names) if len(names) <= NAMED else counted(len(names), "tracker")


def _best(result: Result) -> str:
    """Return a clause: which tracker has the smallest error, and than which trackers it is not shown better."""
    summary, contenders = result.summary, result.contenders
    if not contenders:
        reasons = {result.why_unscored(tracker) for tracker in result.unscored if tracker.failed is None}
        return reasons.pop() if len(reasons) == 1 else ANSWERS["none is ranked"]
    if not summary.truth.known:
        return ANSWERS["no truth"].format(trackers=counted(len(contenders), "tracker"))
    pairs = Pairs(result)
    names = [tracker.name for tracker in contenders]
    best, verdicts = names[0], _verdicts(names, pairs)
    not_better = [name for name, word in verdicts.items() if word != "better"]
    # Divergence has its own clause, and must not hide a verdict on the other trackers.
    not_better = [name for name in not_better if not result[name].health.diverged_runs] or not_better
    all_equivalent = all(verdicts[name] == "equivalent" for name in not_better)
    kind = "shown better" if not not_better else "equivalent" if all_equivalent else "not shown better"
    alike = [best, *not_better]
    if kind == "equivalent" and len(alike) <= NAMED:
        kind = "best alike"
    if pairs.unjudged or not verdicts:
        kind = "not judged" if len(names) > 1 else "alone"
    scenes = summary.truth.scenes_in_words
    # Where each run has a motion of its own, the differences are not of one scene.
    in_one_scene = not scenes and not (summary.truth.model_extra or {}).get("random")
    return ANSWERS[kind].format(
        over=f"over {scenes} " if scenes else "",
        best=best,
        names=joined_names(_marked(result, alike)),
        errors=joined_names([_error(metric_of(result[name], summary.headline)) for name in alike]),
        what="position error" if summary.identities == "known" else summary.headline_name,
        error=_error(metric_of(contenders[0], summary.headline)),
        why=pairs.unjudged or "not compared with the others",
        within=pairs.within(best, not_better) if not_better else "",
        whom=_whom(_marked(result, not_better or [*verdicts]), len(verdicts), are_equivalent=all_equivalent),
        here=" in this scene" if in_one_scene else "",
    )


def _whom(names: Sequence[str], number: int, *, are_equivalent: bool) -> str:
    """Return the names as text; if they are many, only their count out of ``number`` others: "7 of the 9 others"."""
    if len(names) <= NAMED:
        return joined_names(names)
    which = f"{len(names)} of the" if len(names) < number else "all" if are_equivalent else "any of the"
    return f"{which} {number} others"


def _error(metric: MetricValue) -> str:
    """Return a value with at least three digits, so that different runs have different texts: "0.0708 m"."""
    places = max(meaningful_decimals(metric.value, metric.ci95), decimals([metric.value]))
    return f"{rounded(metric.value, places)} m"
