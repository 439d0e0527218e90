"""What a result keeps of functions: the decisions of the recorded run, and the worst events of all runs."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from tests.subjects.functions.test_function_runs import BRAKING, result_of
from tests.support.results import with_tables

from trackbench.metrics.function_events import function_events
from trackbench.results import Result


@pytest.fixture(scope="module")
def noisy(tmp_path_factory: pytest.TempPathFactory) -> Result:
    return result_of(tmp_path_factory.mktemp("noisy"), BRAKING, SIGMA="0.5", AZIMUTH="0.2")


def test_the_truth_decides_as_computed_by_hand(noisy: Result):
    # After t s of braking the gap is 40 - 3 t^2 and the closing speed 6 t: 14.4 t is more from 1.97 s on. The lead then
    # keeps 0.09 m/s, and 24.13 m are left at 13.8 m/s.
    rows = noisy.tables.decisions.to_pandas().query("tracker == 'slow'").set_index("time_s")
    assert rows.index[rows.true_active > 0][0] == pytest.approx(5.0)
    assert rows.true_quantity[5.4] == pytest.approx((24.13 - 0.1 * 13.8) / 13.8)
    assert rows.index[rows.impact > 0][0] == pytest.approx(7.05)
    assert set(rows.true_object[rows.true_active > 0]) == {"lead"}


def test_an_event_of_the_recorded_run_is_as_late_as_the_decisions_are(noisy: Result):
    decisions = noisy.tables.decisions.to_pandas()
    for tracker in ("ekf", "slow"):
        rows = decisions[decisions.tracker == tracker].set_index("time_s")
        first, due = (rows.index[rows[name] > 0][0] for name in ("active", "true_active"))
        events = noisy.tables.function_events.to_pandas().query(f"tracker == '{tracker}' and run == 0")
        assert events.delay_s.tolist() == pytest.approx([first - due])
        assert (events.outcome.tolist(), events.object.tolist()) == (["answered"], ["lead"])


def test_the_mean_delay_is_that_of_the_events(noisy: Result):
    events = noisy.tables.function_events.to_pandas().query("tracker == 'slow'")
    assert sorted(events.run) == list(range(20))
    assert events.delay_s.mean() == pytest.approx(noisy["slow"].metrics["warn_delay.fcw"].value)


def test_of_many_events_the_recorded_ones_and_the_worst_stay(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, noisy: Result
):
    monkeypatch.setattr("trackbench.subjects.functions.records.MOST_EVENTS", 2)
    events = result_of(tmp_path, BRAKING, SIGMA="0.5", AZIMUTH="0.2").tables.function_events.to_pandas()
    every = noisy.tables.function_events.to_pandas()
    for tracker, own in events.groupby("tracker", observed=True):
        worst = every[every.tracker == tracker].delay_s.abs().nlargest(2)
        assert own.run.iloc[0] == 0
        assert len(own) <= 3
        assert own.delay_s.abs().nlargest(2).tolist() == worst.tolist()


def test_blocks_of_runs_number_their_events_alike(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, noisy: Result):
    monkeypatch.setattr("trackbench.runner.work.BATCH_SIZE", 7)
    result = result_of(tmp_path, BRAKING, SIGMA="0.5", AZIMUTH="0.2")
    for name in ("decisions", "function_events"):
        assert result.tables[name].equals(noisy.tables[name])


def _with_events(result: Result, *rows: tuple[str, float, float, float]) -> Result:
    """With these events of ``slow``: outcome, run, length and delay in s."""
    outcome, run, length, delay = zip(*rows, strict=True)
    same = {"tracker": "slow", "function": "fcw", "object": "lead"}
    numbers = {"run": run, "time_s": np.ones(len(rows)), "until_s": 1.0 + np.array(length), "delay_s": delay}
    table = pa.table({name: [text] * len(rows) for name, text in same.items()} | {"outcome": outcome, **numbers})
    return with_tables(result, function_events=table)


MIXED = (
    ("false", 1.0, 0.3, np.nan),
    ("answered", 2.0, 2.0, -0.4),
    ("answered", 3.0, 2.0, 0.2),
    ("missed", 4.0, 2.0, 1.0),
    ("answered", 5.0, 2.0, 0.0),
    ("missed", 6.0, 2.0, 1.5),
    ("answered", 7.0, 2.0, 0.9),
    ("false", 0.0, 0.8, np.nan),
)


def test_missed_events_come_first_then_late_false_and_early_ones(noisy: Result):
    events = function_events(_with_events(noisy, *MIXED), "fcw")
    assert [event.run for event in events] == [6, 4, 7, 3, 0, 1, 2]
    assert [event.word for event in events] == ["missed", "missed", "late", "late", "false", "false", "early"]
    assert [event.wrong_s for event in events] == pytest.approx([1.5, 1.0, 0.9, 0.2, 0.8, 0.3, 0.4])


def test_inspect_lists_the_worst_events(tmp_path: Path, cli: Callable[..., Any]):
    (tmp_path / "braking.yaml").write_text(
        BRAKING.replace("SIGMA", "0.5").replace("AZIMUTH", "0.2").replace("runs: 20", "runs: 4"), encoding="utf-8"
    )
    assert cli("run", "braking.yaml", "--quiet").status == 0
    lines = cli("inspect", "results/braking_lead", "--worst", "9", "--function", "fcw").out.splitlines()
    assert lines[2].startswith("The worst first")
    assert lines[4].split()[:4] == ["slow", "5.00", "lead", "late"]
    sound = cli("inspect", "results/braking_lead", "--worst", "2", "--function", "fcw", "--tracker", "ekf")
    assert "Nothing that counts went wrong." in sound.out
    done = cli("inspect", "results/braking_lead", "--worst", "--function", "fcv")
    assert done.status == 2
    assert "did you mean 'fcw'?" in done.err
    assert "--worst" in cli("inspect", "results/braking_lead", "--function", "fcw").err
