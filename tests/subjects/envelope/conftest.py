"""Small maps, made once."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import pytest
import yaml
from click.testing import CliRunner, Result

import trackbench as tb
from trackbench.base.execution import executor
from trackbench.cli.commands import cli
from trackbench.subjects.envelope.api import envelope_of
from trackbench.subjects.envelope.claim import Envelope
from trackbench.subjects.envelope.files import save_envelope
from trackbench.subjects.envelope.mapping import EnvelopeMap
from trackbench.subjects.envelope.task import task_of

#: One car that drives straight on, and a lidar: the error of the Kalman filter grows with that of the lidar.
SMALL: dict[str, Any] = {
    "name": "small",
    "truth": {
        "source": "scripted",
        "duration_s": 3,
        "rate_hz": 10,
        "objects": {"car": {"start": {"x": 20, "y": 5, "speed_mps": 10}}},
    },
    "sensors": {"lidar": {"type": "lidar", "rate_hz": 10, "position_sigma_m": 0.3}},
    "trackers": {
        "kf": {"filter": "kf", "motion": "cv", "acceleration_sigma_mps2": 1},
        "loose": {"filter": "kf", "motion": "cv", "acceleration_sigma_mps2": 10},
    },
    "monte_carlo": {"runs": 20, "seed": 1},
    "expect": [{"tracker": "kf", "metric": "position_rmse", "below": 0.25}],
    "envelope": {
        "cells": 12,
        "runs": {"first": 25, "most": 100},
        "axes": {"sigma": {"key": "sensors.lidar.position_sigma_m", "from": 0.1, "to": 1, "levels": 4}},
    },
}


def small(**changes: Any) -> tb.Scenario:
    """The small scenario with other values at its top level, or in its ``envelope``."""
    own = {key: changes.pop(key) for key in ("axes", "cells", "runs", "claim", "resolution") if key in changes}
    return tb.load({**SMALL, **changes, "envelope": SMALL["envelope"] | own})


def map_of(loaded: tb.Scenario, **options: Any) -> EnvelopeMap:
    """The map of a scenario, made in this process."""
    with executor(1) as chosen:
        made = EnvelopeMap(task_of(loaded), chosen, **options)
        made.make()
    return made


@pytest.fixture(scope="session")
def small_map() -> EnvelopeMap:
    """Of the small scenario."""
    return map_of(small())


@pytest.fixture(scope="session")
def small_envelope(small_map: EnvelopeMap) -> Envelope:
    """What is claimed of it."""
    return envelope_of(small_map, "trackbench envelope small.yaml")


class Commanded(NamedTuple):
    """What the command left."""

    done: Result
    folder: Path
    """In which it was called."""
    envelope: Envelope
    """That it wrote."""


@pytest.fixture(scope="session")
def commanded(tmp_path_factory: pytest.TempPathFactory) -> Commanded:
    """The command on the small scenario, with one counter-example."""
    folder, written = tmp_path_factory.mktemp("commanded"), list[Envelope]()
    (folder / "small.yaml").write_text(yaml.safe_dump(SMALL))
    words = "envelope small.yaml --counter-examples 1 --no-recording --junit cells.xml"

    def save(made: Envelope, *arguments: Any) -> Path:
        written.append(made)
        return save_envelope(made, *arguments)

    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        patch.setattr("trackbench.subjects.envelope.files.save_envelope", save)
        return Commanded(CliRunner().invoke(cli, words.split()), folder, written[0])


@pytest.fixture(scope="session")
def made_map() -> Callable[..., EnvelopeMap]:
    """Makes the map of the small scenario with other values."""
    return lambda **changes: map_of(small(**changes))
