"""Result of one tracker, in ``result.json``."""

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
    """Failure of a tracker: cause and place."""

    cause: str
    place: str | None = None
    """File, line and function in the tracker's code, where they are known."""
    step: int
    """Number of the instant, from 0."""
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
    """Counts of faults that did not end the run; None where the tracker failed before they were counted."""

    diverged_runs: int | None = None
    repaired_covariances: int | None = None
    repaired_runs: int | None = None
    non_finite_estimates: int = 0
    missing_estimates: int | None = None
    """Number of due estimates that were not given; None with hidden identities."""
    reused_ids: int | None = None
    """Number of ids that were used again after their track had ended; None with known identities."""


class ConditionScores(ResultModel):
    """Scores of the estimates under one condition."""

    count: int
    """Number of errors."""
    given: int
    """Number of errors of given estimates; the others are charged for missing estimates."""
    runs: int
    metrics: Metrics = Field(default_factory=MetricsByPath)
    """Errors, the NEES and its parts along and across the motion, and shares of the NEES beyond points of chi-square
    where there are enough estimates; by path."""


class FiledRows(ResultModel):
    """Rows of a file of tracks that were scored or left out."""

    rows: int
    outside: int
    """Number of rows of scored runs outside the time of the truth, which are left out."""
    silent_runs: int
    """Number of runs without a row: what is due in them is missed."""
    remarks: tuple[str, ...] = ()
    """Contradictions within the file or with the truth, each with what to do about it."""


class TrackerResult(ResultModel):
    """Result of one tracker. Its metrics are attributes: ``tracker.position_rmse``."""

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
    """Place in the scenario file, from 0, which gives the colour."""
    describe: str
    association: str | None = None
    """Association of a built-in tracker with hidden identities; None for any other tracker."""
    baseline: bool = False
    """Whether it filters nothing, as the least that any tracker has to beat."""
    sensors: list[str] | None = None
    """Names of the sensors that the tracker uses; None for all."""
    confirmation: str | None = None
    """Rule that confirms tracks, such as "3 of 5"; None for a tracker without one."""
    smoother: str | None = None
    """Smoother of a built-in filter, whose estimates use all measurements of the run; None for any other tracker."""
    engine: ComputedBy | None = None
    """Engine that computed a built-in filter; None for any other tracker, and in results that do not say it."""
    random: bool = False
    """Whether the tracker declares that it draws random numbers, so that no second drive checks its estimates."""
    offline: bool = False
    """Whether its tracks were made elsewhere: nothing shows that they were made without later measurements."""
    paired: bool = True
    """False for tracks made elsewhere from unknown scans, which are compared with no tracker."""
    time_offset: MetricValue | None = None
    """Time to add to the time stamps of tracks made elsewhere for the least error along the path, s; a constant shift
    along the path is allowed for."""
    offset_shown: bool = False
    """Whether the interval of the offset excludes 0, and the offset is a part of the error that matters."""
    filed: FiledRows | None = None
    """Rows of the file of tracks made elsewhere; None for any other tracker."""
    failed: Failure | None
    metrics: Metrics
    """Metrics by dotted path, such as ``position_rmse``, ``rmse.px`` or ``nis.front_radar``."""
    health: Health
    conditions: dict[str, ConditionScores] = Field(default_factory=dict)
    """Scores of all estimates, named "", and under each condition that occurred, such as "manoeuvre: braking" or
    "range: 20 to 50 m". Empty with hidden identities."""

    @property
    def reference_kind(self) -> str:
        """Kind of reference, if the tracker knows what no tracker can know; empty for a competitor."""
        if self.smoother is not None:
            return "offline"
        return "reference" if self.association == ORACLE else ""

    @property
    def is_reference(self) -> bool:
        return bool(self.reference_kind)

    @property
    def below_reference(self) -> bool:
        """Whether the position error over the reference is shown to be below ``LEAST_OVER_BOUND``."""
        ratio = self.metrics.get("position_over_reference")
        return ratio is not None and ratio.ci95 is not None and ratio.ci95[1] < LEAST_OVER_BOUND

    def beats_bound(self, reference: ReferenceSummary | None) -> bool:
        """Return whether a tracker that is no reference is shown to be below the Cramer-Rao bound of random motion."""
        is_drawn = reference is not None and reference.kind == "bound" and reference.acceleration_sigma_mps2 > 0
        return is_drawn and self.below_reference and not self.is_reference

    @property
    def marks(self) -> tuple[str, ...]:
        """Words that stand beside the tracker's name, such as "random"."""
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
        """Return the names of metrics and fields, without the methods of pydantic."""
        methods = [name for name, value in vars(type(self)).items() if not name.startswith("_") and callable(value)]
        properties = [name for name, value in vars(type(self)).items() if isinstance(value, property)]
        return [*filter(str.isidentifier, self.metrics), *type(self).model_fields, *methods, *properties]
