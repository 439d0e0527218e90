"""The block of functions in a scenario: what it refuses, and functions of one's own."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from tests.support.places import DATA

from trackbench.base.errors import InputError
from trackbench.runner.run import run_scenario
from trackbench.scenario import load_scenario
from trackbench.scenario.truth import truths_of

GOOD = (DATA / "scenario.yaml").read_text(encoding="utf-8")
LINES = len(GOOD.splitlines())


def message(folder: Path, functions: str, *changes: tuple[str, str]) -> str:
    text = f"{GOOD}functions:\n  fcw: {functions}\n"
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    file = folder / "bad.yaml"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(InputError) as raised:
        load_scenario(file)
    return str(raised.value).replace(f"{file}:", "")


FCW = "{use: forward_collision_warning}"
BAD = [
    ("{use: cut_inn}", (), "functions.fcw.use: 'cut_inn' is not known; did you mean 'cut_in'?"),
    (
        "{use: emergency_braking, ttc_s: 2}",
        (),
        "functions.fcw.ttc_s: unknown key; choose from: ",
    ),
    ("{use: forward_collision_warning, ttc: 2}", (), "functions.fcw.ttc: unknown key; use ttc_s (seconds)"),
    ("{use: cut_in, probability: 1}", (), "functions.fcw.probability: 1 is not possible: it must be below 1"),
    ("{ttc_s: 2}", (), "functions.fcw.use: missing"),
    (
        FCW,
        (("observer: ego", "observer: {x: 0, y: 0}"),),
        "functions.fcw: the observer is a fixed point, and a function needs an ego: write truth.observer: ego",
    ),
]


@pytest.mark.parametrize(("functions", "changes", "expected"), BAD)
def test_a_bad_block_gives_its_line_and_the_remedy(
    tmp_path: Path, functions: str, changes: tuple[tuple[str, str], ...], expected: str
):
    assert message(tmp_path, functions, *changes).startswith(f"{LINES + 2}: {expected}")


SLOW = """
name: slow
truth: {source: scripted, duration_s: 4, rate_hz: 20, observer: {start: {speed_mps: 20}},
  objects: {lead: {start: {x: 40}}}}
sensors:
  fast: {type: radar, rate_hz: 20, range_sigma_m: 1, azimuth_sigma_deg: 1, range_rate_sigma_mps: 1}
  slow: {type: radar, rate_hz: 5, range_sigma_m: 1, azimuth_sigma_deg: 1, range_rate_sigma_mps: 1}
trackers: {ekf: {filter: ekf, motion: cv, acceleration_sigma_mps2: 4, sensors: SENSORS}}
functions: {fcw: {use: forward_collision_warning}}
"""


def test_the_fastest_sensor_that_is_read_measures_often(tmp_path: Path):
    file = tmp_path / "slow.yaml"
    for sensors, settings, key in (
        ("[slow]", (), "slow"),
        ("[slow]", ("sensors.slow.rate_hz=4",), "slow"),
        ("[fast, slow]", ("sensors.fast.rate_hz=5", "sensors.slow.rate_hz=2"), "fast"),
    ):
        file.write_text(SLOW.replace("SENSORS", sensors), encoding="utf-8")
        with pytest.raises(InputError, match=f"sensors.{key}.rate_hz.* use 10 or more") as raised:
            load_scenario(file, settings)
        assert len(str(raised.value).splitlines()) == 1
    for sensors, settings in (("[slow]", ("sensors.slow.rate_hz=10",)), ("[fast, slow]", ())):
        file.write_text(SLOW.replace("SENSORS", sensors), encoding="utf-8")
        load_scenario(file, settings)
    file.write_text(SLOW.replace("SENSORS", "[slow]").split("functions:")[0], encoding="utf-8")
    load_scenario(file)


def test_an_expectation_names_the_metrics_of_the_functions(tmp_path: Path):
    expect = ("metric: position_rmse", "metric: warn_delays.fcw")
    assert "there is no metric 'warn_delays.fcw'; did you mean 'warn_delay.fcw'?" in message(tmp_path, FCW, expect)


OWN = """
import numpy as np
from trackbench.subjects.functions.protocol import Decision, Function, Quantity

class Near(Function):
    '''Is active where anything is near.'''
    quantity = Quantity("distance", "m", "distance")
    near_m: float = 20.0
    def decide(self, ego, objects):
        WRONG
        distance = np.hypot(objects.mean[0] - ego.px, objects.mean[1] - ego.py)
        distance = np.where(objects.there, distance, np.inf)
        nearest = distance.min(axis=0)
        return Decision(nearest < self.near_m, distance.argmin(axis=0), np.where(np.isfinite(nearest), nearest, np.nan))
"""


@pytest.mark.parametrize("wrong", ["", "raise ValueError('no')"])
def test_a_function_of_ones_own_is_scored_and_ends_the_run_if_it_raises(
    tiny: Path, tmp_path: Path, write_module: Callable[[Path, str], str], wrong: str
):
    module = write_module(tmp_path, OWN.replace("WRONG", wrong or "pass"))
    with tiny.open("a", encoding="utf-8") as file:
        file.write(f"\nfunctions:\n  near: {{use: '{module}:Near', near_m: 500}}\n  fcw: {FCW}\n")
    loaded = load_scenario(tiny)
    if wrong:
        with pytest.raises(ValueError, match="no"):
            run_scenario(loaded, truths_of(loaded))
        return
    metrics = run_scenario(loaded, truths_of(loaded)).summary.trackers[0].metrics
    assert metrics["position_rmse"].value is not None
    assert metrics["false_warnings.fcw"].value is not None
    assert 0 < metrics["distance_error.near"].value < 5
    assert metrics["missed_warnings.near"].value == 0
