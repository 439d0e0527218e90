"""The mode probabilities of trackers with several motion models, as tables."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import product

import numpy as np
import pyarrow as pa

from trackbench.base.types import Array
from trackbench.runner.block import Block
from trackbench.runner.columns import Columns, stacked
from trackbench.runner.labelled_run import LabelledOutcome
from trackbench.trackers.config import FilterConfig, ImmConfig, PluginConfig

AnyConfig = FilterConfig | PluginConfig


def mode_tables(
    trackers: Mapping[str, AnyConfig],
    blocks: Sequence[Block],
    time: Array,
    recorded_time: Array,
    objects: Sequence[str],
) -> dict[str, pa.Table]:
    """The mean over runs and objects, and the recorded run; nothing where no tracker has modes.

    Args:
        trackers: those that did not fail.
        blocks: of all runs.
        time: ``(instants,)`` of the longest scene, s.
        recorded_time: ``(instants,)`` of the recorded run, s.
        objects: of the recorded run.
    """
    means: list[Columns] = []
    single: list[Columns] = []
    for tracker, config in trackers.items():
        outcomes = [block.outcomes[tracker] for block in blocks]
        sums = [item.modes for item in outcomes if isinstance(item, LabelledOutcome) and item.modes is not None]
        names = _names(config, len(sums[0].total)) if sums else []
        total, count = np.zeros((len(names), len(time))), np.zeros(len(time))
        for part in sums:
            total[:, : len(part.count)] += part.total
            count[: len(part.count)] += part.count
        mean = total / np.where(count > 0, count, np.nan)
        means += [{**_keys(tracker, mode, time), "probability": mean[m]} for m, mode in enumerate(names)]
        for recorded in (part.recorded for part in sums if part.recorded is not None):
            for (m, mode), (i, target) in product(enumerate(names), enumerate(objects)):
                single.append({**_keys(tracker, mode, recorded_time, target), "probability": recorded[m, :, i]})
    return {"modes": stacked(means), "recorded_modes": stacked(single)} if means else {}


def _keys(tracker: str, mode: str, time: Array, target: str | None = None) -> Columns:
    of_object: Columns = {} if target is None else {"object": [target] * len(time)}
    return {"tracker": [tracker] * len(time), "mode": [mode] * len(time), **of_object, "time_s": time}


def _names(config: AnyConfig, size: int) -> list[str]:
    """The models of a built-in filter; of another tracker, their numbers."""
    if isinstance(config, FilterConfig) and isinstance(config.motion, ImmConfig):
        return config.motion.names
    return [f"mode {number}" for number in range(1, size + 1)]
