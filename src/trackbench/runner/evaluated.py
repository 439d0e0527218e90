"""The metrics of every tracker from the blocks of a run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from trackbench.base.types import Array, Indices
from trackbench.metrics import BUILT_IN, BlockScores, Evaluation, evaluate, merge_sums, ratio, variance_shares
from trackbench.metrics.estimates import ESTIMATES
from trackbench.metrics.registry import headline
from trackbench.metrics.sums import ERROR
from trackbench.results import Failure
from trackbench.runner.block import Block, failures_and_outcomes
from trackbench.runner.work import Work


@dataclass(frozen=True)
class Evaluated:
    """What the trackers of a run reached."""

    failures: dict[str, Failure]
    """By tracker that could not go on."""
    scores: dict[str, BlockScores]
    """By each other tracker, the sums over all runs."""
    evaluations: dict[str, Evaluation]
    """By each other tracker, its metrics."""
    scene: Indices
    """``(runs,)`` number of the scene of each run."""
    ranked: list[str]
    """Those with enough estimates, best first. They are scored where all of them gave an estimate."""

    def error_by_scene(self, name: str) -> Array:
        """``(scenes,)`` position RMSE of a tracker, m; NaN where it has no estimate."""
        sums = self.evaluations[name].scores.per_run
        square, count = (
            np.bincount(self.scene, row) for row in (sums[ERROR["px"]] + sums[ERROR["py"]], sums[ERROR["count"]])
        )
        return np.sqrt(square / np.where(count > 0, count, np.nan))

    def scene_share(self, name: str) -> float | None:
        """Share of the variance of one run's squared position error that is between scenes."""
        sums = self.evaluations[name].scores.per_run
        count = sums[ERROR["count"]]
        if not count.sum():
            return None
        shares = variance_shares(ratio(sums[ERROR["px"]] + sums[ERROR["py"]], count), self.scene)
        return None if shares is None else shares.scene

    @property
    def common_share(self) -> float | None:
        """Share of the estimates that are due which all ranked trackers gave; None where none is ranked."""
        if not self.ranked:
            return None
        best = self.ranked[0]
        return float(self.evaluations[best].scores.per_run[ERROR["count"]].sum() / self.scores[best].due.sum())


def evaluated(work: Work, blocks: Sequence[Block]) -> Evaluated:
    """The metrics of every tracker."""
    failures, outcomes = failures_and_outcomes(work.trackers, blocks)
    sums = {name: merge_sums([item.sums for item in items], work.metrics) for name, items in outcomes.items()}
    scores: dict[str, BlockScores] = {name: item[ESTIMATES.name] for name, item in sums.items()}
    together = frozenset(name for name, item in scores.items() if item.given and item.coverage >= work.min_coverage)
    evaluations = {
        name: evaluate(item, work.scene_of_run, work.metrics, together if name in together else frozenset({name}))
        for name, item in sums.items()
    }
    errors = {name: evaluations[name].intervals.get(headline(BUILT_IN)) for name in together}
    known = {name: error.value for name, error in errors.items() if error is not None}
    ranked = sorted(known, key=lambda name: (known[name], list(sums).index(name)))
    return Evaluated(failures, scores, evaluations, work.scene_of_run, ranked)
