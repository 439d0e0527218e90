"""Memory of a run: nothing of a block's measurements is left once the block is scored."""

from __future__ import annotations

import gc
import weakref
from typing import Any

import pytest

import trackbench as tb
from trackbench.base.types import Array
from trackbench.runner import batches


def test_measurements_are_gone_once_a_block_is_scored(monkeypatch: pytest.MonkeyPatch) -> None:
    # Of `raw` estimates are missing at the start, so that measured positions are asked for.
    kept: list[weakref.ref[Array]] = []
    sense = batches.sense_known

    def noted(*arguments: Any) -> Any:
        assert all(array() is None for array in kept)
        measurements = sense(*arguments)
        whole = measurements.scans[0].measurement.base
        assert whole is not None
        kept.append(weakref.ref(whole))
        return measurements

    monkeypatch.setattr(batches, "sense_known", noted)
    scenario = tb.load("scripted/figure_eight", runs=2010, trackers=["raw"])
    gc.collect()
    gc.disable()
    try:
        tb.run(scenario, workers=1)
    finally:
        gc.enable()
    assert len(kept) == 2
