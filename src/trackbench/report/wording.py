"""The sentences of a report: what was found, in words that a number alone does not give."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from trackbench.report.claims import confidence
from trackbench.report.numbers import decimals, fixed, half_width, interval, joined, percent
from trackbench.report.significance import Differences
from trackbench.words import counted

Tracker = Mapping[str, Any]

#: An efficiency this close to one is called "at the bound".
_AT_THE_BOUND = 0.01

MEANING = {
    "consistent": "errors are as large as claimed",
    "optimistic": "errors are larger than claimed",
    "pessimistic": "errors are smaller than claimed",
    "undecided": "too few runs to say whether errors are as large as claimed",
}


def facts(summary: Mapping[str, Any]) -> list[str]:
    """The run in a few words."""
    truth = summary["truth"]
    facts = [
        counted(summary["runs"], "run"),
        counted(len(truth["objects"]), "vehicle"),
        f"{fixed(truth['duration_s'], 1)} s",
        counted(len(summary["sensors"]), "sensor"),
        counted(len(summary["trackers"]), "tracker"),
        f"seed {summary['seed']}",
    ]
    source = " ".join(str(part) for part in (truth["source"], truth.get("env")) if part)
    return [f"{source}, other motion in each run" if truth.get("random") else source, *facts]


def scored(summary: Mapping[str, Any]) -> list[Tracker]:
    """The trackers that finished with a position RMSE, best first."""
    by_name = {tracker["name"]: tracker for tracker in summary["trackers"]}
    ranked = [by_name[name] for name in summary["ranking"]]
    return [t for t in ranked if not t["failed"] and t["metrics"]["position_rmse"]["value"] is not None]


def unscored(summary: Mapping[str, Any]) -> list[Tracker]:
    """The trackers that failed or gave nothing to score."""
    good = {tracker["name"] for tracker in scored(summary)}
    return [tracker for tracker in summary["trackers"] if tracker["name"] not in good]


def verdict(tracker: Tracker, runs: int) -> str:
    """One sentence on a tracker's accuracy, honesty and health, without its name.

    For example "0.412 m position RMSE, 38 % above the Cramér-Rao bound; optimistic: errors are larger than claimed
    (NEES 6.1, should be 4); too confident about velocity in turns (errors 1.6 times the claim)".
    """
    metrics = tracker["metrics"]
    rmse = metrics["position_rmse"]["value"]
    parts = [f"{fixed(rmse, decimals([rmse]))} m position RMSE" + _above_bound(metrics["position_efficiency"]["value"])]
    nees, clauses = metrics["nees"], confidence(tracker["breakdown"])
    if nees["mean"] is None:
        parts.append("no covariance to judge" if not nees.get("reason") else f"NEES n/a: {nees['reason']}")
    else:
        mean = fixed(nees["mean"], decimals([nees["mean"]], 2))
        meaning = " on the whole" if clauses else f": {MEANING[nees['verdict']]}"
        parts.append(f"{nees['verdict']}{meaning} (NEES {mean}, should be {nees['dof']})")
    return "; ".join(parts + clauses + _complaints(tracker["health"], runs))


def _above_bound(efficiency: float | None) -> str:
    if efficiency is None:
        return ""
    excess = efficiency - 1
    if abs(excess) < _AT_THE_BOUND:
        return ", at the Cramér-Rao bound"
    if excess > 1:
        return f", {fixed(efficiency, 1)} times the Cramér-Rao bound"
    return f", {percent(abs(excess))} {'above' if excess > 0 else 'below'} the Cramér-Rao bound"


def _complaints(health: Mapping[str, int], runs: int) -> list[str]:
    found = []
    if health["diverged_runs"]:
        found.append(f"diverged in {health['diverged_runs']} of {counted(runs, 'run')}")
    if health["repaired_covariances"]:
        found.append(f"covariance repaired {counted(health['repaired_covariances'], 'time')}")
    if health["non_finite_estimates"]:
        found.append(counted(health["non_finite_estimates"], "non-finite estimate"))
    return found


def failure(tracker: Tracker) -> str:
    """Why a tracker has no score: the cause, and where it happened."""
    failed = tracker["failed"]
    if not failed:
        return str(tracker["metrics"]["position_rmse"].get("reason") or "nothing to score")
    time = failed.get("time_s")
    place = [
        f"step {failed['step']}" if failed.get("step") is not None else "",
        f"{fixed(time, 2)} s" if time is not None else "",
        f"sensor {failed['sensor']}" if failed.get("sensor") else "",
        f"run {failed['run']}" if failed.get("run") is not None else "",
        f"object {failed['object']}" if failed.get("object") is not None else "",
    ]
    where = ", ".join(part for part in place if part)
    return f"{failed['cause']} ({where})" if where else str(failed["cause"])


def headline(summary: Mapping[str, Any]) -> str:
    """Who won, by how much, and whether that is real."""
    order = scored(summary)
    if not order:
        return "No tracker finished."
    first, names = order[0], [tracker["name"] for tracker in order]
    metric = first["metrics"]["position_rmse"]
    places = decimals([metric["value"], half_width(metric)], 1)
    spread = f" (95 % interval {interval(metric['ci95'], places)} m)" if metric.get("ci95") else ""
    text = f"{names[0]} is the most accurate in position: {fixed(metric['value'], places)} m RMSE{spread}"
    if len(names) == 1:
        return text + "."
    differences = Differences(summary["differences"])
    tied = [name for name in names[1:] if not differences.real(names[0], name)]
    if tied:
        return f"{text}, but no difference was shown between it and {joined(tied)}."
    second = differences.get(names[0], names[1])
    if second is None:
        return text + "."
    gap = decimals([(second.ci95[1] - second.ci95[0]) / 2] if second.ci95 else [second.value], 1)
    bounds = f" (95 % interval {interval((-second.ci95[1], -second.ci95[0]), gap)} m)" if second.ci95 else ""
    return f"{text}. The next, {names[1]}, is {fixed(-second.value, gap)} m worse{bounds}, a real difference."


def precision_reached(precision: Mapping[str, Any], runs: int) -> str:
    """Whether the precision that was asked for was reached, and after how many runs."""
    wanted = f"{percent(precision['target'], 2)} wanted"
    if precision["half_width"] is None:
        return f"precision: no two trackers to compare after {counted(runs, 'run')}; {wanted}"
    pair = f"{precision['best']} against {precision['second']}"
    found = f"{pair} ±{percent(precision['half_width'], 2)} after {counted(runs, 'run')}"
    return f"precision: {found}; {wanted}" + ("" if precision["reached"] else ", not reached")


def expectations_met(expectations: Sequence[Mapping[str, Any]]) -> str:
    """ "All 3 expectations met", "1 of 3 expectations failed", "No expectations stated"."""
    total, failed = len(expectations), sum(not e["passed"] for e in expectations)
    if not total:
        return "No expectations stated"
    if failed:
        return f"{failed} of {counted(total, 'expectation')} failed"
    return f"All {total} expectations met" if total > 1 else "The expectation is met"
