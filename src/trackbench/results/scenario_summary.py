"""Description of a run in ``result.json``: scenario, truth with its audit, sensors, and scoring."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, ConfigDict, Field, JsonValue

from trackbench.base.config.key_units import option_in_words
from trackbench.base.errors import counted
from trackbench.results.metric_value import ResultModel


class VelocityMismatch(ResultModel):
    """Difference between stated velocities and velocities from displacements; None where nothing moves."""

    max_mps: float | None
    mean_mps: float | None
    object: str | None
    """Object with the largest difference."""
    time_s: float | None


class PositionJump(ResultModel):
    """Jump of a body that its velocity does not explain; its true path ends there."""

    object: str
    time_s: float
    distance_m: float


class VelocityJumps(ResultModel):
    """Jumps of a velocity: changes in one step that exceed what a car can do. They are counted, not corrected."""

    limit_mps2: float
    """Change of the velocity vector over the step's duration above which it is a jump."""
    count: int = 0
    """Number of jumps, in all runs of a random motion."""
    largest_mps: float | None = None
    """Change of the velocity vector in the largest jump."""
    object: str | None = None
    """Object of the largest jump, whose step ends at ``time_s``."""
    time_s: float | None = None
    peak_acceleration_mps2: float | None = None
    """Largest change of the velocity vector over the step's duration, jump or not."""


class EndedEarly(ResultModel):
    """Early end of a truth that is shorter than the scenario asks for."""

    time_s: float
    reason: str


class Repairs(ResultModel):
    """Corrections of a truth: names of the corrected objects."""

    velocity_from_displacement: list[str] = Field(default_factory=list)
    cut_at_jump: list[str] = Field(default_factory=list)
    """Objects whose true path ends at a jump."""

    @property
    def any(self) -> bool:
        """Whether anything was corrected."""
        return any(vars(self).values())


class TruthAudit(ResultModel):
    """Findings and corrections of the audit of a truth."""

    mode: Literal["repair", "refuse", "by construction"]
    verdict: Literal["consistent", "repaired", "exact"]
    velocity_error_before: VelocityMismatch
    """Mismatch of the velocities that the source states."""
    velocity_error_after: VelocityMismatch
    jumps: list[PositionJump]
    velocity_jumps: VelocityJumps
    repaired: Repairs
    ended_early: EndedEarly | None = None


#: Audit of a truth; None where it was not audited, for which ``Truth`` has an empty mapping.
Audit = Annotated[TruthAudit | None, BeforeValidator(lambda value: value or None)]


class ScenarioSummary(ResultModel):
    """Scenario as it was run."""

    name: str
    """Name of the scenario, with its world if it has one, as in the name of the folder."""
    description: str
    file: str
    text: str
    overrides: list[str]
    world: str | None = None
    """World of the scenario; None if it has no worlds."""

    @property
    def base(self) -> str:
        """Name of the scenario without its world."""
        return self.name if self.world is None else self.name.removesuffix(f"-{self.world}")


class SceneSummary(ResultModel):
    """One of several scenes."""

    name: str
    """Distinguishing name, such as ``seed 13``."""
    objects: list[str]
    duration_s: float
    audit: Audit
    error: dict[str, float]
    """Value of the metric that ranks, m, for each ranked tracker with an estimate in the scene."""


class TruthSummary(ResultModel):
    """Source of the truth and audit of the recorded run; the options of the source are extra fields."""

    model_config = ConfigDict(extra="allow")

    source: str
    objects: list[str]
    known: bool = True
    """False for a recording with measurements alone, where nothing is ranked."""
    steps: int
    dt: float | None
    duration_s: float
    audit: Audit
    cached: bool
    scenes: list[SceneSummary] = Field(default_factory=list)
    """All scenes if there are several; else empty."""
    few_scenes_decide: bool = False
    """Whether one scene of a hundred may decide between two trackers: simulated vehicles hide others."""
    motion: list[str] = Field(default_factory=list)
    """Fingerprint of the motion in each scene. If one is the beginning of another, both are of the same scene."""

    @property
    def log_stretches(self) -> int:
        """Number of stretches of time that the scores of each log are cut into; 0 for none."""
        return int((self.model_extra or {}).get("stretches", 0))

    @property
    def kind_of_scenes(self) -> str:
        """Plural noun for the scenes: stretches (of logs), sequences (of boxes), or scenes."""
        return "stretches" if self.log_stretches else "sequences" if self.source == "recorded-boxes" else "scenes"

    @property
    def scenes_in_words(self) -> str:
        """Number of scenes: "10 scenes", "6 sequences", "10 stretches of one log"; empty where there is one scene."""
        logs = len(self.scenes) // max(self.log_stretches, 1)
        of = f" of {'one log' if logs == 1 else f'{logs} logs'}" if self.log_stretches else ""
        return f"{len(self.scenes)} {self.kind_of_scenes}{of}" if self.scenes else ""

    @property
    def vehicles(self) -> str:
        """Number of vehicles in words, or "no truth"."""
        return counted(len(self.objects), "vehicle") if self.known else "no truth"


class SensorSummary(ResultModel):
    """Description of a sensor."""

    kind: str
    noise: str
    """Stated standard deviation of each component, such as "range 0.3 m, azimuth 0.5 deg"."""
    fov_deg: float
    max_range_m: float | None
    """None without a limit."""
    rate_hz: float | None
    """Rate of the scans; for recorded measurements, one over their median interval, and None for a single scan."""
    preset: str | None
    detection_rate: float | None
    """Share of the scans with an object in view that gave a measurement of it."""
    latency_s: tuple[float, float] = (0.0, 0.0)
    """Least and largest time from a measurement to its arrival."""
    effects: tuple[dict[str, JsonValue], ...] = ()
    """Effects by which it differs from an ideal sensor, in the order in which they act: type and options of each."""

    @property
    def range_in_words(self) -> str:
        """Largest range in words, such as "150 m"."""
        return "no limit" if self.max_range_m is None else f"{self.max_range_m:g} m"

    @property
    def latency_in_words(self) -> str:
        """Latency of the scans, s, such as "0.1" or, if it is drawn, "0.05 to 0.2"."""
        return " to ".join(dict.fromkeys(f"{end:g}" for end in self.latency_s))

    @property
    def effects_in_words(self) -> str:
        """Effects in words, such as "faces (share 0.2); bias (azimuth 0.1 deg)", or "none"."""
        effects = (f"{_effect_type(each)} ({', '.join(_options_in_words(each))})" for each in self.effects)
        return "; ".join(effects) or "none"


def _effect_type(effect: Mapping[str, object]) -> str:
    name = str(effect["type"])
    return name if ":" in name else name.replace("_", " ")


def _options_in_words(options: Mapping[str, object]) -> Iterator[str]:
    for key, value in options.items():
        if isinstance(value, Mapping):
            yield from _options_in_words(value)
        elif key != "type" and value is not None:
            yield option_in_words(key, value)


class ReferenceSummary(ResultModel):
    """Reference that errors are compared with: the Cramer-Rao bound of targets that move with white acceleration.

    It also assumes that the sensors' noise is as stated and without bias, and that the target of each measurement is
    known.
    """

    kind: Literal["bound", "reference"]
    """bound: the targets do move so and the noise is as stated, and no tracker can be expected to have smaller errors.
    reference: they move in another way, or a sensor has effects, and a tracker can have smaller errors."""
    acceleration_sigma_mps2: float
    """Standard deviation of the acceleration per axis."""
    acceleration_from: Literal["scenario", "truth"]
    """Source of the acceleration. scenario: the scenario states it. truth: the acceleration that drove the targets, or
    else the RMS of their acceleration."""

    @property
    def label(self) -> str:
        """Label in a legend."""
        return "Cramér-Rao bound" if self.kind == "bound" else "reference"

    @property
    def meaning(self) -> str:
        """Meaning of the reference, in one sentence."""
        white = f"with white acceleration of {self.acceleration_sigma_mps2:.3g} m/s² per axis"
        if self.kind == "bound":
            moving = white if self.acceleration_sigma_mps2 > 0 else "straight and steadily"
            return f"The vehicles move {moving}, and no tracker can be expected to have smaller errors than this bound."
        source = ", the RMS of the true one" if self.acceleration_from == "truth" else ""
        return (
            f"It is the Cramér-Rao bound that would hold if the vehicles moved {white}{source}. They do not: it serves "
            "to compare, and a tracker can be below it."
        )


class MetricSummary(ResultModel):
    """Description of a metric, so that a result can be read without the metric's class."""

    name: str
    unit: str
    meaning: str
    better: Literal["smaller", "larger"] | None
    compared: bool
    """Whether trackers are compared by it, run by run."""
    per_sensor: bool
    options: dict[str, Any] = Field(default_factory=dict)


class MarginSummary(ResultModel):
    """Margin up to which differences do not matter: the larger of a share of the better value and an absolute part."""

    percent: float
    position_m: float
    velocity_mps: float
    course_deg: float

    def absolute(self, unit: str) -> float:
        """Return the absolute part of the margin for metrics of a unit; 0 where there is none."""
        return {"m": self.position_m, "m/s": self.velocity_mps, "deg": self.course_deg}.get(unit, 0.0)

    def at(self, value: float, unit: str) -> float:
        """Return the margin if this is the better one of two values."""
        return max(self.percent / 100 * abs(value), self.absolute(unit))


def sentence_on_point(point: str) -> str:
    """Say which point of a body is scored; empty for the centre."""
    words = {"rear": "middle of the rear", "nearest_face": "middle of the face nearest to the observer"}
    if point == "centre":
        return ""
    return f"errors, NEES and gates are at the {words[point]} of each body, which moves as a rigid body; no bound there"


class ScoreSummary(ResultModel):
    """Rules of scoring, and the metrics beside the built-in ones."""

    settle_s: float
    divergence_m: float | None = None
    """Position error above which a run has diverged."""
    point: str = "centre"
    """Point of each body that estimates are compared with."""
    min_coverage: float
    """Least share of the due estimates that a tracker must give to be ranked."""
    from_s: float
    """First instant of a scan; estimates are asked for and scored from here on."""
    to_s: float
    """Last instant of a scan."""
    margin: MarginSummary
    baseline: str | None = None
    """Ranked tracker that all others are compared with, if the scenario names one."""
    best: str | None = None
    """Best tracker, with which alone all others are compared if there are many."""
    cutoff_m: float | None = None
    """Cutoff distance of GOSPA with hidden identities; None with known ones."""
    metrics: list[MetricSummary] = Field(default_factory=list)

    @property
    def against(self) -> str | None:
        """Tracker that all others are compared with; None where every pair is compared."""
        return self.baseline or self.best
