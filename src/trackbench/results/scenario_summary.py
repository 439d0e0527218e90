"""What was run, in ``result.json``: the scenario, its truth with its audit, its sensors, and what is scored."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, ConfigDict, Field, JsonValue

from trackbench.base.config.key_units import option_in_words
from trackbench.base.errors import counted
from trackbench.results.metric_value import ResultModel


class VelocityMismatch(ResultModel):
    """How far a velocity is from the displacement that it should cause; None where nothing moves."""

    max_mps: float | None
    mean_mps: float | None
    object: str | None
    """Where it is largest."""
    time_s: float | None


class PositionJump(ResultModel):
    """A body moves in a way that its velocity does not explain, and its track ends there."""

    object: str
    time_s: float
    distance_m: float


class VelocityJumps(ResultModel):
    """Steps in which a velocity changes by more than a car can do. They are counted and stay."""

    limit_mps2: float
    """Change of the velocity vector over the step's duration, above which it is a jump."""
    count: int = 0
    """In all runs of a random motion."""
    largest_mps: float | None = None
    """Change of the velocity vector in the largest one."""
    object: str | None = None
    """Whose it is."""
    time_s: float | None = None
    """At the end of its step."""
    peak_acceleration_mps2: float | None = None
    """Largest change of the velocity vector over the step's duration, jump or not."""


class EndedEarly(ResultModel):
    """The truth is shorter than the scenario asks for."""

    time_s: float
    reason: str


class Repairs(ResultModel):
    """What was corrected."""

    velocity_from_displacement: list[str] = Field(default_factory=list)
    cut_at_jump: list[str] = Field(default_factory=list)
    """Objects whose track ends at a jump."""

    @property
    def any(self) -> bool:
        """Whether anything was."""
        return any(vars(self).values())


class TruthAudit(ResultModel):
    """What the audit of a truth found and did."""

    mode: Literal["repair", "refuse", "by construction"]
    verdict: Literal["consistent", "repaired", "exact"]
    velocity_error_before: VelocityMismatch
    """Mismatch of the velocity that the source states with the displacement."""
    velocity_error_after: VelocityMismatch
    jumps: list[PositionJump]
    velocity_jumps: VelocityJumps
    repaired: Repairs
    ended_early: EndedEarly | None = None


#: None where a truth was not audited; such a ``Truth`` has an empty mapping.
Audit = Annotated[TruthAudit | None, BeforeValidator(lambda value: value or None)]


class ScenarioSummary(ResultModel):
    """The scenario as it was run."""

    name: str
    """With the world, where it has one: that of the folder."""
    description: str
    file: str
    text: str
    overrides: list[str]
    world: str | None = None
    """One of the worlds of a scenario."""

    @property
    def base(self) -> str:
        """The name that its worlds share."""
        return self.name if self.world is None else self.name.removesuffix(f"-{self.world}")


class SceneSummary(ResultModel):
    """One of several scenes."""

    name: str
    """What tells it from the others, such as ``seed 13``."""
    objects: list[str]
    duration_s: float
    audit: Audit
    error: dict[str, float]
    """Of each ranked tracker with an estimate in it: the metric that trackers are ranked by, m."""


class TruthSummary(ResultModel):
    """Where the truth of the recorded run came from and what the audit found; the source's own options stand beside."""

    model_config = ConfigDict(extra="allow")

    source: str
    objects: list[str]
    known: bool = True
    """False where a recording has measurements alone: nothing is ranked then."""
    steps: int
    dt: float | None
    duration_s: float
    audit: Audit
    cached: bool
    scenes: list[SceneSummary] = Field(default_factory=list)
    """All of them, where there are several."""
    few_scenes_decide: bool = False
    """Whether one scene of a hundred may decide between two trackers: simulated vehicles hide others."""
    motion: list[str] = Field(default_factory=list)
    """Fingerprint of what moved in each scene, also of a single one: one that begins another is of the same scene."""

    @property
    def log_stretches(self) -> int:
        """Into how many stretches of time the scores of each log are cut; 0: into none."""
        return int((self.model_extra or {}).get("stretches", 0))

    @property
    def kind_of_scenes(self) -> str:
        """Plural that names the scenes: stretches of logs, sequences of boxes, or scenes."""
        return "stretches" if self.log_stretches else "sequences" if self.source == "recorded-boxes" else "scenes"

    @property
    def scenes_in_words(self) -> str:
        """Number of scenes: "10 scenes", "6 sequences", "10 stretches of one log"; empty where there is one scene."""
        logs = len(self.scenes) // max(self.log_stretches, 1)
        of = f" of {'one log' if logs == 1 else f'{logs} logs'}" if self.log_stretches else ""
        return f"{len(self.scenes)} {self.kind_of_scenes}{of}" if self.scenes else ""

    @property
    def vehicles(self) -> str:
        """How many there are, or that nobody knows."""
        return counted(len(self.objects), "vehicle") if self.known else "no truth"


class SensorSummary(ResultModel):
    """One sensor."""

    kind: str
    noise: str
    """Standard deviation of each component as the sensor states it, such as "range 0.3 m, azimuth 0.5 deg"."""
    fov_deg: float
    max_range_m: float | None
    """None without a limit."""
    rate_hz: float | None
    """Of recorded measurements one over the median interval between the sensor's scans; None of a single scan."""
    preset: str | None
    detection_rate: float | None
    """Share of the scans with an object in view that gave a measurement of it."""
    latency_s: tuple[float, float] = (0.0, 0.0)
    """The least and the most time from a measurement to its arrival."""
    effects: tuple[dict[str, JsonValue], ...] = ()
    """How it differs from an ideal sensor, in the order in which they act: the type and the options of each."""

    @property
    def range_in_words(self) -> str:
        """The largest range, such as "150 m"."""
        return "no limit" if self.max_range_m is None else f"{self.max_range_m:g} m"

    @property
    def latency_in_words(self) -> str:
        """Of its scans, s, such as "0.1" or, drawn, "0.05 to 0.2"."""
        return " to ".join(dict.fromkeys(f"{end:g}" for end in self.latency_s))

    @property
    def effects_in_words(self) -> str:
        """How it differs from an ideal one, such as "faces (share 0.2); bias (azimuth 0.1 deg)", or "none"."""
        effects = (f"{_effect_type(each)} ({', '.join(_options_in_words(each))})" for each in self.effects)
        return "; ".join(effects) or "none"


def _effect_type(effect: Mapping[str, object]) -> str:
    """The name of a built-in effect in words; the reference of a plug-in as it is."""
    name = str(effect["type"])
    return name if ":" in name else name.replace("_", " ")


def _options_in_words(options: Mapping[str, object]) -> Iterator[str]:
    for key, value in options.items():
        if isinstance(value, Mapping):
            yield from _options_in_words(value)
        elif key != "type" and value is not None:
            yield option_in_words(key, value)


class ReferenceSummary(ResultModel):
    """What errors are held against: the Cramer-Rao bound of targets that move with white acceleration.

    It also takes for granted that the sensors' noise is as stated and without bias, and that each measurement is known
    to be of its target.
    """

    kind: Literal["bound", "reference"]
    """bound: the targets do move so and the noise is as stated, and no tracker can be expected to have smaller errors.
    reference: they move in another way, or a sensor has effects, and a tracker can have smaller errors."""
    acceleration_sigma_mps2: float
    """Standard deviation per axis."""
    acceleration_from: Literal["scenario", "truth"]
    """scenario: as it states. truth: that by which the targets were driven, or else the RMS of their acceleration."""

    @property
    def label(self) -> str:
        """As a legend names it."""
        return "Cramér-Rao bound" if self.kind == "bound" else "reference"

    @property
    def meaning(self) -> str:
        """What it is, in one sentence."""
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
    """A metric, of a result that can be read where its class is not."""

    name: str
    unit: str
    meaning: str
    better: Literal["smaller", "larger"] | None
    compared: bool
    """Whether trackers are compared by it, run by run."""
    per_sensor: bool
    options: dict[str, Any] = Field(default_factory=dict)


class MarginSummary(ResultModel):
    """Differences that do not matter: up to the larger of a share of the better value and an absolute part."""

    percent: float
    position_m: float
    velocity_mps: float
    course_deg: float

    def absolute(self, unit: str) -> float:
        """The absolute part of metrics of a unit; 0 where there is none."""
        return {"m": self.position_m, "m/s": self.velocity_mps, "deg": self.course_deg}.get(unit, 0.0)

    def at(self, value: float, unit: str) -> float:
        """The margin where the better of the two values is this one."""
        return max(self.percent / 100 * abs(value), self.absolute(unit))


def sentence_on_point(point: str) -> str:
    """Say which point of a body is scored, with which velocity; empty for the centre."""
    words = {"rear": "middle of the rear", "nearest_face": "middle of the face nearest to the observer"}
    if point == "centre":
        return ""
    return f"errors, NEES and gates are at the {words[point]} of each body, which moves as a rigid body; no bound there"


class ScoreSummary(ResultModel):
    """Which errors count, and what is computed of them beside the built-in metrics."""

    settle_s: float
    divergence_m: float | None = None
    """A run with a larger position error has diverged."""
    point: str = "centre"
    """The point of each body that estimates are compared with."""
    min_coverage: float
    """A tracker with a smaller share of the estimates that it should give is not ranked."""
    from_s: float
    """The first instant at which a sensor looks; trackers are asked and scored from here on."""
    to_s: float
    """The last one."""
    margin: MarginSummary
    baseline: str | None = None
    """The ranked tracker that all others are held against, where the scenario names one."""
    best: str | None = None
    """The best of so many trackers that all others are held against it alone."""
    cutoff_m: float | None = None
    """Where identities are hidden, the distance from which a track is not on an object."""
    metrics: list[MetricSummary] = Field(default_factory=list)

    @property
    def against(self) -> str | None:
        """The tracker that all others are held against; None where every pair is compared."""
        return self.baseline or self.best
