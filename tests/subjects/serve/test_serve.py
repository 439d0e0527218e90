"""The Udacity server as a process, with real clients."""

from __future__ import annotations

import http.client
import json
import re
import select
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager
from itertools import zip_longest
from pathlib import Path

import numpy as np
import pytest
from tests.support.places import ROOT
from tests.support.udacity import recorded_lines, synthetic_lines, telemetry, write_scenario
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect

import trackbench as tb

COMMAND = [sys.executable, "-c", "from trackbench.cli import main; main()", "serve", "udacity"]
MANUAL = '42["manual",{}]'
SECONDS = 30
LINES = synthetic_lines()
#: The course's limits of the RMSE of px, py, vx, vy.
RUBRIC = {"ekf": [0.11, 0.11, 0.52, 0.52], "ukf": [0.09, 0.10, 0.40, 0.30]}


class Server:
    """A server process and the port at which it listens."""

    def __init__(self, scenario: Path, tracker: str, log: Path, *options: str) -> None:
        self._log = log
        with log.open("w") as err:
            command = [*COMMAND, "--port", "0", "--tracker", f"{scenario}#{tracker}", *options]
            self.process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=err, text=True)
        assert self.process.stdout is not None
        assert select.select([self.process.stdout], [], [], SECONDS)[0], "the server does not start"
        found = re.search(r" listens at ws://127\.0\.0\.1:(\d+);", self.process.stdout.readline())
        assert found, log.read_text()
        self.port = int(found[1])

    @contextmanager
    def client(self) -> Iterator[ClientConnection]:
        # As the simulator does.
        address = f"ws://127.0.0.1:{self.port}/socket.io/?EIO=4&transport=websocket"
        with connect(address, compression=None, open_timeout=SECONDS, close_timeout=SECONDS) as client:
            yield client

    def end(self, number: signal.Signals = signal.SIGTERM) -> int:
        self.process.send_signal(number)
        return self.process.wait(SECONDS)

    def __enter__(self) -> Server:
        return self

    def __exit__(self, *_: object) -> None:
        self.process.kill()
        self.process.wait()
        self.process.stdout.close()

    def log(self) -> str:
        return self._log.read_text()


@pytest.fixture(scope="module")
def scenario(tmp_path_factory):
    return write_scenario(tmp_path_factory.mktemp("serve"))


@pytest.fixture(scope="module")
def server(scenario, tmp_path_factory):
    """A server of each tracker, kept as long as the module runs."""
    started: dict[str, Server] = {}
    with ExitStack() as stack:

        def get(tracker: str) -> Server:
            if tracker not in started:
                log = tmp_path_factory.mktemp("log") / f"{tracker}.log"
                started[tracker] = stack.enter_context(Server(scenario, tracker, log))
            return started[tracker]

        yield get
        for each in started.values():
            assert each.end() == 0


def ask(client: ClientConnection, frame: str | bytes) -> str:
    client.send(frame)
    answer = client.recv(timeout=SECONDS)
    assert isinstance(answer, str)
    return answer


def replay(client: ClientConnection, lines: Sequence[str]) -> list[str]:
    return [ask(client, telemetry(line)) for line in lines]


def rmse_of(answer: str) -> list[float]:
    marker = json.loads(answer.removeprefix("42"))[1]
    return [marker[f"rmse_{name}"] for name in ("x", "y", "vx", "vy")]


def rmse_of_a_run(folder: Path, name: str, lines: Sequence[str]) -> list[float]:
    """What a run of the scenario finds on the same lines, over the estimates that the tracker gave."""
    file = write_scenario(folder)
    (folder / "lines.txt").write_text("\n".join(lines))
    tracker = tb.run(tb.load(file, {"score.settle_s": 0}, trackers=[name]))[name]
    metrics = [tracker.metrics[f"rmse.{component}"] for component in ("px", "py", "vx", "vy")]
    return [metric.value if metric.without_charged is None else metric.without_charged for metric in metrics]


@pytest.mark.parametrize("name", RUBRIC)
def test_a_replay_gives_the_rmse_of_a_run(name, server, tmp_path):
    with server(name).client() as client:
        answers = replay(client, LINES)
    np.testing.assert_allclose(rmse_of(answers[-1]), rmse_of_a_run(tmp_path, name, LINES), rtol=0, atol=1e-9)


def test_clients_do_not_mix(server):
    other = synthetic_lines(count=60, seed=8)
    with server("ekf").client() as one, server("ekf").client() as two:
        alone = replay(one, LINES), replay(two, other)
    with server("ekf").client() as one, server("ekf").client() as two:
        together: tuple[list[str], list[str]] = [], []
        for a, b in zip_longest(LINES, other):
            together[0].extend(replay(one, [a]))
            together[1].extend(replay(two, [b] if b is not None else []))
    assert together == alone


def test_what_is_no_websocket_harms_nobody(server):
    served = server("ekf")
    with closing(http.client.HTTPConnection("127.0.0.1", served.port, timeout=SECONDS)) as browser:
        browser.request("GET", "/")
        assert browser.getresponse().status == 426
    with socket.create_connection(("127.0.0.1", served.port), SECONDS) as raw:
        raw.sendall(b"\x00\x01 garbage\r\n\r\n")
        raw.recv(1000)
    with served.client() as client:
        assert ask(client, telemetry(LINES[0])) != MANUAL
    assert "Traceback" not in served.log()


@pytest.mark.parametrize(
    ("name", "cause"),
    [("raising", "ValueError: no third measurement, please"), ("vanishing", "the estimate is not finite")],
)
def test_a_tracker_that_fails_ends_its_session_alone(name, cause, server):
    served = server(name)
    with served.client() as other:
        replay(other, LINES[:2])
        with served.client() as client:
            assert replay(client, LINES[:3])[2] == MANUAL
            with pytest.raises(ConnectionClosed) as closed:
                client.recv(timeout=SECONDS)
        assert closed.value.rcvd is not None
        assert closed.value.rcvd.code == 1011
        assert closed.value.rcvd.reason.startswith(f"tracker {name} failed at measurement 3: {cause}")
        assert served.log().count(closed.value.rcvd.reason) == 1
        assert ask(other, '42["telemetry",{}]') == MANUAL
    with served.client() as client:
        assert replay(client, LINES[:2]) != [MANUAL, MANUAL]


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_ends_it_with_a_goodbye(number, scenario, tmp_path):
    with Server(scenario, "ekf", tmp_path / "log") as served:
        with served.client() as client, socket.create_connection(("127.0.0.1", served.port)):
            replay(client, LINES[:10])
            served.process.send_signal(number)
            with pytest.raises(ConnectionClosed) as closed:
                client.recv(timeout=SECONDS)
            assert closed.value.rcvd is not None
            assert closed.value.rcvd.code == 1001
            # Although a connection that never said a word is still open.
            assert served.process.wait(SECONDS) == 0
        assert "Traceback" not in served.log()
        with pytest.raises(OSError, match="refused"):
            socket.create_connection(("127.0.0.1", served.port), SECONDS)


def test_the_page_shows_what_happens(tmp_path):
    page = (ROOT / "docs/projects/udacity-simulator.md").read_text()
    scenario, tracker = re.search(r"\$ trackbench serve udacity --port 4567 --tracker (\S+)#(\S+)\n", page).groups()
    lines = recorded_lines() or LINES
    file = tmp_path / "lines.txt"
    file.write_text("\n".join(lines))
    with Server(ROOT / scenario, tracker, tmp_path / "log") as served:
        example = [sys.executable, ROOT / "docs/examples/replay_udacity.py", file, str(served.port)]
        done = subprocess.run(example, capture_output=True, text=True, timeout=SECONDS, check=True)
        assert served.end() == 0
    logged = re.search(r"client 1: (\d+) measurements, .*RMSE ([\d.]+) .*", served.log())
    assert logged
    assert int(logged[1]) == len(lines)
    assert rmse_of(done.stdout)[0] == pytest.approx(float(logged[2]), abs=1e-4)
    if lines is not LINES:
        assert logged[0] in page


@pytest.fixture
def fails(cli):
    """Serves what cannot be served, and returns what is said of it."""

    def call(*options: str) -> str:
        done = cli("serve", "udacity", *options)
        assert (done.status, done.out) == (2, "")
        return done.err

    return call


def test_a_port_in_use(server, scenario, fails):
    port = str(server("ekf").port)
    message = fails("--port", port, "--tracker", f"{scenario}#ekf")
    assert message.startswith(f"--port: cannot listen at 127.0.0.1, port {port}: ")
    assert "in use" in message


def test_what_cannot_be_served_is_said_in_one_line(scenario, fails):
    assert fails("--tracker", f"{scenario}#eff").endswith("no tracker 'eff' in this scenario; did you mean 'ekf'?\n")
    assert fails("--tracker", str(scenario)) == f"--tracker: write SCENARIO#NAME, not '{scenario}'\n"
    assert f"there is no such file; did you mean '{scenario.parent}/cyclist.yaml'?" in fails(
        "--tracker", f"{scenario.parent}/cyclis.yaml#ekf"
    )
    assert "cannot listen at 203.0.113.1" in fails("--tracker", f"{scenario}#ekf", "--host", "203.0.113.1")
    assert "--host: is empty" in fails("--tracker", f"{scenario}#ekf", "--host", "")
