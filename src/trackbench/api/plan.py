"""How scenarios are run."""

from __future__ import annotations

import shlex
from dataclasses import dataclass
from pathlib import Path

from trackbench.base.errors import InputError
from trackbench.driving.isolation import ISOLATED, Isolation
from trackbench.engine.choice import EngineName, require_engine
from trackbench.scenario import Scenario
from trackbench.scenario.shipped import shown_name

#: Where a run that goes on until its precision is reached stops even so.
MAX_RUNS = 10_000


@dataclass(frozen=True)
class Plan:
    """How every scenario is run."""

    out: Path | None = None
    """Each scenario gets a folder in it; nothing is written unless given."""
    workers: int = 1
    """Number of processes."""
    cluster: str | None = None
    """The Dask cluster that is used instead: ``tcp://HOST:PORT``, or ``local:N``."""
    recording: bool = True
    """Whether the Rerun recording is written."""
    isolation: Isolation = ISOLATED
    """How trackers that are not built in are kept apart from the bench."""
    engine: EngineName = "auto"
    """What computes."""
    precision: tuple[float, int] | None = None
    """The share and the largest number of runs, where the precision decides on their number."""

    def __post_init__(self) -> None:
        if not isinstance(self.workers, int) or self.workers < 1:
            raise InputError(f"{self.workers!r} is no number of processes; give a whole one from 1", key="workers")
        if self.workers > 1 and self.cluster is not None:
            raise InputError("the work runs in one place: leave it out beside a cluster", key="workers")
        require_engine(self.engine)


def command_of(scenario: Scenario, engine: EngineName = "auto") -> str:
    """What reproduces the result of a scenario."""
    settings = (x for item in scenario.overrides for x in ("--set", item))
    only = ["--trackers", ",".join(scenario.selected)] if scenario.selected else []
    by = [] if engine == "auto" else ["--engine", engine]
    return shlex.join(["trackbench", "run", shown_name(scenario.path), *settings, *only, *by])
