"""A tracker in another language: what the bench tells a program, and what becomes of one that goes wrong."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from trackbench.base.errors import InputError
from trackbench.base.types import Scan
from trackbench.driving.faults import TrackFault
from trackbench.driving.isolation import Isolation
from trackbench.driving.program import Program
from trackbench.driving.start import check_startable, start_stepper
from trackbench.driving.steppers import ForeignTracker
from trackbench.models.sensors import Lidar
from trackbench.runner.run import run_scenario
from trackbench.scenario import load_scenario
from trackbench.scenario.truth import truths_of
from trackbench.trackers.config import PluginConfig

HEAD = f"""#!{sys.executable}
import os, struct, sys, time
import msgpack, numpy as np

def array(value):
    return np.frombuffer(value[1], "<f8").reshape(value[0])

def packed(value):
    value = np.asarray(value, float)
    return [value.shape, value.tobytes()]

def write(content):
    sys.stdout.buffer.write(content)
    sys.stdout.buffer.flush()

def send(**message):
    content = msgpack.packb(message)
    write(struct.pack("<I", len(content)) + content)

def usual(message):
    return dict(type="estimate", id=message["id"], mean=packed(np.arange(4)), covariance=packed(np.eye(4)))

def answer(message):
    send(**usual(message))

ABOUT, scans, seen = dict(type="hello", version=1), 0, []
"""
LOOP = """
while head := sys.stdin.buffer.read(4):
    message = msgpack.unpackb(sys.stdin.buffer.read(*struct.unpack("<I", head)))
    seen.append(message)
    if message["type"] == "hello":
        send(**ABOUT)
    elif message["type"] == "scan":
        scans += 1
        answer(message)
"""


ANSWER = "def answer(message):\n    "


def scan_of(batch: int, time: float = 0.0, valid: Any = True) -> Scan:
    there = np.broadcast_to(valid, (batch,))
    measurement = np.where(there, np.arange(2.0 * batch).reshape(2, batch), np.nan)
    return Scan(time, "roof", "lidar", measurement, there, np.eye(2), np.arange(3.0), np.zeros(2), time)


Launch = Callable[..., ForeignTracker]


@pytest.fixture
def launch(tmp_path: Path) -> Iterator[Launch]:
    """Start a stepper of the program whose main part is given."""
    started: list[ForeignTracker] = []

    def launch(body: str, batch: int = 1, several: bool = False, **changes: Any) -> ForeignTracker:
        (tmp_path / "program").write_text(HEAD + body + LOOP)
        (tmp_path / "program").chmod(0o755)
        isolation = Isolation(timeout=changes.pop("timeout", 20.0))
        config = PluginConfig.model_validate(
            {"use": {"command": ["./program", *changes.pop("arguments", ())]}, **changes}
        )
        sensors = {"roof": Lidar(rate_hz=10, position_sigma_m=0.5)}
        started.append(start_stepper(config, tmp_path, batch, lambda tracker: tracker, isolation, several, sensors))
        return started[-1]

    yield launch
    for stepper in started:
        stepper.close()


def test_it_is_told_the_sensors_the_options_and_its_arguments(launch: Launch, tmp_path: Path) -> None:
    body = ANSWER + "scans == 1 and open('seen', 'w').write(repr((sys.argv[1:], seen))); send(**usual(message))"
    launch(body, batch=3, options={"q": 2.5, "deep": {"a": [1, None]}}, arguments=["--q", "2"]).step(None, scan_of(3))
    arguments, (hello, *starts, scan) = eval((tmp_path / "seen").read_text())
    assert arguments == ["--q", "2"]
    noise = [[2, 2], np.array([[0.25, 0], [0, 0.25]]).tobytes()]
    roof = {"name": "roof", "kind": "lidar", "components": ["x", "y"], "noise_covariance": noise}
    told = {"batch": 3, "sensors": [roof], "options": {"q": 2.5, "deep": {"a": [1, None]}}}
    assert hello == {"type": "hello", "version": 1, "identities": "known", **told}
    assert starts == [{"type": "start", "id": number} for number in (1, 2, 3)]
    assert scan["id"] == 1
    of_hidden = {"detection_probability", "clutter_density", "field_of_view", "half_range_m"}
    assert set(scan) == {*Scan._fields, "type", "id"} - of_hidden
    assert scan["measurement"] == [[2], np.array([0.0, 3.0]).tobytes()]
    assert scan["valid"] == [[], np.array(1.0).tobytes()]


def test_each_member_is_a_tracker_from_its_first_measurement_on(launch: Launch) -> None:
    body = ANSWER + "send(**usual(message) | {'mean': packed([message['id'], *array(message['measurement']), 0])})"
    stepper = launch(body, batch=3)
    assert stepper.step(None, scan_of(3, valid=False))[1] is None
    first = stepper.step(None, scan_of(3, valid=[True, False, True]))[1]
    np.testing.assert_array_equal(first.mean[0], [1, np.nan, 3])
    second = stepper.step(None, scan_of(3, 0.1))[1]
    np.testing.assert_array_equal(second.mean, [[1, 2, 3], [0, 1, 2], [3, 4, 5], [0, 0, 0]])
    np.testing.assert_array_equal(second.covariance, np.eye(4)[:, :, None] * np.ones(3))


def test_one_that_takes_batches_gets_them(launch: Launch) -> None:
    body = """
ABOUT["batched"] = True
def answer(message):
    z = array(message["measurement"])
    n = z.shape[1]
    P = np.eye(4)[..., None] * np.ones(n)
    send(**usual(message) | {"mean": packed(np.vstack([z, z])), "covariance": packed(P)})
"""
    for batch in (1, 5000):
        stepper = launch(body, batch=batch)
        assert stepper.batched
        scan = scan_of(batch)
        estimate = stepper.step(None, scan)[1]
        np.testing.assert_array_equal(estimate.mean, np.vstack([scan.measurement] * 2))
        assert estimate.covariance.shape == (4, 4, batch)


def test_it_may_say_more_than_an_estimate(launch: Launch) -> None:
    body = """
def answer(message):
    if scans <= 2:
        return send(type="none", id=message["id"])
    more = {"innovation": packed([1, 2]), "innovation_covariance": packed(np.eye(2)), "repaired": packed(1)}
    send(**usual(message), **more, colour="red")
"""
    stepper = launch(body, batch=2)
    assert stepper.step(None, scan_of(2))[1] is None
    estimate = stepper.step(None, scan_of(2))[1]
    np.testing.assert_array_equal(estimate.innovation, [[1, 1], [2, 2]])
    assert estimate.repaired.all()


TRACKS = """
def answer(message):
    k = array(message["valid"]).size
    P, there = packed(np.eye(4)[..., None] * np.ones(k)), packed(np.ones(k))
    mean = packed(np.ones((4, k)))
    ids, used = packed(np.arange(k) + 10 * message["id"]), packed(np.arange(k))
    send(type="tracks", id=message["id"], ids=ids, used=used, existence=there, mean=mean, covariance=P)
"""


def hidden_scan() -> Scan:
    valid = np.array([[True, True], [True, False]])
    measurement = np.where(valid, np.ones((2, 2, 2)), np.nan)
    return scan_of(1)._replace(measurement=measurement, valid=valid, detection_probability=0.9, clutter_density=1e-4)


def test_one_of_several_objects_gives_tracks(launch: Launch) -> None:
    tracks = launch(TRACKS, batch=2, several=True).step(None, hidden_scan())[1]
    np.testing.assert_array_equal(tracks.ids, [[10, 20], [11, -1]])
    np.testing.assert_array_equal(tracks.used, [[0, 0], [1, -1]])


def test_a_track_below_0_is_no_padding(launch: Launch) -> None:
    with pytest.raises(TrackFault, match="an id is -1; ids count from 0"):
        launch(TRACKS.replace("10 * message", "-1 * message"), batch=2, several=True).step(None, hidden_scan())


#: What it does, and what is said of it.
FAULTS = {
    "prints": (
        "print('starting up')\nsys.stdout.flush()",
        r"its output is no message: it begins with 'starting up\\n.*; what a program prints belongs on standard",
    ),
    "prints a little": (ANSWER + "print('ok', flush=True); send(**usual(message))", "it begins with 'ok\\\\n"),
    "leaves": ("sys.stderr.write('no licence\\n'); sys.exit(3)", "with status 3$"),
    "crashes": (ANSWER + "os.kill(os.getpid(), 11)", r"was killed by signal 11 \(SIGSEGV\)$"),
    "closes its output": (ANSWER + "os.close(1); os.close(0); os.abort()", r"signal 6 \(SIGABRT\)"),
    "is silent": (ANSWER + "sys.stderr.write('thinking\\n'); sys.stderr.flush(); time.sleep(60)",
                  r"no answer within 2 s \(see --tracker-timeout\)$"),
    "stops in a frame": (ANSWER + "write(b'\\x10\\0\\0\\0\\x81'); time.sleep(60)", "no answer within 2 s"),
    "says why": (ANSWER + "send(type='error', message='no such sensor')", "^./program: no such sensor$"),
    "another version": ("ABOUT['version'] = 2", "it speaks version 2 of the protocol, and this trackbench 1"),
    "no version": ("del ABOUT['version']", "hello with a version is needed"),
    "no map": (ANSWER + "write(b'\\2\\0\\0\\0\\x91\\1')", "is no message"),
    "another id": (ANSWER + "send(**usual(message) | {'id': 9})", "answered a scan of tracker 1 with 'estimate' of 9"),
    "another type": (ANSWER + "send(type='estimat', id=1)", "answered a scan of tracker 1 with 'estimat' of 1"),
    "too long": (ANSWER + "write(struct.pack('<I', 1 << 31) + b'\\x81')", "is no message"),
    "too few numbers": (ANSWER + "send(**usual(message) | {'mean': [[4], bytes(24)]})", "mean has 24 bytes"),
    "another shape": (ANSWER + "send(**usual(message) | {'mean': packed(np.ones(3))})", r"mean has the shape \(3,\)"),
    "nan": (ANSWER + "send(**usual(message) | {'mean': packed([1, 2, 3, np.nan])})", "the estimate is not finite"),
    "not symmetric": (ANSWER + "send(**usual(message) | {'covariance': packed(np.tri(4))})", "not symmetric"),
    "gives up": (ANSWER + "send(**usual(message) if scans == 1 else dict(type='none', id=1))", "None after an"),
    "tracks": (ANSWER + "send(type='tracks', id=1)", "it gave tracks"),
}  # fmt: skip


@pytest.mark.parametrize("name", FAULTS)
def test_what_goes_wrong_is_one_clear_line(launch: Launch, name: str) -> None:
    body, said = FAULTS[name]

    def drive() -> None:
        stepper = launch(body, timeout=2.0)
        for number in range(3):
            stepper.step(None, scan_of(1, 0.1 * number))

    with pytest.raises(TrackFault, match=said) as caught:
        drive()
    assert "\n" not in str(caught.value)
    assert caught.value.member in (None, 0)


def test_the_member_that_fails_is_named(launch: Launch) -> None:
    stepper = launch(
        ANSWER + "send(**(usual(message) if message['id'] < 3 else {'type': 'error', 'message': 'no'}))", batch=4
    )
    with pytest.raises(TrackFault, match="no") as caught:
        stepper.step(None, scan_of(4))
    assert caught.value.member == 2


def test_more_than_a_pipe_holds_goes_either_way(launch: Launch) -> None:
    body = ANSWER + "send(**usual(message), padding=bytes(3000))"
    estimate = launch(body, batch=4000).step(None, scan_of(4000))[1]
    assert estimate.mean.shape == (4, 4000)


@pytest.mark.parametrize(
    ("instead", "said"),
    [
        ("os.close(1); time.sleep(60)", "its process closed the connection$"),
        ("[write(bytes(1 << 16)) for _ in iter(int, 1)]", "its output is no message"),
    ],
)
def test_one_that_does_not_read_is_ended_whatever_it_writes(launch: Launch, instead: str, said: str) -> None:
    with pytest.raises(TrackFault, match=said):
        launch(ANSWER + instead, batch=4000, timeout=2.0).step(None, scan_of(4000))


def test_its_environment_is_that_of_the_user(launch: Launch, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONPATH", "/users/own")
    body = ANSWER + "send(type='error', message=f\"{os.environ['PYTHONPATH']} {os.path.basename(sys.argv[0])}\")"
    with pytest.raises(TrackFault, match="/users/own program"):
        launch(body).step(None, scan_of(1))


@pytest.mark.parametrize(
    ("command", "said"),
    [
        (["./programm"], "there is no program 'programm' in .*; did you mean '.*/program'"),
        (["bin/program"], "there is no program 'program' in .*bin$"),
        (["./notes"], "notes is not executable: chmod"),
        (["program"], "there is no program 'program' on PATH: a path has a /, such as ./program"),
        (["no-such-program-at-all"], "on PATH: a path has a /"),
    ],
)
def test_a_program_that_is_not_there_is_said_before_a_run(tmp_path: Path, command: list[str], said: str) -> None:
    for name, mode in (("program", 0o755), ("notes", 0o644)):
        (tmp_path / name).write_text("")
        (tmp_path / name).chmod(mode)
    config = PluginConfig.model_validate({"use": {"command": command}})
    with pytest.raises(InputError, match=said):
        check_startable(config, tmp_path, Isolation(), started=False, several=False, sensors={})


def test_one_that_is_no_program_says_so(tmp_path: Path) -> None:
    (tmp_path / "program").write_text("no program")
    (tmp_path / "program").chmod(0o755)
    config = PluginConfig.model_validate({"use": {"command": ["./program"]}})
    with pytest.raises(TrackFault, match=r"^\./program: it cannot be started: .*xec format error"):
        Program(config, tmp_path, Isolation(), several=False)


def test_options_that_cannot_be_told_are_bad_input(launch: Launch) -> None:
    with pytest.raises(InputError, match="cannot be told these options"):
        launch("", options={"q": {1, 2}})


SCENARIO = """
name: again
truth:
  source: scripted
  duration_s: 3
  rate_hz: 10
  objects:
    car: {start: {x: 20, y: 5, speed_mps: 5, course_deg: 0}, pieces: [{}]}
sensors:
  lidar: {type: lidar, rate_hz: 10, position_sigma_m: 0.2}
trackers:
  mine: {use: {command: [./program]}}
monte_carlo: {runs: 6, seed: 1}
"""


@pytest.mark.parametrize("remembers", [False, True])
def test_what_it_remembers_of_trackers_before_is_found(tmp_path: Path, remembers: bool) -> None:
    shift = "0.001 * message['id']" if remembers else "0"
    body = f"""
def answer(message):
    x, y = array(message["measurement"])
    send(**usual(message) | {{"mean": packed([x + {shift}, y, 0, 0])}})
"""
    (tmp_path / "program").write_text(HEAD + body + LOOP)
    (tmp_path / "program").chmod(0o755)
    (tmp_path / "again.yaml").write_text(SCENARIO)
    loaded = load_scenario(tmp_path / "again.yaml")
    (mine,) = run_scenario(loaded, truths_of(loaded)).json()["trackers"]
    if not remembers:
        assert mine["failed"] is None
        return
    assert "asked again in a fresh process" in mine["failed"]["cause"]
    assert "the mean differs by up to 0.00" in mine["failed"]["cause"]
