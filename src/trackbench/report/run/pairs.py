"""Groups of what was not shown to differ."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from string import ascii_lowercase, ascii_uppercase

from trackbench.metrics.differences import size
from trackbench.results import Difference, Result
from trackbench.results.summary import Summary


def groups_of(names: Sequence[str], differ: Callable[[str, str], bool]) -> list[frozenset[str]]:
    """Groups such that two share one exactly when they do not differ, in the order of their first members.

    The insert-and-absorb algorithm of Piepho, "An algorithm for a letter-based representation of all-pairwise
    comparisons", J. Comput. Graph. Stat. 13(2), 2004.
    """
    found = [frozenset(names)]
    for i, a in enumerate(names):
        for b in names[i + 1 :]:
            if not differ(a, b):
                continue
            split = [part for g in found for part in ((g - {a}, g - {b}) if {a, b} <= g else (g,))]
            unique = list(dict.fromkeys(split))
            found = [g for g in unique if not any(g < other for other in unique)]
    return sorted(found, key=lambda g: sorted(names.index(name) for name in g))


_LETTERS = ascii_lowercase + ascii_uppercase


@dataclass(frozen=True)
class Pair:
    """The metric that ranks, of one tracker minus that of another, m."""

    value: float
    ci95: tuple[float, float] | None
    verdict: str
    """Of the first: ``better``, ``worse``, ``equivalent`` or ``undecided``; ``larger`` or ``smaller`` where the
    difference is shown and neither is called better."""
    margin: float
    """m, up to which a difference does not matter."""


class Pairs:
    """All pairs of a result, looked up in either order."""

    def __init__(self, summary: Summary) -> None:
        by = summary.headline
        self._found = {(found.a, found.b): found for found in summary.differences if found.metric == by}

    def get(self, a: str, b: str) -> Pair | None:
        """The difference ``a`` minus ``b``, or None where the pair was not compared."""
        found, flipped = self._found.get((a, b)), self._found.get((b, a))
        if found is not None:
            return Pair(found.value, found.ci95, _verdict(found, a), found.margin)
        if flipped is None:
            return None
        ci95 = None if flipped.ci95 is None else (-flipped.ci95[1], -flipped.ci95[0])
        return Pair(-flipped.value, ci95, _verdict(flipped, a), flipped.margin)

    def differ(self, a: str, b: str) -> bool:
        """Whether one is called better than the other: shown by more than the margin, with as many estimates."""
        found = self._found.get((a, b)) or self._found.get((b, a))
        return found is not None and found.better is not None

    def fewer_estimates(self, names: Sequence[str]) -> dict[str, dict[str, float]]:
        """By tracker, those of ``names`` than which it is not called better for the estimates that it left out.

        Each with the share of the due estimates that it gave fewer.
        """
        shares: dict[str, dict[str, float]] = {}
        for (a, b), found in self._found.items():
            if found.fewer_estimates is not None and {a, b} <= set(names):
                name = found.fewer_estimates.tracker
                shares.setdefault(name, {})[b if name == a else a] = found.fewer_estimates.share
        return shares


def _verdict(found: Difference, name: str) -> str:
    """Of one of the two trackers."""
    if found.fewer_estimates is not None:
        return size(found.value if found.a == name else -found.value)
    return found.verdict if found.better is None else "better" if found.better == name else "worse"


def groups(names: Sequence[str], pairs: Pairs) -> dict[str, str]:
    """Letters such that two trackers share one exactly when neither is called better.

    ``names`` are in order of rank, so "a" is the best.
    """
    found = groups_of(names, pairs.differ)
    return {name: "".join(_LETTERS[i % len(_LETTERS)] for i, g in enumerate(found) if name in g) for name in names}


def letters(result: Result) -> list[str]:
    """The groups of each scored tracker; a reference or a smoother is no competitor and is in none."""
    found = groups([tracker.name for tracker in result.contenders], Pairs(result.summary))
    return [found.get(tracker.name, "") for tracker in result.scored]
