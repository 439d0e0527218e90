"""The claim is the same however often the command is interrupted."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import time
from collections.abc import Callable
from itertools import cycle
from pathlib import Path
from typing import Any

import pytest
import yaml
from tests.subjects.envelope.conftest import SMALL, map_of, small

from trackbench.base.errors import OutputError
from trackbench.subjects.envelope.api import envelope_of
from trackbench.subjects.envelope.cells import Store
from trackbench.subjects.envelope.claim import CLAIM, PARTS, Envelope
from trackbench.subjects.envelope.files import looks_of
from trackbench.subjects.envelope.mapping import EnvelopeMap

Cli = Callable[..., Any]


def claim_of(made: EnvelopeMap) -> Envelope:
    return envelope_of(made, "trackbench envelope small.yaml")


@pytest.fixture(scope="module")
def stored(tmp_path_factory: pytest.TempPathFactory, small_envelope: Envelope) -> Path:
    """The looks of the small map."""
    folder = tmp_path_factory.mktemp("looks")
    store = Store(folder, "one")
    assert claim_of(map_of(small(), store=store)).claim == small_envelope.claim
    assert store.loaded_looks == 0
    return folder


@pytest.fixture
def looks(stored: Path, tmp_path: Path) -> Path:
    """A copy of them, which a test may change."""
    return shutil.copytree(stored, tmp_path / "looks")


def test_what_was_made_is_not_made_again(looks: Path, small_envelope: Envelope) -> None:
    count = len([*looks.iterdir()])
    again, other = Store(looks, "one"), Store(looks, "another")

    assert claim_of(map_of(small(), store=again)).claim == small_envelope.claim
    assert claim_of(map_of(small(), store=other)).claim == small_envelope.claim

    assert (again.loaded_looks, other.loaded_looks) == (count, 0)


def test_a_damaged_file_is_made_anew(looks: Path, small_envelope: Envelope) -> None:
    files = sorted(looks.iterdir())
    damages = (b"", b"x", b"\x80\x05.")
    assert len(files[::2]) >= len(damages)
    for file, damage in zip(files[::2], cycle(damages), strict=False):
        file.write_bytes(file.read_bytes()[: -len(damage) or None][:-3] + damage)
    store = Store(looks, "one")

    assert claim_of(map_of(small(), store=store)).claim == small_envelope.claim
    assert store.loaded_looks == len(files) - len(files[::2])


def test_a_full_disk_is_said_at_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("trackbench.subjects.envelope.cells.write_whole", full)

    with pytest.raises(OutputError, match="No space left on device"):
        map_of(small(), store=Store(tmp_path, "one"))


def test_a_file_in_place_of_the_folder(cli: Cli, tmp_path: Path) -> None:
    (tmp_path / "small.yaml").write_text(yaml.safe_dump(SMALL))
    (tmp_path / "taken").write_text("")
    (tmp_path / "kept" / "small-envelope").mkdir(parents=True)
    (tmp_path / "kept" / "small-envelope" / "mine").write_text("")

    for out in ("taken", "kept"):
        done = cli("envelope", "small.yaml", "--out", out)
        assert done.status == 2
        assert out in done.err
    assert [*(tmp_path / "kept").iterdir()] == [tmp_path / "kept" / "small-envelope"]


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("ps") is None, reason="nothing here lists the processes")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_an_interrupted_map_goes_on(number: signal.Signals, tmp_path: Path, trackbench: str) -> None:
    (tmp_path / "small.yaml").write_text(yaml.safe_dump(SMALL | {"envelope": long_envelope()}))
    command = [trackbench, "envelope", "small.yaml", "-q", "--out"]
    subprocess.run([*command, "whole"], cwd=tmp_path, check=True, capture_output=True)
    folder, looks = tmp_path / "parts" / "small-envelope", looks_of("small", tmp_path / "parts")
    for _ in range(2):
        before = kept(looks)
        process = subprocess.Popen(
            [*command, "parts"], cwd=tmp_path, stderr=subprocess.PIPE, text=True,
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
        )  # fmt: skip
        limit = time.monotonic() + 60
        while process.poll() is None and time.monotonic() < limit and kept(looks) < before + 8:
            time.sleep(0.01)
        process.send_signal(number)
        _, err = process.communicate(timeout=60)
        assert not folder.exists()
        if number != signal.SIGKILL:
            assert process.returncode == 130
            assert err.count("\n") == 1
            assert "goes on from" in err

    done = subprocess.run([*command, "parts", "-v"], cwd=tmp_path, check=True, capture_output=True, text=True)

    assert done.returncode == 0
    assert "looks were there already" in done.stderr
    for file in (CLAIM, PARTS):
        assert (folder / file).read_bytes() == (tmp_path / "whole" / "small-envelope" / file).read_bytes()
    assert os.listdir(tmp_path / "parts") == ["small-envelope"]


def kept(looks: Path) -> int:
    return sum(not file.name.startswith(".") for file in looks.iterdir()) if looks.exists() else 0


def long_envelope() -> dict[str, Any]:
    """One of more cells, which takes some seconds."""
    axes = SMALL["envelope"]["axes"] | {"rate": {"key": "sensors.lidar.rate_hz", "values": [1, 2, 5, 10]}}
    return SMALL["envelope"] | {"cells": 60, "axes": axes, "runs": {"first": 25, "most": 400}}
