"""Second drive of a plug-in through some runs: its answers on a member must not depend on the other members."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from trackbench.base.streams import stream
from trackbench.driving.cross_check import CrossCheckedTracker
from trackbench.driving.isolation import plugged_in
from trackbench.driving.start import start_stepper
from trackbench.runner.batches import Batch
from trackbench.runner.work import Work
from trackbench.trackers.answers import is_random

#: Number of runs of the second drive of a tracker that is not batched.
RUNS = 2


def with_second_drive(work: Work, batch: Batch, name: str, tracker: Any) -> Any:
    """Wrap a plug-in so that a second drive checks it; built-in trackers and random ones are returned as they are.

    In the second drive a batched tracker gets half of the batch, permuted; any other gets two runs in reverse order.
    """
    config, (piece,) = work.driven(name), batch.pieces
    if not plugged_in(config) or is_random(tracker):
        return tracker
    random = stream(work.seed, work.noise_of(piece.scene), piece.runs.start, "second drive")
    if tracker.batched:
        order = random.permutation(batch.members)[batch.members // 2 :]
    else:
        runs = len(piece.runs)
        chosen = np.sort(random.permutation(runs)[:RUNS])
        # Members are numbered by object, then run.
        order = np.concatenate([np.arange(0, batch.members, runs) + run for run in chosen])[::-1]
    options = work.isolation, batch.multi_object, work.sensors
    start = partial(start_stepper, config, work.folder, len(order), work.prepare_tracker, *options)
    return CrossCheckedTracker(tracker, start, order)
