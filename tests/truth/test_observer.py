"""A run can be watched while it is made, and its result is the same as without."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from trackbench.base.execution import executor
from trackbench.base.types import Estimate
from trackbench.metrics.scorer import Scorer
from trackbench.runner.recorded import RecordedInstant
from trackbench.runner.run import run_scenario
from trackbench.scenario import load_scenario
from trackbench.scenario.truth import truth_of, truths_of

#: Its tracker goes on for five instants.
BRIEF = """
import numpy as np

class Brief:
    batched = True

    def step(self, state, scan):
        times = (state or set()) | {scan.time}
        if len(times) > 5:
            raise RuntimeError("tired")
        shape = scan.valid.shape
        eye = np.eye(4).reshape(4, 4, *(1 for _ in shape))
        return times, (np.zeros((4, *shape)), np.broadcast_to(eye, (4, 4, *shape)))
"""


@pytest.mark.parametrize("workers", [1, 2])
def test_the_recorded_run_is_seen_whole_whichever_process_makes_it(tiny: Path, workers: int) -> None:
    # Two blocks, the recorded run in the second one.
    loaded = load_scenario(tiny, ["monte_carlo.runs=1500", "recording.run=1400"])
    truth = truth_of(loaded)
    seen: list[Any] = []
    with executor(workers) as chosen:
        result = run_scenario(loaded, [truth], executor=chosen, on_recorded_run=seen.append)
    scans, *instants = seen
    assert {scan.sensor for scan in scans} == {"radar", "lidar"}
    assert all(isinstance(item, RecordedInstant) for item in instants)
    assert [(item.number, *item.estimates) for item in instants] == [
        (n, name) for name in ("raw", "ekf") for n in range(21)
    ]
    for tracker in ("raw", "ekf"):
        rows = [row for row in result.tables.estimates.to_pylist() if row["tracker"] == tracker]
        for i, name in enumerate(truth.truth.ids):
            table = [row["px_m"] for row in rows if row["object"] == name]
            seen_x = [item.estimates[tracker].mean[0, i] for item in instants if tracker in item.estimates]
            np.testing.assert_array_equal(np.array(table, dtype=float), seen_x)


def test_an_instant_is_seen_before_the_next_is_taken(tiny: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    loaded = load_scenario(tiny, ["monte_carlo.runs=2"])
    order: list[Any] = []
    estimate = Scorer.estimate

    def noted(scorer: Scorer, given: Estimate) -> None:
        order.append(id(scorer))
        estimate(scorer, given)

    monkeypatch.setattr(Scorer, "estimate", noted)
    run_scenario(loaded, [truth_of(loaded)], on_recorded_run=order.append)
    scans, *rest = order
    assert isinstance(scans, list)
    scorers, seen = rest[::2], rest[1::2]
    assert [item.number for item in seen] == [*range(21), *range(21)]
    assert scorers == [scorers[0]] * 21 + [scorers[-1]] * 21, "one tracker after the other"


def test_a_tracker_that_fails_is_seen_up_to_then_and_the_others_to_the_end(tiny: Path) -> None:
    (tiny.parent / "brief.py").write_text(BRIEF, encoding="utf-8")
    loaded = load_scenario(tiny, ["trackers.brief.use=brief:Brief"])
    seen: list[Any] = []
    result = run_scenario(loaded, truths_of(loaded), on_recorded_run=seen.append)
    instants = seen[1:]
    assert result["brief"].failed is not None
    assert result["brief"].failed.step == 5
    brief = [item for item in instants if "brief" in item.estimates]
    assert [(item.number, bool(np.isfinite(item.estimates["brief"].mean).any())) for item in brief] == [
        *((number, True) for number in range(5)),
        (5, False),
    ]
    for name in ("raw", "ekf"):
        assert [item.number for item in instants if name in item.estimates] == list(range(21))


@pytest.mark.slow
def test_looking_changes_no_bit_of_the_tables(tiny: Path) -> None:
    loaded = load_scenario(tiny, ["monte_carlo.runs=1500"])
    truth = truth_of(loaded)
    with executor() as here:
        alone = run_scenario(loaded, [truth], executor=here)
        seen = run_scenario(loaded, [truth], executor=here, on_recorded_run=lambda _: None)
    assert all(alone.tables[name].equals(seen.tables[name]) for name in alone.tables)
