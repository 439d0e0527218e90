"""A class of Python is served by a program that speaks the protocol of docs/any-language.md over its pipes."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import msgpack
import numpy as np
import pytest

from trackbench.base.types import Scan
from trackbench.driving.frames import LENGTH, message_answer, message_frame, scan_frames
from trackbench.results import Result

CODE = """\
import sys
import numpy as np

class Counts:
    def __init__(self, first=0):
        self.first = first

    def step(self, state, scan):
        sys.stdout.reconfigure(encoding="utf-8")
        number = self.first if state is None else state + 1
        print("step", number)
        if number == 3:
            raise ValueError("three")
        return number, (np.full(4, float(number)), np.eye(4))

class Holds(Counts):
    def step(self, state, scan):
        self.numbers = (number for number in range(3))
        return super().step(state, scan)
"""
#: Another name of this interpreter: a program that is not the fork server's own.
PYTHON = str(Path(sys.executable).with_name("python3"))
HELLO = {"type": "hello", "version": 1, "identities": "known", "batch": 2, "sensors": [], "options": {"first": 1}}
SCAN = Scan(0.0, "roof", "lidar", np.ones(2), np.array(True), np.eye(2), np.zeros(3), np.zeros(2), 0.0)


class Host:
    """A host that is asked by hand."""

    def __init__(self, folder: Path, reference: str) -> None:
        pipes: dict[str, Any] = dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.PIPE)
        command = [PYTHON, "-m", "trackbench.driving.host", reference]
        self.process = subprocess.Popen(command, cwd=folder, **pipes)

    def send(self, **message: Any) -> None:
        self.write(message_frame(message))

    def write(self, frame: bytes) -> None:
        assert self.process.stdin is not None
        self.process.stdin.write(frame)
        self.process.stdin.flush()

    def receive(self) -> dict[str, Any]:
        assert self.process.stdout is not None
        (size,) = LENGTH.unpack(self.process.stdout.read(LENGTH.size))
        message: dict[str, Any] = msgpack.unpackb(self.process.stdout.read(size))
        return message

    def step(self, number: int) -> dict[str, Any]:
        self.write(*scan_frames([number], [SCAN]))
        return self.receive()


def mean_of(answer: dict[str, Any]) -> Any:
    mean, _ = message_answer(answer, several=False)  # type: ignore[misc]
    return mean


@pytest.fixture
def host(tmp_path: Path) -> Iterator[Callable[[str], Host]]:
    hosts: list[Host] = []

    def start(name: str) -> Host:
        (tmp_path / "counting.py").write_text(CODE)
        hosts.append(Host(tmp_path, f"counting:{name}"))
        return hosts[-1]

    yield start
    for each in hosts:
        each.process.kill()
        each.process.communicate()


def test_it_answers_as_the_page_says(host: Callable[[str], Host]) -> None:
    own = host("Counts")
    own.send(**HELLO)
    about = own.receive()
    assert (about["type"], about["version"], about["batched"], about["copies"]) == ("hello", 1, False, True)
    own.send(type="start", id=7)
    first = own.step(7)
    assert (first["type"], first["id"]) == ("estimate", 7)
    np.testing.assert_array_equal(mean_of(first), np.ones(4))
    own.send(type="copy", id=8, of=7)
    assert own.receive() == {"type": "done"}
    second, failed = own.step(7), own.step(7)
    np.testing.assert_array_equal(mean_of(second), np.full(4, 2.0))
    assert (failed["type"], failed["message"], failed["kind"]) == ("error", "ValueError: three", "raised")
    assert failed["place"].endswith("counting.py:13, in step")
    np.testing.assert_array_equal(mean_of(own.step(8)), mean_of(second))
    own.send(type="end", id=8)
    out, err = own.process.communicate()
    assert (out, own.process.returncode) == (b"", 0)
    assert err.decode().split() == [word for number in (1, 2, 3, 2) for word in ("step", str(number))]


def test_it_says_what_cannot_be_copied(host: Callable[[str], Host]) -> None:
    own = host("Holds")
    own.send(**HELLO)
    own.receive()
    own.send(type="start", id=1)
    own.step(1)
    own.send(type="copy", id=2, of=1)
    refused = own.receive()
    assert refused["type"] == "error"
    assert refused["message"].startswith("TypeError: cannot pickle 'generator' object")


def test_it_says_which_option_is_wrong(host: Callable[[str], Host]) -> None:
    own = host("Counts")
    own.send(**HELLO | {"options": {"frist": 1}})
    refused = own.receive()
    assert refused["type"] == "error"
    assert "'frist' (it takes: first)" in refused["input"][0][0]


def test_a_scenario_may_name_it_as_a_program(
    run_tiny: Callable[..., Result], tmp_path: Path, write_module: Any
) -> None:
    code = (
        "import numpy as np\nclass T:\n    def step(self, state, scan):\n        n = (state or 0) + 1\n"
        "        return n, (np.array([n / 3, 1, 0, 0]), np.eye(4) * n)\n"
    )
    module = write_module(tmp_path, code)
    command = f"[{PYTHON}, -m, trackbench.driving.host, '{module}:T']"
    settings = [f"trackers.one.use={module}:T", f"trackers.other.use={{command: {command}}}"]
    result = run_tiny(*settings, folder=tmp_path)
    assert result["other"].failed is None
    one, other = (result[name].metrics["position_rmse"].value for name in ("one", "other"))
    assert one == other is not None
