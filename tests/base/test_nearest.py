"""The valid choices that a wrong name may mean."""

from __future__ import annotations

import pytest

from trackbench.base.errors import LISTED, nearest_choices, similar_names

FILTERS = ["ckf", "ekf", "iekf", "kf", "ukf"]
MOTION = ["bicycle", "ca", "ct", "cv", "singer"]
METRICS = ["nees.mean", "nis.roof.mean", "position_rmse", "rmse.vx", "rmse.vy", "start_position_rmse", "velocity_rmse"]
LIMITS = ["above", "below", "better_than", "is", "metric", "tracker", "worlds"]
FUNCTIONS = ["emergency_braking", "forward_collision_warning", "lane_change"]


@pytest.mark.parametrize(
    ("name", "choices", "meant"),
    [
        # Another spelling.
        ("EKF", FILTERS, ["ekf"]),
        ("Forward Collision-Warning", FUNCTIONS, ["forward_collision_warning"]),
        # Initials, in either direction.
        ("constant_velocity", MOTION, ["cv"]),
        ("extended_kalman_filter", FILTERS, ["ekf"]),
        ("FCW", FUNCTIONS, ["forward_collision_warning"]),
        # What others call it, where edit distance misleads.
        ("kalman", FILTERS, ["kf"]),
        ("rmse", METRICS, ["position_rmse", "velocity_rmse"]),
        ("less_than", LIMITS, ["below"]),
        ("greater_than", LIMITS, ["above"]),
        ("doppler_std", ["range_rate_bias", "range_rate_sigma"], []),
        ("range_std", ["range_bias", "range_sigma"], ["range_sigma"]),
        # All its words, the shortest first.
        ("ekf", ["ekf_cv", "ekf_long_name", "ukf"], ["ekf_cv", "ekf_long_name"]),
        ("nis", METRICS, ["nis.roof.mean"]),
        # A slip of the pen, once nothing else is found.
        ("velocity_rmes", METRICS, ["velocity_rmse"]),
        ("xyz", METRICS, []),
    ],
)
def test_what_a_name_means(name: str, choices: list[str], meant: list[str]) -> None:
    found = similar_names(name, choices)
    assert found == meant if meant else set(found) <= {"range_rate_sigma"}


def test_a_name_that_is_near_none_gets_the_choices_but_not_a_screen_of_them() -> None:
    assert nearest_choices("xyz", FILTERS) == "choose from: ckf, ekf, iekf, kf, ukf"
    many = [f"metric_{i:02}" for i in range(LISTED + 1)]
    assert nearest_choices("xyz", many).startswith(f"choose from {LISTED + 1}, such as metric_")
    assert nearest_choices("rmse", METRICS) == "did you mean 'position_rmse' or 'velocity_rmse'?"
    assert nearest_choices("x", []) == "there is none to choose from"
