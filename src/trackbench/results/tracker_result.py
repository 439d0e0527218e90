"""What came of a tracker, in ``result.json``."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from pydantic import Field

from trackbench.base.errors import nearest_choices
from trackbench.engine.equations import ComputedBy
from trackbench.results.metric_value import Metrics, MetricsByPath, MetricValue, ResultModel
from trackbench.results.scenario_summary import ReferenceSummary

#: Error over the Cramer-Rao bound below which the bound is beaten: a biased estimator may be a little below it.
LEAST_OVER_BOUND = 0.97
BEATS_BOUND = "beats the Cramér-Rao bound: it knows more than its measurements say"
#: How a tracker associates that knows the true origin of each detection.
ORACLE = "oracle"


class Failure(ResultModel):
    """Why and where a tracker could not go on."""

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
    """What went wrong without ending the run; None where the tracker failed before it could be counted."""

    diverged_runs: int | None = None
    repaired_covariances: int | None = None
    repaired_runs: int | None = None
    non_finite_estimates: int = 0
    missing_estimates: int | None = None
    """How many of the estimates that were due it did not give; None where identities are hidden."""
    reused_ids: int | None = None
    """Identities that were used again after their track had ended; None where identities are known."""


class ConditionScores(ResultModel):
    """Scores of the estimates under one condition."""

    count: int
    """Number of errors."""
    given: int
    """Number of errors of an estimate that the tracker gave."""
    runs: int
    metrics: Metrics = Field(default_factory=MetricsByPath)
    """Errors, the NEES and its parts along and across the motion, and shares of the NEES beyond points of chi-square
    where there are enough estimates; by path."""


class FiledRows(ResultModel):
    """What was taken of a file of tracks."""

    rows: int
    """In the file."""
    outside: int
    """Of the runs that were scored, those outside the time of the truth, which are left out."""
    silent_runs: int
    """Runs of which there are none: what is due in them is missed."""
    remarks: tuple[str, ...] = ()
    """Contradictions within the file or with the truth, each with what to do about it."""


class TrackerResult(ResultModel):
    """What one tracker reached. Its metrics are attributes: ``tracker.position_rmse``."""

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
    """Number in the scenario file, from 0, which gives the colour."""
    describe: str
    association: str | None = None
    """How a built-in tracker of several objects associates; None of any other."""
    baseline: bool = False
    """Whether it filters nothing, which is what any tracker has to beat."""
    sensors: list[str] | None = None
    """Names of those that it reads; None: all."""
    confirmation: str | None = None
    """What confirms its tracks, such as "3 of 5"; None of any other."""
    smoother: str | None = None
    """Of a built-in filter whose estimates are made of all measurements of the run; None of any other tracker."""
    engine: ComputedBy | None = None
    """What computed a built-in filter; None of any other tracker, and in results that do not say it."""
    random: bool = False
    """Whether it says that it draws random numbers, so that it is not asked again."""
    offline: bool = False
    """Whether its tracks were made elsewhere: nothing shows that they were made without the measurements to come."""
    paired: bool = True
    """False of tracks made elsewhere that do not say of which scans: they are compared with no tracker."""
    time_offset: MetricValue | None = None
    """Of tracks made elsewhere, what has to be added to their time stamps for the least error along the path, beside a
    shift along it, s."""
    offset_shown: bool = False
    """Whether the interval of the offset excludes 0, and the offset is a part of the error that matters."""
    filed: FiledRows | None = None
    """Of tracks made elsewhere."""
    failed: Failure | None
    metrics: Metrics
    """By dotted path, such as ``position_rmse``, ``rmse.px`` or ``nis.front_radar``."""
    health: Health
    conditions: dict[str, ConditionScores] = Field(default_factory=dict)
    """Scores of all estimates, named "", and under each condition that occurred, such as "manoeuvre: braking" or
    "range: 20 to 50 m". Empty where identities are hidden."""

    @property
    def reference_kind(self) -> str:
        """In a word, why it is no competitor: it knows what no tracker knows. Empty of one that is a competitor."""
        if self.smoother is not None:
            return "offline"
        return "reference" if self.association == ORACLE else ""

    @property
    def is_reference(self) -> bool:
        """Whether it is no competitor."""
        return bool(self.reference_kind)

    @property
    def below_reference(self) -> bool:
        """Whether its position error is shown to be below the reference, by more than ``LEAST_OVER_BOUND`` allows."""
        ratio = self.metrics.get("position_over_reference")
        return ratio is not None and ratio.ci95 is not None and ratio.ci95[1] < LEAST_OVER_BOUND

    def beats_bound(self, reference: ReferenceSummary | None) -> bool:
        """Whether it is no smoother, and shown to be below a Cramer-Rao bound of motion that no tracker can expect."""
        is_drawn = reference is not None and reference.kind == "bound" and reference.acceleration_sigma_mps2 > 0
        return is_drawn and self.below_reference and not self.is_reference

    @property
    def marks(self) -> tuple[str, ...]:
        """What a reader must know beside its name, in words."""
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
        """Return the names of its metrics and fields, without the methods of pydantic."""
        own = [name for name, value in vars(type(self)).items() if not name.startswith("_") and callable(value)]
        properties = [name for name, value in vars(type(self)).items() if isinstance(value, property)]
        return [*(path for path in self.metrics if path.isidentifier()), *type(self).model_fields, *own, *properties]
