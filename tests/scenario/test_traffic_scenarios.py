"""The scenarios of traffic show what they say: what is hidden, merged, missed and false."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pytest

import trackbench as tb
from trackbench.base.types import ABSENT, DUE, FALSE_ALARM, OPTIONAL, Array, Truth
from trackbench.runner.work import work_of
from trackbench.scenario import load_scenario
from trackbench.scenario.truth import truth_of
from trackbench.sensing.detections import sense_hidden
from trackbench.sensing.due import Due, find_due
from trackbench.sensing.scans import IdealSensor, Measurements

RUNS = 20


@dataclass(frozen=True)
class Scene:
    """One truth of a scenario, and what its sensors read of it."""

    truth: Truth
    sensors: list[IdealSensor]

    @cached_property
    def due(self) -> Due:
        return find_due(self.truth, self.sensors)

    @cached_property
    def measurements(self) -> Measurements:
        return sense_hidden(self.sensors, 7, "traffic", range(RUNS))

    def status(self, name: str) -> Array:
        return self.due.status[:, self.truth.ids.index(name), 0].astype(float)

    def intervals(self, name: str, status: int) -> list[tuple[float, float]]:
        """First and last time of each stretch in which an object has a status."""
        is_so = np.concatenate([[False], self.status(name) == status, [False]])
        first, last = np.flatnonzero(is_so[1:] & ~is_so[:-1]), np.flatnonzero(~is_so[1:] & is_so[:-1]) - 1
        time = self.truth.time[self.due.steps]
        return [(float(time[a]), float(time[b])) for a, b in zip(first, last, strict=True)]

    def false_alarms(self) -> float:
        """Mean number per scan of the first sensor."""
        pairs = zip(self.measurements.scans, self.measurements.origins, strict=True)
        counts = [(origins == FALSE_ALARM).sum() for scan, origins in pairs if scan.sensor == self.sensors[0].name]
        return float(np.sum(counts) / len(counts) / RUNS)


def scene(name: str, *overrides: str) -> Scene:
    loaded = load_scenario(f"traffic/{name}", ["monte_carlo.runs=20", *overrides])
    found = truth_of(loaded)
    return Scene(found.truth, work_of(loaded, [found]).scenes[0].sensors)


def test_the_truck_hides_the_car_for_four_seconds() -> None:
    ((first, last),) = scene("truck_hides_car").intervals("overtaking", OPTIONAL)
    assert 9 < first < 11
    assert 3.5 < last - first < 4.5


def test_the_car_cuts_in_close_ahead_and_is_never_out_of_sight() -> None:
    of = scene("cut_in")
    assert (of.status("cutting") == DUE).all()
    mine = of.truth.ids.index("cutting")
    ahead = of.truth.px[:, mine, 0] - of.truth.observer.px
    in_lane = np.abs(of.truth.py[:, mine, 0]) < 1.0
    assert 10 < ahead[in_lane].min() < 20


def test_cars_that_meet_are_within_a_standard_deviation_of_their_estimates() -> None:
    loaded = tb.load("traffic/coalescence", runs=1, trackers=["oracle"])
    truth, tracks = tb.truth(loaded), tb.run(loaded).to_pandas("tracks")
    together = (truth.time > 6) & (truth.time < 12)
    apart = np.diff(truth.py[together, :, 0], axis=1)
    np.testing.assert_allclose(np.abs(apart), 2.0, atol=0.01)
    assert np.ptp(truth.px[together, :, 0], axis=1).max() < 1
    own = tracks[(tracks["time_s"] > 6) & (tracks["time_s"] < 12)]
    assert len(own) > 50
    # What the sensor leaves open even where the association is known.
    assert np.sqrt(own["p_11"]).mean() > 2.0


def test_cars_leave_the_tunnel_one_by_one() -> None:
    of = scene("tunnel_exit")
    begins = sorted(min(first for first, _ in of.intervals(name, DUE)) for name in of.truth.ids)
    apart = np.diff(begins)
    assert apart.min() >= 0.25
    assert apart.max() <= 1.25
    assert 0.6 < apart.mean() < 0.9


def test_the_radar_cannot_tell_the_cars_side_by_side_apart() -> None:
    of = scene("side_by_side")
    times = [
        scan.time
        for scan, merged in zip(of.measurements.scans, of.measurements.merged, strict=True)
        if (merged >= 0).any()
    ]
    assert 2 < max(times) - min(times) < 6
    assert 7 < min(times) < max(times) < 15


def test_few_of_the_far_cars_are_detected() -> None:
    of = scene("long_range")
    range_, probability = of.sensors[0].measurement[0], of.sensors[0].probability
    for distance, share in ((80, 0.9), (140, 0.5)):
        near = probability[np.abs(range_ - distance) < 1]
        assert len(near) > 20
        np.testing.assert_allclose(near, share, atol=0.05)
    assert of.measurements.scans[0].detection_probability == 0.9


def test_the_ghosts_are_along_the_rail_and_at_rest() -> None:
    of = scene("guard_rail")
    beside = 0
    for scan, origins in zip(of.measurements.scans, of.measurements.origins, strict=True):
        r, azimuth, rate = scan.measurement[:, origins == FALSE_ALARM]
        beside += int(((np.abs(r * np.sin(azimuth) - 6) < 3) & (np.abs(rate + 20 * np.cos(azimuth)) < 0.5)).sum())
    per_scan = beside / len(of.measurements.scans) / RUNS
    assert per_scan == pytest.approx(3, rel=0.1)
    assert of.false_alarms() == pytest.approx(4, rel=0.1)


def test_a_dense_motorway_has_clutter_trucks_and_hidden_cars() -> None:
    of = scene("dense_highway", "truth.seeds=1", "truth.duration_s=5")
    assert of.false_alarms() == pytest.approx(10, rel=0.1)
    assert {5.0, 10.0} <= set(of.truth.length)
    in_range = np.hypot(of.truth.px[..., 0] - of.truth.observer.px[:, None], of.truth.py[..., 0]) < 80
    assert (in_range[of.due.steps] & (of.due.status[..., 0] == OPTIONAL)).any()


def test_cars_come_to_the_crossing_and_go() -> None:
    of = scene("intersection", "truth.seeds=[2]")
    status = of.due.status[..., 0]
    assert ((status[0] == ABSENT) & (status == DUE).any(axis=0)).any()
    assert ((status[-1] == OPTIONAL) & (status == DUE).any(axis=0)).any()


def test_cars_at_the_crossing_hide_each_other() -> None:
    of = scene("intersection", "truth.seeds=[2]")
    assert [name for name in of.truth.ids if len(of.intervals(name, DUE)) > 1]
