"""The options of a tracker that are tuned, and the ranges of their values."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from inspect import signature
from typing import Any, Literal

from trackbench.base.errors import InputError, nearest_choices
from trackbench.scenario import Scenario
from trackbench.scenario.source import parse_yaml
from trackbench.subjects.tuning.entry import STAYS, current, problem_with
from trackbench.trackers.config import FilterConfig, ImmConfig, PluginConfig
from trackbench.trackers.published import TRACKERS, built_in

Scale = Literal["log", "linear", "odds", "integer", "choice"]
#: Significant digits of a tuned value: more than any tuning can resolve, and few enough to read.
DIGITS = 4
#: Largest distance of a value from an end of its range, as a share of the range, at which it counts as at the edge.
EDGE = 0.02


@dataclass(frozen=True)
class Parameter:
    """Option of a tracker, with the range or choices of its values."""

    key: str
    """Dotted key below the tracker's entry, such as ``initial.velocity_sigma_mps``."""
    scale: Scale
    low: float = 0.0
    high: float = 1.0
    choices: tuple[Any, ...] = ()

    @property
    def is_number(self) -> bool:
        return self.scale != "choice"

    def rounded(self, value: float) -> float:
        """Return the value within the range, rounded to few digits; of a probability p above 0.5, 1 - p is rounded."""
        if self.scale == "odds" and value > 0.5:
            short = round(1.0 - float(f"{1.0 - value:.{DIGITS}g}"), 12)
        else:
            short = float(f"{value:.{DIGITS}g}")
        return min(max(short, self.low), self.high)

    def to_unit(self, value: float) -> float:
        """Return the position of a value in the range, 0 to 1, on the parameter's scale."""
        low, high = self._stretch(self.low), self._stretch(self.high)
        return (self._stretch(value) - low) / (high - low)

    def edge(self, value: Any) -> float | None:
        """Return the end of the range at which a value lies; None for a value inside the range, and for choices."""
        if self.scale == "choice":
            return None
        margin = 0.0 if self.scale == "integer" else EDGE
        share = self.to_unit(value)
        if share <= margin:
            return self.low
        return self.high if share >= 1.0 - margin else None

    def holds(self, value: Any) -> bool:
        """Return whether a value is in the range, or one of the choices."""
        if self.scale == "choice":
            return value in self.choices
        return isinstance(value, int | float) and self.low <= value <= self.high

    def as_tried(self, value: Any) -> Any:
        """Return a value in the type that the search uses, such as 2.0 for 2; None for a value outside the range."""
        if not self.holds(value):
            return None
        if self.scale == "choice":
            return self.choices[self.choices.index(value)]
        return value if self.scale == "integer" else float(value)

    def as_json(self) -> dict[str, Any]:
        """Return the key with the range or choices, for JSON."""
        if self.scale == "choice":
            return {"key": self.key, "choices": list(self.choices)}
        return {"key": self.key, "low": self.low, "high": self.high, "scale": self.scale}

    def __str__(self) -> str:
        if self.scale == "choice":
            return f"{self.key}={','.join(json.dumps(choice) for choice in self.choices)}"
        return f"{self.key}={self.low:g}:{self.high:g}"

    def _stretch(self, value: float) -> float:
        if self.scale == "log":
            return math.log(value)
        return math.log(value / (1.0 - value)) if self.scale == "odds" else value


def option_text(value: Any) -> str:
    """Return the value of an option as YAML text."""
    return f"{value:.10g}" if isinstance(value, float) else json.dumps(value)


FORM = "write KEY=LOW:HIGH, such as acceleration_sigma_mps2=0.1:30, or KEY=A,B,C"
#: Usual ranges of the built-in motion models' process noise, from a lorry on a motorway to an emergency manoeuvre, and
#: of an IMM model's mean duration.
NOISES = {
    "acceleration_sigma_mps2": (0.05, 30.0),
    "yaw_acceleration_sigma_radps2": (0.005, 10.0),
    "jerk_sigma_mps3": (0.1, 200.0),
    "stay_s": (0.1, 100.0),
}
#: Usual range of any other process noise: from the start value divided by this factor to the start times the factor.
FACTOR = 30.0
#: Largest number of a sweep's points that a message names.
MOST_NAMED = 8
#: Usual ranges of the options that decide when a track begins: gate probability, confirmation, existence probability.
GATE = (0.9, 0.99999)
CONFIRM = ([2, 2], [2, 3], [3, 3], [3, 4], [3, 5], [4, 6])
REPORT_EXISTENCE = (0.5, 0.999)


def parse_range(text: str, loaded: Scenario, tracker: str) -> Parameter:
    """Return the parameter that a range of the command line describes, checked against the tracker.

    Raises:
        InputError: the text is no range, or the tracker does not take its values.
    """
    key, values, ends = _read_range(text)
    at = f"--range {text}"
    _require_unique_key(loaded, tracker, key, ends, at)
    if ends:
        low, high = values
        parameter = _number_range(key, low, high, loaded, tracker, at)
        _require_accepted(loaded, tracker, parameter, (low, high), at)
        return parameter
    parameter = Parameter(key, "choice", choices=values)
    _require_accepted(loaded, tracker, parameter, values, at)
    return parameter


def require_tunable(loaded: Scenario, tracker: str) -> None:
    """Refuse a tracker that has no options to tune.

    Raises:
        InputError: the tracker has no options, or is a sweep.
    """
    if tracker in loaded.sweeps:
        points = loaded.sweeps[tracker]
        some_points = ", ".join(points[:MOST_NAMED]) + (" ..." if len(points) > MOST_NAMED else "")
        problem = f"{tracker!r} is a sweep; name one of its points: {some_points}"
        raise InputError(problem, key="--trackers", file=loaded.path)
    entry = loaded.config.trackers[tracker]
    use = entry.reference if isinstance(entry, PluginConfig) else ""
    if built_in(use) and not signature(TRACKERS[use]).parameters:
        raise InputError(f"{tracker} has no options: there is nothing to tune", key="--trackers", file=loaded.path)


def only_tunable(scenarios: Sequence[Scenario]) -> str:
    """Return the only tracker of some scenarios that has options.

    Raises:
        InputError: no tracker has options, or more than one has.
    """
    names = []
    for name in dict.fromkeys(name for item in scenarios for name in item.config.trackers):
        try:
            for item in scenarios:
                require_tunable(item, name)
        except (InputError, KeyError):
            continue
        names.append(name)
    if len(names) != 1:
        raise InputError(f"name the trackers to tune; {nearest_choices('', names)}", key="--trackers")
    return names[0]


def usual_ranges(loaded: Scenario, tracker: str) -> list[Parameter]:
    """Return the usual ranges of a built-in tracker: process noise, mean duration of IMM models, gate and confirmation.

    Raises:
        InputError: the tracker is not built in, or has no such option.
    """
    entry = loaded.config.trackers[tracker]
    if not isinstance(entry, FilterConfig):
        raise InputError(f"{tracker} is not built in: give --range options.KEY=LOW:HIGH", file=loaded.path)
    parameters = noise_ranges(loaded, tracker, entry)
    if isinstance(entry.motion, ImmConfig):
        parameters += [_usual_range(f"{STAYS}{i}", "stay_s", stay) for i, stay in enumerate(entry.motion.stay_s)]
    if entry.associate is not None:
        method = entry.associate.method
        if method != "oracle":
            parameters.append(Parameter("associate.gate", "odds", *GATE))
        if entry.associate.confirms_by == "existence":
            parameters.append(Parameter("associate.report_existence", "odds", *REPORT_EXISTENCE))
        elif entry.associate.confirms_by != "score":
            parameters.append(Parameter("associate.confirm", "choice", choices=CONFIRM))
    if not parameters:
        raise InputError(f"{tracker} has no process noise that could be tuned: give --range", file=loaded.path)
    return parameters


def noise_ranges(loaded: Scenario, tracker: str, entry: FilterConfig) -> list[Parameter]:
    """Return the usual ranges of the process noise; empty where the tracker states its own noise matrix."""
    if entry.process_noise_diag is not None:
        return []
    parameters = []
    # The options of a single motion model are keys of the tracker, or of its ``motion:`` mapping.
    in_mapping = isinstance(loaded.document.value["trackers"][tracker].get("motion"), dict)
    for number, motion in enumerate(entry.models):
        prefix = f"motion.imm.{number}." if len(entry.models) > 1 else "motion." if in_mapping else ""
        for option in dict.fromkeys(motion.driving_noise):
            parameters.append(_usual_range(prefix + option, option, getattr(motion, option)))
    return parameters


def start_values(loaded: Scenario, tracker: str, parameters: Sequence[Parameter]) -> dict[str, Any]:
    """Return the tracker's values in the scenario by option; None where a value is outside its range."""
    return {item.key: item.as_tried(current(loaded, tracker, item.key)) for item in parameters}


def _usual_range(key: str, option: str, start: float) -> Parameter:
    low, high = NOISES.get(option, (start / FACTOR, start * FACTOR))
    return Parameter(key, "log", min(low, start / 2), max(high, start * 2))


def _read_range(text: str) -> tuple[str, tuple[Any, ...], bool]:
    """Return the key of a range, its two ends or its choices, and True for ends, False for choices.

    Raises:
        InputError: the text is no range.
    """
    key, equals, rest = text.partition("=")
    key, at = key.strip(), f"--range {text}"
    if not equals or not all(key.split(".")):
        raise InputError(FORM, key=at)
    ends = rest.split(":")
    if len(ends) == 2 and "[" not in rest:
        if not all(end.strip() for end in ends):
            raise InputError(f"an end is missing; {FORM}", key=at)
        return key, tuple(_parse_value(end, at) for end in ends), True
    choices = tuple(_parse_value(f"[{rest}]", at))
    if len(choices) < 2:
        raise InputError(FORM, key=at)
    return key, choices, False


def _require_unique_key(loaded: Scenario, tracker: str, key: str, ends: bool, at: str) -> None:
    """Refuse an option's key that several motion models of the tracker share.

    Raises:
        InputError: several motion models have the option; the message has their keys.
    """
    entry = loaded.config.trackers[tracker]
    if not isinstance(entry, FilterConfig):
        return
    if isinstance(entry.motion, ImmConfig):
        option = key.removeprefix("motion.")
        keys = [
            f"motion.imm.{i}.{option}" for i, model in enumerate(entry.models) if option in type(model).model_fields
        ]
        if option == "stay_s" and (ends or key == option):
            keys = [f"{STAYS}{i}" for i in range(len(entry.models))]
        if keys:
            raise InputError(f"{tracker} has several motion models: write {' or '.join(keys)}", key=at)


def _number_range(key: str, low: Any, high: Any, loaded: Scenario, tracker: str, at: str) -> Parameter:
    for end in (low, high):
        if isinstance(end, bool) or not isinstance(end, int | float) or not math.isfinite(end):
            raise InputError(f"{option_text(end)} is no number; {FORM}", key=at)
    if low >= high:
        raise InputError(
            f"the range is upside down: write {key}={option_text(high)}:{option_text(low)}"
            if low > high
            else "the two ends are the same: give two that differ",
            key=at,
        )
    whole = isinstance(low, int) and isinstance(high, int)
    if whole and problem_with(loaded, tracker, {key: low}) is None and problem_with(loaded, tracker, {key: low + 0.5}):
        return Parameter(key, "integer", low, high)
    if low > 0 and high < 1 and problem_with(loaded, tracker, {key: 1.5}) is not None:
        return Parameter(key, "odds", float(low), float(high))
    return Parameter(key, "log" if low > 0 else "linear", float(low), float(high))


def _require_accepted(loaded: Scenario, tracker: str, parameter: Parameter, values: Sequence[Any], at: str) -> None:
    for value in values:
        problem = problem_with(loaded, tracker, {parameter.key: value})
        if problem is not None:
            # Advice on a single value, such as to write 5 for -5, does not help with a range.
            raise InputError(f"{tracker}: {problem.partition('; write')[0]}", key=at)


def _parse_value(text: str, at: str) -> Any:
    try:
        return parse_yaml(text, at).value
    except InputError as error:
        raise InputError(f"{error.message}; {FORM}", key=at) from None
