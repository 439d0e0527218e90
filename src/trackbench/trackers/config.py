"""Options of a scenario's trackers: a built-in filter with its motion models, or a tracker of the user."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any, Literal

from pydantic import Discriminator, Field, Tag, ValidationInfo, model_validator
from pydantic_core import PydanticCustomError

from trackbench.base.config import WORD, Config, KeyPath, NonNegative, Positive, Problem, Sigma, chosen_by, reject
from trackbench.base.config.key_units import option_in_words
from trackbench.base.config.plugin import OptionsBeside, Plugin, PluginName, plugin_field
from trackbench.models.motion import MOTION_MODELS, ConstantProcessNoise, MotionModel
from trackbench.models.motion.base import YAW
from trackbench.models.sensors import SENSOR_MODELS
from trackbench.trackers.associate import AssociateConfig
from trackbench.trackers.assume import AssumedEffects, AssumedSensors
from trackbench.trackers.foreign import Command
from trackbench.trackers.initial import InitialConfig

Motion = Annotated[MotionModel, Plugin(MOTION_MODELS, "model", word=True)]


class ImmConfig(Config):
    """Interacting multiple model estimator (IMM): several motion models between which the motion switches."""

    imm: list[Motion] = Field(
        min_length=2,
        description="The motion models, each with its options in a mapping: {model: cv, ...}. A model may come twice, "
        "with other options.",
    )
    stay_s: list[Positive] = Field(
        description="For each model the mean time for which the motion stays with it, s. It then goes over to any of "
        "the others alike, at any time, whatever the rate of the scans."
    )

    @property
    def first_probabilities(self) -> tuple[float, ...]:
        """Probability of each motion model at a track's start, in proportion to ``stay_s``."""
        return tuple(value / sum(self.stay_s) for value in self.stay_s)

    @property
    def names(self) -> list[str]:
        """Names of the motion models, numbered if one comes several times."""
        models = [MOTION_MODELS.name_of(type(model)) for model in self.imm]
        return [
            name if models.count(name) == 1 else f"{name} {models[: i + 1].count(name)}"
            for i, name in enumerate(models)
        ]

    def problems(self) -> Iterator[Problem]:
        if len(self.stay_s) != len(self.imm):
            needed = f"one number for each of the {len(self.imm)} models is needed, not {len(self.stay_s)}"
            yield Problem(("stay_s",), needed)


def _motion_tag(value: Any) -> str:
    return "<imm>" if isinstance(value, ImmConfig) or (isinstance(value, dict) and "imm" in value) else "<model>"


#: Value of the key ``motion``.
OneOrSeveralMotions = Annotated[
    Annotated[Motion, Tag("<model>")] | Annotated[ImmConfig, Tag("<imm>")], Discriminator(_motion_tag)
]


FilterName = Literal["kf", "ekf", "iekf", "ukf", "ckf"]
AdvanceAt = Literal["own_scans", "all_scans"]
LateMethod = Literal["drop", "as_new", "replay"]
SensorKind = Annotated[str, PluginName(SENSOR_MODELS)]
Sweep = Annotated[
    dict[str, list[Any]] | list[dict[str, Any]] | None,
    Field(
        description="Makes one tracker of each point, named after the values (`ukf_0p8_0p4`). A mapping of options to "
        "lists: all combinations. A list of mappings: these points. An option within another is written with a "
        "dot: `initial.velocity_sigma_mps`, `options.alpha`."
    ),
]

#: Keys of the filter ukf alone.
UKF_KEYS = ("sigma_points", "augmented", "kappa")


class FilterConfig(OptionsBeside):
    """Options of a tracker with a built-in filter."""

    filter: FilterName = Field(description="The filter (`trackbench list filters` shows them).")
    motion: OneOrSeveralMotions = Field(
        description="The motion model (`trackbench list motion-models` shows them), or one of your own as "
        "`module:Class`. Its options stand beside it, or with it in a mapping: {model: cv, ...}. Several models, "
        "between which the motion switches: {imm: [{model: cv, ...}, {model: ctrv, ...}], stay_s: [10, 5]}."
    )
    sensors: list[str] | None = Field(
        None, min_length=1, description="Names of the sensors it reads; all unless given."
    )
    advance_at: AdvanceAt = Field(
        "own_scans",
        description="Scans at which the state advances. own_scans: only scans of the sensors that the tracker reads; "
        "at other scans it gives a prediction and keeps its state, so that they change no estimate. all_scans: scans "
        "of unread sensors too, as in some published programs; the process noise then comes in smaller pieces.",
    )
    late: LateMethod = Field(
        "replay",
        description="Treatment of a scan that was taken before the state's time, since its sensor is late. drop: it is "
        "left out. as_new: every scan counts as taken when it arrived, which is wrong. replay: the filter goes back to "
        "the time of the scan and processes all later scans again.",
    )
    lag_s: Positive = Field(1, le=60, description="How far back replay reaches, s. Older scans are dropped.")
    process_noise_diag: list[NonNegative] | None = Field(
        None,
        description="Diagonal of a constant process noise, one variance for each component of the state, added at "
        "every step of time whatever its length, in place of what the standard deviations above give.",
    )
    initial: InitialConfig = Field(
        default_factory=InitialConfig, description="How a track starts; a single word is short for {from: word}."
    )
    sigma_points: Literal["scaled", "classic"] = Field(
        "scaled",
        description="ukf only. scaled: the central point has more weight in covariances, by 2, which is best for a "
        "Gaussian distribution (van der Merwe, alpha 1 and beta 2). classic: it has not (Julier).",
    )
    augmented: bool = Field(True, description="ukf only. Whether the sigma points also spread over the process noise.")
    kappa: float | None = Field(
        None,
        description="ukf only. Secondary spread of the sigma points. Unless given: 0 with scaled, and 3 "
        "minus the number of spread components with classic.",
    )
    sensor_models: dict[str, SensorKind] = Field(
        default_factory=dict,
        description="For a sensor's name, the kind of sensor (`trackbench list sensors` shows them) that the tracker "
        "takes it for, in place of what it is: shows what a wrong sensor model costs.",
    )
    measurement_noise: dict[str, dict[str, Sigma]] = Field(
        default_factory=dict,
        description="For a sensor's name, standard deviations that the tracker takes in place of those that the sensor "
        "states, by the sensor's own options: {front_radar: {range_sigma_m: 0.5}}. For tuning, and to see what wrong "
        "ones cost.",
    )
    assume: dict[str, AssumedEffects] = Field(
        default_factory=dict,
        description="For a sensor's name, effects of the sensor that the tracker knows of: "
        "{front_radar: {signal_to_noise: {half_range_m: 140, stated_at_m: 60}}}.",
    )
    smoother: Literal["rts"] | None = Field(
        None,
        description="rts: the smoother of Rauch, Tung and Striebel. Each estimate uses all measurements of the run, "
        "later ones too, which shows what is possible offline. Such an entry is no competitor.",
    )
    associate: AssociateConfig | None = Field(
        None,
        description="Follows several objects from detections of hidden identities: how it associates them, and when "
        "its tracks begin and end. Tracks then start from one detection.",
    )
    sweep: Sweep = None

    @property
    def sensors_used(self) -> list[str] | None:
        """Names of the sensors whose scans update or start the tracks; None for all."""
        return None if self.sensors is None else [*self.sensors, *(self.initial.sensors or [])]

    @property
    def scan_options(self) -> dict[str, Any]:
        """Options that say how a tracker uses scans, by name, for single-object and multi-object trackers alike."""
        assumed = AssumedSensors(self.sensor_models, self.measurement_noise, self.assume)
        return {"assumed": assumed, **{key: getattr(self, key) for key in ("sensors", "advance_at")}}

    @property
    def models(self) -> tuple[MotionModel, ...]:
        """Motion models of the filter, with the process noise that it uses."""
        if isinstance(self.motion, ImmConfig):
            return tuple(self.motion.imm)
        if self.process_noise_diag is None:
            return (self.motion,)
        return (ConstantProcessNoise(motion=self.motion, variances=tuple(self.process_noise_diag)),)

    @property
    def motion_in_words(self) -> list[str]:
        """Name and options in use of the motion model, in words: "cv", "acceleration sigma 3 m/s^2"."""
        if isinstance(self.motion, ImmConfig):
            models = zip(self.motion.imm, self.motion.stay_s, strict=True)
            return ["imm of " + " and ".join(f"{', '.join(_words(model))} for {stay:g} s" for model, stay in models)]
        return _words(self.motion, () if self.process_noise_diag is None else self.motion.driving_noise)

    @model_validator(mode="before")
    @classmethod
    def _noise_stated_once(cls, data: Any, info: ValidationInfo) -> Any:
        if not isinstance(data, dict) or data.get("process_noise_diag") is None:
            return data
        motion = data.get("motion")
        is_word = isinstance(motion, str)
        options = {key: item for key, item in data.items() if key not in cls.model_fields} if is_word else motion or {}
        name = motion if is_word else isinstance(motion, dict) and motion.get("model")
        if not isinstance(name, str):
            return data
        try:
            model = plugin_field(cls)[1].find(name, info)
        except PydanticCustomError:
            return data
        stated_options, unused = {key: item for key, item in options.items() if key != "model"}, model.driving_noise
        reason = "not used with process_noise_diag, which replaces it; remove one of them"
        at: KeyPath = () if is_word else ("motion",)
        reject(cls.__name__, [Problem((*at, key), reason) for key in dict.fromkeys(unused) if key in stated_options])
        # Replaced options need a valid value for the validation; they end as 0.
        model_config = model.model_validate(stated_options | dict.fromkeys(unused, 1.0), context=info.context)
        rest = {key: item for key, item in data.items() if key in cls.model_fields}
        return {**rest, "motion": model_config.model_copy(update=dict.fromkeys(unused, 0.0))}

    def problems(self) -> Iterator[Problem]:
        stated, models = self.model_fields_set, self.models
        for motion in models:
            yield from self._motion_problems(motion, _name(motion))
        if isinstance(self.motion, ImmConfig) and self.process_noise_diag is not None:
            yield Problem(("process_noise_diag",), "not used with imm, whose models have their own; remove it")
        for key in UKF_KEYS:
            if key in stated and self.filter != "ukf":
                yield Problem((key,), f"only filter ukf has this key; the filter here is {self.filter}")
        if self.associate is not None:
            yield from self._association_problems()
        for sensor, effects in self.assume.items():
            for key in effects.states:
                for at, message in self._error_state_problems():
                    yield Problem(at or ("assume", sensor, key), message)
        if "lag_s" in stated and self.late != "replay":
            yield Problem(("lag_s",), f"not used with late: {self.late}; remove it")
        yield from _unexpanded(self.sweep)

    def _motion_problems(self, motion: MotionModel, name: str) -> Iterator[Problem]:
        if self.filter == "kf" and not motion.linear:
            linear = " or ".join(name for name, model in MOTION_MODELS.loaded().items() if model.linear)
            yield Problem(("motion",), f"kf needs a linear motion model: use {linear}, or filter: ekf with {name}")
        for at, diagonal in (
            (("process_noise_diag",), None if isinstance(self.motion, ImmConfig) else self.process_noise_diag),
            (("initial", "covariance_diag"), self.initial.covariance_diag),
        ):
            components = motion.components
            if diagonal is not None and len(diagonal) != len(components):
                needed = f"motion {name} needs {len(components)} variances ({', '.join(components)})"
                yield Problem(at, f"{needed}, not {len(diagonal)}")

    def _error_state_problems(self) -> Iterator[tuple[KeyPath, str]]:
        if self.initial.source == "truth":
            return
        if self.initial.source == "two_measurements":
            yield ("initial", "from"), "not used with errors as states: a track starts from its first measurement"
        if self.initial.covariance_diag is not None:
            yield ("initial", "covariance_diag"), "not used with errors as states; remove it"
        for motion in self.models:
            if set(YAW) & set(motion.components):
                name, others = _name(motion), "cv or ca"
                yield (), f"a track of {name} starts by position and velocity, without errors as states; use {others}"

    def _association_problems(self) -> Iterator[Problem]:
        if self.initial.source != "first_measurement":
            message = "with associate a track starts from one detection: use from: first_measurement"
            yield Problem(("initial", "from"), message)
        if self.smoother is not None:
            yield Problem(("smoother",), "a smoother follows one object; remove it, or associate")
        for sensor, effects in self.assume.items():
            if effects.signal_to_noise is not None and effects.correlated_errors is not None:
                known = "with associate their size may not depend on the range, as by signal_to_noise"
                yield Problem(("assume", sensor, "correlated_errors"), f"{known}; remove it, or signal_to_noise")
        for key in ("skip", "waiting"):
            if key in self.initial.model_fields_set:
                yield Problem(("initial", key), "not used with associate, which has confirm; remove it")


def _name(motion: MotionModel) -> str:
    return MOTION_MODELS.name_of(type(motion.motion if isinstance(motion, ConstantProcessNoise) else motion))


def _words(motion: MotionModel, unused: tuple[str, ...] = ()) -> list[str]:
    options = {name: getattr(motion, name) for name in type(motion).model_fields if name not in unused}
    shown = (option_in_words(name, value) for name, value in options.items() if value is not None)
    return [_name(motion), *shown]


def _use_tag(value: Any) -> str | None:
    if isinstance(value, str):
        return WORD
    return "<command>" if isinstance(value, Command) or (isinstance(value, dict) and "command" in value) else None


#: Tracker of the user: a Python class or a program.
Use = Annotated[
    Annotated[str, Field(min_length=1), Tag(WORD)] | Annotated[Command, Tag("<command>")],
    chosen_by(_use_tag, 'write a published name, "module:Class" or {command: [./program]}'),
]


class PluginConfig(Config):
    """Options of a user's tracker, or of a tracker published under the entry-point group trackbench.trackers."""

    use: Use = Field(
        description='A published name, such as raw, or "package.module:Class", whose code is run; or a program in any '
        "language: {command: [./my_tracker, --q, '2']}."
    )
    options: dict[str, Any] = Field(
        default_factory=dict,
        description="Keyword arguments of the class, passed on as they are; a program is told them at its start.",
    )
    sensors: list[str] | None = Field(
        None, min_length=1, description="Names of the sensors it reads; all unless given."
    )

    sweep: Sweep = None

    @property
    def sensors_used(self) -> list[str] | None:
        """Names of the sensors whose scans the tracker gets; None for all."""
        return self.sensors

    @property
    def reference(self) -> str:
        """Published name or ``"module:Class"`` of the tracker; empty for a program."""
        return self.use if isinstance(self.use, str) else ""

    def problems(self) -> Iterator[Problem]:
        yield from _unexpanded(self.sweep)


def _unexpanded(sweep: object) -> Iterator[Problem]:
    """Yield a problem if a sweep stands outside a scenario; in a scenario, sweeps are expanded before this check."""
    if sweep is not None:
        yield Problem(("sweep",), "only an entry of a scenario's trackers has this key")


def entry_kind(value: Any) -> str | None:
    """Return the tag of a tracker's settings, ``<filter>`` or ``<use>``, by their key; None for both or no key."""
    if isinstance(value, FilterConfig | PluginConfig):
        return "<filter>" if isinstance(value, FilterConfig) else "<use>"
    kinds = [key for key in ("filter", "use") if isinstance(value, dict) and key in value]
    return f"<{kinds[0]}>" if len(kinds) == 1 else None


NO_KIND = "write filter (built in: kf, ekf, iekf, ukf, ckf) or use (your own), and not both"
AnyTracker = Annotated[
    Annotated[FilterConfig, Tag("<filter>")] | Annotated[PluginConfig, Tag("<use>")],
    chosen_by(entry_kind, NO_KIND),
]
