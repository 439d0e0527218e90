"""The ``envelope:`` block of a scenario."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field

from trackbench.base.config import Config, Name, Problem
from trackbench.subjects.envelope.bounds import FEWEST_RUNS

#: Keys that say which values an axis has; exactly one must be given.
FORMS = ("from", "values", "choices")
#: Blocks of a scenario that no axis may change, since the map itself rests on them.
FIXED = ("monte_carlo", "envelope", "name", "expect", "worlds", "recording")


class Linked(Config):
    """Linear relation of a key to the value of an axis: ``offset + factor * value``."""

    factor: float = Field(1, description="Factor by which the value is multiplied.")
    offset: float = Field(0, description="What is added.")

    def value(self, number: float) -> float:
        """Return the value of the axis at which the key equals ``number``."""
        return (number - self.offset) / self.factor


class Axis(Config):
    """Axis of a map: one key of the scenario, several that follow one value, or named changes."""

    key: str | None = Field(None, description="The key that takes the value, such as `sensors.radar.range_sigma_m`.")
    keys: dict[str, Linked] = Field(
        default_factory=dict, description="Several keys that follow the value, each by a factor and an offset."
    )
    low: float | None = Field(None, alias="from", description="The least value of a continuous axis.")
    high: float | None = Field(None, alias="to", description="The largest value of a continuous axis.")
    levels: int = Field(5, ge=2, le=200, description="How many values of a continuous axis the map starts from.")
    scale: Literal["linear", "log"] = Field("linear", description="How the values of a continuous axis are spaced.")
    values: list[float] = Field(default_factory=list, description="All values of a discrete axis.")
    choices: dict[str, dict[str, Any]] | list[str | bool] = Field(
        default_factory=list,
        description="Categories: values of `key`, or names, each with the keys that it sets.",
    )
    unit: str = Field("", description="Unit shown with the value; unless given, the unit of the key.")

    @property
    def continuous(self) -> bool:
        """Whether the axis has values between any two of its values."""
        return self.low is not None

    @property
    def form(self) -> str:
        """Key that says which values the axis has: ``from``, ``values`` or ``choices``."""
        return self._forms[0]

    @property
    def _forms(self) -> list[str]:
        return [name for name in FORMS if getattr(self, {"from": "low"}.get(name, name)) not in (None, [], {})]

    def problems(self) -> Iterator[Problem]:
        stated = self._forms
        if len(stated) != 1:
            more = f"write one of {', '.join(stated)}" if stated else "missing: from and to, values, or choices"
            yield Problem((stated[1],) if stated else (), more)
            return
        yield from self._keyed()
        if self.continuous:
            yield from self._between()
        elif self.high is not None:
            yield Problem(("to",), "only used with from")
        for value in [item for item in self.values if self.values.count(item) > 1][1:2]:
            yield Problem(("values",), f"{value:g} stands there twice")
        if len(self.values) == 1 or (self.form == "choices" and len(self.choices) == 1):
            yield Problem((self.form,), "at least two are needed to vary anything")
        if self.form != "from" and {"levels", "scale"} & self.model_fields_set:
            yield Problem(("levels",), "only used with from and to")

    def _keyed(self) -> Iterator[Problem]:
        named = isinstance(self.choices, dict) and bool(self.choices)
        if named and (self.key or self.keys):
            yield Problem(("key" if self.key else "keys",), "each choice says which keys it sets: leave this out")
        elif not named and (self.key is None) == (not self.keys):
            yield Problem((), "write key, or keys where several follow the value")
        if self.keys and self.form == "choices":
            yield Problem(("keys",), "choices are no numbers: give each choice the keys that it sets")
        every = [("key", self.key)] if self.key is not None else [("keys", key) for key in self.keys]
        every += [("choices", key) for keys in self.choices.values() for key in keys] if named else []  # type: ignore[union-attr]
        for place, key in every:
            if key is not None and not all(key.split(".")):
                yield Problem((place,), f"{key!r} is no key of a scenario, such as sensors.radar.range_sigma_m")
            elif key is not None and key.partition(".")[0] in FIXED:
                yield Problem((place,), f"{key} cannot be an axis: it must be the same in the whole map")

    def _between(self) -> Iterator[Problem]:
        assert self.low is not None
        if self.high is None:
            yield Problem(("to",), "missing: the largest value")
        elif self.low >= self.high:
            yield Problem(("from",), f"must be below to, which is {self.high:g}")
        elif self.scale == "log" and self.low <= 0:
            yield Problem(("from",), "must be above 0 on a logarithmic scale")


class Population(Config):
    """Numbers of runs of a cell at the first and the last look."""

    first: int = Field(
        25, ge=FEWEST_RUNS, description="Runs at the first look at a cell; scenes for `traffic like these`."
    )
    most: int = Field(
        400, ge=FEWEST_RUNS, description="Runs, or scenes, after which a cell without a decision stays `undecided`."
    )

    def problems(self) -> Iterator[Problem]:
        if self.first > self.most:
            yield Problem(("first",), f"must be at most the budget of a cell, which is {self.most}")


class EnvelopeConfig(Config):
    """Settings of `trackbench envelope`: what is varied, and how surely a cell of the map is decided."""

    EXAMPLE: ClassVar[str] = """\
envelope:
  claim: these scenes
  axes:
    range_sigma: {key: sensors.front_radar.range_sigma_m, from: 0.1, to: 2, scale: log}
    rate: {key: sensors.front_radar.rate_hz, values: [5, 10, 20]}
"""

    axes: dict[Name, Axis] = Field(min_length=1, description="The axes that are varied, by name.")
    #: Probability that no cell of the whole map is decided wrongly, for any tracker.
    confidence: ClassVar[float] = 0.95
    claim: Literal["these scenes", "traffic like these"] = Field(
        "these scenes",
        description="these scenes: new runs of the same scenes. traffic like these: new scenes, at least 30.",
    )
    runs: Population = Field(default_factory=Population, description="Numbers of runs, or scenes, of a cell.")
    cells: int = Field(200, ge=2, le=10_000, description="Largest number of cells, with the cells added near borders.")
    resolution: Annotated[float, Field(gt=0, le=0.5)] = Field(
        1 / 32, description="Share of a continuous axis down to which the map is refined near a border."
    )

    def problems(self) -> Iterator[Problem]:
        if self.claim == "traffic like these" and self.runs.first < 30:
            yield Problem(("runs", "first"), "must be at least 30 scenes for a claim about traffic like these")
        grid = math.prod(len(axis.values) or len(axis.choices) or axis.levels for axis in self.axes.values())
        if grid > self.cells:
            yield Problem(("cells",), f"the grid has {grid} cells: raise cells, or take fewer levels")
        keys: dict[str, str] = {}
        for name, axis in self.axes.items():
            for key in axis_keys(axis):
                if key in keys:
                    yield Problem(("axes", name), f"{key} is varied by {keys[key]} already")
                keys[key] = name


def axis_keys(axis: Axis) -> list[str]:
    """Return the keys of the scenario that an axis changes, each once."""
    named = [key for keys in axis.choices.values() for key in keys] if isinstance(axis.choices, dict) else []
    return list(dict.fromkeys([*([axis.key] if axis.key else []), *axis.keys, *named]))
