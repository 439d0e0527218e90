"""Better, equivalent or undecided"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from trackbench.metrics import BUILT_IN
from trackbench.metrics.differences import differences
from trackbench.metrics.intervals import Interval, ratio, root
from trackbench.results.score_summary import MarginSummary

from .claim import Claim, rate

TRIALS = 4000
MARGIN = MarginSummary(percent=1.0, position_m=0.005, velocity_mps=0.02, course_deg=0.05)
#: RMSE of the best tracker, m: 1 % of it is more than 5 mm.
RMSE = 1.0


def claims() -> Iterator[Claim]:
    random = np.random.default_rng(1)
    for runs in (10, 100):
        equal = [_verdicts(random, runs, [1.0] * 6) for _ in range(TRIALS)]
        wrong = [any(verdict.endswith("better") for verdict in found) for found in equal]
        yield rate(f"any of six equal trackers called better than another, {runs} runs", wrong, 0.0, 0.05)
        at_margin = [_verdicts(random, runs, [1.0, 1.0 + MARGIN.percent / 100]) for _ in range(TRIALS)]
        wrong = [found[0].endswith("better") for found in at_margin]
        yield rate(f"a tracker that is worse by the margin called worse, {runs} runs", wrong, 0.0, 0.05)
        wrong = [found[0] == "equivalent" for found in at_margin]
        yield rate(f"a tracker that is worse by the margin called equivalent, {runs} runs", wrong, 0.0, 0.05)
    for runs in (20, 400):
        found = [_verdicts(random, runs, [1.0, 1.05])[0] for _ in range(TRIALS)]
        yield rate(
            f"a tracker that is worse by five margins called better, {runs} runs",
            [v == "b better" for v in found],
            0.0,
            0.001,
        )
    right = [_verdicts(random, 400, [1.0, 1.05])[0] == "a better" for _ in range(TRIALS)]
    yield rate("a tracker that is worse by five margins called worse, 400 runs", right, 0.95, 1.0)
    right = [_verdicts(random, 1000, [1.0, 1.0])[0] == "equivalent" for _ in range(TRIALS)]
    yield rate("of two equal trackers one called equivalent to the other, 1000 runs", right, 0.95, 1.0)


def _verdicts(random: np.random.Generator, runs: int, errors: list[float]) -> list[str]:
    """Of every pair of trackers with these errors, whose runs have most of the noise in common."""
    common = 0.25 * random.normal(size=runs)
    intervals: dict[str, dict[str, Interval]] = {}
    for name, error in zip("abcdef", errors, strict=False):
        logs = common + 0.075 * random.normal(size=runs)
        squares = (RMSE * error) ** 2 * np.exp(logs - (0.25**2 + 0.075**2) / 2)
        intervals[name] = {"position_rmse": root(ratio(squares, np.ones(runs)))}
    return [item.verdict for item in differences(intervals, BUILT_IN, MARGIN, dict.fromkeys(intervals, 1.0))]
