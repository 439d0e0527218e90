"""Changes against a baseline, pooled over scenarios: geometric mean of the ratios, with its interval."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.special import stdtrit

from trackbench.compare.comparison import EntrantScore, OverallChange, PairDifference, as_percent
from trackbench.metrics.contrasts import LogRatio


def overall(
    differences: Sequence[PairDifference], sets: Sequence[Sequence[str]], scores: Sequence[EntrantScore]
) -> list[OverallChange]:
    """Return the change of each entrant against the baseline, pooled over the scenarios, for each metric.

    Args:
        differences: differences of trackers to the baseline, in each scenario.
        sets: names of scenarios, grouped where they share scenes.
        scores: scores of the entrants; where runs diverged, few runs decide a mean, and the pooled change has no
            interval.
    """
    number = {scenario: number for number, members in enumerate(sets) for scenario in members}
    diverged = [(score.scenario, score.entrant) for score in scores if score.diverged_runs]
    # A tracker that lacks a scenario has no mean, as it would be over other scenarios than the mean of the rest.
    scenarios, changes = len({item.scenario for item in differences}), []
    for key in dict.fromkeys((item.metric, item.entrant, item.against) for item in differences):
        rows = [item for item in differences if (item.metric, item.entrant, item.against) == key]
        verdicts = [item.verdict for item in rows]
        # Values that are equal in every run are taken as equal in further runs.
        ratios = [LogRatio(0.0, 0.0, 1) if item.identical else item.log_ratio for item in rows]
        positive = [ratio for ratio in ratios if ratio is not None]
        mean, reach = (
            pooled(positive, [number[item.scenario] for item in rows]) if len(positive) == scenarios else (None, None)
        )
        if any((item.scenario, side) in diverged for item in rows for side in key[1:]):
            reach = None
        changes.append(
            OverallChange(
                metric=key[0],
                entrant=key[1],
                against=key[2],
                verdicts={verdict: verdicts.count(verdict) for verdict in dict.fromkeys(verdicts)},
                mean_percent=None if mean is None else as_percent(mean),
                ci95=(as_percent(mean - reach), as_percent(mean + reach)) if mean is not None and reach else None,
            )
        )
    return changes


def pooled(ratios: Sequence[LogRatio], sets: Sequence[int]) -> tuple[float, float | None]:
    """Return the mean over all scenarios of the log ratios of errors, and half of its 95 % interval.

    The scenarios are fixed: their ratios are allowed to differ, and the interval is over other noise and scenes of
    each. Errors of scenarios that share scenes are added as fully correlated, the others are independent. Source of the
    degrees of freedom: Satterthwaite (1946), "An approximate distribution of estimates of variance components".
    ``benchmarks/calibration/pooled.py`` measures the coverage. With squared errors of single runs that differ by a
    factor of e, one standard deviation, 13 scenarios of 20 runs cover 92 %.

    Args:
        ratios: log ratio of each scenario.
        sets: ``(scenarios,)`` number of the set of scenes of each scenario.
    """
    mean = float(np.mean([ratio.value for ratio in ratios]))
    errors: dict[int, float] = {}
    freedoms: dict[int, int] = {}
    for ratio, group in zip(ratios, sets, strict=True):
        if ratio.error is None:
            return mean, None
        errors[group] = errors.get(group, 0.0) + ratio.error
        if ratio.error > 0:
            freedoms[group] = min(ratio.freedom, freedoms.get(group, ratio.freedom))
    squares = {group: errors[group] ** 2 for group in freedoms}
    total = sum(squares.values())
    if not total:
        return mean, 0.0
    freedom = total**2 / sum(square**2 / freedoms[group] for group, square in squares.items())
    return mean, float(stdtrit(freedom, 0.975) * np.sqrt(total) / len(ratios))
