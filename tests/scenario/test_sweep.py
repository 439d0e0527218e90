"""One tracker for each point of a sweep."""

import json
from pathlib import Path

import pytest
from click.testing import CliRunner

from trackbench.base.errors import InputError
from trackbench.cli.commands import cli
from trackbench.scenario import load_scenario

HEAD = """\
name: example
truth: {source: scripted, duration_s: 2, rate_hz: 10, objects: {car: {start: {x: 20, speed_mps: 3}}}}
sensors:
  front: {type: radar, rate_hz: 10, range_sigma_m: 0.1, azimuth_sigma_deg: 0.5, range_rate_sigma_mps: 0.1}
  roof: {type: lidar, rate_hz: 10, position_sigma_m: 0.1}
trackers:
"""
COMBINED = """\
  ukf:
    filter: ukf
    motion: ctrv
    sweep:
      acceleration_sigma_mps2: [0.8, 2]
      yaw_acceleration_sigma_radps2:
        - 0.4
        - 1e-3
"""


def load(folder: Path, trackers: str, *overrides: str):
    path = folder / "sweep.yaml"
    path.write_text(HEAD + trackers, encoding="utf-8")
    return load_scenario(path, overrides)


def messages(folder: Path, trackers: str) -> list[str]:
    with pytest.raises(InputError) as caught:
        load(folder, trackers)
    return str(caught.value).replace(str(folder / "sweep.yaml"), "FILE").splitlines()


def test_all_combinations_in_order(tmp_path):
    loaded = load(tmp_path, "  raw: {use: raw}\n" + COMBINED + "  last: {use: raw}\n")

    points = ("ukf_0p8_0p4", "ukf_0p8_0p001", "ukf_2_0p4", "ukf_2_0p001")
    assert tuple(loaded.config.trackers) == ("raw", *points, "last")
    assert loaded.sweeps == {"ukf": points}
    point = loaded.config.trackers["ukf_2_0p4"]
    assert (point.filter, point.motion.acceleration_sigma_mps2, point.motion.yaw_acceleration_sigma_radps2) == (
        "ukf",
        2,
        0.4,
    )
    assert point.sweep is None


def test_a_list_of_points(tmp_path):
    sweep = "  ekf: {filter: ekf, motion: cv, sweep: [{acceleration_sigma_mps2: 1}, {acceleration_sigma_mps2: 2, "
    loaded = load(tmp_path, sweep + "sensors: [roof]}]}\n")

    assert loaded.sweeps == {"ekf": ("ekf_1", "ekf_2_roof")}
    assert loaded.config.trackers["ekf_1"].sensors is None
    assert loaded.config.trackers["ekf_2_roof"].sensors == ["roof"]


def test_any_option_can_vary(tmp_path):
    loaded = load(
        tmp_path,
        "  all: &all\n    motion: cv\n    acceleration_sigma_mps2: 1\n"
        "    sweep: {filter: [kf, ukf], sensors: [[front, roof], [roof]],\n"
        "            initial: [truth, {from: first_measurement}]}\n"
        "  q: {filter: ekf, motion: cv, sweep: {process_noise_diag: [[20, 20, 4, 4], [1, 1, 1, 0.5]]}}\n"
        "  p: {filter: ekf, motion: cv, acceleration_sigma_mps2: 1, initial: {from: first_measurement},\n"
        "      sweep: {initial.velocity_sigma_mps: [5, 10]}}\n"
        "  w: {filter: ukf, motion: cv, acceleration_sigma_mps2: 1, sweep: {augmented: [true, false]}}\n",
    )

    assert loaded.sweeps["all"][0] == "all_kf_front-roof_truth"
    assert len(loaded.sweeps["all"]) == 8
    assert loaded.config.trackers["all_ukf_roof_first_measurement"].initial.source == "first_measurement"
    assert loaded.sweeps["q"] == ("q_20-20-4-4", "q_1-1-1-0p5")
    assert loaded.config.trackers["p_10"].initial.velocity_sigma_mps == 10
    assert loaded.sweeps["w"] == ("w_true", "w_false")


def test_options_of_a_tracker_of_ones_own(tmp_path):
    loaded = load(tmp_path, "  mine: {use: 'm:C', options: {beta: 1}, sweep: {options.alpha: [0.1, 0.5]}}\n")

    assert loaded.config.trackers["mine_0p5"].options == {"beta": 1, "alpha": 0.5}
    assert loaded.config.trackers["mine_0p1"].options == {"beta": 1, "alpha": 0.1}


def test_expectations_and_overrides_name_the_points(tmp_path):
    expect = "expect: [{tracker: ukf_2_0p4, metric: position_rmse, below: 1}]\n"
    assert load(tmp_path, COMBINED + expect).config.expect[0].tracker == "ukf_2_0p4"

    loaded = load(tmp_path, COMBINED, "trackers.ukf.sweep.acceleration_sigma_mps2=[7]")
    assert loaded.sweeps == {"ukf": ("ukf_7_0p4", "ukf_7_0p001")}


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("[0.8, 2]", "[0.8, -2]", "11: trackers.ukf.sweep.acceleration_sigma_mps2.1: -2 is not possible"),
        ("- 1e-3", "- fast", "14: trackers.ukf.sweep.yaw_acceleration_sigma_radps2.1: a number"),
        (
            "yaw_acceleration_sigma_radps2:",
            "yaw_acc_sigma_radps2:",
            "13: trackers.ukf.sweep.yaw_acc_sigma_radps2.0: unk",
        ),
        ("[0.8, 2]", "[]", "11: trackers.ukf.sweep.acceleration_sigma_mps2: a list of values is needed"),
        (
            "[0.8, 2]",
            "[2, 2.0]",
            "11: trackers.ukf.sweep.acceleration_sigma_mps2.1: there is another tracker 'ukf_2_0p4'",
        ),
        (
            "acceleration_sigma_mps2: [0.8, 2]",
            "filter.x: [1]",
            "11: trackers.ukf.sweep.filter.x.0: it is 'ukf', which has",
        ),
        (
            "acceleration_sigma_mps2: [0.8, 2]",
            "sweep: [1]",
            "11: trackers.ukf.sweep.sweep.0: 'sweep' is not an option",
        ),
        (
            "[0.8, 2]",
            f"[{', '.join(map(str, range(6000)))}]",
            "10: trackers.ukf.sweep: more than 10000 points",
        ),
        (
            "[0.8, 2]",
            f"['{'x' * 70}']",
            "7: trackers.ukf: a name starts with a letter and has only letters, digits, _ and -, at most 64",
        ),
    ],
)
def test_a_mistake_is_shown_where_it_was_written(tmp_path, old, new, expected):
    assert old in COMBINED
    found = messages(tmp_path, COMBINED.replace(old, new, 1))

    assert any(message.startswith(f"FILE:{expected}") for message in found), found
    # A mistake in what the points share is one mistake.
    assert len(found) == len(set(found))


@pytest.mark.parametrize("sweep", ["3", "[]", "{}", "[3]", "[{}]", "word", "null"])
def test_neither_form(tmp_path, sweep):
    [message] = messages(tmp_path, f"  ekf: {{filter: ekf, motion: cv, sweep: {sweep}}}\n")
    assert message.startswith("FILE:7: trackers.ekf.sweep")
    assert "a list of mappings, each a point" in message


def test_check_shows_the_number_of_points(tmp_path):
    load(tmp_path, COMBINED)
    shown = CliRunner().invoke(cli, ["check", str(tmp_path / "sweep.yaml")])

    assert shown.exit_code == 0
    assert shown.output == f"{tmp_path / 'sweep.yaml'}: ok (ukf: 4 points)\n"


def test_the_name_of_a_sweep_chooses_all_of_its_points(tmp_path):
    load(tmp_path, COMBINED + "  raw: {use: raw}\nmonte_carlo: {runs: 2}\n")
    command = ["run", str(tmp_path / "sweep.yaml"), "--out", str(tmp_path / "out"), "--no-recording", "--json"]
    for chosen, count in (("ukf", 4), ("ukf_0p8_0p4,raw", 2)):
        done = CliRunner().invoke(cli, [*command, "--trackers", chosen], standalone_mode=False)
        result = json.loads((tmp_path / "out" / "example" / "result.json").read_text())
        assert done.exit_code == 0
        assert len(result["trackers"]) == count
