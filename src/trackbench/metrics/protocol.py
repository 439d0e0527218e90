"""What a metric is: how it is named and judged, what it sums over the estimates, and what it makes of the sums."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar, Literal, NamedTuple, Protocol

import numpy as np

from trackbench.base.config import Config
from trackbench.base.types import Array, Mask
from trackbench.engine.equations import Compute, by_numpy
from trackbench.metrics.conditions import Classes
from trackbench.metrics.ego import EgoScene
from trackbench.metrics.intervals import Interval, ratio
from trackbench.metrics.sums import ERROR
from trackbench.results import MetricValue

if TYPE_CHECKING:
    from trackbench.metrics.traffic.assignment import TrafficScoreOptions

Direction = Literal["smaller", "larger"]
#: What ``finish`` may give for one path; None where there is no value.
Outcome = Interval | MetricValue | float | None


class Target(NamedTuple):
    """What the estimates of a block of runs are held against, at each instant of a scan."""

    time: Array
    """``(instants,)`` s."""
    state: Array
    """``(4, instants, objects, runs or 1)`` px, py, vx, vy."""
    alive: Mask
    """``(instants, objects)``"""
    due: Mask
    """``(instants, objects, runs)`` where a tracker should have an estimate, and is scored: the object is there, was
    detected, its track settled, and it is or was not long ago in view of a sensor."""
    starting: Mask
    """``(instants, objects, runs)`` the first second after an object was detected for the first time, or again after it
    was out of view for long."""
    divergence: float
    """m"""
    reference: Array
    """``(2, instants, objects, runs or 1)`` of the squared error of position, m^2, and velocity, (m/s)^2."""

    def each(self, mask: Mask) -> Mask:
        """Return ``(instants, objects * runs)`` of a mask of this target, such as ``due``."""
        return mask.reshape(len(self.time), -1)


@dataclass(frozen=True)
class Scope:
    """A block of runs, as a metric knows it before the first estimate or track. Its arrays are not to be changed."""

    tracker: str
    """Name of the tracker that is scored."""
    runs: int
    """Number of runs, or of stretches of a run, each of which is scored by itself."""
    bodies: EgoScene | None = None
    """The ego and the sizes of the objects."""
    options: TrafficScoreOptions | None = None
    """What is asked of a track; None with known identities."""
    target: Target | None = None
    """What estimates are held against; None with hidden identities, as ``classes``."""
    classes: Classes | None = None
    """``(instants, objects, runs or 1)`` of :func:`trackbench.metrics.conditions.condition_classes`."""
    measurements: Mapping[str, int] = field(default_factory=dict)
    """Number of instants of each sensor; empty with hidden identities."""
    single: bool = False
    """Whether it is a run whose stretches of time stand for independent runs."""
    compute: Compute = by_numpy
    """What computes equations."""

    @property
    def labelled(self) -> Target:
        """The target of a scope with known identities."""
        assert self.target is not None
        return self.target


class Innovation(NamedTuple):
    """What a tracker made of one measurement."""

    instant: int
    whitened: Array | None
    """``(m, batch)`` innovation in units of its own standard deviations; None where the tracker gives none."""
    used: Mask
    """``(batch,)`` where the measurement is valid and the estimate is scored."""
    due: Mask
    """``(batch,)`` where also the tracker had an estimate of the object before, so that there should be one."""
    log_density: Array | None = None
    """``(batch,)`` of the measurement under the prediction; None where the tracker gives no innovation, and where no
    metric is ``of_density``."""


@dataclass(frozen=True)
class Chunk:
    """The estimates of one tracker at some successive instants.

    The batch has a member for each object and run; the runs of an object are next to each other. The arrays are those
    of the scorer: they are not to be changed, and hold other values after ``update``.
    """

    instants: slice
    time: Array
    """``(instants,)`` s."""
    truth: Array
    """``(4, instants, objects, runs or 1)`` px, py, vx, vy."""
    mean: Array
    """``(4, instants, batch)`` of the estimate; where it gave none, what it is charged with (``metrics.silence``)."""
    covariance: Array
    """``(4, 4, instants, batch)``, of estimates that were given."""
    values: Array
    """``(15, instants, batch)`` rows ``ERROR_FIELDS``, what the built-in metrics sum; 0 where not scored."""
    scored: Mask
    """``(instants, batch)`` where an estimate is due, and the error counts. Elsewhere, what other arrays hold means
    nothing."""
    given: Mask
    """``(instants, batch)`` where the tracker gave an estimate. What is made of covariances counts there alone."""
    innovations: Mapping[str, Sequence[Innovation]]
    """By sensor, in order of time."""
    repaired: Array
    """``(runs,)`` number of covariances that were repaired."""
    seconds: float
    """Time spent in the tracker."""
    steps: int
    """Number of steps of single objects that it took."""

    @cached_property
    def error(self) -> Array:
        """``(4, instants, batch)`` estimate minus truth."""
        error = self.mean.reshape(*self.mean.shape[:2], -1, self.runs) - self.truth
        return error.reshape(self.mean.shape)

    @property
    def nees(self) -> Array:
        """``(instants, batch)``"""
        nees: Array = self.values[ERROR["nees"]]
        return nees

    @property
    def runs(self) -> int:
        return len(self.repaired)

    def by_run(self, values: Array | float) -> Array:
        """``(runs,)`` sums of values ``(instants, batch)`` over what is scored; of 1, the number of errors."""
        total = np.where(self.scored, values, 0.0).sum(axis=0)
        return np.asarray(total.reshape(-1, self.runs).sum(axis=0))

    @cached_property
    def squares(self) -> Array:
        """``(2, instants, batch)`` squared errors of position and velocity; as ``values``."""
        rows = self.values
        return np.stack([rows[ERROR["px"]] + rows[ERROR["py"]], rows[ERROR["vx"]] + rows[ERROR["vy"]]])


class SquaredErrors(NamedTuple):
    """What metrics that are ``of_squares`` look at of a ``Chunk``."""

    instants: slice
    squares: Array
    scored: Mask
    given: Mask
    runs: int
    seconds: float
    steps: int


class Fault(Exception):
    """An estimate that cannot be scored."""

    def __init__(self, cause: str, instant: int, member: int | None) -> None:
        super().__init__(cause)
        self.cause = cause
        self.instant = instant
        self.member = member


def raise_fault(cause: str, wrong: Mask, first: int) -> None:
    """Raise a Fault if an estimate ``(instants, batch)`` is wrong; ``first`` is the number of the first instant."""
    if np.any(wrong):
        step, member = np.argwhere(wrong)[0]
        raise Fault(cause, first + int(step), int(member))


class Accumulator(Protocol):
    """Sums over the estimates of one tracker, as :class:`Metric`. Metrics that name the same one share its sums."""

    @property
    def name(self) -> str: ...

    def init(self, scope: Any) -> Any: ...

    def update(self, sums: Any, chunk: Any) -> Any: ...

    def close(self, sums: Any) -> Any: ...

    def merge(self, blocks: Sequence[Any]) -> Any: ...


#: What a scenario may have: measurements that say of which object they are, or hidden identities and so tracks; and
#: a truth, or none.
PROPERTIES = frozenset({"labels", "tracks", "truth", "no truth"})
#: Stands in a path for a sensor's name.
SENSOR = "<sensor>"


class Field(NamedTuple):
    """What an expectation may name: the value of a metric, or a part of it."""

    name: str
    """Of a part, in its metric; else the dotted path, with ``<sensor>`` for a sensor's name."""
    meaning: str
    words: tuple[str, ...] = ()
    """The values of a verdict; empty for a number."""
    unit: str = "1"
    """ "1" for a number without a unit, "" for a word."""
    better: Direction | None = None
    compared: bool = False
    """Whether two trackers are compared by it, run by run (``better_than``)."""
    needs: Set[str] = frozenset()
    """Which of ``PROPERTIES`` a scenario must have."""

    @property
    def per_sensor(self) -> bool:
        return SENSOR in self.name


#: Root mean square errors, by how many axes they are of: what the noise of a recorded truth is part of.
AXES = {"position_rmse": 2.0, "velocity_rmse": 2.0} | dict.fromkeys(("rmse.px", "rmse.py", "rmse.vx", "rmse.vy"), 1.0)


class Metric(Config):
    """One metric of a tracker, built in or not. The pydantic fields of a subclass are its options in a scenario.

    It has ``init``, ``update`` and ``merge`` of its own, with sums of any type that can be pickled, or names in
    ``shared`` the sums that it has in common with others; and it has ``finish``.

    ``init`` is given a :class:`Scope`. ``update`` is given the chunks of a block where identities are known, and one
    :class:`~trackbench.metrics.traffic.TrackedRun` after the other where they are hidden.
    """

    name: ClassVar[str]
    """Dotted path in a tracker's metrics."""
    unit: ClassVar[str]
    """ "1" for a number without a unit."""
    meaning: ClassVar[str]
    """In one line."""
    needs: ClassVar[Set[str]] = frozenset({"labels", "truth"})
    """Which of ``PROPERTIES`` a scenario must have."""
    better: ClassVar[Direction | None] = None
    """Which values are better; None where neither is."""
    ranks: ClassVar[bool] = False
    """Whether trackers are ranked by it, where there is no other wish."""
    compared: ClassVar[bool] = True
    """Whether trackers are compared by it, run by run, where one direction is better."""
    per_sensor: ClassVar[bool] = False
    """Whether each sensor has a value."""
    fields: ClassVar[tuple[Field, ...]] = ()
    """What an expectation may name beside the value."""
    value_name: ClassVar[str] = ""
    """How an expectation names the value; empty where it is the metric itself."""
    shared: ClassVar[Accumulator | None] = None
    """The sums that it is made of; None where they are its own."""
    of_squares: ClassVar[bool] = False
    """Whether ``update`` looks at no more of a chunk than :class:`SquaredErrors` have."""
    of_density: ClassVar[bool] = False
    """Whether ``update`` looks at the log densities of innovations."""
    at_least: ClassVar[float] = -np.inf
    """What its mean over runs cannot be below."""
    at_most: ClassVar[float] = np.inf
    """What it cannot be above."""

    @property
    def accumulator(self) -> Accumulator:
        """What sums for this metric."""
        return self.shared or self

    def reference_axes(self, path: str, sums: Any) -> float:
        """How many times the squared error of the reference along an axis is in the squared value, where it is one."""
        return AXES.get(path, 0.0)

    def init(self, scope: Any) -> Any:
        """The sums before the first chunk of a block of runs."""
        raise NotImplementedError

    def update(self, sums: Any, chunk: Any) -> Any:
        """The sums with one more chunk; they may be changed in place."""
        raise NotImplementedError

    def close(self, sums: Any) -> Any:
        """What is kept of a block after its last chunk."""
        return sums

    def merge(self, blocks: Sequence[Any]) -> Any:
        """The sums of consecutive blocks of runs as one."""
        raise NotImplementedError

    @abstractmethod
    def finish(self, sums: Any) -> Outcome | Mapping[str, Outcome]:
        """The value from the merged sums of all runs; by sensor if each has one.

        A mean over runs is an :class:`~trackbench.metrics.Interval`: its confidence interval, and the differences
        between trackers, follow from what each run adds to it.
        """

    def without_charged(self, sums: Any) -> tuple[float, float] | None:
        """Share of the squared error that is charged for missing estimates, and the value without it.

        None where none is missing or none was given, and of a metric that does not tell it.
        """
        return None

    def no_value(self, reason: str) -> MetricValue:
        """What stands in a result where there is none."""
        return MetricValue(unit=self.unit, reason=reason)

    @property
    def path(self) -> str:
        """How an expectation and a comparison name the value."""
        path = f"{self.name}.{SENSOR}" if self.per_sensor else self.name
        return f"{path}.{self.value_name}" if self.value_name else path

    @property
    def columns(self) -> tuple[str, ...]:
        """Columns of the table of runs that hold it: values, number of terms of each, and others that it needs.

        Empty where the runs do not tell it.
        """
        return () if self.shared is not None or self.per_sensor else (run_column(self.name),)

    def in_runs(self, path: str, sums: Any, interval: Interval | None, runs: int) -> dict[str, Array]:
        """``(runs,)`` each, what the table of runs holds of one with sums of its own, by column.

        Args:
            path: of its value, or of that of a sensor.
            sums: the merged sums.
            interval: of the value; None where it is no mean over runs.
            runs: how many there are.
        """
        return {run_column(path): np.full(runs, np.nan) if interval is None else interval.value + interval.influence}

    def of_runs(self, *columns: Array) -> Interval | None:
        """The metric from its ``columns`` ``(runs,)`` of some runs; None where there is nothing to compare."""
        (values,) = columns
        if not np.isfinite(values).all():
            return None
        return ratio(values, np.ones(len(values)), at_least=self.at_least, at_most=self.at_most)

    def entries(self) -> list[Field]:
        """What an expectation may name of it."""
        path = f"{self.name}.{SENSOR}" if self.per_sensor else self.name
        compared = self.compared and self.better is not None
        value = Field(self.path, self.meaning, (), self.unit, self.better, compared, self.needs)
        parts = [
            Field(f"{path}.{part.name}", *part[1:3], unit="" if part.words else part.unit, needs=self.needs)
            for part in self.fields
        ]
        return [value, *parts]


def run_column(path: str) -> str:
    """Where the table of runs holds a metric with sums of its own. Its mean is the metric, unless a number of terms
    is beside it."""
    return f"{path}_per_run"
