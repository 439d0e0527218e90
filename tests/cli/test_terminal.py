"""What a terminal shows: help, examples, progress, tables, how much is said, completion."""

from __future__ import annotations

import fcntl
import os
import pty
import re
import select
import shlex
import shutil
import struct
import subprocess
import termios
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import click
import pytest
from rich.console import Console

from trackbench.cli import terminal
from trackbench.cli.commands import cli as root
from trackbench.report.console import print_summary
from trackbench.results import Result

Cli = Callable[..., Any]


def commands(group: click.Group = root, path: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
    """The way to every command, those of groups included."""
    yield path
    context = click.Context(group)
    for name in group.list_commands(context):
        command = group.get_command(context, name)
        if isinstance(command, click.Group):
            yield from commands(command, (*path, name))
        else:
            yield (*path, name)


@pytest.mark.parametrize("path", list(commands()), ids=" ".join)
def test_every_help_fits_its_terminal_and_has_an_example(
    cli: Cli, monkeypatch: pytest.MonkeyPatch, path: tuple[str, ...]
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    lines = cli(*path, "--help").out.splitlines()
    assert lines[0].startswith(" ".join(["Usage: trackbench", *path]))
    assert max(map(len, lines)) <= 80
    assert not any(line.endswith("...") for line in lines[1:]), "a text is cut off"
    heading = next(i for i, line in enumerate(lines) if line.strip().startswith(("Example:", "Examples:")))
    assert any(f"trackbench {' '.join(path)}".rstrip() in line for line in lines[heading:])


def examples() -> Iterator[str]:
    for path in commands():
        command: click.Command = root
        for name in path:
            assert isinstance(command, click.Group)
            command = command.get_command(click.Context(command), name)
        shown = (command.help or "").partition("Example")[2].partition("\n\n")[0]
        yield from (line.strip() for line in shown.splitlines()[1:] if line.strip())


@pytest.mark.parametrize("line", sorted(set(examples())))
def test_every_example_is_a_command_that_is_understood(line: str) -> None:
    quoted = re.search(r"\$\((.*?)\)", line)
    words = shlex.split(re.split(r"\s[>|]\s", quoted[1] if quoted else line)[0], comments=True)
    words = words[words.index("trackbench") + 1 :]
    command: click.Command = root
    while isinstance(command, click.Group) and (inner := command.get_command(click.Context(command), words[0])):
        command, words = inner, words[1:]
    command.make_context("trackbench", words).close()


def test_quiet_says_the_outcome_and_what_failed(cli: Cli, tiny: Path) -> None:
    assert cli("check", "tiny.yaml", "--quiet").out == ""
    expect = "expect=[{tracker: ekf, metric: position_rmse, above: 100}]"
    done = cli("run", "tiny.yaml", "--no-recording", "--quiet", "--set", expect)
    assert (done.status, done.err) == (1, "")
    first, missed = done.out.splitlines()
    assert first == "tiny: 1 of 1 expectation failed"
    assert re.fullmatch(r"  FAILED ekf position_rmse \S+, wanted above 100", missed)


def on_a_terminal(command: list[str], folder: Path, environment: dict[str, str]) -> list[str]:
    """The states of each line of a terminal of 80 columns, one after the other, without their colours."""
    pid, terminal = pty.fork()
    if pid == 0:
        os.chdir(folder)
        os.execve(command[0], command, environment)
    fcntl.ioctl(terminal, termios.TIOCSWINSZ, struct.pack("HHHH", 24, 80, 0, 0))
    written = b""
    while True:
        try:
            found = os.read(terminal, 65536) if select.select([terminal], [], [], 60)[0] else b""
        except OSError:
            break
        if not found:
            break
        written += found
    assert os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]) == 0, written.decode()
    text = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", written.decode())
    return [line for line in re.split(r"[\r\n]+", text) if line.strip()]


SLOW = """\
import time
class T:
    def step(self, state, scan):
        time.sleep(0.002)
        place = list(scan.measurement[:2]) if scan.valid and scan.kind == "lidar" else (state or [0, 0])
        return place, ([*place, 0, 0], [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
"""


def test_progress_with_the_time_left(
    tiny: Path, tmp_path: Path, trackbench: str, write_module: Callable[[Path, str], str]
) -> None:
    module = write_module(tmp_path, SLOW)
    long = "a_name_as_long_as_a_name_of_a_scenario_may_be_before_it_is_too_l"
    tiny.with_name("two.yaml").write_text(tiny.read_text(encoding="utf-8").replace("name: tiny", f"name: {long}"))
    # Of blocks of other processes it is said when they are done.
    command = [trackbench, "run", "tiny.yaml", "two.yaml", "--set", f"trackers.slow.use={module}:T", "--workers", "1"]
    environment = {**os.environ, "TERM": "xterm", "TRACKBENCH_CACHE": str(tmp_path / "cache")}
    lines = on_a_terminal(command, tmp_path, environment)
    bars = [line for line in lines if "━" in line]
    assert max(map(len, bars)) <= 80
    assert any(re.match(r"1 of 2: truth of tiny .* \d+ of 21 steps", line) for line in bars)
    assert any(re.match(r"1 of 2: tiny .* [1-3] of 4 runs, \d:\d\d left", line) for line in bars)
    assert any(re.match(r"2 of 2: a_name_as_.*… .* [1-3] of 4 runs, \d:\d\d left", line) for line in bars)
    assert any(line.startswith("1 of 2: writing tiny ━") for line in bars)


def test_lines_where_there_is_no_terminal(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(terminal, "LINES_EVERY_S", 0.0)
    for quiet in (False, True):
        with terminal.progress("ekf", "trials", quiet=quiet) as advance:
            advance(0, 10)
            advance(4, 10, "best 0.12")
    first, second = capsys.readouterr().err.splitlines()
    assert first == "ekf: 0 of 10 trials"
    assert re.fullmatch(r"ekf: 4 of 10 trials, best 0\.12(, \d:\d\d left)?", second)


def result_of(names: list[str], like: Result, position: float = 0.1) -> Result:
    """A result of trackers with these names, between any two of which no difference was shown."""
    pattern = like["ekf"]
    metrics = {**pattern.metrics, "position_rmse": pattern.position_rmse.model_copy(update={"value": position})}
    trackers = [pattern.model_copy(update={"name": name, "metrics": metrics}) for name in names]
    return like.updated(trackers=trackers, ranking=names)


@pytest.mark.parametrize("longest", [8, 20, 64])
@pytest.mark.parametrize("position", [0.1, 1234567.0])
def test_the_table_fits_whatever_the_names(tiny_result: Result, longest: int, position: float) -> None:
    names = [f"{'x' * (longest - 3)}_{i:02}" for i in range(40)] + ["ekf"]
    console = Console(width=80, record=True, quiet=False, file=open(os.devnull, "w"))  # noqa: SIM115
    with console.file:
        print_summary(result_of(names, tiny_result, position), console)
        lines = console.export_text().splitlines()
    assert max(map(len, lines)) <= 80
    for name in names:
        row = next(i for i, line in enumerate(lines) if name in line.replace(":", "").split()[:2])
        assert len(" ".join(lines[row : row + 3]).split()) >= 8, "a name is on the line of its numbers or right above"


def offered(trackbench: str, folder: Path, *words: str) -> list[str]:
    """What bash is offered for the last of the words."""
    environment = {**os.environ, "_TRACKBENCH_COMPLETE": "bash_complete", "COMP_WORDS": shlex.join(words)}
    environment["COMP_CWORD"] = str(len(words) - 1)
    done = subprocess.run([trackbench], cwd=folder, env=environment, capture_output=True, text=True, check=True)
    return done.stdout.split()


@pytest.mark.slow
def test_completion_offers_scenarios(tiny: Path, tmp_path: Path, trackbench: str) -> None:
    (tmp_path / "scenarios" / "deep").mkdir(parents=True)
    for name in ("one", "deep/two"):
        shutil.copy(tiny, tmp_path / "scenarios" / f"{name}.yaml")
    both = ["plain,scenarios/deep/two.yaml", "plain,scenarios/one.yaml"]
    assert offered(trackbench, tmp_path, "trackbench", "run", "scen") == both
    assert offered(trackbench, tmp_path, "trackbench", "run", "high") == ["plain,highway", "plain,highway_dense"]
    assert offered(trackbench, tmp_path, "trackbench", "check", "ti") == ["plain,tiny.yaml"]
    assert offered(trackbench, tmp_path, "trackbench", "check", "de") == ["file,de"]
    assert offered(trackbench, tmp_path, "trackbench", "serve", "udacity", "--tracker", "ti") == ["plain,tiny.yaml"]
    assert offered(trackbench, tmp_path, "trackbench", "list", "mo") == ["plain,motion-models"]


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_the_completion_script_is_one_of_its_shell(trackbench: str, shell: str, tmp_path: Path) -> None:
    environment = {**os.environ, "_TRACKBENCH_COMPLETE": f"{shell}_source"}
    done = subprocess.run([trackbench], env=environment, capture_output=True, text=True, check=True)
    assert done.stderr == ""
    assert f"_TRACKBENCH_COMPLETE={shell}_complete" in done.stdout
    if shutil.which(shell):
        (tmp_path / "script").write_text(done.stdout, encoding="utf-8")
        subprocess.run([shell, "-n", "script"], cwd=tmp_path, check=True)
