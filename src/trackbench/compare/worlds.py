"""In which of the worlds of a scenario one tracker is ahead of another."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import combinations

from trackbench.compare.comparability import ScenarioResults
from trackbench.compare.comparison import EntrantScore, OrderInWorlds
from trackbench.compare.ranking import Pairings


def orders(
    cells: Iterable[ScenarioResults], ranked_by: str, scores: Sequence[EntrantScore], pairings: Pairings
) -> list[OrderInWorlds]:
    """Each pair of trackers of each scenario that has several worlds, in the order of their errors in the first."""
    by_base: dict[str, dict[str, str]] = {}
    for cell in cells:
        scenario = cell.entries[0].result.summary.scenario
        if scenario.world is not None:
            by_base.setdefault(scenario.base, {})[scenario.world] = cell.scenario
    result = []
    for base, worlds in by_base.items():
        first, *others = (_errors(scores, name, ranked_by) for name in worlds.values())
        names = [name for name in sorted(first, key=first.__getitem__) if all(name in other for other in others)]
        for a, b in combinations(names, 2) if others else ():
            ahead = {world: pairings.better(name, a, b) for world, name in worlds.items()}
            result.append(OrderInWorlds(scenario=base, a=a, b=b, ahead=ahead))
    return result


def _errors(scores: Sequence[EntrantScore], scenario: str, metric: str) -> dict[str, float]:
    """Of the contenders of a scenario."""
    own = [score for score in scores if score.scenario == scenario and score.rank is not None and not score.reference]
    return {score.entrant.tracker: value for score in own if (value := score.value(metric)) is not None}
