"""Each bad scenario gives its messages: file, line, key path and the nearest valid choice."""

from pathlib import Path

import pytest

# The messages below count the lines of this file.
from tests.support.places import DATA

from trackbench.base.errors import InputError
from trackbench.scenario import load_scenario

GOOD = (DATA / "scenario.yaml").read_text(encoding="utf-8")

PHASE = (
    "must be a multiple of the truth step, which is 0.05 s, below the sensor's period, which is 0.1 s, and not after "
    "the end; use 0.05"
)
FILTERS = "filter (built in: kf, ekf, iekf, ukf, ckf) or use (your own)"

# What is replaced, by what, and the messages after the file's name.
BAD = [
    # Unknown keys, most often in another unit.
    (
        "azimuth_sigma_deg: 0.5",
        "azimuth_sigma_rad: 0.01",
        ["15: sensors.front.azimuth_sigma_rad: unknown key; use azimuth_sigma_deg (degrees): 0.573"],
    ),
    (
        "azimuth_sigma_deg: 0.5",
        "azimuth_sigma: 0.5",
        ["15: sensors.front.azimuth_sigma: unknown key; use azimuth_sigma_deg (degrees)"],
    ),
    (
        "azimuth_sigma_deg: 0.5",
        "azimut_sigma_mrad: 10",
        ["15: sensors.front.azimut_sigma_mrad: unknown key; use azimuth_sigma_deg (degrees): 0.573"],
    ),
    ("duration_s: 20", "durations_s: 20", ["6: truth.durations_s: unknown key; use duration_s (seconds): 20"]),
    (
        "{nearest: 4}",
        "{nearst: 4}",
        ["9: truth.targets.nearst: unknown key; did you mean 'nearest'?"],
    ),
    ("observer: ego", "observer: {x_m: 3}", ["8: truth.observer.x_m: unknown key; use x"]),
    ("monte_carlo:", "monte-carlo:", ["24: monte-carlo: unknown key; did you mean 'monte_carlo'?"]),
    ("seed: 7", "seed: 7, workers: 2", ["24: monte_carlo.workers: unknown key; choose from: runs, seed"]),
    # Options of a class beside its name.
    (
        "{use: ",
        "{alpha: 0.5, use: ",
        ["23: trackers.mine.alpha: unknown key; options of a class go under options"],
    ),
    ("{use: ", "{optoins: {}, use: ", ["23: trackers.mine.optoins: unknown key; did you mean 'options'?"]),
    # Effects of a sensor, one at a time.
    *(
        ("dropouts: [{from_s: 5, to_s: 6}]", f"effects: [{{{effect}}}]", [f"18: sensors.front.effects.0.{message}"])
        for effect, message in [
            (
                "type: ghosts, probability: 0.1, wall: [[0, 6], [0, 6]]",
                "wall.1: is the same point as the corner before it; remove one of them",
            ),
            (
                "type: interference, per_minute: 1.0e+9, duration_s: 1, detection_factor: 0.5",
                "per_minute: 1e+09 is not possible: it must be at most 6000",
            ),
            (
                "type: interference, per_minute: 1, duration_s: 1",
                "type: interference does nothing without one of these: detection_factor, alarms_per_scan",
            ),
            (
                "type: reflection, time_s: 2",
                "type: reflection does nothing without one of these: toward_sensor, along_m, across_m",
            ),
            (
                "type: bias, sigmas: {azimuth_deg: 1, azimuth_rad: 0.1}",
                "sigmas.azimuth_rad: the azimuth is stated by azimuth_deg already; remove one of them",
            ),
        ]
    ),
    # Wrong types.
    (
        "range_sigma_m: 0.3",
        "range_sigma_m: 20 m",
        ["14: sensors.front.range_sigma_m: a number in metres is needed, not '20 m'"],
    ),
    (
        "detection_probability: 0.9",
        "detection_probability: 90%",
        ["17: sensors.front.detection_probability: a number is needed, not '90%'"],
    ),
    (
        "range_sigma_m: 0.3",
        "range_sigma_m: .nan",
        ["14: sensors.front.range_sigma_m: a number in metres is needed, not nan"],
    ),
    (
        "range_sigma_m: 0.3",
        "range_sigma_m:",
        ["14: sensors.front.range_sigma_m: a number in metres is needed, not nothing"],
    ),
    ("runs: 100", "runs: 2.5", ["24: monte_carlo.runs: a whole number is needed, not 2.5"]),
    ("description: one line", "description: 5", ["2: description: text is needed, not 5"]),
    (
        "sensors: [front, roof]",
        "sensors: roof",
        ["21: trackers.ekf.sensors: a list is needed, not 'roof'"],
    ),
    (
        "score: {settle_s: 2}",
        "score: 2",
        [
            "25: score: a mapping of keys to values is needed, not 2 (keys: settle_s, each, point, divergence_m, "
            "lost_after_s, cutoff_m, switch_costs_s, min_coverage, margin, baseline, reference, metrics)"
        ],
    ),
    (
        "initial: truth",
        "initial: truth, augmented: maybe",
        ["22: trackers.ukf.augmented: true or false is needed, not 'maybe'"],
    ),
    # Words that are not known.
    ("observer: ego", "observer: egg", ["8: truth.observer: 'egg' is not known; did you mean 'ego'?"]),
    ("type: lidar, ", "", ["19: sensors.roof.type: missing; choose from: lidar, radar"]),
    ("filter: ekf", "filter: EKF", ["21: trackers.ekf.filter: 'EKF' is not known; did you mean 'ekf'?"]),
    (
        "filter: ekf",
        "filter: kalman",
        ["21: trackers.ekf.filter: 'kalman' is not known; choose from: ckf, ekf, iekf, kf, ukf"],
    ),
    (
        "rate_hz: 10",
        "preset: velodyne_vlp61",
        ["19: sensors.roof.preset: no lidar preset has the name 'velodyne_vlp61'; did you mean 'velodyne_vlp16'?"],
    ),
    (
        "rate_hz: 10",
        "preset: bosch_lrr3",
        ["19: sensors.roof.preset: no lidar preset has the name 'bosch_lrr3'; choose from: ouster_os1, velodyne_vlp16"],
    ),
    ("name: example", "name: My Example", ["1: name: 'My Example' is not possible: only a to z, 0 to 9, _ and -"]),
    (
        "  roof:",
        "  roof.top:",
        ["19: sensors.roof.top: a name starts with a letter and has only letters, digits, _ and -, at most 64"],
    ),
    # Impossible values.
    (
        "range_sigma_m: 0.3",
        "range_sigma_m: -1",
        ["14: sensors.front.range_sigma_m: -1 is not possible: it must be at least 1e-06"],
    ),
    (
        "detection_probability: 0.9",
        "detection_probability: 95",
        ["17: sensors.front.detection_probability: 95 is not possible: it must be at most 1"],
    ),
    ("to_s: 6", "to_s: 5", ["18: sensors.front.dropouts.0.to_s: must be later than from_s, which is 5"]),
    ("sensors: [front, roof]", "sensors: []", ["21: trackers.ekf.sensors: must not be empty"]),
    # Required keys.
    (
        "    range_sigma_m: 0.3\n",
        "",
        ["11: sensors.front.range_sigma_m: missing; standard deviation of the range, m"],
    ),
    (
        "name: example\n",
        "",
        [
            "1: name: missing; name of the result's folder. The noise is drawn by the name and the seed: a copy under "
            "another name has other noise"
        ],
    ),
    # Trackers.
    ("use: raw, ", "", [f"23: trackers.mine: write {FILTERS}, and not both"]),
    ("filter: ekf", "fliter: ekf", [f"21: trackers.ekf: write {FILTERS}, and not both; did you mean 'filter'?"]),
    (
        "motion: cv, acceleration_sigma_mps2: 3",
        "motion: ca, acceleration_sigma_mps2: 3",
        [
            "21: trackers.ekf.acceleration_sigma_mps2: motion ca does not use this; it uses jerk_sigma_mps3",
        ],
    ),
    (
        "filter: ukf",
        "filter: kf",
        [
            "22: trackers.ukf.motion: kf needs a linear motion model: use ca or cv or cv_continuous or "
            "singer, or filter: ekf with ctrv"
        ],
    ),
    (
        "filter: ekf",
        "filter: ekf, sigma_points: classic",
        ["21: trackers.ekf.sigma_points: only filter ukf has this key; the filter here is ekf"],
    ),
    (
        "initial: truth",
        "initial: {from: two_measurements, velocity_sigma_mps: 3}",
        [
            "22: trackers.ukf.initial.velocity_sigma_mps: not used with from: two_measurements; remove it, "
            "or use from: first_measurement or truth"
        ],
    ),
    (
        "sensors: [front, roof]",
        "sensors: [front, rof]",
        ["21: trackers.ekf.sensors.1: the scenario has no sensor 'rof'; did you mean 'roof'?"],
    ),
    (
        "sensors: [front, roof]",
        "sensors: [front], measurement_noise: {roof: {position_sigma_m: 0.3}}",
        ["21: trackers.ekf.measurement_noise.roof: the tracker does not read roof; it reads front"],
    ),
    (
        "sensors: [front, roof]",
        "sensors: [front, roof], initial: {from: first_measurement, velocity: radial, sensors: [roof]}",
        [
            "21: trackers.ekf.initial.velocity: roof (lidar) measures no range rate; remove it, or start from a sensor "
            "that does"
        ],
    ),
    # Times and rates.
    (
        "rate_hz: 10",
        "rate_hz: 7",
        ["19: sensors.roof.rate_hz: 7 Hz does not divide truth.rate_hz, which is 20; use 5 or 10"],
    ),
    (
        "type: lidar, rate_hz: 10, position_sigma_m: 0.15",
        "type: radar, preset: bosch_lrr3",
        ["19: sensors.roof.rate_hz: 12.5 Hz does not divide truth.rate_hz, which is 20; use 10 or 20"],
    ),
    (
        "rate_hz: 10",
        "rate_hz: 10, phase_s: 0.1",
        [f"19: sensors.roof.phase_s: {PHASE}"],
    ),
    (
        "rate_hz: 10",
        "rate_hz: 10, phase_s: 0.04",
        [f"19: sensors.roof.phase_s: {PHASE}"],
    ),
    (
        "settle_s: 2",
        "settle_s: 20",
        ["25: score.settle_s: is 20 and must be shorter than truth.duration_s, which is 20"],
    ),
    ("run: 0", "run: 100", ["28: recording.run: must be from 0 to 99, of 100 runs"]),
    # Expectations.
    ("tracker: ekf", "tracker: efk", ["27: expect.0.tracker: the scenario has no tracker 'efk'; did you mean 'ekf'?"]),
    (
        "metric: position_rmse",
        "metric: position_rms",
        ["27: expect.0.metric: there is no metric 'position_rms'; did you mean 'position_rmse'?"],
    ),
    (
        "metric: position_rmse",
        "metric: gospa",
        [
            "27: expect.0.metric: there is no metric 'gospa'; it is one of hidden identities, and "
            "sensing.identities is known"
        ],
    ),
    (
        "tracker: ekf, metric: position_rmse",
        "tracker: mine, metric: nis.roof.mean",
        ["27: expect.0.metric: tracker mine does not read roof; it reads front"],
    ),
    (", below: 0.5", "", ["27: expect.0: no limit is given: add below, above, is or better_than"]),
    (
        "below: 0.5",
        "is: consistent",
        ["27: expect.0.is: position_rmse is a number, not a word; use below or above"],
    ),
    (
        "metric: position_rmse, below: 0.5",
        "metric: nees.verdict, below: 5",
        [
            "27: expect.0.below: nees.verdict is a word, not a number; "
            "use is: consistent | optimistic | pessimistic | undecided | mixed | heavy-tailed"
        ],
    ),
    (
        "below: 0.5",
        "better_than: row",
        ["27: expect.0.better_than: the scenario has no other tracker 'row'; choose from: mine, ukf"],
    ),
    (
        "below: 0.5",
        "better_than: ekf",
        ["27: expect.0.better_than: the scenario has no other tracker 'ekf'; did you mean 'ukf'?"],
    ),
    (
        "metric: position_rmse, below: 0.5",
        "metric: nees.mean, better_than: ukf",
        [
            "27: expect.0.better_than: trackers are not compared by nees.mean; only by position_rmse, velocity_rmse, "
            "rmse.px, rmse.py, rmse.vx, rmse.vy"
        ],
    ),
    # Several mistakes are all shown, in the order of the file.
    (
        "rate_hz: 10, position_sigma_m: 0.15}\ntrackers:\n  ekf: {filter: ekf",
        "rate_hz: fast, position_sigma_m: 0}\ntrackers:\n  ekf: {filter: ekg",
        [
            "19: sensors.roof.rate_hz: a number in Hz is needed, not 'fast'",
            "19: sensors.roof.position_sigma_m: 0 is not possible: it must be at least 1e-06",
            "21: trackers.ekf.filter: 'ekg' is not known; did you mean 'ekf'?",
        ],
    ),
]


def messages(path: Path) -> list[str]:
    with pytest.raises(InputError) as caught:
        load_scenario(path)
    return str(caught.value).replace(str(path), "FILE").splitlines()


@pytest.mark.parametrize(("old", "new", "expected"), BAD, ids=[new.strip()[:50] or f"no {old}" for old, new, _ in BAD])
def test_message(tmp_path: Path, old: str, new: str, expected: list[str]) -> None:
    assert GOOD.count(old) >= 1
    path = tmp_path / "bad.yaml"
    path.write_text(GOOD.replace(old, new, 1), encoding="utf-8")

    assert messages(path) == [f"FILE:{line}" for line in expected]


def test_a_scene_shorter_than_the_settling_time_that_it_does_not_state(tmp_path: Path) -> None:
    path = tmp_path / "short.yaml"
    text = GOOD.replace("duration_s: 20", "duration_s: 1").replace("score: {settle_s: 2}\n", "")
    path.write_text(text.replace("    dropouts: [{from_s: 5, to_s: 6}]\n", ""), encoding="utf-8")
    (message,) = messages(path)
    assert message.endswith("score.settle_s: is 1 and must be shorter than truth.duration_s, which is 1")


def test_the_good_scenario_is_good(tmp_path: Path) -> None:
    path = tmp_path / "good.yaml"
    path.write_text(GOOD)

    assert load_scenario(path).config.name == "example"


@pytest.mark.parametrize(
    ("old", "new", "line", "said"),
    [
        ("  rate_hz: 20", " rate_hz: 20", 7, "wrong indentation"),
        ("  rate_hz: 20", "  rate_hz 20", 7, "a key is followed by a colon and a space"),
        ("sensors:", "sensors", 10, "a key is followed by a colon and a space"),
        ("  roof: {", "  roof {", 19, "a colon is missing in or before this line"),
        ("name: example", "name:example", 2, "a colon is missing in or before this line"),
    ],
)
def test_a_slip_of_yaml_has_its_own_line(tmp_path: Path, old: str, new: str, line: int, said: str) -> None:
    assert any(GOOD.splitlines()[near - 1].startswith(old) for near in (line - 1, line))
    path = tmp_path / "bad.yaml"
    path.write_text(GOOD.replace(old, new, 1), encoding="utf-8")
    (message,) = messages(path)
    assert message.startswith(f"FILE:{line}: not valid YAML: {said}")
