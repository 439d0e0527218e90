"""Which trackers are better than others: pairs, looked up by name, and the column of the ranking that says so."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from string import ascii_lowercase

from trackbench.metrics.differences import EQUIVALENT, UNDECIDED, size
from trackbench.report.numbers import margin_words
from trackbench.results import Result


def groups_of(names: Sequence[str], differ: Callable[[str, str], bool]) -> list[frozenset[str]]:
    """Groups such that two share one exactly when they do not differ, in the order of their first members.

    The insert-and-absorb algorithm of Piepho, "An algorithm for a letter-based representation of all-pairwise
    comparisons", J. Comput. Graph. Stat. 13(2), 2004.
    """
    groups = [frozenset(names)]
    for i, a in enumerate(names):
        for b in names[i + 1 :]:
            if not differ(a, b):
                continue
            split = [part for g in groups for part in ((g - {a}, g - {b}) if {a, b} <= g else (g,))]
            unique = list(dict.fromkeys(split))
            groups = [g for g in unique if not any(g < other for other in unique)]
    return sorted(groups, key=lambda g: sorted(names.index(name) for name in g))


def group_letter(number: int) -> str:
    """ "a" to "z", then "aa", "ab" and so on, of the groups from 0 on."""
    before, last = divmod(number, len(ascii_lowercase))
    return (group_letter(before - 1) if before else "") + ascii_lowercase[last]


def difference_word(verdict: str) -> str:
    """Return what is said of a difference, such as "same"; "not shown": neither worse nor the same can be shown."""
    return {EQUIVALENT: "same", UNDECIDED: "not shown"}.get(verdict, verdict)


@dataclass(frozen=True)
class Pair:
    """A metric of one tracker minus that of another, in the metric's unit."""

    value: float
    ci95: tuple[float, float] | None
    verdict: str
    """Of the first: ``better``, ``worse``, ``equivalent`` or ``undecided``; ``larger`` or ``smaller`` where the
    difference is shown and neither is called better."""
    margin: float
    """Up to which a difference does not matter."""


class Pairs:
    """The judged pairs of a result by a metric, that which ranks unless given, looked up in either order."""

    def __init__(self, result: Result, path: str | None = None) -> None:
        path = path or result.summary.headline
        self._items = {
            (item.a, item.b): item for item in result.differences if item.metric == path and item.verdict is not None
        }
        self.margins = [item.margin for item in self._items.values()] or [result.summary.score.margin.absolute("m")]
        """Up to which differences do not matter, m."""

        alone = result.summary.runs == 1 and not any(item.ci95 for item in self._items.values())
        self.unjudged = "one run: differences cannot be judged" if alone and self._items else ""
        """Why no difference can be judged; empty where one can."""

    def get(self, a: str, b: str) -> Pair | None:
        """The difference ``a`` minus ``b``, or None where the pair was not compared."""
        item, sign = self._items.get((a, b)), 1.0
        if item is None:
            item, sign = self._items.get((b, a)), -1.0
        if item is None:
            return None
        word = item.verdict or "" if item.better is None else "better" if item.better == a else "worse"
        if item.turned:
            word = size(sign * item.value)
        ci95 = item.ci95 if item.ci95 is None or sign > 0 else (-item.ci95[1], -item.ci95[0])
        return Pair(sign * item.value, ci95, word, item.margin)

    def differ(self, a: str, b: str) -> bool:
        """Whether one is called better than the other: shown by more than the margin."""
        item = self._items.get((a, b)) or self._items.get((b, a))
        return item is not None and item.better is not None

    def within(self, name: str, others: Iterable[str]) -> str:
        """ "within 5 mm": up to what a difference from each of the others does not matter."""
        return f"within {margin_words(pair.margin for other in others if (pair := self.get(name, other)))}"

    def undecided(self, name: str) -> bool:
        """Whether in some pair with it neither is called better."""
        return any(name in names and item.better is None for names, item in self._items.items())

    def turned(self, names: Sequence[str]) -> dict[str, list[str]]:
        """By tracker, those of ``names`` than which it is not called better: for missing estimates alone it is."""
        others: dict[str, list[str]] = {}
        for (a, b), item in self._items.items():
            if item.turned and a in names and b in names:
                smaller, larger = (a, b) if item.value < 0 else (b, a)
                others.setdefault(smaller, []).append(larger)
        return others


def groups(names: Sequence[str], pairs: Pairs) -> dict[str, str]:
    """Letters such that two trackers share one exactly when neither is called better.

    ``names`` are in order of rank, so "a" is the best.
    """
    sets = groups_of(names, pairs.differ)
    gap = " " if len(sets) > len(ascii_lowercase) else ""
    return {name: gap.join(group_letter(i) for i, g in enumerate(sets) if name in g) for name in names}


@dataclass(frozen=True)
class Standing:
    """A column of the ranking: which of the differences from others were shown."""

    heading: str
    short: str
    """The same for a terminal."""
    meaning: str
    cells: list[str]
    """Of each scored tracker."""


def standing(result: Result) -> Standing:
    """Letters where every pair is compared, else what was shown of each tracker and the one that it is held against.

    A reference or a smoother is no competitor and has none.
    """
    score, pairs = result.summary.score, Pairs(result)
    margin, names = margin_words(pairs.margins), [tracker.name for tracker in result.contenders if tracker.paired]
    if score.against is None:
        heading = short = "group"
        meaning, cells = (f"the same letter: no difference over {margin} is shown", groups(names, pairs))
        if pairs.unjudged:
            meaning, cells = pairs.unjudged, {}
    else:
        words = {name: pair.verdict for name in names if (pair := pairs.get(name, score.against))}
        heading, short, cells = f"against {score.against}", "against", {score.against: "baseline", **words}
        meaning = f"better or worse than {score.against}: shown to differ by more than {margin}"
    if score.best is not None:
        heading, short = "not shown worse than the best", "best?"
        meaning = f"not shown to be worse than {score.best}, the best of {len(names)}, by more than {margin}"
        cells = {name: "" if words.get(name) == "worse" else "yes" for name in names}
    # An interval of runs of which few decide the mean says nothing.
    cells |= {t.name: "diverged" for t in result.contenders if t.health.diverged_runs and pairs.undecided(t.name)}
    return Standing(heading, short, meaning, [cells.get(tracker.name, "") for tracker in result.scored])
