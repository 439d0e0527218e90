"""A run that cannot be finished leaves nothing under its final name, and says so in one line."""

from __future__ import annotations

import errno
import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest

from trackbench.subjects.recording import writer as recording

pytestmark = pytest.mark.slow

Cli = Callable[..., Any]


def test_ctrl_c_while_the_result_is_written(
    cli: Cli, tiny: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*_: Any, **__: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(recording, "write", interrupted)
    done = cli("run", "tiny.yaml")
    assert (done.status, done.out) == (130, "")
    assert list((tmp_path / "results").iterdir()) == []


def no_space(*_: Any, **__: Any) -> None:
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


WRITERS = {"tables": (pq, "write_table"), "recording": (recording, "write"), "texts": (Path, "write_text")}


@pytest.mark.parametrize("writer", WRITERS)
def test_a_disk_that_fills_up_leaves_the_last_result(
    cli: Cli, tiny: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, writer: str
) -> None:
    assert cli("run", "tiny.yaml", "--no-recording", "--seed", "1").status == 0
    before = {path: path.read_bytes() for path in (tmp_path / "results").rglob("*") if path.is_file()}
    monkeypatch.setattr(*WRITERS[writer], no_space)
    done = cli("run", "tiny.yaml", "--seed", "2")
    assert (done.status, done.out) == (4, "")
    assert done.err.startswith("trackbench: cannot write results/tiny: No space left on device")
    assert {path: path.read_bytes() for path in (tmp_path / "results").rglob("*") if path.is_file()} == before
    assert [path.name for path in (tmp_path / "results").iterdir()] == ["tiny"]


def test_an_earlier_result_is_replaced_whole(cli: Cli, tiny: Path, tmp_path: Path) -> None:
    folder = tmp_path / "results" / "tiny"
    assert cli("run", "tiny.yaml", "--seed", "1").status == 0
    (folder / "left_over.parquet").touch()
    assert cli("run", "tiny.yaml", "--seed", "2", "--no-recording").status == 0
    summary = json.loads((folder / "result.json").read_text(encoding="utf-8"))
    assert summary["seed"] == 2
    assert {path.name for path in folder.iterdir()} == {"result.json", *summary["artifacts"].values()}
    assert not (folder / "recording.rrd").exists()
    assert [path.name for path in (tmp_path / "results").iterdir()] == ["tiny"]
