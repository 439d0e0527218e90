"""Ratios pooled over scenarios"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from trackbench.compare.pooled import pooled
from trackbench.metrics.contrasts import LogRatio, log_ratio
from trackbench.metrics.intervals import ratio, root

from .claim import Claim, rate

TRIALS = 4000
#: Number of scenarios and of runs of each, spread of the logarithm of a run's squared error, and paired or not.
CASES = ((4, 20, 0.3, True), (4, 20, 0.3, False), (2, 5, 0.3, True), (13, 20, 0.3, True))


def claims() -> Iterator[Claim]:
    """Fixed scenarios with ratios of their own; the noise of scenarios differs by up to a factor of five."""
    random = np.random.default_rng(1)
    for scenarios, runs, spread, is_paired in CASES:
        inside = [_covers(random, scenarios, runs, spread, is_paired) for _ in range(TRIALS)]
        how = "paired" if is_paired else "unpaired"
        what = f"{scenarios} scenarios of {runs} runs, {how}, spread {spread:g}: interval of the pooled ratio covers"
        yield rate(what, inside, 0.93, 0.97)


def _covers(random: np.random.Generator, scenarios: int, runs: int, spread: float, is_paired: bool) -> bool:
    """Whether the interval holds the mean logarithm of the ratios of the expected errors."""
    truth = np.linspace(-0.2, 0.4, scenarios)
    ratios: list[LogRatio] = []
    for scenario, logarithm in enumerate(truth):
        scale = spread * (1.0 if scenario % 2 else 0.2)
        common = random.normal(size=runs)
        other = common if is_paired else random.normal(size=runs)
        a, b = (_errors(random, side, scale) for side in (common, other))
        made = log_ratio(root(ratio(np.exp(2 * logarithm) * a, np.ones(runs))), root(ratio(b, np.ones(runs))),
                         is_paired=is_paired)  # fmt: skip
        assert made is not None
        ratios.append(made)
    mean, reach = pooled(ratios, range(scenarios))
    assert reach is not None
    return bool(abs(mean - truth.mean()) <= reach)


def _errors(random: np.random.Generator, common: np.ndarray, spread: float) -> np.ndarray:
    """Squared errors of the runs of one tracker, with mean 1: half of their logarithm is common to all trackers."""
    logarithm = spread * (common + random.normal(size=len(common))) / np.sqrt(2)
    errors: np.ndarray = np.exp(logarithm - 0.5 * spread**2)
    return errors
