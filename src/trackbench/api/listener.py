"""What a run tells of itself while it goes on."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from trackbench.base.types import Progress, no_progress
from trackbench.results import Result
from trackbench.scenario import Scenario
from trackbench.truth import LoadedTruth

if TYPE_CHECKING:
    from trackbench.compare import Comparison
    from trackbench.runner.block import OnRecordedRun


@dataclass(frozen=True)
class Prepared:
    """A checked scenario with the truths of its scenes, ready to run."""

    scenario: Scenario
    truths: list[LoadedTruth]


class Listener:
    """Is told of the work; this one says nothing to anybody."""

    @property
    def observes(self) -> bool:
        """Whether ``begin`` gives a function, so that the recorded run is made in this process."""
        return False

    @contextmanager
    def progress(self, work: str, unit: str) -> Iterator[Progress]:
        """Around a piece of work that takes its time.

        Args:
            work: what it is.
            unit: what is counted.

        Yields:
            A function that is called with how much is done and how much there is.
        """
        yield no_progress

    def note(self, text: str) -> None:
        """What a user should know of the truth."""

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
    def progress(self, work: str, unit: str) -> Iterator[Progress]:
        """Of the unit alone."""
        yield self._progress if unit == self._unit else no_progress
