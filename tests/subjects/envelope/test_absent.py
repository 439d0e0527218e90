"""Cells that would be copies of others, since the world `recorded` sets what an axis varies."""

from __future__ import annotations

import pytest
from tests.subjects.envelope.conftest import map_of

import trackbench as tb
from trackbench.base.errors import InputError
from trackbench.scenario.load import load_scenario
from trackbench.subjects.envelope.api import FinishedEnvelope
from trackbench.subjects.envelope.claim import AbsentCells, Claim
from trackbench.subjects.envelope.task import task_of

QUALITY = "envelope/sensor_quality"
FEW = [
    "truth.seeds=1", "truth.duration_s=3", "envelope.axes.world.choices=[ideal, recorded]",
    "envelope.axes.azimuth.levels=2", "envelope.cells=12", "envelope.runs={first: 25, most: 25}",
]  # fmt: skip


@pytest.fixture(scope="module")
def made() -> FinishedEnvelope:
    return tb.envelope(load_scenario(QUALITY, FEW), counter_examples=0)


def cells_of(claim: Claim) -> set[tuple[str, float]]:
    return {(str(cell.point[0]), float(cell.point[2])) for cell in claim.cells}


def test_no_cell_is_a_copy(made: FinishedEnvelope) -> None:
    claim = made.claim
    ideal = {("ideal", rate) for rate in (5.0, 10.0, 20.0)}
    assert cells_of(claim) == ideal | {("recorded", 5.0), ("recorded", 10.0)}
    assert claim.absent == [AbsentCells(at={"world": "recorded", "rate": 20.0}, reason="recorded at 10 Hz")]
    page = " ".join(str(made.report()).split())
    assert (
        "There is no cell with world recorded, rate 20 Hz (recorded at 10 Hz): it would be a copy of another." in page
    )
    values = [[v.value for v in cell.trackers["ekf_cv"].values] for cell in claim.cells]
    assert len({str(value) for value in values}) == len(values)


def test_a_map_of_nothing_but_copies_is_refused() -> None:
    axes = "envelope.axes={rate: {key: sensors.front_radar.rate_hz, values: [15, 20]}}"
    expect = "expect=[{tracker: ekf_cv, metric: position_rmse, below: 0.8, worlds: [recorded]}]"
    with pytest.raises(InputError, match="no cell of the map differs from another: recorded at 10 Hz"):
        map_of(load_scenario(QUALITY, [*FEW[:2], "world=recorded", expect, axes]))


def test_the_motion_of_a_recording_is_no_axis_either() -> None:
    axes = (
        "envelope.axes={world: {key: world, choices: [ideal, recorded]}, "
        "cars: {key: truth.config.vehicles_count, values: [10, 20]}}"
    )
    task = task_of(load_scenario(QUALITY, [*FEW[:2], axes]))
    assert task.absent_at(("ideal", 10.0)) is None
    assert task.absent_at(("recorded", 10.0)) == AbsentCells(
        at={"world": "recorded", "cars": 10.0}, reason="the truth is recorded"
    )
