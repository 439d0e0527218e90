"""Detection probability by range and aspect, and objects that a sensor cannot tell apart."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from tests.support.scenes import fixed_observer, truth

from trackbench.base.types import Array, Truth
from trackbench.models.sensors import Lidar, Radar, Sensor
from trackbench.sensing.detections import sense_hidden
from trackbench.sensing.scans import Measurements, ideal_sensors, sense_known

RADAR: dict[str, Any] = {
    "rate_hz": 10, "range_sigma_m": 0.3, "azimuth_sigma_deg": 0.5, "range_rate_sigma_mps": 0.1,
}  # fmt: skip
#: Exact, but for what a filter could not be told.
SHARP: dict[str, Any] = {**RADAR, "range_sigma_m": 1e-6, "azimuth_sigma_deg": 1e-7, "range_rate_sigma_mps": 1e-6}


def resting(positions: list[tuple[float, float]], steps: int = 1, speed: tuple[float, ...] = ()) -> Truth:
    """Objects that stay where they are, and may be said to move along x."""
    x, y = np.broadcast_to(np.array(positions, dtype=float).T[:, None, :, None], (2, steps, len(positions), 1))
    vx = np.zeros_like(x) + np.array(speed or (0.0,))[:, None]
    return truth(np.arange(steps) / 10, x, y, vx, 0 * x, observer=fixed_observer(steps))


def found(of: Truth, sensor: Sensor, runs: range = range(1)) -> Measurements:
    return sense_hidden(ideal_sensors(of, {"sensor": sensor}), 3, "detection", runs)


def shares(of: Truth, sensor: Sensor, runs: int = 20) -> Array:
    """``(objects,)`` how often each object was detected, with known identities."""
    measurements = sense_known(ideal_sensors(of, {"sensor": sensor}), 3, "detection", range(runs))
    detected = np.sum([scan.valid.reshape(-1, runs).sum(axis=1) for scan in measurements.scans], axis=0)
    return np.asarray(detected / (runs * len(of.time)))


def test_half_at_the_half_value_range_and_as_the_radar_equation_says() -> None:
    sensor = Radar(detection={"half_range_m": 100}, **RADAR)
    drawn = shares(resting([(r, 0.0) for r in (1, 50, 100, 150)], 400), sensor)
    # By hand: 1 + S = ln(1e-6) / ln(.5) = 19.93 at 100 m; S is 16 times that at 50 m, 5.06 times less at 150 m.
    expected = np.array([1, 1e-6 ** (1 / (1 + 16 * 18.9316)), 0.5, 1e-6 ** (1 / (1 + 18.9316 / 5.0625))])
    np.testing.assert_array_less(np.abs(drawn - expected), 4 * np.sqrt(expected * (1 - expected) / 8000) + 1e-9)


@pytest.mark.parametrize(
    "effect",
    [
        {"occlusion": True},
        {"detection": {"half_range_m": 40}},
        {"detection_probability": 0.5},
        {"resolution": {"range_m": 1, "azimuth_deg": 1}},
        {"dropouts": [{"from_s": 1, "to_s": 3}]},
    ],
    ids=lambda effect: next(iter(effect)),
)
def test_an_effect_changes_no_other_draw(effect: dict[str, Any]) -> None:
    random = np.random.default_rng(1)
    of = resting([tuple(place) for place in random.uniform(-50, 50, (10, 2))], 60)
    plain, other = (ideal_sensors(of, {"sensor": Radar(**keys, **RADAR)})[0] for keys in ({}, effect))
    before, after = (sense_known([one], 3, "detection", range(7, 8)).scans for one in (plain, other))
    assert any(scan.valid.any() for scan in after)
    for scan, less in zip(before, after, strict=True):
        np.testing.assert_array_equal(less.measurement[:, less.valid], scan.measurement[:, less.valid])
    hidden = [sense_hidden([one], 3, "detection", range(7, 8)) for one in (plain, other)]
    for (scan, origins, _), (rest, from_, merged) in zip(*(_rows(one) for one in hidden), strict=True):
        # What is left stays in the order it had.
        single = merged == -1
        kept = np.isin(origins, from_[single])
        np.testing.assert_array_equal(origins[kept], from_[single])
        np.testing.assert_array_equal(scan[:, kept], rest[:, single])


def _rows(measurements: Measurements) -> list[tuple[Array, Any, Any]]:
    triples = zip(measurements.scans, measurements.origins, measurements.merged, strict=True)
    return [(scan.measurement[..., 0], origins[:, 0], merged[:, 0]) for scan, origins, merged in triples]


def test_two_in_one_cell_give_one_measurement_at_their_mean_by_power() -> None:
    cell = {"range_m": 2, "azimuth_deg": 3, "range_rate_mps": 1}
    of = resting([(41.0, 0), (40.0, 0)], speed=(5.0, 5.5))
    ((z, origins, merged),) = _rows(found(of, Radar(resolution=cell, **SHARP)))
    far, near = 41.0**-4, 40.0**-4
    mean = np.array([far * 41 + near * 40, 0, far * 5 + near * 5.5]) / (far + near)
    np.testing.assert_allclose(z[:, 0], mean, atol=6e-6)
    assert (origins.tolist(), merged.tolist()) == ([1], [0])


@pytest.mark.parametrize(
    ("cell", "count"),
    [
        ({"range_m": 0.9}, 2),
        ({"range_m": 1.1}, 1),
        ({"range_m": 1.1, "range_rate_mps": 0.4}, 2),
        ({"azimuth_deg": 1}, 1),
    ],
)
def test_they_differ_in_any_quantity_that_the_cell_has(cell: dict[str, float], count: int) -> None:
    of = resting([(41.0, 0), (40.0, 0)], speed=(5.0, 5.5))
    ((z, _, _),) = _rows(found(of, Radar(resolution=cell, **SHARP)))
    assert z.shape[1] == count


def test_a_mean_of_azimuths_across_the_rear() -> None:
    of = resting([(-40.0, 0.4), (-40.0, -0.4)])
    ((z, _, _),) = _rows(found(of, Radar(resolution={"azimuth_deg": 3}, **SHARP)))
    assert z.shape == (3, 1)
    assert abs(z[1, 0]) == pytest.approx(np.pi, abs=1e-8)


def test_a_chain_is_one_group_and_what_is_missed_takes_no_part() -> None:
    of = resting([(40.0, 0), (41.5, 0), (43.0, 0), (60.0, 0)])
    sensor = Lidar(rate_hz=10, position_sigma_m=1e-6, resolution={"range_m": 2})
    ((z, origins, merged),) = _rows(found(of, sensor))
    assert sorted(zip(origins.tolist(), merged.tolist(), strict=True)) == [(0, 1), (3, -1)]
    power = np.array([40.0, 41.5, 43.0]) ** -4
    np.testing.assert_allclose(z[0, origins == 0], power @ [40, 41.5, 43] / power.sum())
    # Without the middle one the others are apart.
    without = replace(of, alive=np.array([[True, False, True, True]]))
    ((z, origins, merged),) = _rows(found(without, sensor))
    assert sorted(origins.tolist()) == [0, 2, 3]
    assert (merged == -1).all()


def test_the_noise_of_a_merged_measurement_is_that_of_the_strongest() -> None:
    of = resting([(41.0, 0), (40.0, 0)], 50)
    cell = {"range_m": 2, "azimuth_deg": 3}
    own, merged = (_rows(found(of, Radar(**keys, **RADAR))) for keys in ({}, {"resolution": cell}))
    weight = 41.0**-4 / (41.0**-4 + 40.0**-4)
    for (z, origins, _), (one, _, _) in zip(own, merged, strict=True):
        np.testing.assert_allclose(one[:, 0], z[:, origins == 1][:, 0] + [weight, 0, 0], atol=1e-12)
