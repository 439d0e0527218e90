"""The valid choices that a wrong name may mean."""

from __future__ import annotations

import pytest

from trackbench.base.errors import similar_names

FILTERS = ["ckf", "ekf", "kf", "ukf"]
METRICS = ["nees.mean", "nis.roof.mean", "position_rmse", "rmse.vx", "rmse.vy", "velocity_rmse"]
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
