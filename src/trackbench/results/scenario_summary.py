"""Description of a run in ``result.json``: scenario, truth with its audit, sensors, and scoring."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, ConfigDict, Field, JsonValue

from trackbench.base.config.key_units import option_in_words
from trackbench.base.errors import counted
from trackbench.results.metric_value import ResultModel


class VelocityMismatch(ResultModel):
    """Largest and mean difference of a truth's stated velocities from its displacements, m/s; None at rest."""

    max_mps: float | None
    mean_mps: float | None
    object: str | None
    time_s: float | None


class PositionJump(ResultModel):
    """Jump of an object's true position that its velocity does not explain; the true path is cut there."""

    object: str
    time_s: float
    distance_m: float


class VelocityJumps(ResultModel):
    """Jumps of a velocity: changes in one step that exceed what a car can do. They are counted, not corrected."""

    limit_mps2: float
    """Acceleration above which a change of the velocity vector in one step is a jump."""
    count: int = 0
    """Number of jumps; for a random motion, in all runs together."""
    largest_mps: float | None = None
    """Change of the velocity vector in the largest jump; None without a jump."""
    object: str | None = None
    """Name of the object with the largest jump; None without a jump."""
    time_s: float | None = None
    peak_acceleration_mps2: float | None = None
    """Largest acceleration of any object: change of the velocity vector in a step, divided by the step's duration."""


class EndedEarly(ResultModel):
    """Time and reason of the end of a truth that is shorter than the scenario asks for."""

    time_s: float
    reason: str


class Repairs(ResultModel):
    """Names of the objects whose truth was corrected, by kind of correction."""

    velocity_from_displacement: list[str] = Field(default_factory=list)
    cut_at_jump: list[str] = Field(default_factory=list)

    @property
    def any(self) -> bool:
        return any(vars(self).values())


class TruthAudit(ResultModel):
    """Findings of the audit of a truth (velocity mismatches, jumps, an early end) and the corrections made."""

    mode: Literal["repair", "refuse", "by construction"]
    verdict: Literal["consistent", "repaired", "exact"]
    velocity_error_before: VelocityMismatch
    """Mismatch between the velocities that the source of the truth states and its displacements, before any repair."""
    velocity_error_after: VelocityMismatch
    jumps: list[PositionJump]
    velocity_jumps: VelocityJumps
    repaired: Repairs
    ended_early: EndedEarly | None = None


#: Audit of a truth; None where it was not audited, for which ``Truth`` has an empty mapping.
Audit = Annotated[TruthAudit | None, BeforeValidator(lambda value: value or None)]


class ScenarioSummary(ResultModel):
    """Scenario as it was run: its text, overrides, and world (variant with other drivers and sensors)."""

    name: str
    """Name of the scenario, with a suffix for its world if it has worlds; also the name of the run's folder."""
    description: str
    file: str
    text: str
    overrides: list[str]
    world: str | None = None
    """Name of the world (drivers and sensors) in which the scenario was run; None for a scenario without worlds."""

    @property
    def base(self) -> str:
        """Name of the scenario without the suffix for its world, such as "highway" for "highway-human"."""
        return self.name if self.world is None else self.name.removesuffix(f"-{self.world}")


class SceneSummary(ResultModel):
    """One of a run's several scenes: objects, duration, audit and the errors of the trackers."""

    name: str
    """Name that distinguishes the scene, such as ``seed 13``."""
    objects: list[str]
    duration_s: float
    audit: Audit
    error: dict[str, float]
    """Value, m, of the metric that ranks trackers, by name of each ranked tracker with an estimate in the scene."""


class TruthSummary(ResultModel):
    """Source of the truth, with options as extra fields; all scenes; objects and audit of the recorded scene."""

    model_config = ConfigDict(extra="allow")

    source: str
    objects: list[str]
    known: bool = True
    """False for a recording of measurements without a truth, in which nothing is ranked."""
    steps: int
    dt: float | None
    duration_s: float
    audit: Audit
    cached: bool
    scenes: list[SceneSummary] = Field(default_factory=list)
    """All scenes of the run; empty where there is only one."""
    few_scenes_decide: bool = False
    """Whether vehicles hide others, so that one scene in a hundred can turn which of two trackers is better."""
    motion: list[str] = Field(default_factory=list)
    """Fingerprint of the motion in each scene. A fingerprint that is the beginning of another belongs to the same
    scene, recorded for a shorter time."""

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
        """Number of vehicles as text, such as "5 vehicles", or "no truth"."""
        return counted(len(self.objects), "vehicle") if self.known else "no truth"


class SensorSummary(ResultModel):
    """Properties of a sensor as simulated or recorded: noise, field of view, rate, latency and effects."""

    # Older results have a text in place of ``sigmas``.
    model_config = ConfigDict(extra="ignore")

    kind: str
    sigmas: dict[str, float] = Field(default_factory=dict)
    """Stated standard deviation of each component, by name and unit, such as ``range_m`` and ``azimuth_deg``."""
    fov_deg: float
    max_range_m: float | None
    """Largest range at which the sensor measures; None without a limit."""
    rate_hz: float | None
    """Rate of the scans; of recorded scans, one over the median interval between them. None for a single scan."""
    preset: str | None
    detection_rate: float | None
    """Share of the scans with an object in view in which the object was detected; None if the share is unknown."""
    latency_s: tuple[float, float] = (0.0, 0.0)
    """Least and largest delay between the taking of a scan and its arrival."""
    effects: tuple[dict[str, JsonValue], ...] = ()
    """Effects that make the sensor differ from an ideal sensor, in the order in which they act: type and options of
    each."""

    @property
    def noise_in_words(self) -> str:
        """Standard deviation of each component in words, such as "range 0.3 m, azimuth 0.5 deg"."""
        return ", ".join(option_in_words(name, sigma) for name, sigma in self.sigmas.items())

    @property
    def range_in_words(self) -> str:
        """Text of the largest range at which the sensor measures, such as "150 m"; "no limit" without one."""
        return "no limit" if self.max_range_m is None else f"{self.max_range_m:g} m"

    @property
    def latency_in_words(self) -> str:
        """Latency of the scans, s, as text, such as "0.1" or, if it is random, "0.05 to 0.2"."""
        return " to ".join(dict.fromkeys(f"{end:g}" for end in self.latency_s))

    @property
    def effects_in_words(self) -> str:
        """Effects of the sensor in words, such as "faces (share 0.2); bias (azimuth 0.1 deg)", or "none"."""
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

    The reference also assumes that the sensors' noise is as stated and without bias, and that the target of each
    measurement is known.
    """

    kind: Literal["bound", "reference"]
    """bound: targets move with white acceleration and noise is as stated, so no tracker can be expected to have smaller
    errors. reference: motion or sensors differ from these assumptions, and a tracker can have smaller errors."""
    acceleration_sigma_mps2: float
    """Standard deviation of the white acceleration per axis that the reference assumes."""
    acceleration_from: Literal["scenario", "truth"]
    """Source of ``acceleration_sigma_mps2``. scenario: the scenario states the value. truth: the random acceleration
    that the motion was simulated with, or for any other motion the RMS of the true acceleration."""

    @property
    def label(self) -> str:
        """Name of the Cramér-Rao reference for the legend of a figure, which depends on its kind."""
        return "Cramér-Rao bound" if self.kind == "bound" else "reference"

    @property
    def meaning(self) -> str:
        """Explanation, in one or two sentences, whether a tracker can have errors below the Cramér-Rao reference."""
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
    """Name, unit, meaning and options of a metric, so that a result is read without the metric's code."""

    name: str
    unit: str
    meaning: str
    better: Literal["smaller", "larger"] | None
    compared: bool
    """Whether trackers are compared by this metric, run by run."""
    per_sensor: bool
    options: dict[str, Any] = Field(default_factory=dict)


class MarginSummary(ResultModel):
    """Margin up to which differences do not matter: a share of the better value, or an absolute value if larger."""

    percent: float
    position_m: float
    velocity_mps: float
    course_deg: float

    def absolute(self, unit: str) -> float:
        """Return the absolute part of the margin for metrics with this unit; 0 for a unit without an absolute part."""
        return {"m": self.position_m, "m/s": self.velocity_mps, "deg": self.course_deg}.get(unit, 0.0)

    def at(self, value: float, unit: str) -> float:
        """Return the largest difference of two trackers that does not matter; ``value``: the better of their values."""
        return max(self.percent / 100 * abs(value), self.absolute(unit))


def sentence_on_point(point: str) -> str:
    """Return a sentence on the point of each body that estimates are compared with; empty for the centre."""
    words = {"rear": "middle of the rear", "nearest_face": "middle of the face nearest to the observer"}
    if point == "centre":
        return ""
    return f"errors, NEES and gates are at the {words[point]} of each body, which moves as a rigid body; no bound there"


class ScoreSummary(ResultModel):
    """Rules of scoring, such as margin, divergence limit and baseline, and the metrics that are not built in."""

    settle_s: float
    divergence_m: float | None = None
    """Limit on the position error, m: a run has diverged if an error exceeds the limit. Without effect with hidden
    identities."""
    point: str = "centre"
    """Point of each body that estimates are compared with."""
    min_coverage: float
    """Least share of the due estimates that a tracker must give to be ranked."""
    from_s: float
    """Time of the first scan; estimates are scored from here on."""
    to_s: float
    """Time of the last scan, up to which estimates are scored."""
    margin: MarginSummary
    baseline: str | None = None
    """Name of the ranked tracker that all other trackers are compared with; None if the scenario names no baseline."""
    best: str | None = None
    """Name of the best tracker, if all others are compared with the best alone because trackers are many; else None."""
    cutoff_m: float | None = None
    """Cutoff distance of GOSPA; None with known identities."""
    metrics: list[MetricSummary] = Field(default_factory=list)

    @property
    def against(self) -> str | None:
        """Name of the tracker that all other trackers are compared with; None where every pair is compared."""
        return self.baseline or self.best
