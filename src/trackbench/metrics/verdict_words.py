"""What a reader is told of a verdict on a covariance."""

from __future__ import annotations

import math

from trackbench.results import MetricValue

MEANING = {
    "consistent": "the errors are as large as its covariance states, under each condition",
    "optimistic": "the errors are larger than its covariance states",
    "pessimistic": "the errors are smaller than its covariance states",
    "mixed": "the errors are larger or smaller than its covariance states, depending on the condition",
    "undecided": "too few runs or scenes to say whether the errors are as large as its covariance states",
}


def conditions_off(found: MetricValue, most: int = 4) -> str:
    """Where a mean is off, farthest first, and by how much: "turning 39.7, straight 2.9".

    Of a mixed one that is off nowhere, the conditions that are furthest apart.
    """
    off = [condition for condition in found.conditions or () if condition.verdict in ("optimistic", "pessimistic")]
    dof = found.dof or 1
    if found.verdict == "mixed" and not off:
        means = sorted(found.conditions or (), key=lambda condition: condition.mean)
        off = [means[0], means[-1]]
    off.sort(key=lambda condition: -abs(math.log(max(condition.mean, 1e-9) / dof)))
    named = [f"{condition.name} {mean_text(condition.mean)}" for condition in off[:most]]
    more = [f"{len(off) - most} more"] if len(off) > most else []
    return ", ".join(named + more)


def mean_text(mean: float) -> str:
    """ "4.2", "2e+05"."""
    return f"{mean:.1f}" if mean < 1000 else f"{mean:.0e}"
