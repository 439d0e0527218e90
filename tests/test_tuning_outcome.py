"""What a tuning amounts to, in words."""

from __future__ import annotations

from dataclasses import replace

import pytest

import trackbench as tb
from trackbench.api.scenario import load
from trackbench.tuning.held_out import LackingMeasure
from trackbench.tuning.objectives import OBJECTIVES
from trackbench.tuning.outcome import headline, remarks
from trackbench.tuning.split import SAME_MOTION
from trackbench.tuning.tune import Tuning

SCENARIO = {
    "name": "turn",
    "truth": {
        "source": "scripted",
        "duration_s": 3,
        "rate_hz": 10,
        "objects": {"car": {"start": {"x": 60, "y": 0, "vx_mps": 8}, "pieces": [{"turn_rate_degps": 10}]}},
    },
    "sensors": {"lidar": {"type": "lidar", "rate_hz": 10, "position_sigma_m": 0.15}},
    "trackers": {"kf": {"filter": "kf", "motion": "cv", "acceleration_sigma_mps2": 3}},
    "monte_carlo": {"runs": 3, "seed": 4},
}


@pytest.fixture(scope="module")
def tuning() -> Tuning:
    return tb.tune(load(SCENARIO), ["kf"], ranges={"acceleration_sigma_mps2": (0.5, 10.0)}, trials=3)["kf"]


@pytest.mark.parametrize(
    ("verdict", "change", "text"),
    [
        ("better", 0.1, "better than the start on other noise of the same motion"),
        ("undecided", 0.1, "the gain may be noise: no difference from the start is shown on other noise"),
        ("undecided", -0.1, "no difference from the start is shown on other noise"),
        ("undecided", 0.0, "no difference from the start is shown on other noise"),
        ("worse", -0.1, "worse than the start on other noise of the same motion: the values fit"),
    ],
)
def test_a_headline_says_what_is_shown_and_on_what(tuning: Tuning, verdict: str, change: float, text: str) -> None:
    likelihood = tuning.held_out.of("log_likelihood")[0]
    one = replace(likelihood, verdict=verdict, difference=likelihood.difference._replace(value=change))
    found = replace(tuning, start={}, held_out=replace(tuning.held_out, comparisons=(one,)))
    assert headline(found)[0].split(": ", 1)[1].startswith(text)
    # Of random motion another one was tried.
    assert "same motion" not in headline(replace(found, apart=("other noise and other random motion",)))[0]


def test_a_smaller_error_is_the_gain_that_may_be_noise(tuning: Tuning) -> None:
    error = tuning.held_out.of("position_rmse")[0]
    for change, gain in ((-0.1, True), (0.1, False)):
        one = replace(error, verdict="undecided", difference=error.difference._replace(value=change))
        held_out = replace(tuning.held_out, comparisons=(one,))
        found = replace(tuning, start={}, objective=OBJECTIVES["position_rmse"], held_out=held_out)
        assert ("may be noise" in headline(found)[0]) is gain


def test_of_several_scenarios_those_of_the_same_motion_are_named(tuning: Tuning) -> None:
    one = replace(tuning.held_out.of("log_likelihood")[0], verdict="better")
    lacking = LackingMeasure("c", "log_likelihood", "it gives 1 of the 2 innovations that the start gives")
    held_out = replace(tuning.held_out, comparisons=(one, one), not_compared=(lacking,))
    apart = (SAME_MOTION, "other scenes and other noise", SAME_MOTION)
    found = replace(tuning, start={}, held_out=held_out, scenarios=("a", "b", "c"), apart=apart)
    text, tone = headline(found)
    assert text.endswith("of 3 scenarios better in 2, not compared in 1; in a and c on other noise of the same motion")
    assert tone == "warn"
    said = list(remarks(found))
    assert f"c: not compared by log-likelihood of a measurement: with the tuned values {lacking.why}" in said
    none = replace(found, held_out=replace(held_out, comparisons=()))
    assert headline(none) == (f"not compared with the start: with the tuned values {lacking.why}", "bad")
