"""What an environment is asked for, as a scenario that is checked as any other."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from copy import deepcopy
from typing import Any, get_args

from trackbench.api.scenario import Named, load
from trackbench.base.errors import InputError, InputErrors, nearest_choices
from trackbench.scenario import Scenario
from trackbench.scenario.load import scenario_of
from trackbench.trackers.associate import AssociationMethod

#: Where sensors and trackers come from unless stated.
SCENARIO = "traffic/dense_highway"
#: In place of a tracker: every vehicle as it is, or the detections as they are.
TRUTH, DETECTIONS = "truth", "detections"
METHODS: tuple[str, ...] = get_args(AssociationMethod)
#: The key of the tracker in the scenario.
TRACKER = "tracker"
#: By key of that scenario, what the environment is given.
KEYS = {f"trackers.{TRACKER}": "tracker", "truth.config": "config", "truth.env": "env"}
#: Keys of a truth that mean nothing here.
UNUSED = ("seed", "seeds", "targets", "observer", "others_within_m", "audit")
HIGHWAY = {"source": "highway-env", "env": "highway-v0", "duration_s": 60, "rate_hz": 20}


def setting_of(
    env: str | None,
    config: Mapping[str, Any] | None,
    scenario: Named | None,
    sensors: Mapping[str, Any] | None,
    tracker: str | Mapping[str, Any],
) -> Scenario:
    """The scenario with one tracker, or with none that counts where it is the truth or detections.

    Args:
        env: id of highway-env; that of the scenario unless given.
        config: changes of the environment's configuration; ``simulation_frequency`` is the rate of the truth.
        scenario: whose truth, sensors and trackers hold where nothing else is stated.
        sensors: by name, as in a scenario.
        tracker: as in a scenario, the name of one of the scenario's, or a method of association.

    Raises:
        InputError: anything in it is wrong.
    """
    base = load(SCENARIO if scenario is None else scenario)
    written: dict[str, Any] = deepcopy(base.document.value)
    truth = written["truth"]
    if truth.get("source") != HIGHWAY["source"] and env is None:
        raise InputError(f"the truth of {base.config.name} is not highway-env; give env", key="env")
    if truth.get("source") != HIGHWAY["source"] or (env is not None and env != truth["env"]):
        truth = {
            **HIGHWAY,
            **{key: truth[key] for key in ("drivers", "steering_rate_degps") if key in truth},
            "env": env,
        }
    changes = {} if config is None else _mapping(config, "config")
    rate = changes.pop("simulation_frequency", truth["rate_hz"])
    truth = {key: value for key, value in truth.items() if key not in UNUSED}
    asked = {
        "name": base.config.name,
        "truth": {**truth, "rate_hz": rate, "ego": "idle", "config": {**truth.get("config", {}), **changes}},
        "sensing": {"identities": "hidden"},
        "sensors": written["sensors"] if sensors is None else _mapping(sensors, "sensors"),
        "trackers": {TRACKER: _entry(tracker, written["trackers"])},
    }
    with asked_errors():
        return scenario_of(json.dumps(asked, default=_plain), base.path)


@contextmanager
def asked_errors() -> Iterator[None]:
    """Errors name what was asked for, not a place in a scenario file that nobody wrote."""
    try:
        yield
    except InputErrors as several:
        raise InputErrors([_asked(error) for error in several.errors]) from several
    except InputError as error:
        raise _asked(error) from error


def _asked(error: InputError) -> InputError:
    key = error.key
    for inner, outer in KEYS.items():
        if key is not None and (key == inner or key.startswith(f"{inner}.")):
            key = outer + key.removeprefix(inner)
    return InputError(error.message, key=key)


def _mapping(value: Any, key: str) -> dict[str, Any]:
    if not isinstance(value, Mapping):
        raise InputError(f"must be a mapping, not {value!r}", key=key)
    return dict(value)


def _plain(value: Any) -> Any:
    """Numbers and arrays of NumPy as Python's."""
    try:
        return value.tolist()
    except AttributeError:
        raise InputError(f"{value!r} cannot stand in a scenario") from None


def _entry(tracker: str | Mapping[str, Any], named: Mapping[str, Any]) -> Any:
    if not isinstance(tracker, str):
        return _mapping(tracker, "tracker")
    if tracker in (TRUTH, DETECTIONS):
        return _of_method("naive")
    if tracker in named:
        return named[tracker]
    if tracker in METHODS:
        return _of_method(tracker)
    if ":" in tracker:
        return {"use": tracker}
    raise InputError(
        f"no tracker {tracker!r}; {nearest_choices(tracker, [TRUTH, DETECTIONS, *named, *METHODS])}", key="tracker"
    )


def _of_method(method: str) -> dict[str, Any]:
    return {"filter": "ekf", "motion": "cv", "acceleration_sigma_mps2": 3, "associate": {"method": method}}
