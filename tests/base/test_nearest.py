"""The valid choices that a wrong name may mean."""

from __future__ import annotations

import pytest

from trackbench.base.errors import LISTED, nearest_choices, similar_names

FILTERS = ["ckf", "ekf", "iekf", "kf", "ukf"]
MOTION = ["bicycle", "ca", "ct", "cv", "singer"]
METRICS = ["nees.mean", "nis.roof.mean", "position_rmse", "rmse.vx", "rmse.vy", "velocity_rmse"]
LIMITS = ["above", "below", "better_than", "is", "metric", "tracker", "worlds"]
FUNCTIONS = ["emergency_braking", "forward_collision_warning", "lane_change"]


@pytest.mark.parametrize(
    ("name", "choices", "meant"),
    [
        # Another spelling.
        ("EKF", FILTERS, ["ekf"]),
        ("Forward Collision-Warning", FUNCTIONS, ["forward_collision_warning"]),
        # All its words, the shortest first.
        ("ekf", ["ekf_cv", "ekf_long_name", "ukf"], ["ekf_cv", "ekf_long_name"]),
        ("nis", METRICS, ["nis.roof.mean"]),
        ("rmse", METRICS, ["rmse.vy", "rmse.vx", "velocity_rmse"]),
        # A slip of the pen, once nothing else is found.
        ("velocity_rmes", METRICS, ["velocity_rmse"]),
        ("xyz", METRICS, []),
    ],
)
def test_what_a_name_means(name: str, choices: list[str], meant: list[str]) -> None:
    assert similar_names(name, choices) == meant


def test_a_name_that_is_near_none_gets_the_choices_but_not_a_screen_of_them() -> None:
    assert nearest_choices("xyz", FILTERS) == "choose from: ckf, ekf, iekf, kf, ukf"
    many = [f"metric_{i:02}" for i in range(LISTED + 1)]
    assert nearest_choices("xyz", many).startswith(f"choose from {LISTED + 1}, such as metric_")
    assert nearest_choices("velocity", METRICS) == "did you mean 'velocity_rmse'?"
    assert nearest_choices("x", []) == "there is none to choose from"
