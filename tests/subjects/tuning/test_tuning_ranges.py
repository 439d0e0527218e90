"""Ranges of options: what is said where a tracker cannot be tuned so, and where the search begins."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from tests.subjects.tuning.test_tuning import TEXT
from tests.subjects.tuning.test_tuning_cli import SCENARIO

import trackbench as tb
from trackbench.api.scenario import load
from trackbench.base.errors import InputError
from trackbench.scenario import Scenario
from trackbench.subjects.tuning.parameters import parse_range, require_tunable

Cli = Callable[..., Any]
IMM = "{filter: ekf, motion: {imm: [{model: cv, acceleration_sigma_mps2: 1}, {model: ca, jerk_sigma_mps3: 5}], "
MORE = f"""trackers:
  imm: {IMM}stay_s: [5, 2]}}}}
  own: {{use: 'own:Own', options: {{alpha: 2}}}}
"""


@pytest.fixture
def scenario() -> Scenario:
    return load(TEXT.replace("trackers:\n", MORE))


def test_a_choice_that_the_scenario_has_as_a_whole_number_is_tuned(cli: Cli, tmp_path: Path) -> None:
    (tmp_path / "own.yaml").write_text(SCENARIO, encoding="utf-8")
    done = cli("tune", "own.yaml", "--trackers", "ekf", "--range", "acceleration_sigma_mps2=2,3,5", "--trials", "2",
               "--train-runs", "2", "--test-runs", "2", "--json")  # fmt: skip
    (tracker,) = json.loads(done.out)["trackers"]
    assert tracker["start"] == tracker["trials"][0]["values"] == {"acceleration_sigma_mps2": 2}


@pytest.mark.parametrize(
    ("tracker", "text", "message"),
    [
        ("imm", "acceleration_sigma_mps2=1:2", "write motion.imm.0.acceleration_sigma_mps2"),
        ("imm", "stay_s=1:2", "write motion.stay_s.0 or motion.stay_s.1"),
        ("ekf", "acceleration_sigma_mps2=:30", "an end is missing"),
    ],
)
def test_a_range_says_where_the_option_stands(scenario: Scenario, tracker: str, text: str, message: str) -> None:
    with pytest.raises(InputError) as error:
        parse_range(text, scenario, tracker)
    assert message in error.value.message
    assert "write 5" not in error.value.message


def test_a_sweep_and_a_tracker_without_options_cannot_be_tuned(scenario: Scenario) -> None:
    with pytest.raises(InputError, match="is a sweep; name one of its points: many_1, many_2"):
        require_tunable(scenario, "many")
    with pytest.raises(InputError, match="raw has no options: there is nothing to tune"):
        require_tunable(scenario, "raw")
    require_tunable(scenario, "many_1")


@pytest.mark.parametrize(
    ("given", "message"),
    [
        *(({"trials": trials}, "trials: give a whole number, at least 2") for trials in (0, 1, -5, 2.5, "3", True)),
        ({"train_runs": 0}, "train_runs: give a whole number, at least 1"),
        ({"seed": -1}, "seed: give a whole number, at least 0"),
        ({"ranges": "acceleration_sigma_mps2"}, "write KEY=LOW:HIGH"),
    ],
)
def test_a_program_is_told_what_is_wrong(given: dict[str, Any], message: str) -> None:
    with pytest.raises(tb.InputError, match=message):
        tb.tune(TEXT, ["ekf"], **given)
