"""Standard streams, files and folders that are not as a command needs them: one message, and status 2 or 4."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

FULL = Path("/dev/full")
SECONDS = 60

Shell = Callable[..., "subprocess.CompletedProcess[str]"]


@pytest.fixture
def shell(trackbench: str, tmp_path: Path) -> Shell:
    """Runs a line of the shell in the test's folder, where ``tb`` is the command."""

    def call(line: str, **variables: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            ["bash", "-c", f'tb() {{ "{trackbench}" "$@"; }}; {line}'],
            cwd=tmp_path, env={**os.environ, **variables}, capture_output=True, text=True, timeout=SECONDS, check=False,
        )  # fmt: skip

    return call


def one_line(done: subprocess.CompletedProcess[str], status: int) -> str:
    assert done.returncode == status, done.stderr
    (line,) = done.stderr.splitlines()
    return line


@pytest.mark.skipif(not FULL.exists(), reason="there is no /dev/full here")
@pytest.mark.parametrize("command", ["list filters", "schema", "--help", "--version", "check tiny.yaml"])
def test_a_full_standard_output(shell: Shell, tiny: Path, command: str) -> None:
    line = one_line(shell(f"tb {command} > /dev/full"), 4)
    assert line == "trackbench: cannot write standard output: No space left on device"


@pytest.mark.skipif(not FULL.exists(), reason="there is no /dev/full here")
def test_a_result_that_cannot_be_printed_is_kept(shell: Shell, tiny: Path, tmp_path: Path) -> None:
    for options in ("", "--json", "--quiet"):
        done = shell(f"tb run tiny.yaml --runs 1 --no-recording {options} > /dev/full")
        assert "cannot write standard output" in one_line(done, 4)
        assert (tmp_path / "results" / "tiny" / "result.json").is_file()


def test_a_closed_standard_output(shell: Shell) -> None:
    assert "standard output is closed" in one_line(shell("tb list filters >&-"), 4)
    assert shell("tb list filters >&- 2>&- <&-").returncode == 4


def test_a_standard_error_that_takes_nothing(shell: Shell) -> None:
    whole = shell("tb list filters").stdout
    for closed in ("2>&-", "2>&- <&-", "2>/dev/full"):
        done = shell(f"tb list filters {closed}")
        assert (done.returncode, done.stdout) == (0, whole)
        assert shell(f"tb list filtrs {closed}").returncode == 2


def test_files_opened_later_are_not_taken_for_a_closed_stream(shell: Shell, tiny: Path, tmp_path: Path) -> None:
    done = shell("tb run tiny.yaml --runs 1 2>&- <&-")
    assert done.returncode == 0
    assert (tmp_path / "results" / "tiny" / "recording.rrd").is_file()


@pytest.mark.parametrize(
    "variables", [{"PYTHONIOENCODING": "ascii"}, {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}]
)
def test_what_the_output_lacks_is_a_question_mark(shell: Shell, variables: dict[str, str]) -> None:
    whole, done = shell("tb list sensors").stdout, shell("tb list sensors", **variables)
    assert done.returncode == 0
    assert done.stdout == whole.encode("ascii", "replace").decode()
    assert done.stdout != whole


def test_a_working_directory_that_was_deleted(shell: Shell) -> None:
    done = shell("mkdir gone && cd gone && rmdir ../gone && tb run highway")
    assert one_line(done, 2) == "the working directory no longer exists; change to another one"


@pytest.mark.parametrize(
    "command", ["check {}", "run {}", "inspect {}", "report {}", "compare {}", "view {}", "audit {}"]
)
@pytest.mark.parametrize("path", ["/dev/zero", "fifo"])
def test_what_is_no_file(shell: Shell, tmp_path: Path, command: str, path: str) -> None:
    os.mkfifo(tmp_path / "fifo")
    done = shell(f"tb {command.format(path)}")
    assert one_line(done, 2).startswith(f"{path}: ")


def test_a_device_is_written_not_replaced(shell: Shell, tiny: Path) -> None:
    done = shell("tb run tiny.yaml --runs 1 --no-recording --quiet --junit /dev/stdout")
    assert done.returncode == 0
    assert done.stdout.count("</testsuite>") == 1
