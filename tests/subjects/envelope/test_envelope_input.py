"""What is wrong with an ``envelope:`` block is said in one line with its place, before any run."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml
from tests.subjects.envelope.conftest import SMALL

Cli = Callable[..., Any]
SIGMA = SMALL["envelope"]["axes"]["sigma"]


def write(folder: Path, axes: dict[str, Any], **changes: Any) -> None:
    block = SMALL["envelope"] | {"axes": axes}
    (folder / "small.yaml").write_text(yaml.safe_dump(SMALL | {"envelope": block} | changes, sort_keys=False))


@pytest.mark.parametrize(
    ("axis", "message"),
    [
        ({"key": "sensors.lidar.position_sgma_m", "values": [1, 2]}, "use position_sigma_m"),
        ({"key": "sensors.ldar.position_sigma_m", "values": [1, 2]}, "did you mean 'lidar'?"),
        ({"key": "sensors.lidar.detection_probability", "values": [0.9, 1.2]}, "noise 1.2: 1.2 is not possible"),
        ({"key": "sensors.lidar", "values": [0.9, 1.2]}, "a mapping"),
        ({"key": "a..b", "values": [1, 2]}, "is no key of a scenario"),
        ({"key": "truth.objects.car.start.x.y", "values": [1, 2]}, "has no key 'y'"),
        ({"choices": {"a": {"sensors.lidar.fov_deg": 90}, "b": {"sensors.lidar.fov": 90}}}, "use fov_deg"),
        ({"keys": {"monte_carlo.seed": {}}, "values": [1, 2]}, "cannot be an axis"),
        ({"key": "sensors.lidar.fov_deg", "from": 10, "to": 20, "levels": 50}, "the grid has 50 cells"),
    ],
)
def test_an_axis_that_cannot_be(axis: dict[str, Any], message: str, tmp_path: Path, cli: Cli) -> None:
    write(tmp_path, {"noise": axis})

    done = cli("envelope", "small.yaml")

    assert done.status == 2
    assert done.err.startswith("small.yaml:")
    assert message in done.err
    assert done.err.count("\n") == 1
    assert not any((tmp_path / "results").glob("*"))


@pytest.mark.parametrize(
    ("changes", "place", "message"),
    [
        ({"expect": []}, "expect", "an envelope needs a requirement"),
        ({"expect": [{"tracker": "kf", "metric": "step_time", "below": 3}]}, "expect.0.metric", "changes each time"),
        (
            {"expect": [{"tracker": "kf", "metric": "health.diverged_runs", "below": 3}]},
            "expect.0.metric",
            "not a mean over",
        ),
        ({"expect": [{"tracker": "kf", "metric": "nees.verdict", "is": "consistent"}]}, "expect.0.is", "is a word"),
        (
            {"expect": [{"tracker": "kf", "metric": "position_rmse", "better_than": "loose"}]},
            "expect.0.better_than",
            "an envelope needs a limit: write below or above",
        ),
    ],
)
def test_a_requirement_that_no_cell_is_decided_by(
    changes: dict[str, Any], place: str, message: str, tmp_path: Path, cli: Cli
) -> None:
    write(tmp_path, {"sigma": SIGMA}, **changes)

    done = cli("envelope", "small.yaml")

    assert done.status == 2
    assert f" {place}: " in done.err
    assert message in done.err
