"""The sentences of a run: what went wrong, who is best and how surely, facts, expectations and remarks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import UTC
from itertools import combinations

from trackbench.base.errors import counted
from trackbench.base.subjects import collected
from trackbench.metrics.differences import MOST_CHARGED
from trackbench.report.numbers import decimals, joined_names, meaningful, percent, rounded
from trackbench.report.pairs import Pairs
from trackbench.report.scenes import runs_in_words
from trackbench.report.tables import metric_of, value_text
from trackbench.results import (
    ExpectationResult,
    MetricValue,
    Result,
    Summary,
    TrackerResult,
)
from trackbench.results.tracker_result import BEATS_BOUND

#: A reference takes no false alarm.
FALSE_OF_REFERENCE = "its false tracks: predicted further while their object is hidden or gone"


def facts(result: Result, trackers: int) -> tuple[str, ...]:
    """The run of so many trackers in a few words."""
    summary, truth = result.summary, result.summary.truth
    options = truth.model_extra or {}
    source = " ".join(str(part) for part in (truth.source, options.get("env")) if part)
    return (
        f"{source}, other motion in each run" if options.get("random") else source,
        runs_in_words(result),
        truth.vehicles,
        duration(result),
        counted(len(summary.sensors), "sensor"),
        counted(trackers, "tracker"),
        f"seed {summary.seed}",
        summary.engine_in_words,
    )


def listed_of(summary: Summary, trackers: int) -> str:
    """That a page has not all of so many trackers."""
    listed = f"The first {len(summary.trackers):,} of {trackers:,} trackers are listed here"
    return f"{listed}; result.json and the tables in Parquet have all of them."


def provenance(result: Result) -> list[tuple[str, str]]:
    """When and of which code it was made, each with what it is; nothing of a result that does not say."""
    made = result.summary.provenance
    if made is None:
        return []
    reason = f": {made.no_commit}" if made.no_commit else ""
    return [
        ("made", f"{made.time.astimezone(UTC):%Y-%m-%d %H:%M:%S} UTC"),
        ("commit of the scenario", f"{made.commit_in_words}{reason}"),
        *((f"code of {name}", f"sha256 {code[:16]}" if code else "not found") for name, code in made.code.items()),
    ]


def duration(result: Result) -> str:
    """How long the truth is, and which part of it is scored where the sensors do not look all the time."""
    length, score = result.summary.truth.duration_s, result.summary.score
    period = max((1 / sensor.rate_hz for sensor in result.summary.sensors.values() if sensor.rate_hz), default=0.0)
    whole = score.from_s <= period and length - score.to_s <= period
    part = "" if whole else f" ({rounded(score.from_s, 1)} to {rounded(score.to_s, 1)} s scored)"
    return f"{rounded(length, 1)} s{part}"


def divergence(tracker: TrackerResult, runs: int) -> str:
    """ "diverged in 1 of 10 runs"; empty where none did."""
    number = tracker.health.diverged_runs
    return f"diverged in {number} of {counted(runs, 'run')}" if number else ""


def _value(tracker: TrackerResult, path: str) -> float | None:
    return tracker.metrics[path].value if path in tracker.metrics else None


def censored(result: Result) -> str:
    """What errors of matched tracks leave out."""
    reach = (result.summary.score.cutoff_m or 0.0) / 2
    speed = (result.summary.truth.model_extra or {}).get("recorded_noise", {}).get("velocity_mps", 0.0)
    blurred = f" The boxes' own velocities have noise of {speed:.2g} m/s, which makes NEES larger."
    return (
        f"Errors and NEES are of tracks within {reach:g} m of their object (half of score.cutoff_m): where it is "
        f"larger the object is lost and the track false, so a smaller cutoff makes them smaller.{blurred * bool(speed)}"
    )


def reused_identities(result: Result) -> str:
    """Which trackers gave an identity to a second track; empty where none did."""
    times = [(tracker.name, tracker.health.reused_ids) for tracker in result.scored]
    trackers = ", ".join(f"{name} {counted(number, 'time')}" for name, number in times if number)
    return f"identities used again after their track had ended: {trackers}" if trackers else ""


def drawing_random(result: Result) -> str:
    """Which trackers draw random numbers, and what follows; empty where none does."""
    names = [tracker.name for tracker in result.scored if tracker.random]
    return f"{joined_names(names)}: random = True, so it is not asked again" if names else ""


def others_ignored(result: Result) -> list[str]:
    """Return what it means that tracks on no object are ignored; empty where they count."""
    ignored = "others" in (result.summary.truth.model_extra or {})
    return ["tracks on no object are ignored (truth.reference.others): no score tells false tracks"] * ignored


def made_elsewhere(result: Result) -> list[str]:
    """Which tracks were made elsewhere, what follows, and the offset of their time stamps; empty where none were."""
    trackers = [tracker for tracker in result.scored if tracker.offline]
    if not trackers:
        return []
    names = joined_names([tracker.name for tracker in trackers])
    sentences = [f"{names}: offline, made elsewhere: nothing shows that they did not see the future"]
    for tracker in trackers:
        if not tracker.paired:
            sentences.append(f"{tracker.name}: no fingerprint says of which scans, so compared with no tracker")
        if tracker.filed is not None and tracker.filed.outside:
            of = f"{tracker.filed.outside} of {counted(tracker.filed.rows, 'row')}"
            sentences.append(f"{tracker.name}: {of} outside the time of the truth, left out")
        if tracker.filed is not None and tracker.filed.silent_runs:
            sentences.append(
                f"{tracker.name}: no track in {counted(tracker.filed.silent_runs, 'run')}: all missed there"
            )
        if tracker.filed is not None:
            sentences += [f"{tracker.name}: {remark}" for remark in tracker.filed.remarks]
        sentences += _time_offset(tracker)
    return sentences


def _time_offset(tracker: TrackerResult) -> list[str]:
    """What the errors along the paths say of the clock."""
    offset, name = tracker.time_offset, tracker.name
    if offset is None or tracker.along_path_m is None or tracker.offset_alone_s is None:
        return [f"{name}: time offset n/a: no track is on an object that moves"]
    if offset.ci95 is not None and offset.value is not None:
        low, high = (1e3 * end for end in offset.ci95)
        shift = f"{1e3 * offset.value:+.1f} ms (95 %: {low:+.1f} to {high:+.1f})"
        if not tracker.offset_shown:
            return [f"{name}: no time offset that matters is shown: {shift}"]
        remedy = f"--time-offset or time_offset_s adds it, {offset.value:.3g} s"
        return [f"{name}: time stamps fit best with {shift} added, beside a shift along the path; {remedy}"]
    alone = f"{tracker.along_path_m:+.2g} m along the path"
    causes = f"{1e3 * tracker.offset_alone_s:+.0f} ms added would make up for it, or another point of the body"
    return [f"{name}: time offset n/a: {offset.reason}; the mean error is {alone}: {causes}"]


def switch_cost(result: Result) -> str:
    """Return what a switch of identities costs in T-GOSPA."""
    return f"A switch costs as much as missing the object for {result.summary.score.switch_costs_s or 0.0:g} s."


def missing_estimates(result: Result) -> list[str]:
    """What is charged for estimates that trackers did not give, where it makes much of their errors; empty of nothing.

    For example "mine: 42 % of its squared position error is charged for missing estimates (0.123 m without)".
    """
    sentences = []
    for tracker in result.scored:
        for path, what in (("position_rmse", "position"), ("velocity_rmse", "velocity")):
            metric = tracker.metrics.get(path)
            if metric is not None and (text := charged(metric, f"{what} error")):
                sentences.append(f"{tracker.name}: {text}")
    turned = Pairs(result).turned([tracker.name for tracker in result.contenders])
    for name, others in turned.items():
        sentences.append(
            f"{name} is not called better than {joined_names(others)}: its errors are smaller only with what is charged"
        )
    return sentences


def below_the_bound(result: Result) -> list[str]:
    """Which contenders are shown to be below the reference."""
    label, names = result.summary.held_against.label, [t.name for t in result.contenders if t.below_reference]
    why = "it expects this motion, or knows more than its measurements say"
    return [f"{name} is below the {label}: {why}" for name in names]


def charged(metric: MetricValue, error: str) -> str:
    """What is charged for missing estimates, where that is much of an error; else empty."""
    if metric.charged_share is None or metric.charged_share <= MOST_CHARGED:
        return ""
    without = f"{rounded(metric.without_charged, decimals([metric.without_charged]))} {metric.unit}"
    return (
        f"{percent(metric.charged_share)} of its squared {error} is charged for missing estimates ({without} without)"
    )


def expectations_met(expectations: Sequence[ExpectationResult]) -> str:
    """ "All 3 expectations met", "1 of 3 expectations failed, 1 undecided", "No expectations stated"."""
    total = len(expectations)
    failed, undecided = (sum(item.outcome == word for item in expectations) for word in ("failed", "undecided"))
    if failed:
        more = f", {undecided} undecided" if undecided else ""
        return f"{failed} of {counted(total, 'expectation')} failed{more}"
    if undecided:
        return f"{undecided} of {counted(total, 'expectation')} undecided: more runs or scenes would tell"
    if not total:
        return "No expectations stated"
    return f"All {total} expectations met" if total > 1 else "The expectation is met"


def value_and_limit(item: ExpectationResult) -> str:
    """ "ekf position_rmse 0.273, wanted below 0.25"."""
    subject = f"{item.tracker} {item.metric} "
    wanted = item.text.removeprefix(subject).removeprefix("is ")
    return f"{subject}{value_text(item.value)}, wanted {wanted}"


#: More names than these are counted.
NAMED = 3


def verdict_of_run(result: Result) -> str:
    """Return what went wrong, then who is best, how surely, in one line for a terminal.

    For example "highway: imm_three and imm_cv_ca have the smallest position error, 0.07 m; not shown to differ; all 8
    expectations met".
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
    """Return what went wrong, then who is best, how surely.

    Args:
        result: of the run.
        not_met: which expectations failed, to be said among what went wrong.
    """
    failed = some_names([tracker.name for tracker in result.unscored if tracker.failed])
    went_wrong = [beaten_bound(result), failed and f"{failed} failed", _diverged(result), not_met]
    return "; ".join(filter(None, [*went_wrong, *collected("clauses", result), _best(result)]))


def beaten_bound(result: Result) -> str:
    """Which trackers beat a true Cramér-Rao bound; empty where none does."""
    names = [tracker.name for tracker in result.summary.trackers if tracker.beats_bound(result.summary.reference)]
    return "; ".join(f"{name} {BEATS_BOUND}" for name in names)


def _verdicts(names: Sequence[str], pairs: Pairs) -> dict[str, str]:
    """By tracker, the verdict on the first of some against it."""
    return {name: pair.verdict for name in names[1:] if (pair := pairs.get(names[0], name))}


def _diverged(result: Result) -> str:
    """Which of those that filter diverged, of many how many: "div diverged in 1 of 10 runs"; or ""."""
    divergences = [(t.name, words) for t in result.filtering if (words := divergence(t, result.summary.runs))]
    if len(divergences) > NAMED:
        return f"{counted(len(divergences), 'tracker')} diverged in some runs"
    return joined_names([" ".join(each) for each in divergences])


def _marked(result: Result, names: Sequence[str]) -> list[str]:
    """The names, those that diverged with a word for it."""
    return [f"{name} (diverged)" if result[name].health.diverged_runs else name for name in names]


def some_names(names: Sequence[str]) -> str:
    return joined_names(names) if len(names) <= NAMED else counted(len(names), "tracker")


#: Who is best and how surely, by what was shown.
ANSWERS = {
    "none is ranked": "no tracker is ranked",
    "no truth": "no truth, so {trackers} without a ranking",
    "alone": "{over}{best} has a {what} of {error}",
    "not compared": "{over}{best} has the smallest {what}, {error}",
    "one run": "{best} has the smallest {what}, {error}; {unjudged}",
    "some are equivalent": "{over}{tied} have the smallest {what}, {error_of_tied}; equivalent {within}{here}",
    "some do not differ": "{over}{tied} have the smallest {what}, {error_of_tied}; not shown to differ{here}",
    "equivalent": "{over}{best} has the smallest {what}, {error}; equivalent to {whom} {within}{here}",
    "not shown better": "{over}{best} has the smallest {what}, {error}; not shown better than {whom}{here}",
    "shown better": "{over}{best} has the smallest {what}, {error}; shown better than {whom}{here}",
}


def _best(result: Result) -> str:
    """Return who has the smallest error, and than whom it is not shown to be smaller."""
    summary, contenders = result.summary, result.contenders
    if not contenders:
        reasons = {result.why_unscored(tracker) for tracker in result.unscored if tracker.failed is None}
        return reasons.pop() if len(reasons) == 1 else ANSWERS["none is ranked"]
    if not summary.truth.known:
        return ANSWERS["no truth"].format(trackers=counted(len(contenders), "tracker"))
    pairs = Pairs(result)
    best, *others = names = [tracker.name for tracker in contenders]
    verdicts = _verdicts(names, pairs)
    not_better = [name for name, word in verdicts.items() if word != "better"]
    all_equivalent = all(verdicts[name] == "equivalent" for name in not_better)
    tied = [best, *not_better]
    scenes = summary.truth.scenes_in_words
    # Where each run has a motion of its own, the differences are not of one scene.
    in_one_scene = not scenes and not (summary.truth.model_extra or {}).get("random")
    return ANSWERS[_kind_of_answer(result, pairs, verdicts, not_better) if verdicts or others else "alone"].format(
        over=f"over {scenes} " if scenes else "",
        best=best,
        what="position error" if summary.identities == "known" else summary.headline_name,
        error=_error(contenders[:1], summary.headline),
        unjudged=pairs.unjudged,
        tied=joined_names(tied),
        error_of_tied=_error([result[name] for name in tied], summary.headline),
        within=pairs.within(best, not_better) if not_better else "",
        whom=_whom(_marked(result, not_better or [*verdicts]), len(verdicts), every=all_equivalent),
        here=" in this scene" if in_one_scene else "",
    )


def _kind_of_answer(result: Result, pairs: Pairs, verdicts: Mapping[str, str], not_better: Sequence[str]) -> str:
    """Return the key of ``ANSWERS`` for the verdicts on the best tracker against the others."""
    if not verdicts:
        return "not compared"
    if pairs.unjudged:
        return "one run"
    if not not_better:
        return "shown better"
    first = result.contenders[0]
    tied, words = [first.name, *not_better], {verdicts[name] for name in not_better}
    low, high = first.metrics[result.summary.headline].ci95 or (0.0, 0.0)
    errors = {name: metric_of(result[name], result.summary.headline).value or 0.0 for name in not_better}
    are_alike = (
        len(tied) <= NAMED
        and words <= {"equivalent", "undecided"}
        and not any(result[name].health.diverged_runs for name in tied)
        and not any(pairs.differ(a, b) for a, b in combinations(tied, 2))
        and all(verdicts[name] == "equivalent" or low <= errors[name] <= high for name in not_better)
    )
    if words == {"equivalent"}:
        return "some are equivalent" if are_alike else "equivalent"
    return "some do not differ" if are_alike else "not shown better"


def _whom(names: Sequence[str], number: int, *, every: bool) -> str:
    """Return the names of some of the ``number`` other trackers, of many how many they are."""
    if len(names) <= NAMED:
        return joined_names(names)
    which = f"{len(names)} of the" if len(names) < number else "all" if every else "any of the"
    return f"{which} {number} others"


def _error(trackers: list[TrackerResult], path: str) -> str:
    """ "0.07 m", or "0.07 to 0.09 m" of trackers that differ in what the interval of the best leaves a meaning."""
    metrics = [metric_of(tracker, path) for tracker in trackers]
    places = _places(metrics[0])
    ends = dict.fromkeys(rounded(metric.value, places) for metric in (metrics[0], metrics[-1]))
    return f"{' to '.join(ends)} m"


def _places(metric: MetricValue) -> int:
    """The decimals of a value: three digits or more, so that it can be told from those of other runs."""
    return max(meaningful(metric.value, metric.ci95), decimals([metric.value]))
