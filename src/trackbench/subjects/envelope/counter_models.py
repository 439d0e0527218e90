"""Counter-examples as the claim stores them."""

from __future__ import annotations

from typing import NamedTuple

from trackbench.results import Result
from trackbench.results.metric_value import ResultModel
from trackbench.scenario import Scenario
from trackbench.subjects.envelope.axes import Point

#: Name of the folder of all counter-examples.
COUNTER_EXAMPLES = "counter_examples"


class ShownRun(ResultModel):
    """Run that shows a counter-example: the median of the runs beyond the limit; without any, the run nearest to it."""

    scene: int
    run: int
    """Number of the run in its scene, from 0."""
    value: float | None
    """Value of the metric in the run; None where the metric has no value by run."""
    beyond: int | None
    """Number of the cell's runs that are beyond the limit; None where the metric has no value by run."""
    runs: int


class CounterExample(ResultModel):
    """Cell that fails with confidence and is nearest to the base, among the cells towards one face of the map."""

    folder: str
    """Name of the folder, in ``counter_examples``, with the scenario, report and recording."""
    tracker: str
    axis: str
    """Axis along which the cell is furthest from the base."""
    side: str
    """Face of the axis: low, high, or the name of a choice."""
    cell: int
    """Number of the cell in the claim."""
    distance: float
    """Euclidean distance from the base, with each axis scaled to the range 0 to 1."""
    limit: int | None
    """Number of the requirement that the tracker fails; None where the cell fails for another cause."""
    shown: ShownRun
    event: str
    """Worst event of the shown run, as text; empty where there is none."""
    finding: str
    """Result of an examination of the tracker, as text; empty where none was made."""


class BasePoint(ResultModel):
    """Point from which a tracker's distances are counted."""

    tracker: str
    point: list[float | str]
    note: str
    """Reason why the point is not the scenario's own; empty where it is."""

    @property
    def at(self) -> Point:
        """Values of the axes as a point."""
        return tuple(self.point)


class CounterExamples(ResultModel):
    """All counter-examples of a map."""

    bases: list[BasePoint]
    examples: list[CounterExample]
    """Counter-examples sorted by tracker, then by distance."""


class ShownExample(NamedTuple):
    """Scenario and result in the folder of a counter-example."""

    loaded: Scenario
    result: Result
