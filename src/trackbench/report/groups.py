"""Groups of what was not shown to differ."""

from __future__ import annotations

from collections.abc import Callable, Sequence


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
