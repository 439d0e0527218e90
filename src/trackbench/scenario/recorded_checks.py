"""What must fit together in a scenario whose truth is recorded."""

from __future__ import annotations

from collections.abc import Iterator

from trackbench.base.config import Problem
from trackbench.base.errors import nearest_choices
from trackbench.models.sensors import SENSOR_MODELS, sensor_type
from trackbench.models.sensors.presets import presets
from trackbench.scenario.keys import ScenarioKeys
from trackbench.trackers.config import FilterConfig
from trackbench.truth.config.columns import unit_problems
from trackbench.truth.sources import RecordingTruth

#: Keys of a sensor that say when and what it would read; recorded measurements are taken as they are.
SYNTHETIC = (
    "rate_hz",
    "phase_s",
    "detection_probability",
    "detection",
    "occlusion",
    "clutter",
    "resolution",
    "effects",
)


def recording_problems(scenario: ScenarioKeys, truth: RecordingTruth) -> Iterator[Problem]:
    """Everything that is wrong between the recording and the other sections."""
    kinds = scenario.sensor_kinds
    fed = truth.feeds(kinds)
    yield from _columns(truth, kinds)
    yield from _hidden(scenario, truth)
    for name in scenario.sensors if truth.without_truth else ():
        if name not in fed:
            yield Problem(("truth", "readings"), f"{name} is missing: nothing can be synthesised without a truth")
    if truth.format == "udacity":
        yield from _one_of_each(fed)
    for name in fed:
        yield from _synthetic(scenario, truth, name)
    if scenario.monte_carlo.runs > 1 and same_every_run(scenario):
        message = (
            f"must be 1, not {scenario.monte_carlo.runs}: all measurements are recorded, so every run would be the same"
        )
        yield Problem(("monte_carlo", "runs"), message)


def _columns(truth: RecordingTruth, kinds: dict[str, str]) -> Iterator[Problem]:
    for name, columns in truth.measurements.items():
        at = ("truth", "readings", name)
        if name not in kinds:
            yield Problem(at, f"the scenario has no sensor {name!r}; {nearest_choices(name, kinds)}")
            continue
        model = SENSOR_MODELS[kinds[name]]
        needed = columns.of_sensor(model.components)
        for component in needed:
            if component not in columns.components:
                yield Problem((*at, component), f"missing: a {kinds[name]} reads {', '.join(needed)}")
        for component in (*columns.components, *columns.bias):
            if component not in needed:
                yield Problem((*at, component), f"sensor {name} is a {kinds[name]}, which reads {', '.join(needed)}")
        quantities = columns.quantities(model.components, model.units)
        if columns.copies_within_m is not None and not model.measures_position():
            yield Problem((*at, "copies_within_m"), f"a {kinds[name]} measures no position to compare; remove it")
        for problem in unit_problems(columns.units, {"time": "time", **quantities}):
            yield Problem((*at, *problem.at), problem.message)


def _hidden(scenario: ScenarioKeys, truth: RecordingTruth) -> Iterator[Problem]:
    """What is only used with hidden identities, and what they need."""
    known = scenario.sensing.identities == "known"
    only = "only used with sensing: {identities: hidden}; remove"
    for key in truth.reference.of_tracks if known else ():
        yield Problem(("truth", "reference", key), only)
    if known and truth.stretches is not None:
        yield Problem(("truth", "stretches"), f"{only}: errors have intervals over stretches without it")
    if truth.stretches is not None and scenario.monte_carlo.runs > 1:
        message = "only used with monte_carlo: {runs: 1}: several runs of a log have intervals over its noise; remove"
        yield Problem(("truth", "stretches"), message)
    if known and truth.without_truth:
        message = "missing: the file with the truth; without one, write sensing: {identities: hidden}"
        yield Problem(("truth", "path"), message)
    if known and truth.columns is not None and truth.columns.without_velocity:
        yield Problem(("truth", "columns"), "the velocity is missing: write vx and vy, or speed and course")
    own = truth if known else truth.with_hidden_identities()
    unlabelled = [name for name in truth.measurements if own.unlabelled(name)]
    for name, columns in truth.measurements.items():
        for key in ("slot", "copies_within_m") if name not in unlabelled else ():
            if getattr(columns, key) is not None:
                message = "only used with unlabelled detections, and these are of known objects; remove"
                yield Problem(("truth", "readings", name, key), message)
    for name, tracker in scenario.trackers.items() if unlabelled and not known else ():
        if isinstance(tracker, FilterConfig) and tracker.associate is not None and tracker.associate.method == "oracle":
            message = f"oracle is told of which object each detection is; nothing says so of {', '.join(unlabelled)}"
            yield Problem(("trackers", name, "associate", "method"), message)


def _one_of_each(fed: dict[str, str]) -> Iterator[Problem]:
    first: dict[str, str] = {}
    for name, kind in fed.items():
        other = first.setdefault(sensor_type(kind), name)
        if other != name:
            yield Problem(("sensors", name), f"the recording has one {kind}, and it feeds {other}; remove one of them")


def _synthetic(scenario: ScenarioKeys, truth: RecordingTruth, name: str) -> Iterator[Problem]:
    sensor = scenario.sensors[name]
    of_preset = presets()[sensor.preset].values if sensor.preset is not None else {}
    # With hidden identities it says which objects of a truth are due.
    of_due = {"occlusion"} if scenario.sensing.identities == "hidden" and not truth.without_truth else set()
    for key in SYNTHETIC:
        if key not in of_due and key in sensor.model_fields_set and key not in of_preset:
            yield Problem(
                ("sensors", name, key), f"the measurements of {name} are recorded and taken as they are; remove"
            )


def same_every_run(scenario: ScenarioKeys) -> bool:
    """Whether nothing is drawn: no motion, no tracker's start and no measurement, as all of them are recorded."""
    drawn = scenario.truth.random or any(
        isinstance(item, FilterConfig) and item.initial.source == "truth" for item in scenario.trackers.values()
    )
    return len(scenario.truth.feeds(scenario.sensor_kinds)) == len(scenario.sensors) and not drawn
