"""Trials of a tracker that follows several objects from detections of hidden identities, each by itself."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from trackbench.engine.equations import EngineUsed
from trackbench.metrics import Metric
from trackbench.results import Failure
from trackbench.runner.block import run_block
from trackbench.runner.hidden_run import TrafficScores
from trackbench.runner.traffic_sums import PATHS
from trackbench.runner.work import BlockRuns, Work
from trackbench.subjects.tuning.entry import Entry
from trackbench.subjects.tuning.measures import OF_TRACKS, Sums

TRIAL = "trial"


def score_hidden(
    work: Work, piece: BlockRuns, entry: Entry, measure: str = "gospa", metric: Metric | None = None
) -> tuple[Sums | str, EngineUsed | None]:
    """The sums of one trial over some runs of one scene, or why there are none, where the tracker failed; and what
    computed it; ``measure``: a metric of tracks that is wanted beside the usual ones;
    ``metric``: one that is not built in.
    """
    block = run_block(replace(work, trackers={TRIAL: entry}), piece)
    scores, engine = block.outcomes[TRIAL], block.engines.get(TRIAL)
    if isinstance(scores, Failure):
        return scores.cause, engine
    assert isinstance(scores, TrafficScores)
    values = np.array(scores.sums.values)
    wanted = {path: path for path in (*OF_TRACKS, measure) if path in PATHS} | {"prediction_score": "log_likelihood"}
    sums = Sums({name: values[:, :, PATHS.index(path)].T for path, name in wanted.items()})
    return sums if metric is None else sums.with_metric(metric, scores.metrics), engine
