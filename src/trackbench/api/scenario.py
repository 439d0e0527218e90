"""Loading a scenario: of a file, of the package, or of a text or mapping at hand."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from trackbench.base.errors import InputError
from trackbench.scenario import Scenario, load_scenario
from trackbench.scenario.load import scenario_of, select_trackers
from trackbench.scenario.recorded_checks import same_every_run

#: A file, a name such as ``highway``, the text of a scenario file, or its keys and values.
Named = Path | str | Mapping[str, Any]
#: As which a text at hand is read: what it names is looked for in the working directory.
AT_HAND = Path("scenario.yaml")


def load(
    scenario: Named,
    set: Mapping[str, Any] | Iterable[str] = (),
    *,
    runs: int | None = None,
    seed: int | None = None,
    scenes: int | None = None,
    trackers: Iterable[str] | None = None,
) -> Scenario:
    """A scenario, read and validated; nothing is simulated.

    Args:
        scenario: a YAML file; the name of a scenario that comes with trackbench, such as ``highway``; the text of a
            scenario file (with a line break); or the same as a mapping.
        set: keys to change: ``{"sensors.lidar.rate_hz": 5}`` or ``["sensors.lidar.rate_hz=5"]``.
        runs: number of Monte-Carlo runs instead of the scenario's.
        seed: of the noise, instead of the scenario's.
        scenes: number of scenes; the same as ``truth.seeds``.
        trackers: names of those to keep; all unless given.

    Raises:
        InputError: there is no such scenario, or something in it is wrong; with file, line and key.
    """
    if not isinstance(scenario, Path | str | Mapping):
        raise InputError(f"{scenario!r} is no scenario; give a file, a name such as 'highway', a text or a mapping")
    changes = [f"{key}={_yaml(value, key)}" for key, value in set.items()] if isinstance(set, Mapping) else set
    overrides = listed(changes)
    given = {"monte_carlo.runs": runs, "monte_carlo.seed": seed, "truth.seeds": scenes}
    overrides += [f"{key}={_yaml(value, key)}" for key, value in given.items() if value is not None]
    if isinstance(scenario, Mapping):
        loaded = scenario_of(_yaml(scenario), AT_HAND, overrides)
    elif isinstance(scenario, str) and "\n" in scenario:
        loaded = scenario_of(scenario, AT_HAND, overrides)
    else:
        loaded = load_scenario(scenario, overrides)
    return loaded if trackers is None else select_trackers(loaded, listed(trackers))


def load_several(
    scenarios: Iterable[Named],
    set: Mapping[str, Any] | Iterable[str] = (),
    *,
    runs: int | None = None,
    seed: int | None = None,
    scenes: int | None = None,
    trackers: Iterable[str] | None = None,
) -> tuple[list[Scenario], list[str]]:
    """As :func:`load` each; what always has one run or one scene keeps it, if another one takes ``runs`` or ``scenes``.

    Returns:
        The scenarios, and a sentence on those that an option does not change.
    """
    named, given = [*scenarios], {"runs": runs, "scenes": scenes}
    changes: list[dict[str, int]] = [{option: n for option, n in given.items() if n is not None} for _ in named]
    plain = [load(item, set).config for item in named] if len(named) > 1 and any(changes) else []
    found = []
    for option, word, fixed in (
        ("runs", "run", [same_every_run(config) for config in plain]),
        ("scenes", "scene", ["seeds" not in type(config.truth).model_fields for config in plain]),
    ):
        if given[option] is not None and any(fixed) and not all(fixed):
            for change, one in zip(changes, fixed, strict=True):
                if one:
                    del change[option]
            names = ", ".join(config.name for config, one in zip(plain, fixed, strict=True) if one)
            found.append(f"one {word}, whatever --{option} says: {names}")
    loaded = [
        load(item, set, seed=seed, trackers=trackers, **change) for item, change in zip(named, changes, strict=True)
    ]
    return loaded, found


def loaded_scenario(scenario: Scenario | Named) -> Scenario:
    """A scenario that is loaded already, or is loaded as it is."""
    return scenario if isinstance(scenario, Scenario) else load(scenario)


def listed(texts: Iterable[str]) -> list[str]:
    """Texts as a list; a single one is a list of itself, not of its letters."""
    return [texts] if isinstance(texts, str) else [*texts]


def _yaml(value: Any, key: str | None = None) -> str:
    """A value as YAML, of which JSON is a part that says what is text."""
    try:
        # Numbers and arrays of NumPy have tolist().
        return json.dumps(value, default=lambda item: item.tolist(), indent=None if key else 2, allow_nan=False)
    except (TypeError, ValueError, AttributeError) as error:
        raise InputError(f"cannot be written as YAML: {error}", key=key) from None
