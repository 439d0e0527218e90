"""What a claim says of counter-examples."""

from __future__ import annotations

from typing import NamedTuple

from trackbench.results import Result
from trackbench.results.metric_value import ResultModel
from trackbench.scenario import Scenario
from trackbench.subjects.envelope.axes import Point

#: The folder of their folders.
COUNTER_EXAMPLES = "counter_examples"


class ShownRun(ResultModel):
    """The run by which a counter-example is shown: the median of those that miss the limit."""

    scene: int
    run: int
    """Of its scene, from 0."""
    value: float | None
    """None where runs do not tell the metric."""
    beyond: int | None
    """How many of the runs of the cell are beyond the limit."""
    runs: int


class CounterExample(ResultModel):
    """The nearest cell that fails with confidence, towards a face of the map."""

    folder: str
    """Of its scenario, report and recording, in ``counter_examples``."""
    tracker: str
    axis: str
    """Along which it is furthest from the base."""
    side: str
    """low, high, or the name of a choice."""
    cell: int
    """Its number in the claim."""
    distance: float
    """Distance from the base, in shares of each range."""
    limit: int | None
    """The number of the requirement that it does not meet; None where the cell says another cause."""
    shown: ShownRun
    event: str
    """What went wrong most in the run that is shown."""
    finding: str
    """What an examination of the tracker says; empty where none was made."""


class BasePoint(ResultModel):
    """From where distances are counted for a tracker."""

    tracker: str
    point: list[float | str]
    note: str
    """Where it is not the scenario itself."""

    @property
    def at(self) -> Point:
        """Its values of the axes."""
        return tuple(self.point)


class CounterExamples(ResultModel):
    """Those of a map."""

    bases: list[BasePoint]
    examples: list[CounterExample]
    """By tracker, the nearest first."""


class ShownExample(NamedTuple):
    """What the folder of a counter-example holds."""

    loaded: Scenario
    result: Result
