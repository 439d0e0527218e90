"""Functions in whole runs: from the scenario to the result."""

from __future__ import annotations

from pathlib import Path

import pytest

from trackbench.results import Result
from trackbench.runner.run import run_scenario
from trackbench.scenario import load_scenario
from trackbench.scenario.truth import truths_of

#: Both at 50 km/h, the gap is 40 m, and the lead brakes at 6 m/s^2.
BRAKING = """
name: braking_lead
truth:
  source: scripted
  duration_s: 8
  rate_hz: 20
  observer: {start: {speed_mps: 13.89}, length_m: 5, width_m: 2}
  objects:
    lead:
      start: {x: 44.75, speed_mps: 13.89}
      pieces: [{for_s: 3}, {for_s: 2.3, acceleration_mps2: -6}, {}]
sensors:
  radar: {type: radar, rate_hz: 20, range_sigma_m: SIGMA, azimuth_sigma_deg: AZIMUTH, range_rate_sigma_mps: SIGMA}
trackers:
  ekf: {filter: ekf, motion: cv, acceleration_sigma_mps2: 8}
  slow: {filter: ekf, motion: cv, acceleration_sigma_mps2: 1}
monte_carlo: {runs: 20}
functions:
  fcw: {use: forward_collision_warning, ttc_s: 2.4}
"""


def result_of(folder: Path, text: str, **changes: str) -> Result:
    """Of a scenario with words in capitals in place of others."""
    for word, value in changes.items():
        text = text.replace(word, value)
    file = folder / "scenario.yaml"
    file.write_text(text, encoding="utf-8")
    loaded = load_scenario(file)
    return run_scenario(loaded, truths_of(loaded))


@pytest.fixture(scope="module")
def noisy(tmp_path_factory: pytest.TempPathFactory) -> Result:
    return result_of(tmp_path_factory.mktemp("noisy"), BRAKING, SIGMA="0.5", AZIMUTH="0.2")


def test_without_noise_nothing_is_late_missed_or_false(tmp_path: Path):
    metrics = result_of(tmp_path, BRAKING, SIGMA="0.001", AZIMUTH="0.001")["ekf"].metrics
    assert metrics["warn_delay.fcw"].value == 0.0
    assert metrics["warn_delay.fcw"].missing == 0.0
    assert metrics["missed_warnings.fcw"].value == 0.0
    assert metrics["false_warnings.fcw"].value == 0.0
    assert metrics["ttc_error.fcw"].value < 0.01


def test_a_slow_tracker_warns_later_in_every_run(noisy: Result):
    delay, slow = (noisy[name].metrics["warn_delay.fcw"] for name in ("ekf", "slow"))
    assert slow.value > delay.value + 0.1
    assert slow.ci95[0] > delay.ci95[1]
    assert slow.p05 <= slow.p50 <= slow.p95
    (difference,) = [item for item in noisy.differences if item.metric == "warn_error.fcw"]
    assert difference.ci95[0] * difference.ci95[1] > 0


def test_each_run_in_the_table_has_its_own_error(noisy: Result):
    rows = noisy.tables.runs.to_pandas().query("tracker == 'slow'")
    delay, error, count = (
        rows[name] for name in ("warn_delay.fcw_per_run", "warn_error.fcw_per_run", "warn_error.fcw_count")
    )
    assert (count == 1).all()
    assert error.tolist() == pytest.approx(delay.abs().tolist())


ALL = """
  aeb: {use: emergency_braking}
  lead: {use: following_distance, headway_s: 2}
  cut: {use: cut_in}
"""


def test_hidden_identities_without_clutter_give_what_known_ones_give(tmp_path: Path):
    text = BRAKING.split("trackers:")[0] + "trackers: {ekf: {filter: ekf, motion: cv, acceleration_sigma_mps2: 8}}\n"
    text += "monte_carlo: {runs: 5}\nfunctions:\n  fcw: {use: forward_collision_warning}" + ALL
    associate = ", associate: {method: gnn, confirm: [1, 1]}}}\nsensing: {identities: hidden}\n"
    known, hidden = (
        result_of(tmp_path, text.replace("}}\n", end), SIGMA="0.3", AZIMUTH="0.2")["ekf"].metrics
        for end in ("}}\n", associate)
    )
    paths = [path for path in known if path.partition(".")[2] in ("fcw", "aeb", "lead", "cut")]
    assert {"brake_error.aeb", "deceleration_error.aeb", "lead_errors.lead", "headway_error.lead"} < {*paths}
    assert hidden["brake_error.aeb"].value > 0
    for path in paths:
        known_value, value = known[path].value, hidden[path].value
        assert value == (known_value and pytest.approx(known_value, rel=1e-6)), path
