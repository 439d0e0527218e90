"""Metrics, description, and failure or fault counts of one tracker, as ``result.json`` holds them."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from pydantic import Field

from trackbench.base.errors import nearest_choices
from trackbench.engine.equations import ComputedBy
from trackbench.results.metric_value import Metrics, MetricsByPath, MetricValue, ResultModel
from trackbench.results.scenario_summary import ReferenceSummary

#: Ratio of error to Cramer-Rao bound below which the bound is beaten: a biased estimator may be a little below it.
LEAST_OVER_BOUND = 0.97
BEATS_BOUND = "beats the Cramér-Rao bound: it knows more than its measurements say"
#: Association by the true origin of each detection.
ORACLE = "oracle"


class Failure(ResultModel):
    """Failure that ended a tracker: its cause, where in the code, and at which instant, run and object."""

    cause: str
    place: str | None = None
    """File, line and function in the tracker's code; None where they are unknown."""
    step: int
    """Index from 0 of the instant at which the tracker failed."""
    time_s: float
    sensor: str | None
    run: int | None
    object: str | None

    def __str__(self) -> str:
        place = [] if self.place is None else [self.place]
        place += [f"step {self.step}", f"{self.time_s:.2f} s"]
        named = {"sensor": self.sensor, "run": self.run, "object": self.object}
        place += [f"{what} {value}" for what, value in named.items() if value is not None]
        return f"{self.cause} ({', '.join(place)})"


class Health(ResultModel):
    """Counts of faults that did not end the run, such as diverged runs; None for a fault that was not counted."""

    diverged_runs: int | None = None
    repaired_covariances: int | None = None
    repaired_runs: int | None = None
    non_finite_estimates: int = 0
    missing_estimates: int | None = None
    """Number of estimates that the tracker should have given and did not; None with hidden identities."""
    reused_ids: int | None = None
    """Number of ids that the tracker used for a second track; None with known identities."""


class ConditionScores(ResultModel):
    """Errors and NEES of the estimates under one condition, such as a manoeuvre or a range band."""

    count: int
    """Number of scored errors: of estimates that were given and of missing estimates."""
    given: int
    """Number of errors of given estimates; the other errors are charged for missing estimates."""
    runs: int
    metrics: Metrics = Field(default_factory=MetricsByPath)
    """Metric values by path: errors, the NEES and its parts along and across the motion, and shares of the NEES beyond
    points of chi-square where estimates are enough."""


class FiledRows(ResultModel):
    """Counts of the rows in a file of tracks that were scored or left out."""

    rows: int
    outside: int
    """Number of rows in scored runs that are left out because their times are outside the time of the truth."""
    silent_runs: int
    """Number of runs without a row, in which all objects count as missed."""
    remarks: tuple[str, ...] = ()
    """Contradictions within the file or with the truth, each with advice on what to do."""


class TrackerResult(ResultModel):
    """Description, failure and metrics of one tracker. Metrics are attributes: ``tracker.position_rmse``."""

    if TYPE_CHECKING:
        # The built-in metrics; those of plug-ins are in ``metrics``, as are those of sensors and components.
        position_rmse: ClassVar[MetricValue]
        velocity_rmse: ClassVar[MetricValue]
        nees: ClassVar[MetricValue]
        position_over_reference: ClassVar[MetricValue]
        velocity_over_reference: ClassVar[MetricValue]
        coverage: ClassVar[MetricValue]
        step_time: ClassVar[MetricValue]
        tgospa: ClassVar[MetricValue]
        gospa: ClassVar[MetricValue]
        gospa_localisation: ClassVar[MetricValue]
        gospa_missed: ClassVar[MetricValue]
        gospa_false: ClassVar[MetricValue]
        hota: ClassVar[MetricValue]
        deta: ClassVar[MetricValue]
        assa: ClassVar[MetricValue]
        idf1: ClassVar[MetricValue]
        mota: ClassVar[MetricValue]
        id_switches: ClassVar[MetricValue]
        false_tracks: ClassVar[MetricValue]
        confirm_latency: ClassVar[MetricValue]
        never_confirmed: ClassVar[MetricValue]
        lost_time_share: ClassVar[MetricValue]
        nees_inside: ClassVar[MetricValue]
        matched_share: ClassVar[MetricValue]

    name: str
    place: int = 0
    """Index from 0 of the tracker in the scenario file, which selects its colour."""
    describe: str
    use: str | tuple[str, ...] | None = None
    """Tracker as the scenario names it: ``"module:Class"``, a published name, or the words of a command. None for a
    built-in filter, and in older results, which do not hold it."""
    association: str | None = None
    """Method of data association of a built-in tracker with hidden identities; None for any other tracker."""
    baseline: bool = False
    """Whether the tracker filters nothing, so that any filter has to beat it."""
    sensors: list[str] | None = None
    """Names of the sensors that the tracker uses; None where it uses all."""
    confirmation: str | None = None
    """Rule by which the tracker confirms tracks, such as "3 of 5"; None for a tracker without such a rule."""
    smoother: str | None = None
    """Smoother of a built-in filter, whose estimates use all measurements of the run; None for any other tracker."""
    engine: ComputedBy | None = None
    """Engine that computed a built-in filter; None for any other tracker, and in older results, which do not hold
    it."""
    random: bool = False
    """Whether the tracker declares that it uses random numbers, so that its estimates are not checked by a
    repetition."""
    offline: bool = False
    """Whether the tracks were made by another program: nothing shows that it used no later measurements."""
    paired: bool = True
    """False for tracks of another program that state no scans they were made of; such tracks are compared with no other
    tracker."""
    time_offset: MetricValue | None = None
    """Time to add to the time stamps of another program's tracks for the least error along the path, s, together with a
    constant shift along the path. None for any other tracker."""
    offset_shown: bool = False
    """Whether ``time_offset`` differs from 0 with statistical significance and makes up a substantial part of the
    error."""
    filed: FiledRows | None = None
    """Counts of the rows in the file of another program's tracks; None for any other tracker."""
    failed: Failure | None
    metrics: Metrics
    """Metrics by dotted path, such as ``position_rmse``, ``rmse.px`` or ``nis.front_radar``."""
    health: Health
    conditions: dict[str, ConditionScores] = Field(default_factory=dict)
    """Errors and NEES of all estimates, with the key "", and under each condition that occurred, such as "manoeuvre:
    braking". Empty with hidden identities."""

    @property
    def reference_kind(self) -> str:
        """``offline`` for a smoother, ``reference`` for association by true origins; empty for a competitor."""
        if self.smoother is not None:
            return "offline"
        return "reference" if self.association == ORACLE else ""

    @property
    def is_own(self) -> bool:
        """Whether the tracker is the user's: a class or a program, not a built-in filter or a published name."""
        return isinstance(self.use, tuple) or ":" in (self.use or "")

    @property
    def is_reference(self) -> bool:
        return bool(self.reference_kind)

    @property
    def below_reference(self) -> bool:
        """Whether the interval of position error over reference error is below 0.97 (``LEAST_OVER_BOUND``)."""
        ratio = self.metrics.get("position_over_reference")
        return ratio is not None and ratio.ci95 is not None and ratio.ci95[1] < LEAST_OVER_BOUND

    def beats_bound(self, reference: ReferenceSummary | None) -> bool:
        """Return whether a tracker that is no reference is shown to have errors below the Cramer-Rao bound."""
        is_drawn = reference is not None and reference.kind == "bound" and reference.acceleration_sigma_mps2 > 0
        return is_drawn and self.below_reference and not self.is_reference

    @property
    def marks(self) -> tuple[str, ...]:
        """Words shown beside the tracker's name, such as "random" for a tracker that uses random numbers."""
        words = self.reference_kind, "random" if self.random else "", "offline" if self.offline else ""
        return tuple(filter(None, words))

    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> MetricValue:
            metrics = self.__dict__.get("metrics", {})
            if name in metrics:
                return metrics[name]
            hint = nearest_choices(name, filter(str.isidentifier, metrics))
            raise AttributeError(f"{type(self).__name__!r} object has no attribute or metric {name!r}; {hint}")

    def __dir__(self) -> list[str]:
        """Return names of fields, of metrics that are identifiers, and of methods and properties except pydantic's."""
        methods = [name for name, value in vars(type(self)).items() if not name.startswith("_") and callable(value)]
        properties = [name for name, value in vars(type(self)).items() if isinstance(value, property)]
        return [*filter(str.isidentifier, self.metrics), *type(self).model_fields, *methods, *properties]
