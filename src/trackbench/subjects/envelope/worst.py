"""Searches for the worst run: over seeds, and over how the ego drives or what else the axes vary.

Source of the search: Hansen (2016), "The CMA Evolution Strategy: A Tutorial", by its author's package ``cma``.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from trackbench.base.errors import InputError
from trackbench.base.execution import Task
from trackbench.base.types import NotedProgress, no_progress
from trackbench.runner.tables import run_values
from trackbench.runner.work import BlockRuns
from trackbench.scenario import Scenario
from trackbench.scenario.load import own_folder
from trackbench.subjects.envelope.axes import MapAxis, Point, from_share, overrides
from trackbench.subjects.envelope.cells import Extent, Requirement, make_runs
from trackbench.subjects.envelope.config import Search
from trackbench.subjects.envelope.counter_models import WorstRun
from trackbench.subjects.envelope.mapping import EnvelopeMap
from trackbench.subjects.envelope.task import base_point, changed_scenario

#: Share of the runs that try other seeds at the worst point that was found.
ON_SEEDS = 0.25
#: Of each axis, the first standard deviation of what is tried.
SPREAD = 0.3


def require_cma() -> None:
    """Make sure that the package of the search is there.

    Raises:
        InputError: it is not.
    """
    try:
        import cma  # noqa: F401
    except ImportError:
        raise InputError("a search needs cma: pip install 'trackbench[search]'", key="envelope.search") from None


class Candidate(NamedTuple):
    """A run that may be the worst."""

    shares: tuple[float, ...]
    """Where it lies on each axis, from 0 to 1."""
    number: int
    """Which seed it has: of the runs of all scenes, the first of each scene first; where traffic repeats, of scenes."""


class WorstSearch:
    """Looks for the run that is furthest beyond the limit of a requirement.

    Args:
        made: the map; runs are made as its cells were.
        item: the requirement.
        search: how long, and over what.
    """

    def __init__(self, made: EnvelopeMap, item: Requirement, search: Search) -> None:
        task = made.task
        axes = tuple(MapAxis(name, axis) for name, axis in search.axes.items())
        self.axes = axes or tuple(axis for axis in task.axes if axis.ordered)
        self._task, self._item, self._search = task, item, search
        self._scenes = 1 if task.config.claim == "traffic like these" else len(task.loaded.config.truth.scenes())
        self._map = made.another()
        self._last: list[float] = []
        """The values of the runs that were tried last."""
        self._names = [item.tracker, *([item.other] if item.other else [])]

    def worst(self, progress: NotedProgress = no_progress) -> tuple[Candidate, float]:
        """The worst run and its value: first by an evolution strategy, then over seeds at the worst point.

        Args:
            progress: called with the number of runs made and of all.
        """
        budget, made = self._search.runs, 0
        best = Candidate(tuple(self._start()), 0), float("nan")
        for group in self._proposed(int(budget * (1 - ON_SEEDS)) if self.axes else 0):
            best, made = self._better(best, group), made + len(group)
            progress(made, budget)
        best = self._better(best, [Candidate(best[0].shares, number) for number in range(made, budget)])
        progress(budget, budget)
        return best

    def values(self, candidates: Sequence[Candidate]) -> list[float]:
        """What is required, in each of some runs; NaN where the tracker fails or has no value."""
        begun = []
        for candidate in candidates:
            loaded, piece = self.scenario(candidate), self._piece(candidate)
            work = self._map.work(loaded, Extent(1, loaded.config.monte_carlo.runs))
            here = work.of_scenes({piece.scene})
            task = Task(make_runs, here, own_folder(loaded), long=True)
            begun.append((work.metrics, self._map.executor.submit(task, self._names, [piece])))
        values = []
        for metrics, future in begun:
            sums = future.result().sums
            metric = next(metric for metric in metrics if metric.path == self._item.metric)
            if not {*self._names} <= {*sums}:
                values.append(np.nan)
                continue
            sides = [run_values(metric, sums[name], 1) for name in self._names]
            if any(side is None for side in sides):
                message = f"single runs do not tell {self._item.metric}, so that none can be searched for"
                raise InputError(message, key="envelope.search")
            first, *rest = (float(side[0]) for side in sides if side is not None)
            values.append(first - rest[0] if rest else first)
        return values

    def changes(self, candidate: Candidate) -> list[str]:
        """``key.path=value`` of what a run has, so that it is repeated and recorded alone."""
        config, piece = self._task.loaded.config, self._piece(candidate)
        changes = overrides(self.axes, self.point(candidate))
        if self._task.config.claim == "traffic like these":
            first = next(iter(config.truth.scenes())).seed  # type: ignore[attr-defined]
            changes += [f"truth.seed={first + candidate.number}", "truth.seeds=1"]
        runs = piece.runs.start + 1
        return [*changes, f"monte_carlo.runs={runs}", f"recording.scene={piece.scene}", f"recording.run={runs - 1}"]

    def scenario(self, candidate: Candidate) -> Scenario:
        """That of a run."""
        return changed_scenario(self._task.loaded, self.changes(candidate), self._names)

    def point(self, candidate: Candidate) -> Point:
        """Its values of the axes."""
        return tuple(from_share(axis, share) for axis, share in zip(self.axes, candidate.shares, strict=True))

    def _piece(self, candidate: Candidate) -> BlockRuns:
        run, scene = divmod(candidate.number, self._scenes)
        if self._task.config.claim == "traffic like these":
            run = scene = 0
        return BlockRuns(scene, range(run, run + 1))

    def _better(self, best: tuple[Candidate, float], group: Sequence[Candidate]) -> tuple[Candidate, float]:
        self._last = self.values(group)
        return max([best, *zip(group, self._last, strict=True)], key=lambda pair: self._excess(pair[1]))

    def _excess(self, value: float) -> float:
        return -np.inf if np.isnan(value) else float(self._item.excess(value))

    def _proposed(self, most: int) -> Iterator[list[Candidate]]:
        """Generations of an evolution strategy, begun anew wherever it has converged; each has one seed for all."""
        import cma

        # The strategy has at least two dimensions.
        size, number, start = max(2, len(self.axes)), 0, self._start()
        random = np.random.default_rng(self._search.seed)
        while number < most:
            # A seed of 0 would be that of the clock.
            options = {"bounds": [0, 1], "seed": int(random.integers(1, 2**31)), "verbose": -9}
            strategy = cma.CMAEvolutionStrategy([*start, *[0.5] * (size - len(start))], SPREAD, options)
            while number < most and not strategy.stop():
                points = strategy.ask()
                yield [Candidate(tuple(point[: len(self.axes)].tolist()), number) for point in points]
                # What has no value is no better than the worst.
                losses = [-self._excess(value) for value in self._last if not np.isnan(value)]
                strategy.tell(
                    points, [max(losses, default=0.0) if np.isnan(v) else -self._excess(v) for v in self._last]
                )
                number += len(points)
            start = random.uniform(size=len(self.axes)).tolist()

    def _start(self) -> list[float]:
        own = base_point(self._task.loaded, self.axes)
        shares = [0.5 if value is None else axis.share(value) for axis, value in zip(self.axes, own, strict=True)]
        return [min(max(share, 0.0), 1.0) for share in shares]


def worst_runs(made: EnvelopeMap, search: Search, progress: NotedProgress = no_progress) -> list[WorstRun]:
    """The worst run of each requirement.

    Args:
        made: the map; runs are made as its cells were.
        search: how long, and over what.
        progress: called with the number of runs made and of all, of each requirement.

    Raises:
        InputError: the package ``cma`` is not there, or single runs do not tell the metric.
    """
    require_cma()
    runs = []
    for number, item in enumerate(made.task.requirements):
        looking = WorstSearch(made, item, search)
        candidate, value = looking.worst(progress)
        runs.append(
            WorstRun(
                limit=number,
                runs=search.runs,
                axes=[axis.name for axis in looking.axes],
                point=list(looking.point(candidate)),
                changes=looking.changes(candidate),
                value=None if np.isnan(value) else value,
            )
        )
    return runs
