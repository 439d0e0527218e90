"""Tracking in traffic: intervals, differences and verdicts"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from itertools import combinations
from typing import NamedTuple

import numpy as np

from trackbench.base.types import Array, Indices
from trackbench.metrics.contrasts import paired
from trackbench.metrics.differences import EQUIVALENT, EVERY_PAIR, Family, tracker_differences
from trackbench.metrics.intervals import Interval
from trackbench.metrics.traffic import TRACK_METRICS
from trackbench.results.scenario_summary import MarginSummary

from . import traffic_pool
from .claim import Claim, power, rate
from .traffic_pool import RUNS_OF_SCENE, TRACKERS

TRIALS, COMPARISONS = 1000, 500
SIZES = (10, 20, 50, 100, 400)
SCENES = 10
MARGIN = MarginSummary(percent=1.0, position_m=0.005, velocity_mps=0.02, course_deg=0.05)
#: From as many runs on as a result takes for an interval, it misses the mean in at most so many percent of the results.
MISSES = 8.0
#: Metrics whose intervals over runs are looked at.
OVER_RUNS = (
    "gospa",
    "gospa_localisation",
    "gospa_missed",
    "gospa_false",
    "tgospa",
    "hota",
    "idf1",
    "mota",
    "id_switches",
    "false_tracks",
    "confirm_latency",
    "matched_share",
    "position_rmse",
    "velocity_rmse",
    "nees",
    "association_right",
)
#: Of pmb, whose bad runs are less rare.
FEWEST_OF_PMB = {"velocity_rmse": 400, "nees": 400}
#: Metrics whose intervals over ``SCENES`` and whose differences are looked at.
OVER_SCENES = ("gospa", "gospa_missed", "gospa_false", "tgospa", "mota", "false_tracks", "confirm_latency")

#: Expectations of every pair by every metric.
ALL_EXPECTED = Family(
    expected={(path, frozenset(pair)) for path in TRACK_METRICS for pair in combinations(TRACKERS, 2)}
)


class Sample(NamedTuple):
    """The runs of one result: of one scene, or of several."""

    sums: Array
    """``(trackers, runs, 2, paths)``."""
    scene: Indices | None

    def interval(self, tracker: int, path: str) -> Interval | None:
        """A metric of one tracker."""
        return traffic_pool.interval(self.sums[tracker], path, self.scene)

    def exchanged(self, random: np.random.Generator) -> Sample:
        """Each run, or scene, under the names of other trackers: all are equal in expectation."""
        groups = np.arange(self.sums.shape[1]) if self.scene is None else self.scene
        order = random.random((len(TRACKERS), groups[-1] + 1)).argsort(axis=0)[:, groups]
        return self._replace(sums=np.take_along_axis(self.sums, order[:, :, None, None], axis=0))


class Population(NamedTuple):
    """All runs, whose mean is the expectation, and how a result is drawn from them."""

    name: str
    sums: Array
    """``(trackers, scenes or runs, runs of a scene or 1, 2, paths)``."""

    def draw(self, random: np.random.Generator, size: int) -> Sample:
        """A result of so many scenes, or runs of one scene."""
        drawn = self.sums[:, random.integers(0, self.sums.shape[1], size)]
        each = drawn.shape[2]
        scene = None if each == 1 else np.repeat(np.arange(size), each)
        return Sample(drawn.reshape(len(drawn), -1, *drawn.shape[3:]), scene)

    def expected(self, tracker: int, path: str) -> float:
        """The value of a metric over all."""
        found = Sample(self.sums.reshape(len(self.sums), -1, *self.sums.shape[3:]), None).interval(tracker, path)
        assert found is not None
        return found.value


def claims() -> Iterator[Claim]:
    random = np.random.default_rng(1)
    runs = Population("runs", traffic_pool.runs()[:, :, None])
    scenes = Population(f"scenes of {RUNS_OF_SCENE} runs", traffic_pool.scenes())
    for tracker in ("gnn", "pmb"):
        for path in OVER_RUNS:
            yield _intervals(random, runs, TRACKERS.index(tracker), path)
        for path in OVER_SCENES:
            what = f"{tracker} {path}, {SCENES} {scenes.name}: interval misses the mean"
            missed, _ = _missed(random, scenes, TRACKERS.index(tracker), path, SCENES)
            yield rate(what, missed, 0.0, MISSES / 100)
    for population, size in ((runs, 10), (runs, 100), (scenes, SCENES)):
        yield from _equal(random, population, size)
        yield from _different(random, population, size)


def _missed(
    random: np.random.Generator, population: Population, tracker: int, path: str, size: int
) -> tuple[Array, float]:
    """Which of many results have an interval that misses, and the share of those that have none."""
    expected, missed, without = population.expected(tracker, path), np.zeros(TRIALS), 0
    for trial in range(TRIALS):
        found = population.draw(random, size).interval(tracker, path)
        ci95 = None if found is None else found.ci95
        without += ci95 is None
        missed[trial] = ci95 is not None and not ci95[0] <= expected <= ci95[1]
    return missed, without / TRIALS


def _intervals(random: np.random.Generator, runs: Population, tracker: int, path: str) -> Claim:
    parts, rates = [], {}
    for size in SIZES:
        missed, without = _missed(random, runs, tracker, path, size)
        rates[size] = 100 * float(missed.mean())
        none = f" ({100 * without:.0f} % have none)" if without > 0.005 else ""
        parts.append(f"{size} runs {rates[size]:.1f} %{none}")
    fewest = TRACK_METRICS[path].fewest
    if TRACKERS[tracker] == "pmb":
        fewest = FEWEST_OF_PMB.get(path, fewest)
    if fewest == np.inf:
        holds, excess = rates[100] > MISSES, MISSES - rates[100]
        wanted = f"where it stops: over {MISSES:g} % with 100 runs, as few runs decide the mean"
    else:
        excess = max(value for size, value in rates.items() if size >= fewest) - MISSES
        holds = excess <= 0.0
        wanted = f"at most {MISSES:g} % from {fewest} runs on"
    what = f"{TRACKERS[tracker]} {path}: interval misses the mean"
    return Claim(what, ", ".join(parts), wanted, holds, excess=excess)


def _equal(random: np.random.Generator, population: Population, size: int) -> Iterator[Claim]:
    """What is said of trackers that are equal in expectation."""
    by_what = {"what ranks": EVERY_PAIR, f"any of {len(TRACK_METRICS)} metrics, all expected": ALL_EXPECTED}
    hits: dict[str, list[bool]] = {what: [] for what in by_what}
    for _ in range(COMPARISONS):
        sample = population.draw(random, size).exchanged(random)
        for what, family in by_what.items():
            hits[what].append(any(verdict.endswith("better") for verdict in _verdicts(sample, family).values()))
    for what, wrong in hits.items():
        claim = f"any of three equal trackers called better than another by {what}, {size} {population.name}"
        yield rate(claim, wrong, 0.0, 0.05)


def _different(random: np.random.Generator, population: Population, size: int) -> Iterator[Claim]:
    """What is said of two trackers, one of which is better."""
    gnn, pmb = TRACKERS.index("gnn"), TRACKERS.index("pmb")
    expected = {path: population.expected(gnn, path) - population.expected(pmb, path) for path in TRACK_METRICS}
    wrong = Counter(dict.fromkeys(TRACK_METRICS, 0))
    equivalent, shown, covered = [], [], {path: np.ones(COMPARISONS) for path in OVER_SCENES}
    for trial in range(COMPARISONS):
        sample = population.draw(random, size)
        for path, hits in covered.items():
            ours, theirs = sample.interval(gnn, path), sample.interval(pmb, path)
            assert ours is not None
            assert theirs is not None
            ci95 = paired(ours, theirs).ci95
            hits[trial] = ci95 is None or ci95[0] <= expected[path] <= ci95[1]
        found = _verdicts(sample, ALL_EXPECTED)
        shown.append(_verdicts(sample, EVERY_PAIR)["tgospa", "gnn", "pmb"].endswith("better"))
        for path, difference in expected.items():
            better = "gnn" if (difference < 0) == (TRACK_METRICS[path].better == "smaller") else "pmb"
            verdict = found.get((path, "gnn", "pmb"), "")
            wrong[path] += verdict.endswith("better") and not verdict.startswith(better)
        equivalent.append(found.get(("id_switches", "gnn", "pmb")) == EQUIVALENT)
    for path, hits in covered.items():
        what = f"gnn minus pmb, {path}, {size} {population.name}: interval covers"
        if (path, size, population.name) == ("gospa_false", 10, "runs"):
            yield rate(f"where it stops: {what}", hits, 0.85, 1 - MISSES / 100)
        else:
            yield rate(what, hits, 1 - MISSES / 100, 1.0)
    yield power(f"gnn or pmb called better than the other by what ranks, {size} {population.name}", shown)
    what = f"gnn and pmb called equivalent by id_switches, of which pmb has more, {size} {population.name}"
    yield rate(what, equivalent, 0.0, 0.05)
    path, most = wrong.most_common(1)[0]
    yield Claim(
        f"gnn or pmb called better though it is worse, the metric of {len(TRACK_METRICS)} with the most, "
        f"{size} {population.name}",
        f"{100 * most / COMPARISONS:.1f} % ({path})",
        "at most 5 %",
        most <= 0.05 * COMPARISONS,
        excess=most / COMPARISONS - 0.05,
    )


def _verdicts(sample: Sample, family: Family) -> dict[tuple[str, str, str], str]:
    """By metric and pair of trackers, as a result says them."""
    intervals: dict[str, dict[str, Interval]] = {}
    for number, name in enumerate(TRACKERS):
        own = {path: sample.interval(number, path) for path in TRACK_METRICS}
        intervals[name] = {path: found for path, found in own.items() if found is not None}
    found = tracker_differences(
        intervals, list(TRACK_METRICS.values()), MARGIN, {name: {} for name in TRACKERS}, family
    )
    return {(item.metric, item.a, item.b): item.verdict for item in found if item.verdict is not None}
