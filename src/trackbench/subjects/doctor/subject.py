"""The tracker that a name on the command line refers to, and the sensors of its examination."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from trackbench.base.errors import InputError, nearest_choices
from trackbench.driving.isolation import ISOLATED, Isolation, is_program
from trackbench.driving.start import fresh, fresh_tracks
from trackbench.models.sensors import Lidar, Radar, Sensor
from trackbench.scenario import Scenario, load_scenario
from trackbench.scenario.shipped import shipped
from trackbench.scenario.truth import truth_of
from trackbench.subjects.doctor.probes import RATES, Carrier, carrier_of, examination_rate
from trackbench.testing.rules import Identities
from trackbench.trackers.answers import Tracker
from trackbench.trackers.builtin import build
from trackbench.trackers.config import FilterConfig, PluginConfig
from trackbench.trackers.foreign import use_of
from trackbench.trackers.initial import InitialConfig
from trackbench.trackers.late import LateScans
from trackbench.truth.config.highway import HighwayOptions
from trackbench.truth.config.recording import FixedObserver

#: Sensors for a tracker without a scenario.
SENSORS: Mapping[str, Sensor] = {
    "lidar": Lidar(rate_hz=10, position_sigma_m=0.15),
    "radar": Radar(rate_hz=20, range_sigma_m=0.3, azimuth_sigma_deg=0.5, range_rate_sigma_mps=0.1),
}


@dataclass(frozen=True)
class ExaminedTracker:
    """A tracker to be examined, with the sensors and the observer of its examination."""

    name: str
    make: Callable[[], Any]
    """Makes a fresh tracker, of one object or of several."""
    sensors: Mapping[str, Sensor]
    multi_object: bool = False
    notes: tuple[str, ...] = ()
    """Sentences that say how the examination differs from the scenario."""
    observer: Carrier | None = None
    """Observer of the scenario; None without a scenario, and for a tracker of several objects."""


def find_tracker(
    target: str,
    options: Mapping[str, Any],
    scenario: Path | None = None,
    isolation: Isolation = ISOLATED,
    identities: Identities | None = None,
) -> ExaminedTracker:
    """Return the tracker named by ``SCENARIO#NAME``, ``module:Attr``, a published name or the command of a program.

    Args:
        target: name of the tracker.
        options: keyword arguments of a class; none with ``SCENARIO#NAME``.
        scenario: file whose sensors and observer are used. By default those of the tracker's own scenario, or else a
            radar and a lidar.
        isolation: whether a tracker that is not built in gets a process of its own.
        identities: hidden for a class that follows several objects, known by default. A scenario states its own.

    Raises:
        InputError: there is no such scenario, tracker or module, it does not take the options, or its scenario has
            other identities.
        TrackFault: the tracker's process ended while it started.
    """
    file, mark, name = target.rpartition("#")
    if not mark and (Path(target).suffix in (".yaml", ".yml") or target in shipped()):
        trackers = [f"{target}#{name}" for name in load_scenario(target).config.trackers]
        raise InputError(f"name the tracker in it: {' or '.join(trackers)}", file=target)
    sensor_scenario = None if scenario is None else load_scenario(scenario)
    sensors = SENSORS if sensor_scenario is None else sensor_scenario.config.sensors
    if mark:
        loaded = load_scenario(Path(file))
        stated = loaded.config.sensing.identities
        if identities not in (None, stated):
            raise InputError(f"the scenario's identities are {stated}: leave --identities out", file=Path(file))
        return find_tracker_in(loaded, name, options, sensor_scenario, isolation)
    folder = None if scenario is None else scenario.resolve().parent
    tracker = PluginConfig.model_validate({"use": use_of(target), "options": dict(options)})
    if identities == "hidden":
        return ExaminedTracker(target, fresh_tracks(tracker, folder, isolation), sensors, multi_object=True)
    examined = _startable(ExaminedTracker(target, fresh(tracker, folder, isolation), sensors))
    return examined if sensor_scenario is None else _with_observer(examined, sensor_scenario)


def find_tracker_in(
    loaded: Scenario,
    name: str,
    options: Mapping[str, Any] = {},
    sensor_scenario: Scenario | None = None,
    isolation: Isolation = ISOLATED,
) -> ExaminedTracker:
    """Return a tracker of a scenario, ready to be examined.

    Args:
        loaded: scenario with the tracker.
        name: name of the tracker.
        options: must be empty, because the scenario has the options of its trackers.
        sensor_scenario: scenario whose sensors and observer are used; None for those of ``loaded``.
        isolation: whether a tracker that is not built in gets a process of its own.

    Raises:
        InputError: there is no such tracker, or it cannot be examined.
    """
    sensors = None if sensor_scenario is None else sensor_scenario.config.sensors
    examined = _read_tracker(loaded, name, options, sensors, isolation)
    return examined if examined.multi_object else _with_observer(examined, sensor_scenario or loaded)


def gets_own_process(target: str, isolation: Isolation) -> bool:
    """Return whether a tracker is a Python class that gets a process of its own."""
    file, mark, name = target.rpartition("#")
    if not mark:
        config: FilterConfig | PluginConfig = PluginConfig.model_validate({"use": use_of(target)})
    else:
        scenario = load_scenario(Path(file)).config
        if name not in scenario.trackers:
            return False
        config = scenario.driven(name)
    return isolation.of(config) and not is_program(config)


def _with_observer(examined: ExaminedTracker, scenario: Scenario) -> ExaminedTracker:
    """Return the tracker with the observer of a scenario, and with a note on rates that the examination changes."""
    truth = scenario.config.truth
    if isinstance(truth, HighwayOptions) and isinstance(truth.observer, FixedObserver):
        # This observer is known without a simulation.
        fixed = truth.observer
        observer = Carrier(fixed.x, fixed.y, float(np.deg2rad(fixed.yaw_deg)))
    else:
        observer = carrier_of(truth_of(scenario).truth.observer)
    least, most = RATES
    sensors = examined.sensors
    changed = [name for name, sensor in sensors.items() if sensor.rate_hz and not least <= sensor.rate_hz <= most]
    notes = [f"the rate of {name} is {examination_rate(sensors[name]):g} Hz here" for name in changed]
    return replace(examined, observer=observer, notes=(*examined.notes, *notes))


def _read_tracker(
    loaded: Scenario, name: str, options: Mapping[str, Any], sensors: Mapping[str, Sensor] | None, isolation: Isolation
) -> ExaminedTracker:
    config, path = loaded.config, loaded.path
    if name not in config.trackers:
        raise InputError(f"there is no tracker {name!r} in it: {nearest_choices(name, config.trackers)}", file=path)
    if options:
        raise InputError("--option goes with a class; the scenario has the options of its trackers", file=path)
    tracker = config.driven(name)
    sensors_used = tracker.sensors_used
    used = sensors or {
        key: value for key, value in config.sensors.items() if sensors_used is None or key in sensors_used
    }
    notes: tuple[str, ...] = ()
    if isinstance(tracker, FilterConfig) and tracker.assume:
        tracker = tracker.model_copy(update={"assume": {}})
        notes = ("the sensors have no effects here, and the tracker assumes none",)
    if isinstance(tracker, FilterConfig) and tracker.associate is not None:
        if tracker.associate.method == "oracle":
            raise InputError(f"{name} is told the true origins, which an examination does not have", file=path)
        return ExaminedTracker(name, fresh_tracks(tracker, None, isolation), used, True, notes)
    if isinstance(tracker, FilterConfig):
        if tracker.smoother is not None:
            raise InputError(f"{name} is a smoother, which needs all measurements of a run; remove smoother", file=path)
        return _startable(ExaminedTracker(name, lambda: build(tracker), used, notes=notes))
    folder = loaded.folder
    if config.sensing.identities == "hidden":
        return ExaminedTracker(name, fresh_tracks(tracker, folder, isolation), used, multi_object=True)
    return _startable(ExaminedTracker(name, fresh(tracker, folder, isolation), used))


def _startable(examined: ExaminedTracker) -> ExaminedTracker:
    """Return the tracker; if it starts from the truth, make it start from two measurements, and note that."""
    first = examined.make()
    if not (isinstance(first, LateScans) and first.starts_from_truth):
        return examined
    initial = InitialConfig.model_validate("two_measurements")

    def make() -> Tracker:
        tracker = examined.make()
        assert isinstance(tracker, LateScans)
        return replace(tracker, tracker=replace(tracker.tracker, initial=initial))

    note = "its tracks start from two measurements here, and from the truth in the scenario"
    return replace(examined, make=make, notes=(*examined.notes, note))
