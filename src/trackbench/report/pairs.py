"""Paired differences of trackers, looked up by name, and the column of the ranking that shows them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from string import ascii_lowercase

from trackbench.metrics.differences import EQUIVALENT, UNDECIDED, size
from trackbench.report.numbers import margin_words
from trackbench.results import Result


def groups_of(names: Sequence[str], differ: Callable[[str, str], bool]) -> list[frozenset[str]]:
    """Return groups of names such that two names share a group exactly if they do not differ, in order of ``names``.

    Insert-and-absorb algorithm of Piepho, "An algorithm for a letter-based representation of all-pairwise
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
    """Return the letter of group 0, 1 and so on: "a" to "z", then "aa", "ab"."""
    before, last = divmod(number, len(ascii_lowercase))
    return (group_letter(before - 1) if before else "") + ascii_lowercase[last]


def difference_word(verdict: str) -> str:
    """Return a verdict on a difference in plain words: "same" for equivalent, "not shown" for undecided."""
    return {EQUIVALENT: "same", UNDECIDED: "not shown"}.get(verdict, verdict)


@dataclass(frozen=True)
class Pair:
    """Difference of a metric between two trackers, the first minus the second, in the metric's unit."""

    value: float
    ci95: tuple[float, float] | None
    verdict: str
    """Verdict on the first tracker: ``better``, ``worse``, ``equivalent`` or ``undecided``; ``larger`` or ``smaller``
    if the difference is shown and neither tracker is called better."""
    margin: float
    """Largest difference that does not matter, in the metric's unit."""


class Pairs:
    """Judged differences of a run in one metric, for pairs of trackers in either order; default: the ranking metric."""

    def __init__(self, result: Result, path: str | None = None) -> None:
        path = path or result.summary.headline
        self._items = {
            (item.a, item.b): item for item in result.differences if item.metric == path and item.verdict is not None
        }
        self.margins = [item.margin for item in self._items.values()] or [result.summary.score.margin.absolute("m")]
        """Largest differences that do not matter, m: the margin of each pair."""

        has_no_interval = result.summary.runs == 1 and not any(item.ci95 for item in self._items.values())
        self.unjudged = "one run: differences cannot be judged" if has_no_interval and self._items else ""
        """Reason why no difference can be judged; empty otherwise."""

    def get(self, a: str, b: str) -> Pair | None:
        """Return the difference ``a`` minus ``b``, or None if the pair was not compared."""
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
        """Return whether one of two trackers is called better: the difference significantly exceeds the margin."""
        item = self._items.get((a, b)) or self._items.get((b, a))
        return item is not None and item.better is not None

    def within(self, name: str, others: Iterable[str]) -> str:
        """Return the margins of a tracker's differences from ``others``, as "within 5 mm"."""
        return f"within {margin_words(pair.margin for other in others if (pair := self.get(name, other)))}"

    def has_undecided(self, name: str) -> bool:
        """Return whether the tracker ``name`` is in a pair of which neither tracker is called better."""
        return any(name in names and item.better is None for names, item in self._items.items())

    def only_by_charges(self, names: Sequence[str]) -> dict[str, list[str]]:
        """Return, by tracker, the trackers with a larger error only because missing estimates are charged."""
        larger_errors: dict[str, list[str]] = {}
        for (a, b), item in self._items.items():
            if item.turned and a in names and b in names:
                smaller, larger = (a, b) if item.value < 0 else (b, a)
                larger_errors.setdefault(smaller, []).append(larger)
        return larger_errors


def group_letters(names: Sequence[str], differ: Callable[[str, str], bool]) -> dict[str, str]:
    """Return letters by tracker, as in a compact letter display: two trackers share a letter if they do not differ."""
    groups = groups_of(names, differ)
    gap = " " if len(groups) > len(ascii_lowercase) else ""
    return {name: gap.join(group_letter(i) for i, group in enumerate(groups) if name in group) for name in names}


@dataclass(frozen=True)
class Standing:
    """Column of the ranking that shows the verdicts on differences between trackers."""

    heading: str
    short: str
    """Short form of ``heading``, for a terminal."""
    meaning: str
    cells: list[str]
    """Text in this column for each scored tracker, best first."""


def standing(result: Result) -> Standing:
    """Return the ranking's column of verdicts: letters of groups if all pairs are compared, else against one tracker.

    A reference or a smoother does not compete and has an empty cell.
    """
    score, pairs = result.summary.score, Pairs(result)
    margin, names = margin_words(pairs.margins), [tracker.name for tracker in result.contenders if tracker.paired]
    if score.against is None:
        heading = short = "group"
        meaning = f"trackers that share a letter are the same, or not shown to be better by more than {margin}"
        cells = group_letters(names, pairs.differ)
        if pairs.unjudged:
            meaning, cells = pairs.unjudged, {}
    else:
        words = {name: difference_word(pair.verdict) for name in names if (pair := pairs.get(name, score.against))}
        heading, short, cells = f"against {score.against}", "against", {score.against: "baseline", **words}
        meaning = f"better or worse than {score.against}: shown to differ by more than {margin}"
    if score.best is not None:
        heading, short = "not shown worse than the best", "best?"
        meaning = f"not shown to be worse than {score.best}, the best of {len(names)}, by more than {margin}"
        cells = {name: "" if words.get(name) == "worse" else "yes" for name in names}
    # Few runs decide the mean of a tracker that diverged, so its interval says nothing.
    cells |= {t.name: "diverged" for t in result.contenders if t.health.diverged_runs and pairs.has_undecided(t.name)}
    return Standing(heading, short, meaning, [cells.get(tracker.name, "") for tracker in result.scored])
