"""What the tests share: a scene small enough to run in no time, and the pages of the documentation as commands."""

from __future__ import annotations

import functools
import itertools
import math
import os
import re
import signal
import subprocess
import sys
import sysconfig
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import pytest
from hypothesis import settings
from tests.support.browser import CHROMIUM
from tests.support.commands import run_command

# How long an example takes says how busy the machine is, and nothing of the code.
from tests.support.places import DOCS
from tests.support.slow_tests import PARTS, listed, part
from tests.support.udacity import data_folder

from trackbench.base.errors import InputError
from trackbench.base.execution import executor
from trackbench.cli import terminal
from trackbench.driving.isolation import ISOLATED, Isolation
from trackbench.results import Result
from trackbench.runner.run import run_scenario
from trackbench.scenario import load_scenario
from trackbench.scenario.truth import truths_of
from trackbench.subjects.recording import viewer

settings.register_profile("any machine", deadline=None)
settings.load_profile("any machine")

TINY = """\
name: tiny
description: Two cars before a radar and a lidar
truth:
  source: highway-env
  env: highway-v0
  config: {vehicles_count: 4, lanes_count: 2}
  seed: 1
  duration_s: 2
  rate_hz: 10
  targets: {nearest: 2}
sensors:
  radar: {type: radar, rate_hz: 10, range_sigma_m: 0.3, azimuth_sigma_deg: 0.5, range_rate_sigma_mps: 0.1}
  lidar: {type: lidar, rate_hz: 5, position_sigma_m: 0.15, detection_probability: 0.9}
trackers:
  raw: {use: raw}
  ekf: {filter: ekf, motion: cv, acceleration_sigma_mps2: 3, initial: {from: two_measurements, least_time_s: 0}}
score: {settle_s: 0}
monte_carlo: {runs: 4, seed: 7}
"""

EXAMPLES = DOCS / "examples"

Run = Callable[..., Result]


def pytest_addoption(parser: pytest.Parser) -> None:
    """The part of the slow tier that a run takes."""
    parser.addoption("--part", type=int, choices=range(PARTS), help="of the slow tests and the pages, only this part")


def pytest_configure() -> None:
    """The folder that holds recordings, for scenarios that name it by TRACKBENCH_DATA, and byte code that is kept.

    The processes that tests start would compile trackbench anew, each for a third of its time.
    """
    sys.dont_write_bytecode = False
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
    if data_folder().is_dir():
        os.environ.setdefault("TRACKBENCH_DATA", str(data_folder()))


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Mark the tests that are slow by their cost, and leave out the parts of the slow tier that were not asked for."""
    costly = listed()
    for item in items:
        if item.nodeid in costly:
            item.add_marker("slow")
    chosen = config.getoption("--part")
    if chosen is None:
        return
    left_out = [
        item
        for item in items
        if (item.get_closest_marker("slow") or item.get_closest_marker("docs_pages")) and part(item.nodeid) != chosen
    ]
    config.hook.pytest_deselected(items=left_out)
    items[:] = [item for item in items if item not in set(left_out)]


def pytest_runtest_setup(item: pytest.Item) -> None:
    """Skip what needs a program that is not here, and say which."""
    if item.get_closest_marker("browser") and CHROMIUM is None:
        pytest.skip("Chromium is not installed (apt-get install chromium)")
    if item.get_closest_marker("viewer") and not viewer_draws():
        pytest.skip(viewer.NO_DRIVER)


@functools.cache
def viewer_draws() -> bool:
    """Whether there is a driver for the viewer, which starts without one too; it fails for no other cause."""
    with ExitStack() as stack:
        try:
            started = viewer.start_viewer("--headless")
            stack.callback(started.stop)
            started.wait().take_screenshot()
            return True
        except InputError as error:
            cause = error
        except (ConnectionError, RuntimeError):
            started.process.wait(viewer.PATIENCE)
            cause = viewer.end_error(started.log)
    assert str(cause) == viewer.NO_DRIVER
    return False


@pytest.fixture(scope="session", autouse=True)
def _isolated(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """A cache of its own, no terminal, and Ctrl-C not ignored, which the processes that a test starts would inherit."""
    with pytest.MonkeyPatch.context() as patch:
        signal.signal(signal.SIGINT, signal.default_int_handler)
        patch.setenv("TRACKBENCH_CACHE", str(tmp_path_factory.mktemp("cache")))
        for name in ("COLUMNS", "FORCE_COLOR", "NO_COLOR", "RERUN"):
            patch.delenv(name, raising=False)
        yield


@pytest.fixture(autouse=True)
def _own_modules_forgotten(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """A module that a test writes or takes from the examples is gone for the next, whose may have the same name."""
    before = set(sys.modules)
    yield
    for name in set(sys.modules) - before:
        file = Path(getattr(sys.modules[name], "__file__", None) or "")
        if file.is_relative_to(tmp_path_factory.getbasetemp()) or file.is_relative_to(EXAMPLES):
            del sys.modules[name]


@pytest.fixture(scope="session")
def tiny_text() -> str:
    """A scenario of two cars over two seconds."""
    return TINY


@pytest.fixture
def tiny(tmp_path: Path) -> Path:
    """Its file, in a folder of the test's own."""
    file = tmp_path / "tiny.yaml"
    file.write_text(TINY, encoding="utf-8")
    return file


@pytest.fixture(scope="session")
def run_tiny(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """Runs the tiny scenario with ``key.path=value`` set over it; trackers' modules are looked for in ``folder``."""
    texts = tmp_path_factory.mktemp("tiny")

    def call(*overrides: str, folder: Path = texts, workers: int = 1, isolation: Isolation = ISOLATED) -> Result:
        file = folder / "tiny.yaml"
        file.write_text(TINY, encoding="utf-8")
        loaded = load_scenario(file, overrides)
        with executor(workers) as chosen:
            return run_scenario(loaded, truths_of(loaded, executor=chosen), executor=chosen, isolation=isolation)

    return call


@pytest.fixture(scope="session")
def tiny_result(run_tiny: Run) -> Result:
    """The result of the tiny scenario as it is."""
    return run_tiny()


@pytest.fixture(scope="session")
def write_module() -> Callable[[Path, str], str]:
    """Writes a module under a name that no other test uses, and returns the name."""
    numbers = itertools.count()

    def write(folder: Path, code: str) -> str:
        name = f"own_module_{os.getpid()}_{next(numbers)}"
        (folder / f"{name}.py").write_text(code, encoding="utf-8")
        return name

    return write


@pytest.fixture(scope="session")
def trackbench() -> str:
    """The installed command."""
    return str(Path(sysconfig.get_path("scripts")) / "trackbench")


@dataclass(frozen=True)
class Block:
    """A fenced block of a page."""

    language: str
    text: str
    note: str
    """The comment right above it, such as ``file: mine.py`` or ``not run``."""
    line: int


FENCE = re.compile(r"(?:^<!-- (?P<note>.*?) -->\n)?^```(?P<language>\w+)\n(?P<text>.*?)^```$", re.MULTILINE | re.DOTALL)
NOT_RUN = ("make ", "git ", "pip ", "python -m pip ", "python3 -m venv ", "cd ", "#", "rerun ")


@pytest.fixture(scope="session")
def fenced() -> Callable[[Path], list[Block]]:
    """The fenced blocks of a page."""

    def read(page: Path) -> list[Block]:
        text = page.read_text(encoding="utf-8")
        return [
            Block(found["language"], found["text"], found["note"] or "", text.count("\n", 0, found.start("text")))
            for found in FENCE.finditer(text)
        ]

    return read


@pytest.fixture(scope="session")
def run_page(fenced: Callable[[Path], list[Block]], trackbench: str) -> Callable[[Path, Path], int]:
    """Runs the console and Python blocks of a page in a folder, as a reader would; returns how many commands ran.

    A scenario is saved under its name, and a block with the comment ``file: NAME`` under that one. After a line that
    begins with ``$`` the lines up to the next one are its output, in which numbers may differ. With
    TRACKBENCH_REPRINT=1 the page gets the output of today in their place.
    """
    reprint = os.environ.get("TRACKBENCH_REPRINT") == "1"

    def call(page: Path, folder: Path) -> int:
        path = os.pathsep.join([str(Path(trackbench).parent), os.environ["PATH"]])
        count = 0
        for block in fenced(page):
            where = f"{page.name}:{block.line}"
            if block.note.startswith("file: "):
                (folder / block.note.removeprefix("file: ")).write_text(block.text, encoding="utf-8")
            elif scenario := re.match(r"name: (\w+)\n", block.text):
                (folder / f"{scenario[1]}.yaml").write_text(block.text, encoding="utf-8")
            if block.note == "not run":
                continue
            if block.language == "python":
                done = subprocess.run(
                    [sys.executable, "-c", block.text], cwd=folder, capture_output=True, text=True, check=False
                )
                assert done.returncode == 0, f"{where}: {done.stderr}"
                count += 1
            for command, printed in commands(block):
                done = subprocess.run(
                    command.replace(".venv/bin/", ""), shell=True, cwd=folder, env={**os.environ, "PATH": path},
                    capture_output=True, text=True, check=False,
                )  # fmt: skip
                status = 1 if block.note == "finds a fault" else 0
                assert done.returncode == status, f"{where}: {command}: {done.stderr}"
                if printed and reprint:
                    reprinted(page, printed, done.stdout)
                else:
                    assert not printed or masked(printed) == masked(done.stdout.splitlines()), f"{where}: {done.stdout}"
                count += 1
        return count

    return call


def commands(block: Block) -> Iterator[tuple[str, list[str]]]:
    """The commands of a console block, each with the output that the page shows."""
    if block.language not in ("console", "bash", "sh"):
        return
    lines = [line.rstrip() for line in block.text.splitlines() if line.strip()]
    prompted = any(line.startswith("$ ") for line in lines)
    while lines:
        command = lines.pop(0).removeprefix("$ ")
        printed = list(itertools.takewhile(lambda line: prompted and not line.startswith("$ "), lines))
        del lines[: len(printed)]
        if not command.startswith(NOT_RUN):
            yield command.partition("  #")[0], printed


def reprinted(page: Path, printed: Sequence[str], output: str) -> None:
    """Put an output in a page in the place of what it prints there, with blank lines if there were any."""
    lines, text = (
        [line.rstrip().expandtabs(4) for line in output.strip("\n").splitlines()],
        page.read_text(encoding="utf-8"),
    )
    pattern = r"[ \t]*\n\s*?".join(re.escape(line) for line in printed)
    before = re.search(rf"^{pattern}$", text, re.MULTILINE)
    assert before, f"{page.name} does not have {printed[0]!r} and the lines after it"
    if "\n\n" not in before[0]:
        lines = [line for line in lines if line]
    page.write_text(text[: before.start()] + "\n".join(lines) + text[before.end() :], encoding="utf-8")


def masked(lines: Sequence[str]) -> list[str]:
    """Lines that differ in their numbers and spaces only become equal."""
    words = [re.sub(r"[±<~]?[-+]?\d+(\.\d+)?(e[-+]?\d+)?", "N", " ".join(line.split())) for line in lines]
    return [line for line in words if line]


@dataclass(frozen=True)
class Outcome:
    """What a command left on the terminal."""

    status: int
    out: str
    err: str


@pytest.fixture
def cli(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> Callable[..., Outcome]:
    """Runs ``trackbench`` with arguments in the test's folder, in this process."""
    monkeypatch.chdir(tmp_path)
    # On a slow machine, too, what is printed says nothing of progress.
    monkeypatch.setattr(terminal, "LINES_EVERY_S", math.inf)

    def call(*arguments: str | Path) -> Outcome:
        capfd.readouterr()
        status = run_command(Path.cwd(), *arguments)
        printed = capfd.readouterr()
        return Outcome(status, printed.out, printed.err)

    return call
