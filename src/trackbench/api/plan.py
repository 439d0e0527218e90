"""Options of a run, and the interface of listeners to its progress."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from trackbench.base.types import NotedProgress, Progress, no_progress
from trackbench.driving.isolation import ISOLATED, Isolation
from trackbench.engine.choice import EngineName, require_engine
from trackbench.results import Result
from trackbench.results.summary import Provenance
from trackbench.scenario import Scenario
from trackbench.scenario.shipped import shown_name
from trackbench.truth import LoadedTruth

if TYPE_CHECKING:
    from trackbench.compare import Comparison
    from trackbench.runner.recorded import OnRecordedRun


@dataclass(frozen=True)
class RunPlan:
    """Where and how the scenarios of a call are run: output folder, processes, limits and engine."""

    out: Path | None = None
    """Folder in which each scenario gets a folder of its own; None to write nothing."""
    workers: int | None = 1
    """Number of processes; None for one per core if the work takes long, else one."""
    cluster: str | None = None
    """Dask cluster that replaces the processes: ``tcp://HOST:PORT``, or ``local:N``."""
    left_out: frozenset[str] = frozenset()
    """Names of optional files, such as ``recording.rrd``, that are not written into the folder of a run."""
    isolation: Isolation = ISOLATED
    """Limits of time and memory for the processes in which plug-in trackers run."""
    engine: EngineName = "auto"
    """Engine that computes built-in trackers and scores: numpy, fused or auto."""

    def __post_init__(self) -> None:
        require_engine(self.engine)


def command_of(scenario: Scenario, engine: EngineName = "auto") -> str:
    """Return the command line that reproduces the result of a scenario."""
    settings = (x for item in scenario.overrides for x in ("--set", item))
    only = ["--trackers", ",".join(scenario.selected)] if scenario.selected else []
    by = [] if engine == "auto" else ["--engine", engine]
    return shlex.join(["trackbench", "run", shown_name(scenario.path), *settings, *only, *by])


def place_prefix(number: int, items: Sequence[object]) -> str:
    """Return a prefix for a message on item ``number`` of ``items``, "2 of 3: "; empty for a single item."""
    return f"{number} of {len(items)}: " if len(items) > 1 else ""


@dataclass(frozen=True)
class Prepared:
    """Checked scenario with the truths of its scenes, ready to run."""

    scenario: Scenario
    truths: list[LoadedTruth]
    provenance: Provenance | None = None
    """Time of the run, git commit and hashes of the user's code; None if not recorded."""


class Listener:
    """Receiver of messages on the progress of runs; this base class ignores all messages."""

    @property
    def observes(self) -> bool:
        """Whether ``begin`` can return a function; if so, this process makes the run that is kept for plots."""
        return False

    @contextmanager
    def progress(self, work: str, unit: str) -> Iterator[NotedProgress]:
        """Return a context around a long task, in which the progress of the task is reported.

        Args:
            work: name of the work.
            unit: unit in which its progress is counted.

        Yields:
            A function to call with the amount done, the total and, optionally, a note on what was reached.
        """
        yield no_progress

    def note(self, text: str) -> None:
        """Receive a remark that a user should know, on a truth, a plug-in or an option."""

    def begin(self, item: Prepared) -> OnRecordedRun | None:
        """Receive the message that the runs of a scenario begin.

        Returns:
            A function that is called repeatedly with the recorded run (the run that is kept for plots) while it is
            made; None for no such calls.
        """
        return None

    def end(self, result: Result, folder: Path | None) -> None:
        """Receive the result of a scenario's runs, and its complete folder; None if nothing is written."""

    def compared(self, comparison: Comparison, page: Path) -> None:
        """Receive the comparison of the trackers of several scenarios, and the path of the comparison's HTML page."""


class Counter(Listener):
    """Listener that passes on progress counted in one unit, such as runs, and ignores all other messages."""

    def __init__(self, progress: Progress, unit: str) -> None:
        self._progress, self._unit = progress, unit

    @contextmanager
    def progress(self, work: str, unit: str) -> Iterator[NotedProgress]:
        yield self._counted if unit == self._unit else no_progress

    def _counted(self, done: float, total: float, note: str = "") -> None:
        self._progress(done, total)
