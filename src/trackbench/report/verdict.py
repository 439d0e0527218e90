"""What an engineer says aloud of a run: what went wrong, and who is best, how surely; in a line and in full."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from itertools import combinations

from trackbench.base.errors import counted
from trackbench.base.subjects import collected
from trackbench.report.numbers import decimals, in_brackets, joined_names, meaningful, rounded
from trackbench.report.pairs import Pairs
from trackbench.report.sentences import charged, divergence, expectations_met
from trackbench.report.tables import metric_of
from trackbench.results import MOST_DRAWN, MetricValue, Result, TrackerResult
from trackbench.results.tracker_result import BEATS_BOUND

#: More names than these are counted.
NAMED = 3


def verdict_of_run(result: Result) -> str:
    """What went wrong, then who is best, how surely.

    For example "highway: imm_three and imm_cv_ca have the smallest position error, 0.07 m; not shown to differ; all 8
    expectations met".
    """
    expectations = result.summary.expectations
    outcome = expectations_met(expectations)
    outcome = outcome[0].lower() + outcome[1:] if expectations else ""
    failed = some_names([tracker.name for tracker in result.unscored if tracker.failed])
    met = all(item.passed for item in expectations)
    went_wrong = [beaten_bound(result), failed and f"{failed} failed", _diverged(result, NAMED), "" if met else outcome]
    clauses = [*went_wrong, *collected("clauses", result), _best(result)]
    return f"{result.name}: {'; '.join(filter(None, [*clauses, outcome if met else '']))}"


def next_step(result: Result) -> tuple[str, str]:
    """What to do next in a few words, and the command for it; ``.`` is the folder of the run."""
    summary, pairs = result.summary, Pairs(result)
    words = shlex.split(summary.command)
    scenario = words[2] if words[:2] == ["trackbench", "run"] else None
    baselines = [tracker.name for tracker in result.scored if tracker.baseline]

    def fault(tracker: TrackerResult) -> str:
        if tracker.failed or tracker.health.diverged_runs:
            return "failed" if tracker.failed else "diverged"
        worse = (name for name in baselines if (pair := pairs.get(tracker.name, name)) and pair.verdict == "worse")
        return next((f"is worse than {name}" for name in worse), "")

    own = [tracker for tracker in summary.trackers if not (tracker.baseline or tracker.is_reference or tracker.offline)]
    for name, what in ((tracker.name, fault(tracker)) for tracker in own if scenario):
        if what:
            return f"{name} {what}; to find out why", f"trackbench doctor {scenario}#{name}"
    if any(item.outcome == "failed" for item in summary.expectations):
        return "to see where the errors are largest, in this folder", "trackbench inspect . --worst 3"
    if scenario and summary.truth.source == "highway-env" and not summary.truth.scenes:
        return "to see whether it holds in other traffic", f"{summary.command} --scenes 10"
    return "to see the largest errors, in this folder", f"trackbench view .{' --worst' * summary.truth.known}"


def headline_sentence(result: Result) -> str:
    """Which tracker is the most accurate, by how much, and whether the difference was shown.

    One that knows the true origin of each detection is not held against the others. A beaten bound is said first.
    """
    beaten = beaten_bound(result)
    return f"{beaten}. {_accuracy_sentence(result)}" if beaten else _accuracy_sentence(result)


def beaten_bound(result: Result) -> str:
    """Which trackers beat a true Cramér-Rao bound; empty where none does."""
    names = [tracker.name for tracker in result.summary.trackers if tracker.beats_bound(result.summary.reference)]
    return "; ".join(f"{name} {BEATS_BOUND}" for name in names)


def _accuracy_sentence(result: Result) -> str:
    summary, names = result.summary, [tracker.name for tracker in result.contenders]
    labelled = summary.identities == "known"
    if not names:
        # Where all finished and identities are hidden, there was nothing to track.
        reasons = {result.why_unscored(tracker) for tracker in result.unscored if tracker.failed is None}
        reason = "No tracker finished" if labelled or len(reasons) != 1 else reasons.pop()
        return f"{reason[0].upper()}{reason[1:]}."
    metric = result.contenders[0].metrics[summary.headline]
    places = _places(metric)
    bounds = in_brackets(metric.ci95, places)
    value = rounded(metric.value, places)
    text = f"{names[0]} has the smallest {summary.headline_name}: {value} m{bounds}"
    if words := _diverged(result, MOST_DRAWN):
        text = f"{words}. {text}"
    pairs = Pairs(result)
    verdicts = _verdicts(names, pairs)
    if summary.score.baseline is not None and verdicts.get(summary.score.baseline) == "better":
        text += f"; it is better than {summary.score.baseline}, the baseline"
    equivalent, undecided = ([n for n in verdicts if verdicts[n] == word] for word in ("equivalent", "undecided"))
    if equivalent:
        others = some_names(_marked(result, equivalent), MOST_DRAWN)
        text += f"; equivalent to {others} {pairs.within(names[0], equivalent)}"
    if undecided and pairs.unjudged:
        text += f"; {pairs.unjudged}"
    elif undecided:
        text += f"; whether it is better than {some_names(_marked(result, undecided), MOST_DRAWN)} is undecided"
    if turned := pairs.turned(names).get(names[0], []):
        others = some_names(turned, MOST_DRAWN)
        text += f"; it is not called better than {others}: its errors are smaller only with what is charged"
    if much := charged(metric, "error"):
        text += f"; {much}"
    second = pairs.get(names[1], names[0]) if len(names) > 1 else None
    if equivalent or undecided or turned or second is None:
        return text + "."
    gap = meaningful(second.value, second.ci95)
    bounds = in_brackets(second.ci95, gap)
    of_next = f"The {'RMSE' if labelled else summary.headline_name} of the next, {names[1]},"
    return f"{text}. {of_next} is {rounded(second.value, gap)} m larger{bounds}."


def _verdicts(names: Sequence[str], pairs: Pairs) -> dict[str, str]:
    """By tracker, the verdict on the first of some against it."""
    return {name: pair.verdict for name in names[1:] if (pair := pairs.get(names[0], name))}


def _diverged(result: Result, most: int) -> str:
    """Which of those that filter diverged, of more than ``most`` how many: "div diverged in 1 of 10 runs"; or ""."""
    divergences = [(t.name, words) for t in result.filtering if (words := divergence(t, result.summary.runs))]
    if len(divergences) > most:
        return f"{counted(len(divergences), 'tracker')} diverged in some runs"
    return joined_names([" ".join(each) for each in divergences])


def _marked(result: Result, names: Sequence[str]) -> list[str]:
    """The names, those that diverged with a word for it."""
    return [f"{name} (diverged)" if result[name].health.diverged_runs else name for name in names]


def some_names(names: Sequence[str], most: int = NAMED) -> str:
    return joined_names(names) if len(names) <= most else counted(len(names), "tracker")


def _best(result: Result) -> str:
    """Who has the smallest error, and than whom it is not shown to be smaller."""
    summary, contenders = result.summary, result.contenders
    if not contenders:
        return "no tracker is ranked"
    if not summary.truth.known:
        return f"no truth, so {counted(len(contenders), 'tracker')} without a ranking"
    what = "position error" if summary.identities == "known" else summary.headline_name
    over = f"over {scenes} " if (scenes := summary.truth.scenes_in_words) else ""
    # Where each run has a motion of its own, the differences are not of one scene.
    here = "" if scenes or (summary.truth.model_extra or {}).get("random") else " in this scene"
    best, *others = names = [tracker.name for tracker in contenders]
    errors = {tracker.name: metric_of(tracker, summary.headline).value for tracker in contenders}
    pairs = Pairs(result)
    words = _verdicts(names, pairs)
    open_ = [name for name, word in words.items() if word != "better"]
    if not words:
        have = "has the smallest" if others else "has a"
        return f"{over}{best} {have} {what}{',' if others else ' of'} {_error(contenders[:1], summary.headline)}"
    if pairs.unjudged:
        return f"{best} has the smallest {what}, {_error(contenders[:1], summary.headline)}; {pairs.unjudged}"
    tied = [best, *open_]
    low, high = contenders[0].metrics[summary.headline].ci95 or (0.0, 0.0)
    alike = len(tied) <= NAMED and not any(pairs.differ(a, b) for a, b in combinations(tied, 2))
    alike &= not any(result[name].health.diverged_runs for name in tied)
    near = [words[name] == "equivalent" or low <= (errors[name] or 0.0) <= high for name in open_]
    equivalent = {words[name] for name in open_} == {"equivalent"}
    if open_ and alike and all(near) and {words[name] for name in open_} <= {"equivalent", "undecided"}:
        error = _error([result[name] for name in tied], summary.headline)
        how = f"equivalent {pairs.within(best, open_)}" if equivalent else "not shown to differ"
        return f"{over}{joined_names(tied)} have the smallest {what}, {error}; {how}{here}"
    names = _marked(result, open_ or [*words])
    every = "all" if equivalent or not open_ else "any of the"
    which = every if len(names) == len(words) else f"{len(names)} of the"
    whom = joined_names(names) if len(names) <= NAMED else f"{which} {len(words)} others"
    shown = f"not shown better than {whom}" if open_ else f"shown better than {whom}"
    if equivalent:
        shown = f"equivalent to {whom} {pairs.within(best, open_)}"
    return f"{over}{best} has the smallest {what}, {_error(contenders[:1], summary.headline)}; {shown}{here}"


def _error(trackers: list[TrackerResult], path: str) -> str:
    """ "0.07 m", or "0.07 to 0.09 m" of trackers that differ in what the interval of the best leaves a meaning."""
    metrics = [metric_of(tracker, path) for tracker in trackers]
    places = _places(metrics[0])
    ends = dict.fromkeys(rounded(metric.value, places) for metric in (metrics[0], metrics[-1]))
    return f"{' to '.join(ends)} m"


def _places(metric: MetricValue) -> int:
    """The decimals of a value: three digits or more, so that it can be told from those of other runs."""
    return max(meaningful(metric.value, metric.ci95), decimals([metric.value]))
