"""How scenarios are run, and what a run tells of itself while it goes on."""

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
    """How every scenario is run."""

    out: Path | None = None
    """Each scenario gets a folder in it; nothing is written unless given."""
    workers: int | None = 1
    """Number of processes; None: as many as there are cores, where the work takes long."""
    cluster: str | None = None
    """The Dask cluster that is used instead: ``tcp://HOST:PORT``, or ``local:N``."""
    left_out: frozenset[str] = frozenset()
    """Files of subjects that are not written into the folder of a run."""
    isolation: Isolation = ISOLATED
    """How trackers that are not built in are kept apart from the bench."""
    engine: EngineName = "auto"
    """What computes."""

    def __post_init__(self) -> None:
        require_engine(self.engine)


def command_of(scenario: Scenario, engine: EngineName = "auto") -> str:
    """What reproduces the result of a scenario."""
    settings = (x for item in scenario.overrides for x in ("--set", item))
    only = ["--trackers", ",".join(scenario.selected)] if scenario.selected else []
    by = [] if engine == "auto" else ["--engine", engine]
    return shlex.join(["trackbench", "run", shown_name(scenario.path), *settings, *only, *by])


def place_prefix(number: int, of: Sequence[object]) -> str:
    """ "2 of 3: ", before what is done of one of several; empty for a single one."""
    return f"{number} of {len(of)}: " if len(of) > 1 else ""


@dataclass(frozen=True)
class Prepared:
    """A checked scenario with the truths of its scenes, ready to run."""

    scenario: Scenario
    truths: list[LoadedTruth]
    provenance: Provenance | None = None
    """When and of which code."""


class Listener:
    """Is told of the work; this one says nothing to anybody."""

    @property
    def observes(self) -> bool:
        """Whether ``begin`` gives a function, so that the recorded run is made in this process."""
        return False

    @contextmanager
    def progress(self, work: str, unit: str) -> Iterator[NotedProgress]:
        """Around a piece of work that takes its time.

        Args:
            work: what it is.
            unit: what is counted.

        Yields:
            A function that is called with how much is done, how much there is and, perhaps, what was reached.
        """
        yield no_progress

    def note(self, text: str) -> None:
        """What a user should know of the truth or a plug-in."""

    def begin(self, item: Prepared) -> OnRecordedRun | None:
        """A scenario's runs begin.

        Returns:
            A function that is called with the recorded run while it is made; it should return at once.
        """
        return None

    def end(self, result: Result, folder: Path | None) -> None:
        """A scenario's runs have ended, and its folder is complete if it has one."""

    def compared(self, comparison: Comparison, page: Path) -> None:
        """Several scenarios are compared, and the page says what was found."""


class Counter(Listener):
    """Passes on how much of one unit is done."""

    def __init__(self, progress: Progress, unit: str) -> None:
        self._progress, self._unit = progress, unit

    @contextmanager
    def progress(self, work: str, unit: str) -> Iterator[NotedProgress]:
        """Of the unit alone."""
        yield self._counted if unit == self._unit else no_progress

    def _counted(self, done: float, total: float, note: str = "") -> None:
        self._progress(done, total)
