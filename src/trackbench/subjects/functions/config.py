"""The block ``functions`` of a scenario, and its requirements on the rest of the scenario."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any

from pydantic import Field

from trackbench.base.config import Name, Problem
from trackbench.base.config.plugin import Plugin
from trackbench.base.subjects import FieldBlock
from trackbench.subjects.functions.protocol import FUNCTIONS, Function
from trackbench.truth.config.recording import FixedObserver
from trackbench.truth.sources import RecordingTruth

BLOCK = FieldBlock(
    dict[Name, Annotated[Function, Plugin(FUNCTIONS, "use")]],
    Field(
        default_factory=dict,
        description="Driver assistance functions, by name. Their decisions on the tracks are compared with their "
        "decisions on the truth.",
    ),
    """\
functions:
  fcw: {use: forward_collision_warning, ttc_s: 2.4}
""",
)
#: Smallest rate of the fastest sensor, Hz, since functions decide when a sensor measures.
SLOWEST_DECISIONS = 10.0
#: Instruction how the observer becomes the ego, by source of the truth; other sources have no ego.
EGO = {
    "highway-env": "write truth.observer: ego",
    "recorded-traffic": "name its vehicle: truth.observer: {vehicle: ...}",
    "recording": "name the columns of its motion in truth.ego",
}


def listed_functions() -> Iterator[tuple[str, str]]:
    """Yield the name and the description of each published driver assistance function."""
    from trackbench.cli.listing import registered

    return registered(FUNCTIONS, "use")


def function_problems(scenario: Any) -> Iterator[Problem]:
    """Yield conflicts between the driver assistance functions of a scenario and its other sections."""
    if not scenario.functions:
        return
    yield from _ego_problems(scenario)
    if scenario.score.point != "centre":
        yield Problem(("score", "point"), "functions reckon from the centre of a body: remove them, or write centre")
    yield from _rate_problems(scenario)


def _ego_problems(scenario: Any) -> Iterator[Problem]:
    truth = scenario.truth
    if isinstance(truth, RecordingTruth) and truth.ego is not None and not truth.without_truth:
        return
    for name in scenario.functions:
        if isinstance(truth, RecordingTruth) and truth.without_truth:
            yield Problem(("functions", name), "there is no truth on which it could decide")
        elif type(getattr(truth, "observer", None)) is FixedObserver:
            remedy = EGO.get(truth.source, f"{truth.source} has none; use {' or '.join(EGO)}")
            yield Problem(("functions", name), f"the observer is a fixed point, and a function needs an ego: {remedy}")


def _rate_problems(scenario: Any) -> Iterator[Problem]:
    sensor_names = [tracker.sensors for tracker in scenario.trackers.values()]
    read = {name for sensors in sensor_names for name in (scenario.sensors if sensors is None else sensors)}
    rates = {name: sensor.rate_hz for name, sensor in scenario.sensors.items() if name in read}
    stated = {name: rate for name, rate in rates.items() if rate is not None}
    if not stated or len(stated) < len(rates):
        return
    fastest = max(stated, key=lambda name: stated[name])
    if stated[fastest] < SLOWEST_DECISIONS:
        why = "a function decides only when a sensor measures, so a slow one hides delays"
        message = (
            f"{stated[fastest]:g} Hz, and no sensor that is read is faster: {why}; use {SLOWEST_DECISIONS:g} or more"
        )
        yield Problem(("sensors", fastest, "rate_hz"), message)
