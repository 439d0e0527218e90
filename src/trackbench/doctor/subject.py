"""The tracker that a name on the command line stands for."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from trackbench.errors import InputError, nearest
from trackbench.models.sensors import Lidar, Radar, Sensor
from trackbench.scenario import load_scenario
from trackbench.trackers.base import Tracker
from trackbench.trackers.builtin import build
from trackbench.trackers.config import FilterConfig, InitialConfig
from trackbench.trackers.filtered import FilterTracker
from trackbench.trackers.published import create

#: What a tracker is examined with unless a scenario says otherwise.
SENSORS: Mapping[str, Sensor] = {
    "lidar": Lidar(rate_hz=10, position_sigma_m=0.15),
    "radar": Radar(rate_hz=20, range_sigma_m=0.3, azimuth_sigma_deg=0.5, range_rate_sigma_mps=0.1),
}


@dataclass(frozen=True)
class Subject:
    """A tracker to be examined."""

    name: str
    make: Callable[[], Tracker]
    sensors: Mapping[str, Sensor]
    notes: tuple[str, ...] = ()
    """What was done differently from what its scenario says."""


def subject(target: str, options: Mapping[str, Any], scenario: Path | None = None) -> Subject:
    """The tracker behind ``SCENARIO.yaml#NAME``, ``module:Attr`` or a published name.

    Args:
        target: the name.
        options: keyword arguments of a class; not with ``SCENARIO.yaml#NAME``.
        scenario: the file whose sensors the tracker is examined with; those of its own, or else a radar and a lidar,
            unless given.

    Raises:
        InputError: there is no such scenario, tracker or module, or the options do not fit.
    """
    file, mark, name = target.rpartition("#")
    if not mark and Path(target).suffix in (".yaml", ".yml"):
        names = list(load_scenario(Path(target)).config.trackers)
        raise InputError(f"say which of its trackers: {target}#{names[0]} ({', '.join(names)})", file=target)
    sensors = SENSORS if scenario is None else load_scenario(scenario).config.sensors
    if mark:
        return _of_scenario(Path(file), name, options, None if scenario is None else sensors)
    folder = None if scenario is None else scenario.resolve().parent
    return _startable(Subject(target, create(target, dict(options), folder), sensors))


def _of_scenario(path: Path, name: str, options: Mapping[str, Any], sensors: Mapping[str, Sensor] | None) -> Subject:
    config = load_scenario(path).config
    if name not in config.trackers:
        raise InputError(f"there is no tracker {name!r} in it: {nearest(name, config.trackers)}", file=path)
    if options:
        raise InputError("--option goes with a class; that of a scenario has its options there", file=path)
    tracker = config.trackers[name]
    sensors_used = tracker.sensors_used
    seen = sensors or {
        key: value for key, value in config.sensors.items() if sensors_used is None or key in sensors_used
    }
    if isinstance(tracker, FilterConfig):
        return _startable(Subject(name, lambda: build(tracker), seen))
    return _startable(Subject(name, create(tracker.use, tracker.options, path.resolve().parent), seen))


def _startable(of: Subject) -> Subject:
    """A tracker that is given its first state by the bench starts from two measurements here."""
    made = of.make()
    if not (isinstance(made, FilterTracker) and made.starts_from_truth):
        return of
    initial = InitialConfig.model_validate("two_readings")

    def make() -> Tracker:
        tracker = of.make()
        assert isinstance(tracker, FilterTracker)
        return replace(tracker, initial=initial)

    return replace(of, make=make, notes=("its tracks start from the truth; here they start from two measurements",))
