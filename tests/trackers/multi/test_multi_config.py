"""The options of association: those that do not go together are refused with a clear message."""

from __future__ import annotations

from typing import Any

import pytest
from pydantic import ValidationError

from trackbench.trackers.config import FilterConfig

EKF = {"filter": "ekf", "motion": "cv", "acceleration_sigma_mps2": 2.0}


def messages(associate: dict[str, Any], **keys: Any) -> list[tuple[str, str]]:
    with pytest.raises(ValidationError) as caught:
        FilterConfig.model_validate({**EKF, **keys, "associate": associate})
    return [(".".join(map(str, error["loc"])), error["msg"]) for error in caught.value.errors()]


@pytest.mark.parametrize(
    ("associate", "key", "message"),
    [
        ({"method": "oracle", "gate": 0.9}, "gate", "not used with method: oracle; remove it, or use gnn or jpda or"),
        ({"method": "pmb", "confirm": "score"}, "confirm", "score is not used with method: pmb; use [M, N], or gnn or"),
        (
            {"method": "pmb", "confirm": [3, 5], "report_existence": [0.9, 0.5]},
            "report_existence",
            "one number is needed, such as 0.5: [M, N] confirms",
        ),
        ({"method": "pmb", "report_existence": [0.5, 0.9]}, "report_existence", "the larger comes first: [0.9, 0.5]"),
        ({"method": "pmb", "birth_density": 3}, "birth_density", "write uniform, or the mean and standard deviation"),
        ({"method": "gnn", "confirm": [0, 3]}, "confirm", "[M, N] needs M from 1 to N, and N at most 100, not [0, 3]"),
        (
            {"method": "pmb", "delete_existence": 0.6},
            "delete_existence",
            "must not exceed that down to which tracks are reported, 0.5 of report_existence",
        ),
    ],
)
def test_options_that_do_not_go_together(associate: dict[str, Any], key: str, message: str) -> None:
    (found,) = messages(associate)
    assert found[0] == f"associate.{key}"
    assert found[1].startswith(message)


@pytest.mark.parametrize("initial", ["two_measurements", "truth"])
def test_a_track_starts_from_one_detection(initial: Any) -> None:
    (found,) = messages({"method": "gnn"}, initial=initial)
    assert found == ("initial.from", "with associate a track starts from one detection: use from: first_measurement")


@pytest.mark.parametrize("initial", [{}, "first_measurement", {"sensors": ["lidar"]}, {"velocity_sigma_mps": 5}])
def test_tracks_start_with_the_range_rate_unless_said_otherwise(initial: Any) -> None:
    config = FilterConfig.model_validate({**EKF, "associate": {"method": "gnn"}, "initial": initial})
    assert (config.initial.source, config.initial.velocity) == ("first_measurement", "range_rate")
    resting = {**EKF, "initial": {"velocity": "zero"}, "associate": {"method": "gnn"}}
    assert FilterConfig.model_validate(resting).initial.velocity == "zero"
    assert FilterConfig.model_validate(EKF).initial.source == "first_measurement"
