"""Functions in a recording: lanes, and the tables to read back."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from rerun.chunk import RrdReader
from tests.subjects.functions.test_function_runs import BRAKING, result_of

from trackbench.base.errors import InputError
from trackbench.metrics.function_events import FunctionEvent
from trackbench.results import Result
from trackbench.subjects.recording.data import read
from trackbench.subjects.recording.focus import Opening, focus_of, worst_moments
from trackbench.subjects.recording.functions import lane
from trackbench.subjects.recording.writer import write

HIDDEN = BRAKING.replace("_mps2: 8}", "_mps2: 8, associate: {method: gnn}}").replace(
    "_mps2: 1}", "_mps2: 1, associate: {method: gnn}}"
)


@pytest.fixture(scope="module", params=["known", "hidden"])
def result(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Result:
    text = BRAKING if request.param == "known" else f"{HIDDEN}sensing: {{identities: hidden}}\n"
    return result_of(tmp_path_factory.mktemp("run"), text.replace("runs: 20", "runs: 3"), SIGMA="0.5", AZIMUTH="0.2")


@pytest.fixture(scope="module")
def file(result: Result, tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("recording") / "recording.rrd"
    write(result, file)
    return file


def _event(outcome: str, time: float, until: float, delay: float | None) -> FunctionEvent:
    return FunctionEvent("slow", "fcw", "lead", outcome, 0, time, until, delay)


def test_a_lane_says_what_is_late_missed_and_false() -> None:
    active = np.isin(np.arange(10), [2, 3, 8])
    rows = {"time_s": np.arange(10.0), "active": active * 1.0, "object": np.where(active, "lead", "")}
    events = [_event("answered", 1, 4, 1.0), _event("missed", 5, 7, 2.0), _event("false", 8, 9, None)]
    assert lane(rows, events).tolist() == ["", "late", "lead", "lead", "", "missed", "missed", "", "false", ""]


def test_lanes_are_in_the_file(file: Path) -> None:
    chunks = [chunk for chunk in RrdReader(file).stream() if not chunk.is_static]
    rows = {str(chunk.entity_path): chunk.to_record_batch() for chunk in chunks}
    assert {f"/functions/fcw/{name}" for name in ("_truth", "ekf", "slow")} <= {*rows}
    (name,) = [name for name in rows["/functions/fcw/_truth"].schema.names if "state" in name]
    states = [values[0] for values in rows["/functions/fcw/_truth"][name].to_pylist()]
    assert states == ["", "lead", ""]


def test_events_are_read_back_from_the_file(result: Result, file: Path) -> None:
    recorded = read(file).result
    from_file = worst_moments(recorded, Opening(worst=5, function="fcw"))
    assert from_file == worst_moments(result, Opening(worst=5, function="fcw"))
    assert isinstance(from_file[0], FunctionEvent)
    assert from_file[0].word == "late"
    assert worst_moments(recorded, Opening(worst=5, function="fcw", tracker="ekf")) != from_file


def test_a_recording_opens_at_the_worst_event(result: Result) -> None:
    focus = focus_of(result, Opening(worst=1, function="fcw", tracker="slow"))
    assert (focus.vehicle, focus.time_s) == ("lead", pytest.approx(5.0))
    with pytest.raises(InputError, match="run 0, which is recorded, has 1 such moment"):
        focus_of(result, Opening(worst=2, function="fcw", tracker="slow"))
