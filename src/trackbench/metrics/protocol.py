"""Interface of a metric: its name, unit and direction, its sums over the estimates, and its value from the sums."""

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
#: Return value of ``finish`` for one path; None where there is no value.
Outcome = Interval | MetricValue | float | None


class Target(NamedTuple):
    """Ground truth that the estimates of a block of runs are compared with, at each instant of a scan."""

    time: Array
    """``(instants,)`` s."""
    state: Array
    """``(4, instants, objects, runs or 1)`` px, py, vx, vy."""
    alive: Mask
    """``(instants, objects)``"""
    due: Mask
    """``(instants, objects, runs)`` where a tracker should have an estimate, and is scored: the object is there, was
    detected, its track had time to settle, and a sensor has it in view or had it not long ago."""
    starting: Mask
    """``(instants, objects, runs)`` first second after an object's first detection, or after its first detection since
    it was out of view for long."""
    divergence: float
    """Position error above which a run has diverged, m."""
    reference: Array
    """``(2, instants, objects, runs or 1)`` reference squared error of position, m^2, and of velocity, (m/s)^2."""

    def each(self, mask: Mask) -> Mask:
        """Reshape a mask of this target, such as ``due``, to ``(instants, objects * runs)``."""
        return mask.reshape(len(self.time), -1)


@dataclass(frozen=True)
class Scope:
    """Block of runs, as a metric knows it before the first estimate or track; its arrays must not be changed."""

    tracker: str
    """Name of the tracker that is scored."""
    runs: int
    """Number of runs, or of stretches of a run that are scored separately."""
    bodies: EgoScene | None = None
    """Ego and sizes of the objects."""
    options: TrafficScoreOptions | None = None
    """Criteria by which a track is scored; None with known identities."""
    target: Target | None = None
    """Ground truth that estimates are compared with; None with hidden identities."""
    classes: Classes | None = None
    """Result of :func:`trackbench.metrics.conditions.condition_classes`; None with hidden identities."""
    measurements: Mapping[str, int] = field(default_factory=dict)
    """Number of instants of each sensor; empty with hidden identities."""
    single: bool = False
    """Whether the block is a single run whose stretches of time stand for independent runs."""
    compute: Compute = by_numpy
    """Function that computes equations."""

    @property
    def labelled(self) -> Target:
        """Target of a scope with known identities."""
        assert self.target is not None
        return self.target


class Innovation(NamedTuple):
    """Innovations of a tracker at one scan."""

    instant: int
    whitened: Array | None
    """``(m, batch)`` innovation in units of its own standard deviations; None where the tracker gives none."""
    used: Mask
    """``(batch,)`` where the measurement is valid and the estimate is scored."""
    due: Mask
    """``(batch,)`` where an innovation should exist: it is used, and the tracker had an estimate before."""
    log_density: Array | None = None
    """``(batch,)`` log density of the measurement under the prediction; None where the tracker gives no innovation, or
    no metric is ``of_density``."""


@dataclass(frozen=True)
class Chunk:
    """Estimates of one tracker at some successive instants.

    The batch has a member for each object and run; the runs of an object are neighbours. The arrays belong to the
    scorer: they must not be changed, and hold other values after ``update``.
    """

    instants: slice
    time: Array
    """``(instants,)`` s."""
    truth: Array
    """``(4, instants, objects, runs or 1)`` px, py, vx, vy."""
    mean: Array
    """``(4, instants, batch)`` estimate; if missing, the state charged for it (``metrics.missing_estimates``)."""
    covariance: Array
    """``(4, 4, instants, batch)`` covariance of the estimates that were given."""
    values: Array
    """``(15, instants, batch)`` rows ``ERROR_FIELDS``, which the built-in metrics sum; 0 where not scored."""
    scored: Mask
    """``(instants, batch)`` where an estimate is due and its error counts; other arrays may hold anything elsewhere."""
    given: Mask
    """``(instants, batch)`` where the tracker gave an estimate; a score of covariances counts only there."""
    innovations: Mapping[str, Sequence[Innovation]]
    """Innovations by sensor, in order of time."""
    repaired: Array
    """``(runs,)`` number of covariances that were repaired."""
    seconds: float
    """Time spent in the tracker."""
    steps: int
    """Number of steps of single objects in this time."""

    @cached_property
    def error(self) -> Array:
        """``(4, instants, batch)`` estimate minus truth."""
        error = self.mean.reshape(*self.mean.shape[:2], -1, self.runs) - self.truth
        return error.reshape(self.mean.shape)

    @property
    def nees(self) -> Array:
        """NEES, ``(instants, batch)``."""
        nees: Array = self.values[ERROR["nees"]]
        return nees

    @property
    def runs(self) -> int:
        return len(self.repaired)

    def by_run(self, values: Array | float) -> Array:
        """Sum values ``(instants, batch)`` over the scored estimates of each run, ``(runs,)``; 1 counts the errors."""
        total = np.where(self.scored, values, 0.0).sum(axis=0)
        return np.asarray(total.reshape(-1, self.runs).sum(axis=0))

    @cached_property
    def squares(self) -> Array:
        """``(2, instants, batch)`` squared errors of position and velocity; 0 where not scored."""
        rows = self.values
        return np.stack([rows[ERROR["px"]] + rows[ERROR["py"]], rows[ERROR["vx"]] + rows[ERROR["vy"]]])


class SquaredErrors(NamedTuple):
    """Part of a ``Chunk`` that metrics with ``of_squares`` read."""

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
    """Raise a Fault at the first wrong estimate ``(instants, batch)``; ``first`` is the number of the first instant."""
    if np.any(wrong):
        step, member = np.argwhere(wrong)[0]
        raise Fault(cause, first + int(step), int(member))


class Accumulator(Protocol):
    """Sums over the estimates of one tracker that several metrics share, with the methods of :class:`Metric`."""

    @property
    def name(self) -> str: ...

    def init(self, scope: Any) -> Any: ...

    def update(self, sums: Any, chunk: Any) -> Any: ...

    def close(self, sums: Any) -> Any: ...

    def merge(self, blocks: Sequence[Any]) -> Any: ...


#: Properties of a scenario: known identities (``labels``) or hidden identities (``tracks``); with or without a truth.
PROPERTIES = frozenset({"labels", "tracks", "truth", "no truth"})
#: Placeholder in a path for a sensor's name.
SENSOR = "<sensor>"


class Field(NamedTuple):
    """Value of a metric, or part of the value, that an expectation may name."""

    name: str
    """Dotted path, with ``<sensor>`` for a sensor's name; of a part in ``Metric.fields``, its last component."""
    meaning: str
    words: tuple[str, ...] = ()
    """Possible values of a verdict; empty for a number."""
    unit: str = "1"
    """Unit: "1" for a number without one, "" for a word."""
    better: Direction | None = None
    compared: bool = False
    """Whether two trackers are compared by it, run by run (``better_than``)."""
    needs: Set[str] = frozenset()
    """Members of ``PROPERTIES`` that a scenario must have."""

    @property
    def per_sensor(self) -> bool:
        return SENSOR in self.name


#: Number of axes in each root mean square error; the noise of a recorded truth enters once for each axis.
AXES = {"position_rmse": 2.0, "velocity_rmse": 2.0} | dict.fromkeys(("rmse.px", "rmse.py", "rmse.vx", "rmse.vy"), 1.0)


class Metric(Config):
    """One metric of a tracker, built in or not. The pydantic fields of a subclass are its options in a scenario.

    A metric has its own ``init``, ``update`` and ``merge``, with sums of any type that can be pickled, or it names in
    ``shared`` an accumulator that other metrics use too. It always has ``finish``.

    ``init`` gets a :class:`Scope`. ``update`` gets the chunks of a block one by one with known identities, and each
    :class:`~trackbench.metrics.traffic.TrackedRun` with hidden ones.
    """

    name: ClassVar[str]
    """Dotted path in a tracker's metrics."""
    unit: ClassVar[str]
    """Unit; "1" for a number without one."""
    meaning: ClassVar[str]
    """Meaning in one line."""
    needs: ClassVar[Set[str]] = frozenset({"labels", "truth"})
    """Members of ``PROPERTIES`` that a scenario must have."""
    better: ClassVar[Direction | None] = None
    """Better direction; None where neither is better."""
    ranks: ClassVar[bool] = False
    """Whether trackers are ranked by it by default."""
    compared: ClassVar[bool] = True
    """Whether trackers are compared by it, run by run, where one direction is better."""
    per_sensor: ClassVar[bool] = False
    """Whether each sensor has a value."""
    fields: ClassVar[tuple[Field, ...]] = ()
    """Parts of the value that an expectation may name."""
    value_name: ClassVar[str] = ""
    """Name of the value in an expectation; empty where the metric's path is enough."""
    shared: ClassVar[Accumulator | None] = None
    """Accumulator of the sums; None where the metric has its own."""
    of_squares: ClassVar[bool] = False
    """Whether ``update`` reads no more of a chunk than :class:`SquaredErrors` have."""
    of_density: ClassVar[bool] = False
    """Whether ``update`` reads the log densities of innovations."""
    at_least: ClassVar[float] = -np.inf
    """Lower limit of the mean over runs."""
    at_most: ClassVar[float] = np.inf
    """Upper limit of the mean over runs."""

    @property
    def accumulator(self) -> Accumulator:
        """Accumulator of the sums of this metric."""
        return self.shared or self

    def reference_axes(self, path: str, sums: Any) -> float:
        """Return how often the squared error of the reference along an axis is part of the squared value."""
        return AXES.get(path, 0.0)

    def init(self, scope: Any) -> Any:
        """Return the sums before the first chunk of a block of runs."""
        raise NotImplementedError

    def update(self, sums: Any, chunk: Any) -> Any:
        """Return the sums with one more chunk; they may be changed in place."""
        raise NotImplementedError

    def close(self, sums: Any) -> Any:
        """Return the sums of a block to be kept after its last chunk."""
        return sums

    def merge(self, blocks: Sequence[Any]) -> Any:
        """Merge the sums of consecutive blocks of runs."""
        raise NotImplementedError

    @abstractmethod
    def finish(self, sums: Any) -> Outcome | Mapping[str, Outcome]:
        """Return the value from the merged sums of all runs; by sensor if each has one.

        A mean over runs is an :class:`~trackbench.metrics.Interval`: its confidence interval, and the differences
        between trackers, follow from the influence of each run.
        """

    def without_charged(self, sums: Any) -> tuple[float, float] | None:
        """Return the share of the squared error that is charged for missing estimates, and the value without it.

        None where no estimate is missing or none was given, and for a metric without such a charge.
        """
        return None

    def no_value(self, reason: str) -> MetricValue:
        """Return the entry of a result for a missing value."""
        return MetricValue(unit=self.unit, reason=reason)

    @property
    def path(self) -> str:
        """Path of the value in expectations and comparisons."""
        path = f"{self.name}.{SENSOR}" if self.per_sensor else self.name
        return f"{path}.{self.value_name}" if self.value_name else path

    @property
    def columns(self) -> tuple[str, ...]:
        """Columns of the table of runs from which the metric follows: values, number of terms, and others.

        Empty where the metric does not follow from runs.
        """
        return () if self.shared is not None or self.per_sensor else (run_column(self.name),)

    def in_runs(self, path: str, sums: Any, interval: Interval | None, runs: int) -> dict[str, Array]:
        """Return the columns ``(runs,)`` of the table of runs for a metric with sums of its own.

        Args:
            path: path of the value, or of its value for a sensor.
            sums: the merged sums.
            interval: interval of the value; None where the value is no mean over runs.
            runs: number of runs.
        """
        return {run_column(path): np.full(runs, np.nan) if interval is None else interval.value + interval.influence}

    def of_runs(self, *columns: Array) -> Interval | None:
        """Compute the metric from its ``columns`` ``(runs,)`` of some runs; None where there is nothing to compare."""
        (values,) = columns
        if not np.isfinite(values).all():
            return None
        return ratio(values, np.ones(len(values)), at_least=self.at_least, at_most=self.at_most)

    def entries(self) -> list[Field]:
        """Return the fields that an expectation may name."""
        path = f"{self.name}.{SENSOR}" if self.per_sensor else self.name
        compared = self.compared and self.better is not None
        value = Field(self.path, self.meaning, (), self.unit, self.better, compared, self.needs)
        parts = [
            Field(f"{path}.{part.name}", *part[1:3], unit="" if part.words else part.unit, needs=self.needs)
            for part in self.fields
        ]
        return [value, *parts]


def run_column(path: str) -> str:
    """Return the column of the table of runs for a metric with sums of its own.

    The mean of the column is the metric, unless another column has numbers of terms.
    """
    return f"{path}_per_run"
