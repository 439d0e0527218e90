"""A run that cannot be finished leaves nothing under its final name, and says so in one line."""

from __future__ import annotations

import errno
import json
import os
import shutil
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest

from trackbench.runner import work
from trackbench.subjects.recording import writer as recording

pytestmark = pytest.mark.slow

Cli = Callable[..., Any]


def processes_of(group: int) -> list[str]:
    listed = subprocess.run(["ps", "-eo", "pgid=,stat=,args="], capture_output=True, text=True, check=True).stdout
    rows = [line.split(maxsplit=2) for line in listed.splitlines()]
    return [row[2] for row in rows if int(row[0]) == group and not row[1].startswith("Z")]


@pytest.mark.skipif(shutil.which("ps") is None, reason="nothing here lists the processes")
@pytest.mark.parametrize(
    ("number", "where"),
    [
        (signal.SIGINT, ""),
        (signal.SIGTERM, "--workers 2"),
        (signal.SIGKILL, "--workers 2"),
        (signal.SIGINT, "--cluster local:2"),
    ],
)
def test_ctrl_c_and_kill(
    tiny: Path, tmp_path: Path, trackbench: str, cli: Cli, where: str, number: signal.Signals
) -> None:
    assert cli("run", "tiny.yaml", "--no-recording").status == 0
    before = {path: path.read_bytes() for path in (tmp_path / "results").rglob("*") if path.is_file()}
    # A tracker says when the run is under way.
    (tmp_path / "says_so.py").write_text(
        "from pathlib import Path\n"
        "class T:\n"
        "    batched = True\n"
        "    def step(self, state, scan):\n"
        "        Path('under_way').touch()\n"
        "        return 1, None\n",
        encoding="utf-8",
    )
    command = [trackbench, "run", "tiny.yaml", "--runs", "1000000", *where.split()]
    command += ["--set", "trackers.says.use=says_so:T"]
    # A script starts what runs in the background with Ctrl-C ignored, and ends it by SIGTERM.
    on_ctrl_c = signal.SIG_IGN if number == signal.SIGTERM else signal.SIG_DFL
    process = subprocess.Popen(
        command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, on_ctrl_c),
    )  # fmt: skip
    try:
        limit = time.monotonic() + 120
        while not (tmp_path / "under_way").exists() and time.monotonic() < limit:
            time.sleep(0.02)
        # Ctrl-C goes to every process of the terminal's foreground group; a kill goes to the one that is named.
        os.killpg(process.pid, number) if number == signal.SIGINT else process.send_signal(number)
        out, err = process.communicate(timeout=60)
    finally:
        process.kill()
    assert (tmp_path / "under_way").exists()
    assert out == ""
    if number == signal.SIGKILL:
        assert (process.returncode, err) == (-signal.SIGKILL, "")
    else:
        assert (process.returncode, err) == (130, "interrupted: the unfinished run was not kept\n")
    assert {path: path.read_bytes() for path in (tmp_path / "results").rglob("*") if path.is_file()} == before
    assert [path.name for path in (tmp_path / "results").iterdir()] == ["tiny"]
    limit = time.monotonic() + 20
    while processes_of(process.pid) and time.monotonic() < limit:
        time.sleep(0.05)
    assert processes_of(process.pid) == []


def test_ctrl_c_while_the_result_is_written(
    cli: Cli, tiny: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*_: Any, **__: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(recording, "write", interrupted)
    done = cli("run", "tiny.yaml")
    assert (done.status, done.out) == (130, "")
    assert list((tmp_path / "results").iterdir()) == []


DEADLY = """\
import os
from trackbench.metrics import Metric


class Deadly(Metric):
    '''Ends the process that scores.'''
    name, unit, meaning = "deadly", "1", "nothing"

    def init(self, scope):
        os._exit(7)

    def update(self, sums, chunk):
        return sums

    def merge(self, blocks):
        return blocks[0]

    def finish(self, sums):
        return sums
"""


def test_workers_that_die(
    cli: Cli, tiny: Path, tmp_path: Path, write_module: Callable[[Path, str], str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(work, "BATCH_SIZE", 4)
    metric = f"score.metrics=['{write_module(tmp_path, DEADLY)}:Deadly']"
    done = cli("run", "tiny.yaml", "--workers", "2", "--set", metric)
    assert (done.status, done.out) == (2, "")
    assert done.err.startswith("trackbench: no result: the process of a worker ended (EXIT(7)); a plug-in may have ")
    assert len(done.err.splitlines()) == 1
    assert list((tmp_path / "results").iterdir()) == []


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A folder on a disk of 60 KiB, where the test may mount one."""
    folder = tmp_path / "small"
    folder.mkdir()
    command = ["mount", "-t", "tmpfs", "-o", "size=60k", "tmpfs", str(folder)]
    try:
        mounted = subprocess.run(command, capture_output=True, check=False).returncode == 0
    except FileNotFoundError:
        mounted = False
    if not mounted:
        pytest.skip("cannot mount a file system here")
    yield folder
    subprocess.run(["umount", "--lazy", str(folder)], check=True)


def test_a_full_disk(cli: Cli, tiny: Path, small_disk: Path) -> None:
    done = cli("run", "tiny.yaml", "--out", small_disk)
    assert (done.status, done.out) == (4, "")
    assert "No space left on device" in done.err
    assert len(done.err.splitlines()) == 1
    assert list(small_disk.iterdir()) == []


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
