"""The claim of a map (``claim.json``): each cell's state (holds, fails, undecided), and what repeats and checks it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pyarrow as pa
from pydantic import Field, ValidationError, model_validator

from trackbench.base.errors import InputError
from trackbench.base.types import Array
from trackbench.results import Result
from trackbench.results.checks import stored_table
from trackbench.results.metric_value import ResultModel, read_model
from trackbench.subjects.envelope.axes import MapAxis, Point, axes_of
from trackbench.subjects.envelope.config import EnvelopeConfig
from trackbench.subjects.envelope.counter_models import COUNTER_EXAMPLES, CounterExamples, ShownExample

CLAIM, PARTS, SCHEMA_VERSION = "claim.json", "parts.parquet", 1

State = Literal["holds", "fails", "undecided"]
Direction = Literal["below", "above"]
Population = Literal["these scenes", "traffic like these"]
STATES: tuple[State, ...] = ("holds", "fails", "undecided")


class ClaimedLimit(ResultModel):
    """Requirement on a tracker: a metric that must lie below or above a limit."""

    tracker: str
    metric: str
    unit: str
    direction: Direction
    limit: float

    @property
    def text(self) -> str:
        """Requirement as text: "ekf position_rmse below 0.5 m"."""
        return f"{self.tracker} {self.metric} {self.direction} {self.limit:g}{self.after_number}"

    @property
    def after_number(self) -> str:
        """Unit of the metric as text to append to a number, with a leading space; empty for a metric without unit."""
        return "" if self.unit == "1" else f" {self.unit}"

    def excess(self, value: Any) -> Any:
        """Return by how much a value, or each value of an array, violates the limit; negative where it meets it."""
        return value - self.limit if self.direction == "below" else self.limit - value


class CellValue(ResultModel):
    """Value of a requirement's metric in a cell, and whether the requirement holds there."""

    state: State
    value: float | None
    low: float | None
    """One-sided lower bound at the last look's error probability; ``high`` is the upper bound. None without a bound."""
    high: float | None

    @property
    def text(self) -> str:
        """Value with its bounds as text: "0.45 (0.4 to 0.5)"."""
        value, low, high = ("open" if end is None else f"{end:.3g}" for end in (self.value, self.low, self.high))
        return f"{value} ({low} to {high})"


class TrackerState(ResultModel):
    """State of a tracker in a cell (holds, fails or undecided), with the values by which it was judged."""

    state: State
    cause: str
    """Reason other than a limit why the tracker fails or is undecided; empty where there is none."""
    failed: bool = False
    """Whether the tracker broke down with an error, so that it had no further runs."""
    scenes: int
    runs: int
    """Number of Monte-Carlo runs of each scene."""
    looks: int
    values: list[CellValue]
    """Value of each requirement on the tracker, in the order of ``Claim.limits``."""
    coverage: CellValue | None = None
    """Share of expected estimates that were given; None where the scenario requires no share."""


class ClaimCell(ResultModel):
    """Cell of the map: a point (a value for each axis) with the state of each tracker."""

    point: list[float | str]
    changes: list[str]
    """Changes that make the cell's scenario from the mapped scenario, each as ``key.path=value``."""
    added: bool
    """Whether the cell was added near a border; False for a cell of the grid from which the map starts."""
    measurements: list[str]
    """One hash for each look (interim test): of the measurements of the runs that were added for the look."""
    trackers: dict[str, TrackerState]

    @property
    def at(self) -> Point:
        """Values of the axes as a point."""
        return tuple(self.point)


class AbsentCells(ResultModel):
    """Points without cells: their world (drivers and sensors) fixes what an axis varies; cells would be copies."""

    at: dict[str, float | str]
    """Values that these points have in common, by axis name."""
    reason: str


class Claim(ResultModel):
    """Result of a map: its cells with their states (holds, fails or undecided), and the settings that repeat them."""

    schema_version: Literal[1] = 1
    scenario: str
    """Name of the scenario."""
    file: str
    """Path or name of the scenario file, as the user gave it."""
    text: str
    """Text of the scenario file."""
    overrides: list[str]
    claim: Population
    confidence: float
    extents: list[tuple[int, int]]
    """For each look (interim test) the numbers of scenes and of runs of each scene, cumulative."""
    seed: int
    engine: str
    versions: dict[str, str]
    command: str
    envelope: dict[str, Any]
    """The scenario's ``envelope:`` block."""
    limits: list[ClaimedLimit]
    base: list[float | str | None]
    """The scenario's own value on each axis; None for an axis on which the scenario has no value."""
    cells: list[ClaimCell]
    absent: list[AbsentCells] = Field(default_factory=list)
    places: dict[str, int] = Field(default_factory=dict)
    """Position of each tracker in the scenario file, by name, which determines the tracker's colour."""
    counter_examples: CounterExamples | None = None
    """Counter-examples: the nearest failing cells, shown in detail; None before the search for them."""
    parts: str | None = None
    """SHA-256 hash of the file with each run's or scene's contribution; None until the file is written."""

    @model_validator(mode="after")
    def _whole(self) -> Claim:
        try:
            axes, trackers = self.axes, self.trackers
        except ValidationError as invalid:
            error = invalid.errors()[0]
            raise ValueError(f"envelope.{'.'.join(map(str, error['loc']))}: {error['msg']}") from None
        if not self.extents or not self.limits:
            raise ValueError("it has no looks or no limits")
        if len(self.base) != len(axes):
            raise ValueError("base has other axes than the claim")
        for number, cell in enumerate(self.cells):
            inside = len(cell.point) == len(axes) and all(map(MapAxis.takes, axes, cell.point))
            if not inside or [*cell.trackers] != trackers:
                raise ValueError(f"cell {number} has other axes or trackers than the claim")
            for name, tracker in cell.trackers.items():
                if len(tracker.values) not in (0, len(self.limits_of(name))):
                    raise ValueError(f"cell {number} has other limits of {name} than the claim")
        return self

    @cached_property
    def config(self) -> EnvelopeConfig:
        """The ``envelope:`` block, validated."""
        return EnvelopeConfig.model_validate(self.envelope)

    @cached_property
    def axes(self) -> tuple[MapAxis, ...]:
        """Axes of the map: the quantities that it varies, in the order of the scenario."""
        return axes_of(self.config)

    @property
    def trackers(self) -> list[str]:
        """Names of the trackers that have a requirement."""
        return list(dict.fromkeys(limit.tracker for limit in self.limits))

    @property
    def own_values(self) -> dict[str, float | str | None]:
        """The scenario's own value on each axis, by axis name; None for an axis on which the scenario has no value."""
        return {axis.name: value for axis, value in zip(self.axes, self.base, strict=True)}

    @property
    def base_point(self) -> Point:
        """Point of the map nearest to the scenario; the middle of an axis for which the scenario has no value."""
        return tuple(axis.nearest(value) for axis, value in zip(self.axes, self.base, strict=True))

    def limits_of(self, tracker: str) -> list[ClaimedLimit]:
        return [limit for limit in self.limits if limit.tracker == tracker]

    def required_of(self, tracker: str) -> str:
        """Return the requirements on a tracker as text, without its name."""
        return " and ".join(limit.text.removeprefix(f"{tracker} ") for limit in self.limits_of(tracker))

    def counts(self, tracker: str) -> dict[State, int]:
        """Return the number of cells in each state (holds, fails, undecided) of a tracker."""
        states = [cell.trackers[tracker].state for cell in self.cells]
        return {state: states.count(state) for state in STATES}

    @property
    def failures(self) -> dict[str, str]:
        """Reason of each tracker's first breakdown, by tracker name; empty text for a tracker that never broke down."""
        return {
            name: next((cell.trackers[name].cause for cell in self.cells if cell.trackers[name].failed), "")
            for name in self.trackers
        }


@dataclass(frozen=True)
class Envelope:
    """Claim of a map (its cells and their states), with the contribution of each run or scene to each value."""

    claim: Claim
    parts: pa.Table
    """Columns ``cell`` and ``limit`` (indices in ``Claim``), ``part`` (number of the run or scene) and ``value``.
    The mean of ``value`` over the parts is the cell's value, to first order."""
    shown: Mapping[str, ShownExample] = field(default_factory=dict)
    """Scenario and result of each counter-example, by folder name; empty for a claim that was read from a file."""
    folder: Path | None = None
    """Folder from which the claim was read; None for a newly computed claim."""

    def values(self, cell: int, limit: int) -> Array:
        """Return the contribution of each run or scene to a value, ``(parts,)``; empty without a value.

        ``cell`` and ``limit`` are the indices of the cell and of the requirement in the claim.
        """
        return self._parts_by_cell.get((cell, limit), np.zeros(0))

    @cached_property
    def nearest_run(self) -> Result | None:
        """Result of the counter-example nearest to its base point; None without counter-examples or folder."""
        counter = self.claim.counter_examples
        nearest = min(counter.examples if counter else (), key=lambda example: example.distance, default=None)
        if nearest is None or nearest.folder in self.shown:
            return self.shown[nearest.folder].result if nearest else None
        path = self.folder and self.folder / COUNTER_EXAMPLES / nearest.folder
        return Result.load(path) if path and path.is_dir() else None

    @cached_property
    def _parts_by_cell(self) -> dict[tuple[int, int], Array]:
        groups = self.parts.to_pandas().groupby(["cell", "limit"])["value"]
        return {key: values.to_numpy() for key, values in groups}


def place_of_cell(axes: Sequence[MapAxis], point: Point) -> str:
    """Return the coordinates of a cell as text: "azimuth 0.5 deg, range 0.1 m"."""
    return ", ".join(f"{axis.name} {axis.shown(value)}" for axis, value in zip(axes, point, strict=True))


def read_claim(path: Path) -> Claim:
    """Read a claim from the envelope's folder, or from its file.

    Raises:
        InputError: there is no claim, or it is damaged.
    """
    file = path / CLAIM if path.is_dir() else path
    if file.suffix in (".yaml", ".yml"):
        raise InputError("this is a scenario; `trackbench envelope` writes the folder of its claim", file=file)
    try:
        return read_model(Claim, file, "claim of an envelope", SCHEMA_VERSION)
    except FileNotFoundError:
        raise InputError(f"there is no {CLAIM} of an envelope", file=path) from None


def read_envelope(path: Path) -> Envelope:
    """Read a claim with the values of its runs, from the envelope's folder or its claim file.

    Raises:
        InputError: a file is missing, damaged, or of another map.
    """
    folder = path if path.is_dir() else path.parent
    claim, file = read_claim(path), folder / PARTS
    try:
        parts = stored_table(file, claim.parts, CLAIM)
    except FileNotFoundError:
        raise InputError(f"there is no {PARTS} beside the claim", file=folder) from None
    if parts.schema != parts_of([]).schema or any(column.null_count for column in parts.columns):
        raise InputError("is not the table of a claim: cell, limit, part and value", file=file)
    return Envelope(claim, parts, folder=folder)


def parts_of(rows: Sequence[tuple[int, int, Array]]) -> pa.Table:
    """Return the table ``Envelope.parts`` from rows of cell index, requirement index and values ``(parts,)``."""
    sizes = [len(values) for *_, values in rows]
    columns = {
        "cell": np.repeat([cell for cell, *_ in rows], sizes).astype(np.int32),
        "limit": np.repeat([limit for _, limit, _ in rows], sizes).astype(np.int32),
        "part": np.concatenate([np.arange(0), *map(np.arange, sizes)]).astype(np.int32),
        "value": np.concatenate([np.zeros(0), *(values for *_, values in rows)]),
    }
    return pa.table(columns)
