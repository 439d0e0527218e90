"""Options of a tracker that are tuned, and the ranges of their values."""

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
#: Significant digits of a value: more than any tuning can tell, and few enough to be read.
DIGITS = 4
#: A value so near to an end of its range, as a share of the range on its scale, is at the edge.
EDGE = 0.02


@dataclass(frozen=True)
class Parameter:
    """An option of a tracker and the values that are tried."""

    key: str
    """Key as ``sweep:`` writes it: ``initial.velocity_sigma_mps``."""
    scale: Scale
    low: float = 0.0
    high: float = 1.0
    choices: tuple[Any, ...] = ()

    @property
    def is_number(self) -> bool:
        """Whether the values are numbers."""
        return self.scale != "choice"

    def rounded(self, value: float) -> float:
        """Return a number in the range, with few digits; of a probability near one, few of its distance from one."""
        if self.scale == "odds" and value > 0.5:
            short = round(1.0 - float(f"{1.0 - value:.{DIGITS}g}"), 12)
        else:
            short = float(f"{value:.{DIGITS}g}")
        return min(max(short, self.low), self.high)

    def to_unit(self, value: float) -> float:
        """Return the share of the range at which a value lies, on the scale."""
        low, high = self._stretch(self.low), self._stretch(self.high)
        return (self._stretch(value) - low) / (high - low)

    def edge(self, value: Any) -> float | None:
        """Return the end of the range that a value is at; None where it is at none."""
        if self.scale == "choice":
            return None
        near = 0.0 if self.scale == "integer" else EDGE
        share = self.to_unit(value)
        if share <= near:
            return self.low
        return self.high if share >= 1.0 - near else None

    def holds(self, value: Any) -> bool:
        """Return whether a value is in the range, or one of the choices."""
        if self.scale == "choice":
            return value in self.choices
        return isinstance(value, int | float) and self.low <= value <= self.high

    def tried(self, value: Any) -> Any:
        """Return a value in the type of those that are tried, such as 2.0 for 2; None where it is not in the range."""
        if not self.holds(value):
            return None
        if self.scale == "choice":
            return self.choices[self.choices.index(value)]
        return value if self.scale == "integer" else float(value)

    def as_json(self) -> dict[str, Any]:
        """Return what tells the parameter from others."""
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
    """Return a value as a scenario writes it."""
    return f"{value:.10g}" if isinstance(value, float) else json.dumps(value)


FORM = "write KEY=LOW:HIGH, such as acceleration_sigma_mps2=0.1:30, or KEY=A,B,C"
#: Usual ranges of the noises that drive the built-in motion models, from a lorry on a motorway to an emergency, and of
#: the time for which a motion stays with one.
NOISES = {
    "acceleration_sigma_mps2": (0.05, 30.0),
    "yaw_acceleration_sigma_radps2": (0.005, 10.0),
    "jerk_sigma_mps3": (0.1, 200.0),
    "stay_s": (0.1, 100.0),
}
#: Of other noises: this factor to either side of the start.
FACTOR = 30.0
#: Most points of a sweep that a message names.
MOST_NAMED = 8
#: Usual values of when tracks of several objects begin.
GATE = (0.9, 0.99999)
CONFIRM = ([2, 2], [2, 3], [3, 3], [3, 4], [3, 5], [4, 6])
REPORT_EXISTENCE = (0.5, 0.999)


def parse_range(text: str, loaded: Scenario, tracker: str) -> Parameter:
    """Parse a range of the command line, checked against the tracker.

    Raises:
        InputError: it is no range, or the tracker does not take its values; says which it would.
    """
    key, values, ends = _read_range(text)
    at = f"--range {text}"
    _require_home(loaded, tracker, key, ends, at)
    if ends:
        low, high = values
        parameter = _between(key, low, high, loaded, tracker, at)
        _require(loaded, tracker, parameter, (low, high), at)
        return parameter
    parameter = Parameter(key, "choice", choices=values)
    _require(loaded, tracker, parameter, values, at)
    return parameter


def require_tunable(loaded: Scenario, tracker: str) -> None:
    """Make sure that a tracker has options.

    Raises:
        InputError: it has none, or is a sweep.
    """
    if tracker in loaded.sweeps:
        points = loaded.sweeps[tracker]
        named = ", ".join(points[:MOST_NAMED]) + (" ..." if len(points) > MOST_NAMED else "")
        problem = f"{tracker!r} is a sweep; name one of its points: {named}"
        raise InputError(problem, key="--trackers", file=loaded.path)
    entry = loaded.config.trackers[tracker]
    use = entry.reference if isinstance(entry, PluginConfig) else ""
    if built_in(use) and not signature(TRACKERS[use]).parameters:
        raise InputError(f"{tracker} has no options: there is nothing to tune", key="--trackers", file=loaded.path)


def only_tunable(scenarios: Sequence[Scenario]) -> str:
    """Return the only tracker of some scenarios that has options.

    Raises:
        InputError: there is none, or more than one.
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
        raise InputError(f"name those to tune; {nearest_choices('', names)}", key="--trackers")
    return names[0]


def usual_ranges(loaded: Scenario, tracker: str) -> list[Parameter]:
    """Return the usual ranges of a built-in tracker: process noise, mean times of models, gate and confirmation.

    Raises:
        InputError: it is not built in, or has no such option.
    """
    entry = loaded.config.trackers[tracker]
    if not isinstance(entry, FilterConfig):
        raise InputError(f"{tracker} is not built in: give --range options.KEY=LOW:HIGH", file=loaded.path)
    parameters = noise_ranges(loaded, tracker, entry)
    if isinstance(entry.motion, ImmConfig):
        parameters += [_usual(f"{STAYS}{number}", "stay_s", stay) for number, stay in enumerate(entry.motion.stay_s)]
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
    """Return the usual ranges of the process noise; none where the motion models do not drive it."""
    if entry.process_noise_diag is not None:
        return []
    parameters = []
    # The options of a single motion model stand beside its name, or with it in a mapping.
    in_mapping = isinstance(loaded.document.value["trackers"][tracker].get("motion"), dict)
    for number, motion in enumerate(entry.models):
        prefix = f"motion.imm.{number}." if len(entry.models) > 1 else "motion." if in_mapping else ""
        for option in dict.fromkeys(motion.driving_noise):
            parameters.append(_usual(prefix + option, option, getattr(motion, option)))
    return parameters


def start_values(loaded: Scenario, tracker: str, parameters: Sequence[Parameter]) -> dict[str, Any]:
    """Return the values that the tracker has in the scenario; None where one is not in its range."""
    return {item.key: item.tried(current(loaded, tracker, item.key)) for item in parameters}


def _usual(key: str, option: str, start: float) -> Parameter:
    low, high = NOISES.get(option, (start / FACTOR, start * FACTOR))
    return Parameter(key, "log", min(low, start / 2), max(high, start * 2))


def _read_range(text: str) -> tuple[str, tuple[Any, ...], bool]:
    """Return the key of a range, its ends or choices, and whether they are ends.

    Raises:
        InputError: it is no range.
    """
    key, equals, rest = text.partition("=")
    key, at = key.strip(), f"--range {text}"
    if not equals or not all(key.split(".")):
        raise InputError(FORM, key=at)
    ends = rest.split(":")
    if len(ends) == 2 and "[" not in rest:
        if not all(end.strip() for end in ends):
            raise InputError(f"an end is missing; {FORM}", key=at)
        return key, tuple(_read(end, at) for end in ends), True
    choices = tuple(_read(f"[{rest}]", at))
    if len(choices) < 2:
        raise InputError(FORM, key=at)
    return key, choices, False


def _require_home(loaded: Scenario, tracker: str, key: str, ends: bool, at: str) -> None:
    """Make sure that an option stands where the tracker has it.

    Raises:
        InputError: the tracker does not associate, or has several motion models that have the option.
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


def _between(key: str, low: Any, high: Any, loaded: Scenario, tracker: str, at: str) -> Parameter:
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


def _require(loaded: Scenario, tracker: str, parameter: Parameter, values: Sequence[Any], at: str) -> None:
    for value in values:
        problem = problem_with(loaded, tracker, {parameter.key: value})
        if problem is not None:
            # What would mend a single value does not mend a range: -5 is not to be 5.
            raise InputError(f"{tracker}: {problem.partition('; write')[0]}", key=at)


def _read(text: str, at: str) -> Any:
    try:
        return parse_yaml(text, at).value
    except InputError as error:
        raise InputError(f"{error.message}; {FORM}", key=at) from None
