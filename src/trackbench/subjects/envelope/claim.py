"""What is claimed of a map: each cell with its state, and what is needed to repeat and check it (``claim.json``)."""

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
    """A requirement of the scenario."""

    tracker: str
    metric: str
    unit: str
    direction: Direction
    limit: float

    @property
    def text(self) -> str:
        """As it is read."""
        return f"{self.tracker} {self.metric} {self.direction} {self.limit:g}{self.after_number}"

    @property
    def after_number(self) -> str:
        """The unit as it stands after a number: " m"; empty where there is none."""
        return "" if self.unit == "1" else f" {self.unit}"

    def excess(self, value: Any) -> Any:
        """Return how far a value, or each of several, is beyond the limit; negative where it meets it."""
        return value - self.limit if self.direction == "below" else self.limit - value


class CellValue(ResultModel):
    """A requirement in a cell."""

    state: State
    value: float | None
    low: float | None
    """One-sided bounds of the value, each at the error that is spent at this look; None where there is none."""
    high: float | None

    @property
    def text(self) -> str:
        """The value with its bounds: "0.45 (0.4 to 0.5)"."""
        value, low, high = ("open" if end is None else f"{end:.3g}" for end in (self.value, self.low, self.high))
        return f"{value} ({low} to {high})"


class TrackerState(ResultModel):
    """A tracker in a cell."""

    state: State
    cause: str
    """Why it fails, or cannot be decided, where that is not a limit."""
    failed: bool = False
    """Whether the tracker could not go on."""
    scenes: int
    runs: int
    """Of each scene."""
    looks: int
    values: list[CellValue]
    """By requirement on the tracker, in their order."""
    coverage: CellValue | None = None
    """The share of the estimates, held against the least of the scenario; None where it is not needed."""


class ClaimCell(ResultModel):
    """A point of the map."""

    point: list[float | str]
    changes: list[str]
    """``key.path=value`` of each key that the scenario has there."""
    added: bool
    """Whether it was put near a border."""
    measurements: list[str]
    """Of each look, a hash of the measurements of the runs that were added."""
    trackers: dict[str, TrackerState]

    @property
    def at(self) -> Point:
        """Its values of the axes."""
        return tuple(self.point)


class AbsentCells(ResultModel):
    """All points with some values of the axes, at which a world sets what an axis varies: a cell would be a copy."""

    at: dict[str, float | str]
    """Values of such points by axis."""
    reason: str


class Claim(ResultModel):
    """A map."""

    schema_version: Literal[1] = 1
    scenario: str
    """Its name."""
    file: str
    """The scenario file, as it was named."""
    text: str
    """Of that file."""
    overrides: list[str]
    claim: Population
    confidence: float
    extents: list[tuple[int, int]]
    """Of each look: scenes, and runs of each."""
    seed: int
    engine: str
    versions: dict[str, str]
    command: str
    envelope: dict[str, Any]
    """The ``envelope:`` block, as it was."""
    limits: list[ClaimedLimit]
    base: list[float | str | None]
    """The scenario's own value of each axis; None where it has none."""
    cells: list[ClaimCell]
    absent: list[AbsentCells] = Field(default_factory=list)
    places: dict[str, int] = Field(default_factory=dict)
    """By tracker, its place in the scenario file, from which it has its colour."""
    counter_examples: CounterExamples | None = None
    """None where none were looked for."""
    parts: str | None = None
    """The sha256 of the file with the values of the runs; None until it is written."""

    @model_validator(mode="after")
    def _whole(self) -> Claim:
        """Its cells are such as its axes and its requirements have."""
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
        """The block."""
        return EnvelopeConfig.model_validate(self.envelope)

    @cached_property
    def axes(self) -> tuple[MapAxis, ...]:
        """Those of the map."""
        return axes_of(self.config)

    @property
    def trackers(self) -> list[str]:
        """Those of which something is required."""
        return list(dict.fromkeys(limit.tracker for limit in self.limits))

    @property
    def own_values(self) -> dict[str, float | str | None]:
        """The scenario's own, by the name of the axis."""
        return {axis.name: value for axis, value in zip(self.axes, self.base, strict=True)}

    @property
    def base_point(self) -> Point:
        """The scenario's own point, within the map; the middle of an axis for which the scenario has no value."""
        return tuple(axis.nearest(value) for axis, value in zip(self.axes, self.base, strict=True))

    def limits_of(self, tracker: str) -> list[ClaimedLimit]:
        """The requirements on a tracker."""
        return [limit for limit in self.limits if limit.tracker == tracker]

    def required_of(self, tracker: str) -> str:
        """What is required of a tracker, as it is read."""
        return " and ".join(limit.text.removeprefix(f"{tracker} ") for limit in self.limits_of(tracker))

    def counts(self, tracker: str) -> dict[State, int]:
        """By state, the number of cells."""
        states = [cell.trackers[tracker].state for cell in self.cells]
        return {state: states.count(state) for state in STATES}

    @property
    def failures(self) -> dict[str, str]:
        """By tracker, why it could not go on in the first cell in which it could not; empty where it always could."""
        return {
            name: next((cell.trackers[name].cause for cell in self.cells if cell.trackers[name].failed), "")
            for name in self.trackers
        }


@dataclass(frozen=True)
class Envelope:
    """A claim with what each run, or scene, adds to each value."""

    claim: Claim
    parts: pa.Table
    """``cell`` and ``limit`` (their numbers in the claim), ``part`` (the run, or the scene), ``value``: their mean over
    the parts is the value of the cell, to first order."""
    shown: Mapping[str, ShownExample] = field(default_factory=dict)
    """By folder, the counter-examples; none of a claim that was read."""
    folder: Path | None = None
    """The folder that it was read from."""

    def values(self, cell: int, limit: int) -> Array:
        """``(parts,)`` of a requirement in a cell."""
        return self._by_place.get((cell, limit), np.zeros(0))

    @cached_property
    def nearest_run(self) -> Result | None:
        """The run of the nearest counter-example; None where there is none, or not any more."""
        counter = self.claim.counter_examples
        nearest = min(counter.examples if counter else (), key=lambda example: example.distance, default=None)
        if nearest is None or nearest.folder in self.shown:
            return self.shown[nearest.folder].result if nearest else None
        place = self.folder and self.folder / COUNTER_EXAMPLES / nearest.folder
        return Result.load(place) if place and place.is_dir() else None

    @cached_property
    def _by_place(self) -> dict[tuple[int, int], Array]:
        groups = self.parts.to_pandas().groupby(["cell", "limit"])["value"]
        return {place: values.to_numpy() for place, values in groups}


def place_of_cell(axes: Sequence[MapAxis], point: Point) -> str:
    """A cell as it is read: "azimuth 0.5 deg, range 0.1 m"."""
    return ", ".join(f"{axis.name} {axis.shown(value)}" for axis, value in zip(axes, point, strict=True))


def read_claim(place: Path) -> Claim:
    """The claim of a folder or of its file.

    Raises:
        InputError: there is none, or it is damaged.
    """
    file = place / CLAIM if place.is_dir() else place
    if file.suffix in (".yaml", ".yml"):
        raise InputError("this is a scenario; `trackbench envelope` writes the folder of its claim", file=file)
    try:
        return read_model(Claim, file, "claim of an envelope", SCHEMA_VERSION)
    except FileNotFoundError:
        raise InputError(f"there is no {CLAIM} of an envelope", file=place) from None


def read_envelope(place: Path) -> Envelope:
    """The claim of a folder with the values of its runs.

    Args:
        place: the folder, or the claim in it.

    Raises:
        InputError: one is not there, damaged, or of another map.
    """
    folder = place if place.is_dir() else place.parent
    claim, file = read_claim(place), folder / PARTS
    try:
        parts = stored_table(file, claim.parts, CLAIM)
    except FileNotFoundError:
        raise InputError(f"there is no {PARTS} beside the claim", file=folder) from None
    if parts.schema != parts_of([]).schema or any(column.null_count for column in parts.columns):
        raise InputError("is not the table of a claim: cell, limit, part and value", file=file)
    return Envelope(claim, parts, folder=folder)


def parts_of(rows: Sequence[tuple[int, int, Array]]) -> pa.Table:
    """The table of values ``(parts,)`` by cell and requirement."""
    sizes = [len(values) for *_, values in rows]
    columns = {
        "cell": np.repeat([cell for cell, *_ in rows], sizes).astype(np.int32),
        "limit": np.repeat([limit for _, limit, _ in rows], sizes).astype(np.int32),
        "part": np.concatenate([np.arange(0), *map(np.arange, sizes)]).astype(np.int32),
        "value": np.concatenate([np.zeros(0), *(values for *_, values in rows)]),
    }
    return pa.table(columns)
