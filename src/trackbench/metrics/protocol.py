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
    """``(instants,)`` time of each instant, s."""
    state: Array
    """``(4, instants, objects, runs or 1)`` true px, py, vx, vy."""
    alive: Mask
    """``(instants, objects)`` where the object exists."""
    due: Mask
    """``(instants, objects, runs)`` where a tracker should have an estimate, and is scored: the object is there, was
    detected, its track had time to settle, and a sensor has the object in view or had it in view not long ago."""
    starting: Mask
    """``(instants, objects, runs)`` where an object is in the first second after its first detection, or after its
    first detection since a long loss of view."""
    divergence: float
    """Limit on the position error, m: a run has diverged if an error exceeds the limit."""
    reference: Array
    """``(2, instants, objects, runs or 1)`` Cramér-Rao bound of the squared error of position, m^2, and of velocity,
    (m/s)^2, for objects with white acceleration. For objects that move otherwise it is a reference, no bound."""

    def each(self, mask: Mask) -> Mask:
        """Reshape a mask of this target, such as ``due``, to ``(instants, objects * runs)``."""
        return mask.reshape(len(self.time), -1)


@dataclass(frozen=True)
class Scope:
    """Data of a block of runs that a metric gets before the first estimate or track; the arrays must not be changed."""

    tracker: str
    """Name of the tracker that is scored."""
    runs: int
    """Number of runs in the block, or of stretches of time of a run that are scored separately."""
    bodies: EgoScene | None = None
    """Motion of the vehicle that carries the sensors, and sizes of the objects."""
    options: TrafficScoreOptions | None = None
    """Criteria by which a track is scored, such as the cutoff distance; None with known identities."""
    target: Target | None = None
    """Ground truth that estimates are compared with; None with hidden identities."""
    classes: Classes | None = None
    """``(instants, objects, runs or 1)`` class of each estimate by manoeuvre, range, age and velocity jump; None with
    hidden identities."""
    measurements: Mapping[str, int] = field(default_factory=dict)
    """Number of instants at which each sensor measures, by sensor; empty with hidden identities."""
    single: bool = False
    """Whether the block is a single run whose stretches of time stand for independent runs."""
    compute: Compute = by_numpy
    """Function that evaluates the equations of metrics, with NumPy or with compiled kernels."""

    @property
    def labelled(self) -> Target:
        """Ground truth that estimates are compared with, as ``target``, which is never None with known identities."""
        assert self.target is not None
        return self.target


class Innovation(NamedTuple):
    """Whitened innovations of a tracker at one scan, with masks of scored and of expected innovations."""

    instant: int
    whitened: Array | None
    """``(m, batch)`` innovation in units of its standard deviations; None where the tracker gives no innovation."""
    used: Mask
    """``(batch,)`` where the measurement is valid and the estimate is scored."""
    due: Mask
    """``(batch,)`` where an innovation should exist: the measurement is used, and the tracker had an estimate before
    it."""
    log_density: Array | None = None
    """``(batch,)`` log density of the measurement under the prediction; None where the tracker gives no innovation, or
    no metric is ``of_density``."""


@dataclass(frozen=True)
class Chunk:
    """Estimates of one tracker at some successive instants.

    The batch has a member for each pair of object and run; the runs of one object are neighbours. The arrays belong to
    the scorer: they must not be changed, and hold other values after ``update``.
    """

    instants: slice
    time: Array
    """``(instants,)`` time of each instant, s."""
    truth: Array
    """``(4, instants, objects, runs or 1)`` true px, py, vx, vy."""
    mean: Array
    """``(4, instants, batch)`` estimated px, py, vx, vy; for a missing estimate, the state charged for it."""
    covariance: Array
    """``(4, 4, instants, batch)`` covariance of the estimates that were given."""
    values: Array
    """``(15, instants, batch)`` terms that the built-in metrics sum: squared errors, NEES and the other rows of
    ``ERROR_FIELDS``; 0 where not scored."""
    scored: Mask
    """``(instants, batch)`` where an estimate is due and scored; elsewhere the other arrays can hold arbitrary
    values."""
    given: Mask
    """``(instants, batch)`` where the tracker gave an estimate; a score of covariances counts only there."""
    innovations: Mapping[str, Sequence[Innovation]]
    """Whitened innovations at each scan, by name of the sensor, in order of time."""
    repaired: Array
    """``(runs,)`` number of covariances that were repaired in each run."""
    seconds: float
    """Computing time of the tracker for these estimates, s."""
    steps: int
    """Number of steps, of one object in one run each, that the computing time was spent on."""

    @cached_property
    def error(self) -> Array:
        """``(4, instants, batch)`` error of each estimate: estimate minus truth in px, py, vx, vy."""
        error = self.mean.reshape(*self.mean.shape[:2], -1, self.runs) - self.truth
        return error.reshape(self.mean.shape)

    @property
    def nees(self) -> Array:
        """``(instants, batch)`` NEES of each estimate; 0 where not scored."""
        nees: Array = self.values[ERROR["nees"]]
        return nees

    @property
    def runs(self) -> int:
        return len(self.repaired)

    def by_run(self, values: Array | float) -> Array:
        """Sum values ``(instants, batch)`` over each run's scored estimates, ``(runs,)``; 1 counts estimates."""
        total = np.where(self.scored, values, 0.0).sum(axis=0)
        return np.asarray(total.reshape(-1, self.runs).sum(axis=0))

    @cached_property
    def squares(self) -> Array:
        """``(2, instants, batch)`` squared errors of position and velocity; 0 where not scored."""
        rows = self.values
        return np.stack([rows[ERROR["px"]] + rows[ERROR["py"]], rows[ERROR["vx"]] + rows[ERROR["vy"]]])


class SquaredErrors(NamedTuple):
    """Squared errors of a ``Chunk``, for metrics that read nothing else of it (``of_squares``)."""

    instants: slice
    squares: Array
    scored: Mask
    given: Mask
    runs: int
    seconds: float
    steps: int


class Fault(Exception):
    """Error for an estimate that cannot be scored: cause, instant, and index in the batch of objects and runs."""

    def __init__(self, cause: str, instant: int, member: int | None) -> None:
        super().__init__(cause)
        self.cause = cause
        self.instant = instant
        self.member = member


def raise_fault(cause: str, wrong: Mask, first: int) -> None:
    """Raise a Fault at the first True of ``wrong`` ``(instants, batch)``, whose first row is the instant ``first``."""
    if np.any(wrong):
        step, member = np.argwhere(wrong)[0]
        raise Fault(cause, first + int(step), int(member))


class Accumulator(Protocol):
    """Object that sums over a tracker's estimates for several metrics, with the methods of :class:`Metric`."""

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
    """Value of a metric, or part of the value such as a verdict, that an expectation in a scenario can name."""

    name: str
    """Dotted path, with ``<sensor>`` for a sensor's name; for an item of ``Metric.fields``, the last component of the
    path."""
    meaning: str
    words: tuple[str, ...] = ()
    """Words that a verdict can be, such as ``consistent``; empty for a number."""
    unit: str = "1"
    """Unit: "1" for a number without one, "" for a word."""
    better: Direction | None = None
    compared: bool = False
    """Whether two trackers are compared by this value, run by run (``better_than`` in an expectation)."""
    needs: Set[str] = frozenset()
    """Properties that a scenario must have: known ("labels") or hidden ("tracks") identities, "truth" or "no truth"."""

    @property
    def per_sensor(self) -> bool:
        return SENSOR in self.name


#: Number of axes in each root mean square error; the noise of a recorded truth enters once for each axis.
AXES = {"position_rmse": 2.0, "velocity_rmse": 2.0} | dict.fromkeys(("rmse.px", "rmse.py", "rmse.vx", "rmse.vy"), 1.0)


class Metric(Config):
    """One metric of a tracker, built in or not. The pydantic fields of a subclass are its options in a scenario.

    A metric has its own ``init``, ``update`` and ``merge``, with sums of any type that can be pickled, or it names in
    ``shared`` an accumulator whose sums other metrics use as well. It always has ``finish``.

    ``init`` gets a :class:`Scope`. ``update`` gets the chunks of a block one by one with known identities, and each
    :class:`~trackbench.metrics.traffic.TrackedRun` with hidden ones.
    """

    name: ClassVar[str]
    """Name of the metric: its dotted path in a tracker's metrics."""
    unit: ClassVar[str]
    """Unit of the value; "1" for a number without one."""
    meaning: ClassVar[str]
    """Explanation of the metric in one line."""
    needs: ClassVar[Set[str]] = frozenset({"labels", "truth"})
    """Properties that a scenario must have: known ("labels") or hidden ("tracks") identities, "truth" or "no truth"."""
    better: ClassVar[Direction | None] = None
    """Whether smaller or larger values are better; None where neither is."""
    ranks: ClassVar[bool] = False
    """Whether trackers are ranked by the metric by default."""
    compared: ClassVar[bool] = True
    """Whether trackers are compared run by run in this metric; without effect where neither direction is better."""
    per_sensor: ClassVar[bool] = False
    """Whether the metric has one value for each sensor."""
    fields: ClassVar[tuple[Field, ...]] = ()
    """Parts of the value, such as its verdict, that the scenario's ``expect:`` block can name."""
    value_name: ClassVar[str] = ""
    """Name of the value in an expectation; empty where the metric's path is enough."""
    shared: ClassVar[Accumulator | None] = None
    """Accumulator whose sums several metrics share; None where the metric has sums of its own."""
    of_squares: ClassVar[bool] = False
    """Whether ``update`` reads no more of a chunk than the fields of :class:`SquaredErrors`."""
    of_density: ClassVar[bool] = False
    """Whether ``update`` reads the log densities of innovations."""
    at_least: ClassVar[float] = -np.inf
    """Smallest possible value of the metric's mean over runs."""
    at_most: ClassVar[float] = np.inf
    """Largest possible value of the metric's mean over runs."""

    @property
    def accumulator(self) -> Accumulator:
        return self.shared or self

    def reference_axes(self, path: str, sums: Any) -> float:
        """Return the number of axes whose squared reference errors add to the metric's squared value.

        An RMSE of x and y has 2; the result is 0 for a metric that is not widened for errors of the truth.
        """
        return AXES.get(path, 0.0)

    def init(self, scope: Any) -> Any:
        """Return the sums with which a block of runs starts, before its first estimate or track."""
        raise NotImplementedError

    def update(self, sums: Any, chunk: Any) -> Any:
        """Return the sums with a chunk of estimates, or run of tracks, added; ``sums`` can be changed in place."""
        raise NotImplementedError

    def close(self, sums: Any) -> Any:
        """Return the sums of a block of runs, reduced to what ``merge`` needs; called after the last chunk."""
        return sums

    def merge(self, blocks: Sequence[Any]) -> Any:
        """Return the sums over all runs from the closed sums of consecutive blocks of runs."""
        raise NotImplementedError

    @abstractmethod
    def finish(self, sums: Any) -> Outcome | Mapping[str, Outcome]:
        """Return the metric's value from the merged sums of all runs; by sensor if ``per_sensor``.

        A mean over runs is an :class:`~trackbench.metrics.Interval`: its confidence interval, and the differences
        between trackers, follow from the influence of each run.
        """

    def without_charged(self, sums: Any) -> tuple[float, float] | None:
        """Return the share of the squared error charged for missing estimates, and the value without this charge.

        The result is None where no estimate is missing or no estimate was given, and for a metric without such a
        charge.
        """
        return None

    def no_value(self, reason: str) -> MetricValue:
        """Return a metric value for the result whose value is missing, with the reason."""
        return MetricValue(unit=self.unit, reason=reason)

    @property
    def path(self) -> str:
        """Dotted path by which expectations and comparisons name the value, such as ``nis.<sensor>``."""
        path = f"{self.name}.{SENSOR}" if self.per_sensor else self.name
        return f"{path}.{self.value_name}" if self.value_name else path

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns of the table of runs that give the metric: value in each run, number of terms.

        Empty where the metric does not follow from runs.
        """
        return () if self.shared is not None or self.per_sensor else (run_column(self.name),)

    def in_runs(self, path: str, sums: Any, interval: Interval | None, runs: int) -> dict[str, Array]:
        """Return the metric's columns ``(runs,)`` of the table of runs, by name; empty if other metrics share its sums.

        Args:
            path: path of the value; with one value per sensor, path of the value for a sensor.
            sums: the merged sums.
            interval: interval of the value; None where the value is no mean over runs.
            runs: number of runs.
        """
        return {run_column(path): np.full(runs, np.nan) if interval is None else interval.value + interval.influence}

    def of_runs(self, *columns: Array) -> Interval | None:
        """Compute the metric over some runs from their ``columns``, ``(runs,)`` each; None if no run gives a value."""
        (values,) = columns
        if not np.isfinite(values).all():
            return None
        return ratio(values, np.ones(len(values)), at_least=self.at_least, at_most=self.at_most)

    def entries(self) -> list[Field]:
        """Return the metric's values, and parts of the values such as a verdict, that an expectation can name."""
        path = f"{self.name}.{SENSOR}" if self.per_sensor else self.name
        compared = self.compared and self.better is not None
        value = Field(self.path, self.meaning, (), self.unit, self.better, compared, self.needs)
        parts = [
            Field(f"{path}.{part.name}", *part[1:3], unit="" if part.words else part.unit, needs=self.needs)
            for part in self.fields
        ]
        return [value, *parts]


def run_column(path: str) -> str:
    """Return the name of the metric's column in the table of runs, if no other metric shares its sums.

    The mean of the column is the metric, unless another column has numbers of terms.
    """
    return f"{path}_per_run"
