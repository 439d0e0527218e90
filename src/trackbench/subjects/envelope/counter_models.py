"""Counter-examples, the nearest failing cells of a map, as the claim stores them."""

from __future__ import annotations

from typing import NamedTuple

from trackbench.results import Result
from trackbench.results.metric_value import ResultModel
from trackbench.scenario import Scenario
from trackbench.subjects.envelope.axes import Point

#: Name of the folder of all counter-examples.
COUNTER_EXAMPLES = "counter_examples"


class ShownRun(ResultModel):
    """Run that represents a failing cell: the median run beyond the limit; if none is beyond, the run nearest to it."""

    scene: int
    run: int
    """Number of the run in its scene, from 0."""
    value: float | None
    """Value of the metric in the run; None where the metric has no value by run."""
    beyond: int | None
    """Number of the cell's runs that are beyond the limit; None where the metric has no value by run."""
    runs: int


class CounterExample(ResultModel):
    """Cell in which a tracker fails, the nearest to its base point among such cells towards one side of the map."""

    folder: str
    """Name of the folder, in ``counter_examples``, with the scenario, report and recording."""
    tracker: str
    axis: str
    """Axis along which the cell is furthest from the tracker's base point."""
    side: str
    """Side of the axis towards which the cell lies: low, high, or the name of a choice."""
    cell: int
    """Index of the cell in ``Claim.cells``."""
    distance: float
    """Euclidean distance from the tracker's base point, with each axis scaled to the range 0 to 1."""
    limit: int | None
    """Index in ``Claim.limits`` of the requirement that the tracker fails; None if the cause is no limit."""
    shown: ShownRun
    event: str
    """Worst event of the run ``shown``, as text; empty where there is none."""
    finding: str
    """Result of an examination of the tracker, as text; empty where none was made."""


class BasePoint(ResultModel):
    """Point from which the distances of a tracker's failing cells are counted."""

    tracker: str
    point: list[float | str]
    note: str
    """Reason why the point is not the scenario's own; empty where it is."""

    @property
    def at(self) -> Point:
        """Values of the axes as a point."""
        return tuple(self.point)


class CounterExamples(ResultModel):
    """Failing cells that a map shows in detail, and the points from which their distances are counted."""

    bases: list[BasePoint]
    examples: list[CounterExample]
    """Counter-examples sorted by tracker, then by distance."""


class ShownExample(NamedTuple):
    """Scenario and result of a counter-example (failing cell) that are written into its folder."""

    loaded: Scenario
    result: Result
