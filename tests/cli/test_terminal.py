"""What a terminal shows: examples, progress, how much is said, completion."""

from __future__ import annotations

import os
import re
import shlex
import shutil
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import click
import pytest

from trackbench.cli import terminal
from trackbench.cli.commands import cli as root

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
    assert first == "tiny: 1 of 1 expectation of the scenario failed"
    assert re.fullmatch(r"  FAILED ekf position_rmse \S+, wanted above 100", missed)


def test_lines_where_there_is_no_terminal(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(terminal, "LINES_EVERY_S", 0.0)
    for quiet in (False, True):
        with terminal.progress("ekf", "trials", quiet=quiet) as advance:
            advance(0, 10)
            advance(4, 10, "best 0.12")
    first, second = capsys.readouterr().err.splitlines()
    assert first == "ekf: 0 of 10 trials"
    assert second == "ekf: 4 of 10 trials, best 0.12"


def offered(trackbench: str, folder: Path, *words: str) -> list[str]:
    """What bash is offered for the last of the words."""
    environment = {**os.environ, "_TRACKBENCH_COMPLETE": "bash_complete", "COMP_WORDS": shlex.join(words)}
    environment["COMP_CWORD"] = str(len(words) - 1)
    done = subprocess.run([trackbench], cwd=folder, env=environment, capture_output=True, text=True, check=True)
    return done.stdout.split()


@pytest.mark.slow
def test_completion_offers_files_and_words(tmp_path: Path, trackbench: str) -> None:
    assert offered(trackbench, tmp_path, "trackbench", "run", "ti") == ["file,ti"]
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
