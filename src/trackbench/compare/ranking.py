"""Scores of trackers in each scenario, their order over scenarios, and scenarios that share scenes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from trackbench.compare.comparison import Entrant, EntrantScore, PairDifference, RankedTracker
from trackbench.compare.entries import Entry

#: Metrics that a score always keeps, by the metric that ranks.
SHOWN = {
    "position_rmse": ("position_rmse", "velocity_rmse", "position_over_reference", "nees", "step_time"),
    "tgospa": (
        "tgospa", "gospa_switch", "gospa", "gospa_localisation", "gospa_missed", "gospa_false", "hota", "id_switches",
        "step_time",
    ),
}  # fmt: skip


class Pairings:
    """Verdicts on pairs of trackers in each scenario, by the metric that ranks trackers."""

    def __init__(self, differences: Sequence[PairDifference], metric: str) -> None:
        self._better: dict[tuple[str, frozenset[str]], str | None] = {}
        for item in differences:
            a, b = item.entrant.tracker, item.against.tracker
            if item.metric == metric:
                better = {"better": a, "worse": b}.get(item.verdict)
                self._better[item.scenario, frozenset((a, b))] = better

    def better(self, scenario: str, a: str, b: str) -> str | None:
        """Return the name of the tracker, of two, that is shown to be better in a scenario; None for neither."""
        return self._better.get((scenario, frozenset((a, b))))

    def compared(self, scenario: str, a: str, b: str) -> bool:
        """Return whether the two trackers were compared in a scenario."""
        return (scenario, frozenset((a, b))) in self._better


def entrant_scores(
    number: int,
    entry: Entry,
    scenario: str,
    trackers: Sequence[str],
    pairings: Pairings | None,
    compared: Sequence[str] = (),
) -> list[EntrantScore]:
    """Return metric values and rank of each tracker of one result, in the order of the scenario file.

    ``compared``: paths of metrics to keep, beside the metrics that are always displayed.
    """
    scored = [tracker.name for tracker in entry.result.scored if tracker.name in trackers]
    contenders = [tracker.name for tracker in entry.result.contenders if tracker.name in trackers]
    shown = dict.fromkeys([*SHOWN[entry.result.summary.headline], *(path.removesuffix(".mean") for path in compared)])
    entrants = []
    for tracker in entry.result.summary.trackers:
        name = tracker.name
        if name not in trackers:
            continue
        has_score = name in scored
        metrics = {path: value for path in shown if (value := tracker.metrics.get(path)) and value.value is not None}
        entrants.append(
            EntrantScore(
                scenario=scenario,
                entrant=Entrant(tracker=name, set=number),
                metrics=metrics if has_score else {},
                diverged_runs=(tracker.health.diverged_runs or 0) if has_score else 0,
                leading=pairings is not None and name in contenders and _leads(name, contenders[0], scenario, pairings),
                reference=tracker.is_reference and name not in contenders,
                failure="" if has_score else entry.result.why_unscored(tracker),
            )
        )
    return entrants


def _leads(name: str, best: str, scenario: str, pairings: Pairings) -> bool:
    """Return whether a tracker is the best of a scenario, or was compared with the best and not shown to be worse."""
    return name == best or (
        pairings.compared(scenario, best, name) and pairings.better(scenario, best, name) in (None, name)
    )


def sets_of_scenes(scenes: Mapping[str, Sequence[str]]) -> list[list[str]]:
    """Return names of scenarios, grouped where they share scenes, directly or through a third scenario.

    Args:
        scenes: fingerprints of the scenes of each scenario; a scenario without fingerprints is a group of its own.
    """
    sets: list[list[str]] = []
    for name, fingerprints in scenes.items():
        shared = [group for group in sets if any(_share(fingerprints, scenes[member]) for member in group)]
        if not shared:
            sets.append([name])
            continue
        shared[0].extend([*(member for group in shared[1:] for member in group), name])
        sets = [group for group in sets if group not in shared[1:]]
    return sets


def _share(first: Sequence[str], second: Sequence[str]) -> bool:
    """Return whether two lists of scene fingerprints have a scene in common, perhaps recorded for different times."""
    return any(a.startswith(b) or b.startswith(a) for a in first for b in second)


def ranked_trackers(scores: Sequence[EntrantScore], metric: str) -> list[RankedTracker]:
    """Return the trackers of one set of results, best first, and the references after all competing trackers.

    The tracker with the fewest scenarios without a score is first, then the tracker with the smallest relative error.
    Between trackers with a score in all scenarios, the ratio of relative errors is the pooled ratio in
    ``Comparison.overall``.

    Args:
        scores: scores of every tracker in every scenario.
        metric: metric that ranks trackers.
    """
    errors: dict[str, dict[str, float]] = {score.scenario: {} for score in scores}
    for score in scores:
        if (value := score.value(metric)) is not None:
            errors[score.scenario][score.entrant.tracker] = value
    references = {score.entrant.tracker for score in scores if score.reference}
    relative: dict[str, list[float]] = {score.entrant.tracker: [] for score in scores}
    for of_scenario in errors.values():
        competing = [value for name, value in of_scenario.items() if name not in references and value > 0]
        typical = np.exp(np.mean(np.log(competing))) if competing else 1.0
        for name, value in of_scenario.items():
            relative[name].append(value / typical)
    ranked = [
        RankedTracker(
            tracker=name,
            without_score=len(errors) - len(values),
            relative_error=_geometric_mean(values) if values else None,
            reference=name in references,
        )
        for name, values in relative.items()
    ]
    # Rounding errors differ between machines.
    return sorted(
        ranked,
        key=lambda item: (item.reference, item.without_score, round(item.relative_error or 0.0, 9), item.tracker),
    )


def _geometric_mean(values: Sequence[float]) -> float:
    return float(np.exp(np.mean(np.log(values)))) if min(values) > 0 else 0.0
