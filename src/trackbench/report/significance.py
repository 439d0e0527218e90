"""Which differences between trackers are real, and how to say so in a column."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from string import ascii_lowercase
from typing import Any

NO_DIFFERENCE = "no difference shown"


@dataclass(frozen=True)
class Difference:
    """The paired difference of position RMSE between two trackers, ``a`` minus ``b``."""

    a: str
    b: str
    value: float
    ci95: tuple[float, float] | None
    p_value: float | None
    better: str | None
    """The better one where the difference is real, else None."""

    @property
    def verdict(self) -> str:
        return f"{self.better} better" if self.better else NO_DIFFERENCE


class Differences:
    """All pairs of a result, looked up in either order."""

    def __init__(self, entries: Iterable[Mapping[str, Any]]) -> None:
        self._pairs: dict[tuple[str, str], Difference] = {}
        for entry in entries:
            if entry.get("metric", "position_rmse") != "position_rmse" or entry["value"] is None:
                continue
            a, b, value, ci = entry["a"], entry["b"], entry["value"], entry.get("ci95")
            better = entry["better"]
            p_value = entry.get("p_value")
            self._pairs[a, b] = Difference(a, b, value, tuple(ci) if ci else None, p_value, better)
            flipped = (-ci[1], -ci[0]) if ci else None
            self._pairs[b, a] = Difference(b, a, -value, flipped, p_value, better)

    def get(self, a: str, b: str) -> Difference | None:
        """The difference ``a`` minus ``b``, or None where the pair was not compared."""
        return self._pairs.get((a, b))

    def real(self, a: str, b: str) -> bool:
        """Whether a difference between the two was shown."""
        found = self.get(a, b)
        return found is not None and found.better is not None


def letters(names: Sequence[str], differences: Differences) -> dict[str, str]:
    """Letters such that two trackers share one exactly when no difference between them was shown.

    The insert-and-absorb algorithm of Piepho, "An algorithm for a letter-based representation of all-pairwise
    comparisons", J. Comput. Graph. Stat. 13(2), 2004. ``names`` are in order of rank, so "a" is the best.
    """
    groups = [frozenset(names)]
    for i, a in enumerate(names):
        for b in names[i + 1 :]:
            if not differences.real(a, b):
                continue
            split = [part for g in groups for part in ((g - {a}, g - {b}) if {a, b} <= g else (g,))]
            unique = list(dict.fromkeys(split))
            groups = [g for g in unique if not any(g < other for other in unique)]
    groups.sort(key=lambda g: sorted(names.index(name) for name in g))
    return {name: "".join(_letter(i) for i, g in enumerate(groups) if name in g) for name in names}


def _letter(index: int) -> str:
    lower = ascii_lowercase + ascii_lowercase.upper()
    return lower[index % len(lower)]
