"""The sentences of a run's report: facts, headline, a verdict on each tracker, expectations and precision."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC

from trackbench.base.errors import counted
from trackbench.driving.law import FEWEST
from trackbench.metrics.differences import MOST_CHARGED
from trackbench.report.numbers import decimals, joined_names, percent, rounded
from trackbench.report.pairs import Pairs
from trackbench.report.scenes import runs_in_words
from trackbench.report.tables import value_text
from trackbench.results import (
    MOST_DRAWN,
    ExpectationResult,
    MetricValue,
    PrecisionReached,
    Result,
    Summary,
    TrackerResult,
)
from trackbench.results.metric_value import by_value

#: T-GOSPA at other costs of a switch, by the factor.
SWITCH_COSTS = {"tgospa_half": 0.5, "tgospa_twice": 2.0}
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
    how = "random = True, so its errors are compared with those of each member alone"
    return f"{joined_names(names)}: {how} (of fewer than {FEWEST} objects times runs nothing is)" if names else ""


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


def other_switch_costs(result: Result) -> str:
    """Whether the trackers rank alike where a switch costs half or twice as much."""
    costs = result.summary.score.switch_costs_s or 0.0
    ranked = [tracker.name for tracker in result.contenders]
    stated = f"A switch costs as much as missing the object for {costs:g} s."
    if len(ranked) < 2:
        return stated
    others = []
    for path, factor in SWITCH_COSTS.items():
        by_cost = by_value({name: _value(result[name], path) or 0.0 for name in ranked})
        if by_cost != ranked:
            order = f": {', '.join(by_cost)}" if len(ranked) <= MOST_DRAWN else ""
            others.append(f"With {factor * costs:g} s the order is another{order}.")
    low, high = (f"{factor * costs:g} s" for factor in SWITCH_COSTS.values())
    return " ".join([stated, *(others or [f"With {low} and with {high} the order is the same."])])


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


def precision_reached(precision: PrecisionReached, runs: int) -> str:
    """Whether the precision that the user wants was reached, and after how many runs."""
    after, wanted = f"after {counted(runs, 'run')}", f"{percent(precision.target, 2)} wanted"
    if precision.half_width is None:
        return f"precision: no two trackers to compare {after}; {wanted}"
    pair = f"{precision.best} against {precision.second} ±{percent(precision.half_width, 2)}"
    return f"precision: {pair} {after}; {wanted}" + ("" if precision.reached else ", not reached")


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
