"""The truth of every vehicle, for measurements without identities, and vehicles of other sizes."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from trackbench.base.errors import InputError
from trackbench.base.types import Truth
from trackbench.scenario.load import load_scenario
from trackbench.scenario.truth import truth_of, truth_source
from trackbench.truth import highway
from trackbench.truth.config.highway import VehicleSizes
from trackbench.truth.config.recording import FixedObserver
from trackbench.truth.frames import TRUCK, VAN, Frames, with_sizes
from trackbench.truth.sources import HighwayTruth, ScriptedTruth

CONFIG = HighwayTruth(
    env="highway-v0",
    config={"vehicles_count": 30, "vehicles_density": 2},
    seed=3,
    duration_s=3,
    rate_hz=10,
    targets={"nearest": 3},
)
MOTION = ("px", "py", "heading", "course", "speed", "acceleration", "yaw_rate", "alive")

SCRIPTED = """\
name: convoy
truth:
  source: scripted
  duration_s: 2
  rate_hz: 10
  objects:
    car: {start: {x: 40, vx_mps: 5}}
    truck: {start: {x: 20, vx_mps: 5}, length_m: 10, width_m: 2.5, target: false}
sensors:
  radar: {type: radar, rate_hz: 10, range_sigma_m: 0.3, azimuth_sigma_deg: 0.5, range_rate_sigma_mps: 0.1}
trackers: {mine: {use: "any_tracker:Any"}}
"""


@pytest.fixture(scope="module")
def targets() -> Truth:
    return highway.simulate(CONFIG)


@pytest.fixture(scope="module")
def everything() -> Truth:
    return highway.simulate(CONFIG.with_all_objects(120.0))


def columns(of: Truth, names: tuple[str, ...], field: str) -> Any:
    return getattr(of, field)[:, [of.ids.index(name) for name in names]]


def test_every_vehicle_near_enough_is_there_and_the_targets_are_as_before(targets: Truth, everything: Truth) -> None:
    assert targets.target.tolist() == [True] * 3
    assert len(everything.ids) > 6
    chosen = tuple(name for name, target in zip(everything.ids, everything.target, strict=True) if target)
    assert chosen == targets.ids
    for field in MOTION:
        np.testing.assert_array_equal(columns(everything, targets.ids, field), getattr(targets, field))
    observer = everything.observer
    distance = np.hypot(everything.px[..., 0] - observer.px[:, None], everything.py[..., 0] - observer.py[:, None])
    assert (np.where(everything.alive, distance, np.inf).min(axis=0) <= 120).all()
    assert "ego" not in everything.ids


def test_of_all_vehicles_those_in_reach_are_targets() -> None:
    of = highway.simulate(CONFIG.model_copy(update={"targets": "all"}).with_all_objects(120.0))
    assert of.target.all()
    assert 6 < len(of.ids) < 30
    far = {"observer": FixedObserver(x=-500.0), "targets": "all"}
    with pytest.raises(InputError, match="no vehicle comes within 20 m of the observer"):
        highway.simulate(CONFIG.model_copy(update=far).with_all_objects(20.0))


def test_sizes_are_drawn_and_the_drive_is_the_same(everything: Truth) -> None:
    sized = CONFIG.model_copy(update={"sizes": VehicleSizes(van=0.3, truck=0.3)}).with_all_objects(120.0)
    drive, again = highway.simulate(sized), highway.simulate(sized)
    for field in MOTION:
        np.testing.assert_array_equal(getattr(drive, field), getattr(everything, field))
    found = set(zip(drive.length.tolist(), drive.width.tolist(), strict=True))
    assert found == {(5.0, 2.0), VAN, TRUCK}
    np.testing.assert_array_equal(drive.length, again.length)
    # A vehicle has its size whichever others are in the truth.
    few = highway.simulate(sized.with_all_objects(30.0))
    np.testing.assert_array_equal(few.length, [drive.length[drive.ids.index(name)] for name in few.ids])


def test_shares_of_sizes() -> None:
    count = 4000
    nothing = np.zeros((1, count))
    ids = ("ego", *(f"v{i}" for i in range(1, count)))
    alike = Frames(
        dt=0.1, ids=ids, px=nothing, py=nothing, heading=nothing, slip=nothing, speed=nothing, collided=nothing > 0,
        length=np.full(count, 5.0), width=np.full(count, 2.0),
    )  # fmt: skip
    one, other = (with_sizes(alike, VehicleSizes(van=0.2, truck=0.1), seed).length for seed in (1, 2))
    assert one[0] == 5.0
    assert not np.array_equal(one, other)
    for length, share in ((7.0, 0.2), (10.0, 0.1)):
        assert np.mean(one == length) == pytest.approx(share, abs=4 * np.sqrt(share * (1 - share) / count))
    np.testing.assert_array_equal(with_sizes(alike, VehicleSizes(truck=1), 1).length[1:], 10.0)


def test_a_scenario_that_hides_identities_asks_for_every_vehicle_in_reach() -> None:
    known, hidden = load_scenario("highway_dense"), load_scenario("traffic/dense_highway")
    assert truth_source(known) == known.config.truth
    source = truth_source(hidden)
    assert isinstance(source, HighwayTruth)
    # The radar's 150 m, its arm of 2.5 m on the observer, and 10 m.
    assert source.others_within_m == pytest.approx(162.5)


def test_a_scripted_object_that_is_no_target(tmp_path: Path, cli: Callable[..., Any]) -> None:
    (tmp_path / "any_tracker.py").write_text("class Any:\n    def step(self, state, scan): ...\n")
    file = tmp_path / "convoy.yaml"
    file.write_text(SCRIPTED + "sensing: {identities: hidden}\n", encoding="utf-8")
    assert truth_of(load_scenario(file)).truth.target.tolist() == [True, False]
    file.write_text(SCRIPTED, encoding="utf-8")
    done = cli("check", file)
    message = "truth.objects.truck.target: only used with sensing: {identities: hidden}; write that, or remove this"
    assert (done.status, done.err) == (2, f"{file}:8: {message}\n")
    none = {"car": {"target": False}, "truck": {"target": False}}
    with pytest.raises(ValueError, match="no object is a target"):
        ScriptedTruth.model_validate({"duration_s": 1, "rate_hz": 10, "objects": none})
