"""The runs of a cell: those of a run of the same scenario, whatever the looks, and intervals over what repeats."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import trackbench as tb
from trackbench.base.errors import InputError
from trackbench.metrics.intervals import Interval
from trackbench.subjects.envelope.api import envelope_of
from trackbench.subjects.envelope.cells import Extent, _by_repetition
from trackbench.subjects.envelope.mapping import EnvelopeMap
from trackbench.subjects.envelope.task import task_of

HIDDEN: dict[str, Any] = {
    "sensing": {"identities": "hidden"},
    "trackers": {
        "gnn": {"filter": "ekf", "motion": "cv", "acceleration_sigma_mps2": 3, "associate": {"method": "gnn"}},
    },
    "expect": [{"tracker": "gnn", "metric": "tgospa", "below": 1.0}],
}
ROAD = {
    "source": "highway-env",
    "env": "highway-fast-v0",
    "config": {"vehicles_count": 5},
    "seed": 3,
    "seeds": 3,
    "duration_s": 2,
    "rate_hz": 10,
}


def test_blocks_add_up_to_the_extent() -> None:
    first, second = Extent(2, 3), Extent(3, 8)
    pieces = [*first.blocks_beyond(Extent(0, 0), 2), *second.blocks_beyond(first, 2)]

    made = sorted((piece.scene, run) for piece in pieces for run in piece.runs)
    assert made == [(scene, run) for scene in range(3) for run in range(8)]
    assert all(len(piece.runs) <= 2 for piece in pieces)


def test_a_repetition_is_the_run_of_one_number_in_every_scene() -> None:
    influence = np.array([1.0, -2.0, 3.0, 5.0, -4.0, -3.0])
    run = np.array([0, 1, 0, 1, 2, 2])

    repeated = _by_repetition(Interval(7.0, influence, weight=np.ones(6)), run)

    assert repeated.influence.tolist() == [2.0, 1.5, -3.5]
    assert repeated.weight is not None
    assert repeated.weight.tolist() == [2.0, 2.0, 2.0]
    assert _by_repetition(Interval(7.0, influence), np.arange(6)).influence is influence


@pytest.mark.parametrize(
    "changes",
    [{}, HIDDEN, {"truth": ROAD}, {"truth": ROAD, **HIDDEN}],
    ids=["known", "hidden", "scenes", "scenes, hidden"],
)
def test_the_value_of_a_cell_is_that_of_a_run(
    changes: dict[str, Any], made_map: Callable[..., EnvelopeMap], request: pytest.FixtureRequest
) -> None:
    axes = {"s": {"key": "sensors.lidar.position_sigma_m", "values": [0.2, 0.9]}}
    made = made_map(**changes, runs={"first": 25, "most": 50}, cells=2, axes=axes)

    for cell in made.cells.values():
        ((name, tracker),) = cell.trackers.items()
        (decision,) = tracker.judged
        assert decision is not None
        result = tb.run(tb.load(cell.loaded.document.value, runs=tracker.extent.runs, trackers=[name]))
        (limit,) = made.task.requirements
        assert decision.interval.value == pytest.approx(result[name].metrics[limit.metric].value, rel=1e-12)
        assert len(decision.interval.influence) == tracker.extent.runs


def test_traffic_like_these_repeats_scenes(made_map: Callable[..., EnvelopeMap]) -> None:
    made = made_map(
        truth=ROAD | {"config": {"vehicles_count": 2}, "duration_s": 1},
        score={"settle_s": 0},
        claim="traffic like these",
        monte_carlo={"runs": 2, "seed": 1},
        runs={"first": 30, "most": 60},
        cells=2,
        axes={"s": {"key": "sensors.lidar.position_sigma_m", "values": [0.2, 3]}},
        expect=[{"tracker": "kf", "metric": "position_rmse", "below": 0.5}],
    )

    for cell in made.cells.values():
        tracker = cell.trackers["kf"]
        (decision,) = tracker.judged
        assert decision is not None
        assert tracker.extent.runs == 2
        assert tracker.extent.scenes in (30, 60)
        assert decision.interval.scenes
        assert len(decision.interval.influence) == tracker.extent.scenes
    assert [cell.states["kf"] for cell in made.cells.values()] == ["holds", "fails"]


@pytest.mark.slow
def test_a_world_has_its_own_number_of_scenes(made_map: Callable[..., EnvelopeMap]) -> None:
    made = made_map(
        truth=ROAD | {"env": "highway-v0", "seeds": 12, "duration_s": 2, "targets": {"nearest": 2}},
        runs={"first": 25, "most": 25},
        cells=2,
        axes={"world": {"key": "world", "choices": ["ideal", "recorded"]}},
    )

    assert [cell.trackers["kf"].runs.scene.max() + 1 for cell in made.cells.values()] == [12, 10]


def test_a_tracker_that_cannot_go_on_fails(made_map: Callable[..., EnvelopeMap]) -> None:
    made = made_map(
        trackers={"kf": {"use": "tests.subjects.envelope.test_cells:Broken"}},
        cells=2,
        axes={"s": {"key": "sensors.lidar.position_sigma_m", "values": [0.2, 0.9]}},
    )

    for cell in made.cells.values():
        assert cell.states == {"kf": "fails"}
        assert "no more" in cell.trackers["kf"].cause
    assert "no more" in envelope_of(made, "").claim.failures["kf"]


class Broken:
    """A tracker that raises."""

    def step(self, state: Any, scan: Any) -> Any:
        raise RuntimeError("no more")


@pytest.mark.parametrize(
    ("changes", "key"),
    [
        ({"expect": []}, "expect"),
        ({"expect": [{"tracker": "kf", "metric": "nees.verdict", "is": "consistent"}]}, "expect.0.is"),
        ({"claim": "traffic like these", "runs": {"first": 30}}, "envelope.claim"),
    ],
)
def test_what_cannot_be_decided_is_refused(changes: dict[str, Any], key: str) -> None:
    from tests.subjects.envelope.conftest import small

    with pytest.raises(InputError) as caught:
        task_of(small(**changes))

    assert caught.value.key == key


RADAR = {
    "type": "radar",
    "rate_hz": 4,
    "range_sigma_m": 0.3,
    "azimuth_sigma_deg": 0.5,
    "range_rate_sigma_mps": 0.2,
    "detection_probability": 0.9,
}


def seen_at_times(made_map: Callable[..., EnvelopeMap], probability: float, seed: int) -> Any:
    """The cell of a tracker that gives what the radar sees, whose position is far better than is required."""
    made = made_map(
        truth={"source": "scripted", "duration_s": 8, "rate_hz": 4, "objects": {"lead": {"start": {"x": 40}}}},
        sensors={"radar": RADAR},
        trackers={"raw": {"use": "raw"}},
        score={"settle_s": 0},
        monte_carlo={"runs": 50, "seed": seed},
        expect=[{"tracker": "raw", "metric": "position_rmse", "below": 8}],
        cells=2,
        axes={"p": {"key": "sensors.radar.detection_probability", "values": [probability, 1]}},
    )
    return made.cells[(probability,)].trackers["raw"]


def test_a_coverage_that_may_be_enough_is_no_proof_that_a_cell_fails(made_map: Callable[..., EnvelopeMap]) -> None:
    # With a probability of .6 it is .944 to .955, depending on the noise.
    trackers = [seen_at_times(made_map, 0.6, seed) for seed in range(1, 5)]
    below = [item for item in trackers if item.coverage.interval.value < 0.95]

    assert 0 < len(below) < 4
    assert {item.state for item in trackers} == {"holds", "undecided"}
    assert all(item.state == "undecided" and "not shown to be more than 5 %" in item.cause for item in below)


def test_a_coverage_that_is_shown_to_be_too_small_fails(made_map: Callable[..., EnvelopeMap]) -> None:
    tracker = seen_at_times(made_map, 0.2, 1)

    assert tracker.state == "fails"
    assert tracker.coverage.high < 0.95
    assert "of the estimates are missing" in tracker.cause
