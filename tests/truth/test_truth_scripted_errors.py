"""What is said of scripts that cannot be meant."""

from pathlib import Path

import pytest

from trackbench.base.errors import InputError
from trackbench.scenario import load_scenario
from trackbench.scenario.docs import OTHER_EXAMPLES

TEXT = """\
name: example
truth:
  source: scripted
  duration_s: 20
  rate_hz: 20
  objects:
    a:
      start: {speed_mps: 5}
      pieces:
        - {for_s: 5}
        - {for_s: 5, white: {motion: cv, acceleration_sigma_mps2: 3}}
        - {turn_rate_degps: 20}
sensors:
  roof: {type: lidar, rate_hz: 10, position_sigma_m: 0.15}
trackers:
  mine: {use: raw}
"""


START, PIECES = "truth.objects.a.start", "truth.objects.a.pieces"
LAST = "{turn_rate_degps: 20}"


@pytest.mark.parametrize(
    ("old", "new", "line", "message"),
    [
        (
            "  source: scripted\n",
            "",
            2,
            "truth.source: missing; choose from: highway-env, recorded-boxes, recorded-traffic, recording, scripted",
        ),
        (
            "rate_hz: 20\n",
            "rate_hz: 20\n  env: a\n",
            6,
            "truth.env: unknown key; choose from: ",
        ),
        ("{speed_mps: 5}", "{speed_mps: 5, vx_mps: 1}", 8, f"{START}: the velocity is given twice"),
        ("{speed_mps: 5}", "{speed_mps: -5}", 8, f"{START}.speed_mps: -5 is not possible: it must be at least 0"),
        ("- {for_s: 5}", "- {}", 10, f"{PIECES}.0.for_s: missing; only the last piece may leave it out"),
        (
            "for_s: 5}",
            "for_s: 5.02}",
            10,
            f"{PIECES}.0.for_s: must be a multiple of the truth step, which is 0.05 s; use 5",
        ),
        ("for_s: 5}", "for_s: 15}", 12, f"{PIECES}.2: pieces last 20 s, but truth.duration_s is 20"),
        (
            LAST,
            "{for_s: 8}",
            12,
            f"{PIECES}.2.for_s: pieces last 18 s, but truth.duration_s is 20",
        ),
        (LAST, "{speed_mps: 2}", 12, f"{PIECES}.2.speed_mps: a piece has one kind of motion"),
        (LAST, "{waypoints: [[0, 1]], turn_rate_degps: 2}", 12, f"{PIECES}.2.turn_rate_degps: a piece has one kind"),
        (LAST, "{waypoints: [[0]]}", 12, f"{PIECES}.2.waypoints.0: at least 2 entries are needed, not 1"),
        (LAST, "{waypoints: []}", 12, f"{PIECES}.2.waypoints: must not be empty"),
        (
            "acceleration_sigma_mps2",
            "jerk_sigma_mps3",
            11,
            f"{PIECES}.1.white.jerk_sigma_mps3: motion cv does not use this; it uses acceleration_sigma_mps2",
        ),
        (
            "{for_s: 5, white",
            "{for_s: 5, white_acceleration: {x_sigma_mps2: 1}, white",
            11,
            f"{PIECES}.1.white_acceleration: a piece has one kind of motion",
        ),
    ],
)
def test_mistakes(tmp_path: Path, old: str, new: str, line: int, message: str) -> None:
    path = tmp_path / "scenario.yaml"
    path.write_text(TEXT)
    load_scenario(path)
    assert old in TEXT
    path.write_text(TEXT.replace(old, new, 1))
    with pytest.raises(InputError) as caught:
        load_scenario(path)
    assert f"{path}:{line}: {message}" in str(caught.value)


VEHICLE = "rate_hz: 20\n  observer: {start: {speed_mps: 5}, pieces: [{}]}\n"


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "start: ",
            "x: 1, start: ",
            "truth.observer.x: unknown key",
        ),
        ("pieces: [{}]", "vx_mps: 1", "truth.observer.vx_mps: unknown key; choose from: start"),
        ("{}", "{for_s: 9}", "truth.observer.pieces.0.for_s: pieces last 9 s, but truth.duration_s is 20"),
        ("{}", "{white: {motion: cv, acceleration_sigma_mps2: 3}}", "truth.observer.pieces.0: the observer drives"),
        ("{}", "{until_stop: true}", "truth.observer.pieces.0.until_stop: only used with a negative acceleration_mps2"),
    ],
)
def test_mistakes_of_an_observer_that_drives(tmp_path: Path, old: str, new: str, message: str) -> None:
    path = tmp_path / "scenario.yaml"
    path.write_text(TEXT.replace("rate_hz: 20\n", VEHICLE, 1))
    load_scenario(path)
    assert old in VEHICLE
    path.write_text(TEXT.replace("rate_hz: 20\n", VEHICLE.replace(old, new, 1), 1))
    with pytest.raises(InputError) as caught:
        load_scenario(path)
    assert f"{path}:6: {message}" in str(caught.value)


def test_the_example_of_the_page_is_valid(tmp_path: Path) -> None:
    path = tmp_path / "scenario.yaml"
    rest = TEXT[TEXT.index("sensors:") :]
    path.write_text(f"name: page\n{OTHER_EXAMPLES['ScriptedTruth']}{rest}")
    assert list(load_scenario(path).config.truth.objects) == ["cyclist", "bollard"]
