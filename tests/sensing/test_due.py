"""Which objects a tracker has to follow: the cases of the page about it, one by one."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from tests.support.scenes import fixed_observer, truth

from trackbench.base.types import ABSENT, DUE, OPTIONAL, Truth
from trackbench.models.sensors import Lidar, Radar, Sensor
from trackbench.sensing.due import find_due
from trackbench.sensing.scans import ideal_sensors

RADAR: dict[str, Any] = {
    "rate_hz": 10, "range_sigma_m": 0.3, "azimuth_sigma_deg": 0.5, "range_rate_sigma_mps": 0.1, "max_range_m": 100,
}  # fmt: skip
#: Half the diagonal of a car of 4.5 m x 1.8 m.
HALF = np.hypot(4.5, 1.8) / 2


def resting(positions: list[tuple[float, float]], steps: int = 3) -> Truth:
    x, y = np.broadcast_to(np.array(positions, dtype=float).T[:, None, :, None], (2, steps, len(positions), 1))
    return truth(np.arange(steps) / 10, x, y, 0 * x, 0 * x, observer=fixed_observer(steps))


def status(of: Truth, **sensors: Sensor) -> list[list[int]]:
    found = find_due(of, ideal_sensors(of, sensors))
    return [[int(value) for value in row] for row in found.status[..., 0]]


def test_in_range_at_the_rim_and_beyond() -> None:
    of = resting([(50, 0), (100 - HALF - 0.1, 0), (100 - HALF + 0.1, 0), (101, 0)], 1)
    assert status(of, radar=Radar(**RADAR)) == [[DUE, DUE, OPTIONAL, OPTIONAL]]


def test_beside_the_field_of_view() -> None:
    # The edge of 90 degrees is the diagonal; the distance to it is (x - y) / sqrt(2).
    off = np.sqrt(2) * HALF
    of = resting([(30, 30 - off - 0.1), (30, off - 30 + 0.1), (30, off - 30 - 0.1), (30, 31), (-30, 0)], 1)
    expected = [DUE, DUE, OPTIONAL, OPTIONAL, OPTIONAL]
    assert status(of, radar=Radar(fov_deg=90, **RADAR)) == [expected]


def test_nothing_is_at_the_sides_of_a_view_all_around_and_the_sensor_itself_is_the_rim_of_a_wide_one() -> None:
    of = resting([(-30, 0), (1.0, 0), (HALF + 0.1, 0)], 1)
    assert status(of, radar=Radar(**RADAR)) == [[DUE, DUE, DUE]]
    assert status(of, radar=Radar(fov_deg=300, **RADAR)) == [[OPTIONAL, OPTIONAL, DUE]]


def test_a_line_of_sight_counts_where_the_sensor_needs_one() -> None:
    of = resting([(20, 0), (40, 0)], 1)
    of = replace(of, width=np.array([2.5, 1.8]))
    assert status(of, radar=Radar(**RADAR)) == [[DUE, DUE]]
    assert status(of, radar=Radar(occlusion=True, **RADAR)) == [[DUE, OPTIONAL]]
    # Another sensor looks past the first car.
    aside = Lidar(rate_hz=10, position_sigma_m=1, occlusion=True, mount={"y_m": 20})
    assert status(of, radar=Radar(occlusion=True, **RADAR), lidar=aside) == [[DUE, DUE]]


def test_what_is_no_target_is_optional_and_hides_others() -> None:
    of = replace(resting([(20, 0), (40, 0)], 1), target=np.array([False, True]), width=np.array([2.5, 1.8]))
    assert status(of, radar=Radar(**RADAR)) == [[OPTIONAL, DUE]]
    assert status(of, radar=Radar(occlusion=True, **RADAR)) == [[OPTIONAL, OPTIONAL]]


def test_absent_before_it_comes_and_after_it_goes() -> None:
    of = replace(resting([(20, 0), (200, 0)]), alive=np.array([[False, True], [True, True], [False, False]]))
    assert status(of, radar=Radar(**RADAR)) == [[ABSENT, OPTIONAL], [DUE, OPTIONAL], [ABSENT, ABSENT]]


def test_nothing_is_due_while_all_are_silent() -> None:
    of = resting([(20, 0)], 4)
    quiet = Radar(dropouts=[{"from_s": 0.1, "to_s": 0.3}], **RADAR)
    assert status(of, radar=quiet) == [[DUE], [OPTIONAL], [OPTIONAL], [DUE]]
    lidar = Lidar(rate_hz=10, position_sigma_m=1, dropouts=[{"from_s": 0.2, "to_s": 0.5}])
    assert status(of, radar=quiet, lidar=lidar) == [[DUE], [DUE], [OPTIONAL], [DUE]]


def test_at_the_instants_of_any_sensor_and_in_each_run() -> None:
    x = np.array([[30.0, 300.0]])[None] + np.zeros((11, 1, 2))
    of = truth(np.arange(11) / 10, x, 0 * x, 0 * x, 0 * x)
    found = find_due(of, ideal_sensors(of, {"slow": Radar(**{**RADAR, "rate_hz": 5})}))
    np.testing.assert_array_equal(found.steps, [0, 2, 4, 6, 8, 10])
    assert found.status.shape == (6, 1, 2)
    assert found.status.dtype == np.int8
    assert (found.status[..., 0] == DUE).all()
    assert (found.status[..., 1] == OPTIONAL).all()


@pytest.mark.parametrize("distance", [50.0, 99.0])
def test_a_long_vehicle_is_at_the_rim_from_farther_inside(distance: float) -> None:
    of = replace(resting([(distance, 0)], 1), length=np.array([90.0]))
    assert status(of, radar=Radar(**RADAR)) == [[DUE if distance < 55 else OPTIONAL]]
