"""The settings of a tracker under ``trackers`` in a scenario, with some options changed."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from typing import Any

from pydantic import TypeAdapter, ValidationError

from trackbench.base.config.messages import explain
from trackbench.base.errors import InputError
from trackbench.models.motion import MotionModel
from trackbench.scenario import Scenario
from trackbench.scenario.config import ScenarioConfig
from trackbench.scenario.overrides import set_value
from trackbench.trackers.config import AnyTracker, FilterConfig, PluginConfig

Entry = FilterConfig | PluginConfig
Values = Mapping[str, Any]
#: Prefix of the key of an IMM model's mean duration; the number of the model follows.
STAYS = "motion.stay_s."

_TRACKER: TypeAdapter[Entry] = TypeAdapter(AnyTracker)


def plain(loaded: Scenario, tracker: str, values: Values = {}) -> dict[str, Any]:  # noqa: B006
    """Return the settings of a tracker in a scenario as YAML values, with the options ``values`` changed."""
    entry: dict[str, Any] = copy.deepcopy(loaded.document.value["trackers"][tracker])
    for key, value in values.items():
        set_value(entry, key, copy.deepcopy(value))
    return entry


def entry_with(loaded: Scenario, tracker: str, values: Values) -> Entry:
    """Return the validated settings of a tracker in a scenario, with the options ``values`` changed.

    Raises:
        ValidationError: the values are invalid, or contradict each other.
    """
    return _TRACKER.validate_python(plain(loaded, tracker, values), context={"folder": loaded.folder})


def problem_with(loaded: Scenario, tracker: str, values: Values) -> str | None:
    """Return the reason why a tracker's options cannot have these values; None where they can."""
    try:
        trackers = {**loaded.document.value["trackers"], tracker: plain(loaded, tracker, values)}
        ScenarioConfig.model_validate(
            {**loaded.document.value, "trackers": trackers}, context={"folder": loaded.folder}
        )
    except InputError as error:
        # The rest of the message is advice on the option --set.
        return error.message.partition("; set it as a whole")[0]
    except ValidationError as invalid:
        return explain(invalid, {})[0].message
    return None


def current(loaded: Scenario, tracker: str, key: str) -> Any:
    """Return the value of an option in the scenario, or its default; None for an unknown option."""
    config = loaded.config
    node: Any = config.trackers[tracker]
    parts = key.split(".")
    if parts[0] == "measurement_noise" and len(parts) == 3 and isinstance(node, FilterConfig):
        stated = node.measurement_noise.get(parts[1], {}).get(parts[2])
        return getattr(config.sensors.get(parts[1]), parts[2], None) if stated is None else stated
    if (
        isinstance(node, FilterConfig)
        and isinstance(node.motion, MotionModel)
        and key in type(node.motion).model_fields
    ):
        node = node.motion
    for part in parts:
        if isinstance(node, Mapping):
            node = node.get(part)
        elif isinstance(node, list | tuple):
            node = node[int(part)] if part.isdecimal() and int(part) < len(node) else None
        else:
            # An option such as ``from``, a keyword of Python, has an alias.
            fields = getattr(type(node), "model_fields", {})
            node = getattr(node, next((name for name, field in fields.items() if field.alias == part), part), None)
    return node
