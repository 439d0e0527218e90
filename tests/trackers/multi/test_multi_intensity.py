"""What a tracker of several objects expects of a scan: false alarms, and objects that none has found."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from tests.support.traffic_scans import NOISE, RANGE, RATES, VOLUME

from trackbench.base.types import FieldOfView, Scan
from trackbench.trackers.associate import AssociateConfig
from trackbench.trackers.config import FilterConfig
from trackbench.trackers.multi import build_multi
from trackbench.trackers.multi.intensity import Undetected, intensity

PMB = AssociateConfig(method="pmb")
FRONT, REAR = np.zeros(3), np.array([0.0, 0.0, np.pi])


def scan(sensor: str, pose: Any = FRONT, half_angle: float = np.pi, time: float = 0.0, **more: Any) -> Scan:
    """An empty one of a radar."""
    field = FieldOfView(half_angle, RANGE, VOLUME["radar"] * half_angle / np.pi)
    given = {"detection_probability": 0.9, "clutter_density": 5 / VOLUME["radar"], "field_of_view": field, **more}
    empty = np.zeros((3, 0)), np.zeros(0, dtype=bool)
    return Scan(time, sensor, "radar", *empty, np.diag(NOISE["radar"]), pose, np.zeros(2), time, **given)


@pytest.mark.parametrize("velocity_sigma", [3.0, 20.0])
def test_a_filter_of_positions_expects_every_false_alarm_of_the_scan(velocity_sigma: float) -> None:
    found = intensity(scan("radar"), False, PMB, 10.0, np.array([1.0, 0.5]), velocity_sigma)
    np.testing.assert_allclose(found.false_alarms * np.pi * RANGE**2, 5.0)
    np.testing.assert_allclose(found.new_objects * np.pi * RANGE**2, [10.0, 5.0])


def test_one_of_all_components_has_the_stated_density() -> None:
    found = intensity(scan("radar"), True, PMB, 10.0, np.ones(1), 20.0)
    np.testing.assert_allclose(found.false_alarms, 5.0 / (RANGE * 2 * np.pi * 2 * RATES))


def test_a_scan_speaks_against_objects_where_it_looked() -> None:
    start = Undetected(10.0, {})
    after = start.after_scan(scan("front", FRONT, np.pi / 4), 0.9)
    assert after.in_view("front") == pytest.approx(1.0)
    assert after.in_view("rear") == 10.0
    both = after.after_scan(scan("rear", REAR, np.pi / 4), 0.9)
    assert (both.in_view("front"), both.in_view("rear")) == pytest.approx((1.0, 1.0))


def test_views_that_overlap_share_what_is_found() -> None:
    seen = Undetected(10.0, {}).after_scan(scan("all"), 0.0)
    assert seen.in_view("all") == 10.0
    # A quarter of the view of the one that sees all around.
    after = seen.after_scan(scan("front", FRONT, np.pi / 4), 0.8)
    assert after.in_view("all") == pytest.approx(8.0)
    assert after.in_view("front") == pytest.approx(2.0)
    assert after.after_scan(scan("all"), 0.5).in_view("front") == pytest.approx(1.0)


def test_time_takes_some_away_and_brings_others() -> None:
    later = Undetected(10.0, {}).after_scan(scan("front", FRONT, 1.0), 0.9).after_time(0.5, 0.25)
    assert (later.unseen, later.in_view("front")) == pytest.approx((5.25, 0.75))


@pytest.mark.parametrize("method", ["jipda", "pmb"])
def test_what_the_front_radar_sees_says_nothing_of_the_rear(method: str) -> None:
    given = {"filter": "ekf", "motion": "cv", "acceleration_sigma_mps2": 3, "associate": {"method": method}}
    behind = np.array([[40.0], [0.0], [0.0]])
    existence = []
    for looks_ahead in (0, 20):
        of, state = build_multi(FilterConfig.model_validate(given)).tracker, None
        for k in range(looks_ahead):
            state, _ = of.step(state, scan("front", FRONT, np.pi / 4, time=0.05 * k))
        rear = scan("rear", REAR, np.pi / 4, time=1.0)._replace(measurement=behind, valid=np.ones(1, dtype=bool))
        state, _ = of.step(state, rear)
        existence.append(float(state.table.evidence[0, 0]))
    # In that second objects may have come.
    assert existence[1] == pytest.approx(existence[0], rel=0.1)
