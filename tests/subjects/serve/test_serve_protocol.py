"""What a client of the Udacity server is answered, without a network."""

from __future__ import annotations

import json
import logging
import math
import sys

import numpy as np
import pytest
from tests.support.places import ROOT
from tests.support.udacity import synthetic_lines, telemetry, write_scenario

from trackbench.base.errors import InputError
from trackbench.scenario import load_scenario
from trackbench.subjects.serve.protocol import (
    MANUAL,
    estimate_marker,
    parse,
)
from trackbench.subjects.serve.session import Client, TrackerError, load_served
from trackbench.truth.recorded.udacity import Measurement

LINE = "L\t3.122427e-01\t5.803398e-01\t1477010443000000\t6e-01\t6e-01\t5.199937e+00\t0"
LINES = synthetic_lines()


@pytest.fixture
def scenario(tmp_path, monkeypatch):
    monkeypatch.delitem(sys.modules, "serve_faults", raising=False)
    return load_scenario(write_scenario(tmp_path))


@pytest.fixture
def client(scenario):
    return lambda name: Client(load_served(scenario, name), "client 1")


def fields(answer: str) -> dict[str, float]:
    assert answer.startswith('42["estimate_marker",{')
    return json.loads(answer[2:])[1]


def test_the_frame_that_the_simulator_sends():
    # The simulator writes a tab as the two characters that are its escape in JSON.
    frame = '42["telemetry",{"sensor_measurement":"' + LINE.replace("\t", "\\t") + '"}]'
    said = parse(frame)
    assert isinstance(said, Measurement)
    assert said.kind == "lidar"
    assert said.measurement == (0.3122427, 0.5803398)
    assert said.stamp == 1477010443000000
    assert said.truth == (0.6, 0.6, 5.199937, 0.0)


@pytest.mark.parametrize("event", ['["telemetry",null]', '["telemetry",{}]', '["telemetry"]', '["telemetry", null, 1]'])
def test_an_event_without_data(event):
    assert parse("42" + event) == MANUAL


@pytest.mark.parametrize("frame", ['0{"sid":"x"}', "1", "2", "2probe", "40", "41", "", "hello", b"\x00\xff"])
def test_what_belongs_to_the_transport_needs_no_answer(frame, client):
    assert parse(frame) is None
    assert client("ekf").answer(frame) is None


BAD = {
    "no JSON": ("42", "an event is"),
    "deep": ("42" + "[" * 60000, "an event is"),
    "no name": ("42[]", "an event is"),
    "another event": ('42["steer",{"angle":1}]', "an event is"),
    "a list of data": ('42["telemetry",[1]]', "an event is"),
    "a number as line": ('42["telemetry",{"sensor_measurement":1}]', "an event is"),
    "an empty line": (telemetry(""), "begins with L"),
    "NaN": (telemetry(LINE.replace("3.122427e-01", "nan")), "px is not a finite number"),
    "a missing column": (
        telemetry("\t".join(LINE.split("\t")[:-1])),
        "6 columns after its letter",
    ),
    "a time stamp with decimals": (telemetry(LINE.replace("1477010443000000", "0.05")), "whole number"),
}


@pytest.mark.parametrize(("frame", "message"), BAD.values(), ids=BAD)
def test_a_bad_frame_is_answered_and_logged_in_one_line(frame, message, client, caplog):
    with pytest.raises(InputError, match=message):
        parse(frame)
    asked = client("ekf")
    with caplog.at_level(logging.INFO):
        assert asked.answer(frame) == MANUAL
    (record,) = caplog.records
    assert record.levelno == logging.WARNING
    assert "\n" not in record.getMessage()
    assert len(record.getMessage()) < 300
    assert asked.answer(telemetry(LINE)) != MANUAL


def test_the_frame_that_the_simulator_reads():
    assert estimate_marker(np.array([0.5, 1, 0, 0]), np.array([0.25, 2e-5, 3, 4])) == (
        '42["estimate_marker",{"estimate_x":0.5,"estimate_y":1.0,"rmse_x":0.25,"rmse_y":2e-05,"rmse_vx":3.0,"rmse_vy":4.0}]'
    )


@pytest.mark.parametrize("name", ["ekf", "ukf"])
def test_the_running_rmse_is_that_of_the_marks_so_far(name, client):
    asked = client(name)
    squares = []
    for line in LINES:
        answer = asked.answer(telemetry(line))
        if answer == MANUAL:
            assert not squares
            continue
        marker, truth = fields(answer), parse(telemetry(line)).truth
        squares.append([(marker["estimate_x"] - truth[0]) ** 2, (marker["estimate_y"] - truth[1]) ** 2])
        rmse = [marker["rmse_x"], marker["rmse_y"]]
        np.testing.assert_allclose(rmse, np.sqrt(np.mean(squares, axis=0)), rtol=1e-12)
    # Where a track starts from two measurements, the first of them has no estimate.
    assert len(squares) == len(LINES) - (name == "ukf")


def test_time_going_backwards_starts_afresh(client, caplog):
    asked = client("ekf")
    first = [asked.answer(telemetry(line)) for line in LINES]
    with caplog.at_level(logging.INFO):
        assert [asked.answer(telemetry(line)) for line in LINES] == first
    assert [record.getMessage().partition(": ")[2] for record in caplog.records][
        1
    ] == "time goes backwards: starts afresh"


def test_a_line_that_is_sent_twice_counts_once(client):
    once, twice = client("ekf"), client("ekf")
    for line in LINES:
        answer = once.answer(telemetry(line))
        assert [twice.answer(telemetry(line)), twice.answer(telemetry(line))] == [answer, answer]


def test_what_the_tracker_does_not_read_only_tells_the_time(client):
    lidar, whole = client("ekf_lidar"), client("ekf")
    moved = [line if line[0] == "L" else "R\t99\t" + line.split("\t", 2)[2] for line in LINES]
    answers = [lidar.answer(telemetry(line)) for line in LINES]
    assert [lidar.answer(telemetry(line)) for line in moved] == answers
    assert len(set(answers)) == len(LINES)
    assert answers[-1] != [whole.answer(telemetry(line)) for line in LINES][-1]


def test_a_sensor_that_the_scenario_lacks_is_passed_over(tmp_path):
    file = write_scenario(tmp_path)
    text = [line for line in file.read_text().splitlines() if not line.startswith("  radar:")]
    file.write_text("\n".join(text))
    asked = Client(load_served(load_scenario(file), "ekf"), "client 1")
    answers = [asked.answer(telemetry(line)) for line in LINES]
    assert [answer == MANUAL for answer in answers] == [line[0] == "R" for line in LINES]


def test_an_azimuth_beyond_a_half_turn_is_the_same_direction(client):
    """The recording reaches 3.19 rad."""
    column = next(line for line in LINES if line[0] == "R").split("\t")
    column[2] = repr(float(column[2]) + 2 * math.pi)
    turned = [LINES[0], "\t".join(column), *LINES[2:]]
    plain, other = client("ekf"), client("ekf")
    a = [fields(plain.answer(telemetry(line))) for line in LINES]
    b = [fields(other.answer(telemetry(line))) for line in turned]
    np.testing.assert_allclose([list(x.values()) for x in a], [list(x.values()) for x in b], rtol=1e-9)


def test_an_absurd_time_ends_the_session_and_not_more(client):
    asked = client("ukf")
    for line in LINES:
        asked.answer(telemetry(line))
    late = LINES[0].split("\t")
    late[3] = "9" * 16
    for stamp in ("9" * 16, "1" + "0" * 15):
        late[3] = stamp
        try:
            answer = asked.answer(telemetry("\t".join(late)))
        except TrackerError:
            continue
        assert answer == MANUAL or all(math.isfinite(value) for value in fields(answer).values())


def test_a_tracker_that_starts_from_the_truth_cannot_be_served(scenario):
    with pytest.raises(InputError, match=r"cyclist\.yaml:\d+: trackers\.cheat: starts from the truth"):
        load_served(scenario, "cheat")


def test_two_lidars_are_one_too_many():
    loaded = load_scenario(
        ROOT / "scenarios/scripted/figure_eight.yaml",
        ["sensors.roof={type: lidar, rate_hz: 10, position_sigma_m: 1}"],
    )
    with pytest.raises(InputError, match=r"sensors\.roof: a second lidar beside lidar"):
        load_served(loaded, "ekf")
