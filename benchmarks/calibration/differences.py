"""Better, equivalent or undecided"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from trackbench.metrics import BUILT_IN
from trackbench.metrics.differences import EVERY_PAIR, Family, tracker_differences
from trackbench.metrics.intervals import Interval, ratio, root
from trackbench.results import Difference
from trackbench.results.scenario_summary import MarginSummary

from .claim import Claim, power, rate

TRIALS = 2000
#: Without a margin nothing but the correction holds a wrong word back.
NONE = MarginSummary(percent=0.0, position_m=0.0, velocity_mps=0.0, course_deg=0.0)
MARGIN = MarginSummary(percent=1.0, position_m=0.005, velocity_mps=0.02, course_deg=0.05)
#: RMSE of the best tracker: 1 % of it is more than the absolute margins.
RMSE = 10.0
#: The metrics that are means over the runs of every labelled scenario.
METRICS = ("position_rmse", "velocity_rmse", "rmse.px", "rmse.py", "rmse.vx", "rmse.vy")
#: A sweep: of its trackers each is compared with the best.
SWEPT, SWEEPS = 60, 1000
AT_MARGIN = 1.0 + MARGIN.percent / 100
FIVE_MARGINS = 1.0 + 5 * MARGIN.percent / 100


def claims() -> Iterator[Claim]:
    random = np.random.default_rng(1)
    for runs in (10, 100):
        equal = [_verdicts(random, runs, [1.0] * 6, margin=NONE) for _ in range(TRIALS)]
        wrong = [any(verdict.endswith("better") for verdict in found) for found in equal]
        yield rate(f"any of six equal trackers called better than another, {runs} runs", wrong, 0.0, 0.05)
        yield from _power(random, runs, 6, EVERY_PAIR)
        at_margin = [_verdicts(random, runs, [1.0, AT_MARGIN]) for _ in range(TRIALS)]
        wrong = [found[0].endswith("better") for found in at_margin]
        yield rate(f"a tracker that is worse by the margin called worse, {runs} runs", wrong, 0.0, 0.05)
        right = [_verdicts(random, runs, [1.0, FIVE_MARGINS])[0] == "a better" for _ in range(TRIALS // 5)]
        yield power(f"a tracker that is worse by five margins called worse, {runs} runs", right)
        wrong = [found[0] == "equivalent" for found in at_margin]
        yield rate(f"a tracker that is worse by the margin called equivalent, {runs} runs", wrong, 0.0, 0.05)
        right = [_verdicts(random, runs, [1.0, 1.0])[0] == "equivalent" for _ in range(TRIALS // 5)]
        yield power(f"of two equal trackers one called equivalent to the other, {runs} runs", right)
    yield from _any_metric(random)
    yield from _sweep(random)
    yield from _baseline(random)
    for runs, least in ((20, 0.0), (400, 0.95)):
        words = [_verdicts(random, runs, [1.0, FIVE_MARGINS])[0] for _ in range(TRIALS)]
        what = "a tracker that is worse by five margins called"
        yield rate(f"{what} better, {runs} runs", [word == "b better" for word in words], 0.0, 0.001)
        yield power(f"{what} worse, {runs} runs", [word == "a better" for word in words], least)
    right = [_verdicts(random, 1000, [1.0, 1.0])[0] == "equivalent" for _ in range(TRIALS)]
    yield rate("of two equal trackers one called equivalent to the other, 1000 runs", right, 0.95, 1.0)


def _any_metric(random: np.random.Generator) -> Iterator[Claim]:
    """What a result calls better by any of its metrics, with and without expectations of other metrics."""
    expected = {(path, frozenset("ab")) for path in METRICS[1:]}
    for what, family in (("none is expected", EVERY_PAIR), ("six are expected", Family(expected=expected))):
        equal = [_differences(random, 20, [1.0] * 6, family, NONE) for _ in range(TRIALS)]
        wrong = [any(item.better for item in items) for items in equal]
        yield rate(f"any of six equal trackers called better by any of 7 metrics, {what}, 20 runs", wrong, 0.0, 0.05)
        yield from _power(random, 20, 6, family)


def _sweep(random: np.random.Generator) -> Iterator[Claim]:
    """Many trackers: each is held against the best, which is found in the same data."""
    for runs in (10, 100):
        for what, errors, margin in (
            ("equal trackers", [1.0] * SWEPT, NONE),
            ("trackers, all but one worse by the margin", [1.0, *[AT_MARGIN] * (SWEPT - 1)], MARGIN),
            ("trackers, half of them worse by five margins", [1.0, FIVE_MARGINS] * (SWEPT // 2), NONE),
        ):
            good = {_name(place) for place, error in enumerate(errors) if error <= AT_MARGIN}
            trials = [_worse_than_best(random, runs, errors, margin) for _ in range(SWEEPS)]
            wrong = [bool(worse & good) for worse in trials]
            yield rate(f"any as good as the best of {SWEPT} {what} called worse than it, {runs} runs", wrong, 0.0, 0.05)
    for runs, least in ((10, 0.0), (100, 0.95)):
        errors = [1.0, FIVE_MARGINS] * (SWEPT // 2)
        bad = {_name(place) for place, error in enumerate(errors) if error > AT_MARGIN}
        trials = [_worse_than_best(random, runs, errors, MARGIN) for _ in range(SWEEPS // 5)]
        yield power(
            f"of {SWEPT} trackers those worse by five margins called worse than the best, {runs} runs",
            [len(worse & bad) / len(bad) for worse in trials],
            least,
        )


def _baseline(random: np.random.Generator) -> Iterator[Claim]:
    """Each tracker against one that is named before."""
    family = Family(_name(0))
    equal = [_verdicts(random, 20, [1.0] * SWEPT, family, NONE) for _ in range(SWEEPS)]
    wrong = [any(verdict.endswith("better") for verdict in found) for found in equal]
    yield rate(f"any of {SWEPT} equal trackers called better or worse than the baseline, 20 runs", wrong, 0.0, 0.05)
    yield from _power(random, 20, SWEPT, family)


def _power(random: np.random.Generator, runs: int, trackers: int, family: Family) -> Iterator[Claim]:
    """How often a tracker that is better by five margins than all others is called so, of each of them."""
    errors = [1.0, *[FIVE_MARGINS] * (trackers - 1)]
    shares = []
    for _ in range(SWEEPS // 5):
        items = _differences(random, runs, errors, family)
        own = [item.better == _name(0) for item in items if item.a == _name(0) and item.metric == METRICS[0]]
        shares.append(float(np.mean(own)))
    beside = f" and {len(family.expected)} expectations" if family.expected else ""
    what = f"a tracker better by five margins than {trackers - 1} others called so{beside}, {runs} runs"
    yield power(what, shares)


def _worse_than_best(
    random: np.random.Generator, runs: int, errors: Sequence[float], margin: MarginSummary
) -> set[str]:
    """The trackers that are called worse than the best."""
    intervals = _intervals(random, runs, errors)
    best = min(intervals, key=lambda name: intervals[name][METRICS[0]].value)
    items = tracker_differences(
        intervals, BUILT_IN, margin, {name: {} for name in intervals}, Family(best, selected=True)
    )
    return {item.b for item in items if item.better == best}


def _verdicts(
    random: np.random.Generator,
    runs: int,
    errors: Sequence[float],
    family: Family = EVERY_PAIR,
    margin: MarginSummary = MARGIN,
) -> list[str]:
    """Of every pair in the family."""
    return [item.verdict for item in _differences(random, runs, errors, family, margin) if item.verdict is not None]


def _differences(
    random: np.random.Generator, runs: int, errors: Sequence[float], family: Family, margin: MarginSummary = MARGIN
) -> list[Difference]:
    """Of trackers with these errors by every metric, the first of which alone is of the family."""
    intervals = _intervals(random, runs, errors, METRICS)
    return tracker_differences(intervals, BUILT_IN, margin, {name: {} for name in intervals}, family)


def _intervals(
    random: np.random.Generator, runs: int, errors: Sequence[float], metrics: Sequence[str] = METRICS[:1]
) -> dict[str, dict[str, Interval]]:
    """By tracker and metric; the runs of all trackers have most of the noise in common."""
    common = 0.25 * random.normal(size=(len(metrics), runs))
    logs = common[:, None] + 0.075 * random.normal(size=(len(metrics), len(errors), runs))
    squares = (RMSE * np.array(errors)[:, None]) ** 2 * np.exp(logs - (0.25**2 + 0.075**2) / 2)
    return {
        _name(place): {path: root(ratio(own[place], np.ones(runs))) for path, own in zip(metrics, squares, strict=True)}
        for place in range(len(errors))
    }


def _name(place: int) -> str:
    """Single letters first."""
    return "abcdefghijklmnopqrstuvwxyz"[place] if place < 26 else f"t{place}"
