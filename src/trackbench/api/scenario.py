"""Load a scenario from a file, the package, a text or a mapping; return its truth and its scans."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from types import FunctionType
from typing import Any

from trackbench.base.errors import InputError
from trackbench.base.notebook_classes import reference_to
from trackbench.base.types import Scan, Truth, scan_of_run
from trackbench.scenario import Scenario, load_scenario
from trackbench.scenario.load import in_worlds, scenario_of, select_trackers
from trackbench.scenario.validate import same_every_run

#: File, name such as ``highway``, text of a scenario file, or its keys and values.
Named = Path | str | Mapping[str, Any]
#: Path of a scenario that is no file: relative paths in it start in the working directory.
UNSAVED = Path("scenario.yaml")


def load(
    scenario: Named,
    set: Mapping[str, Any] | Iterable[str] = (),
    *,
    runs: int | None = None,
    seed: int | None = None,
    scenes: int | None = None,
    trackers: Iterable[str] | None = None,
) -> Scenario:
    """Read and validate a scenario; nothing is simulated.

    Args:
        scenario: a YAML file; the name of a scenario that comes with trackbench, such as ``highway``; the text of a
            scenario file (with a line break); or its keys and values as a mapping, in which a class may stand for its
            name: ``{"use": Mine}``.
        set: keys to change: ``{"sensors.lidar.rate_hz": 5}`` or ``["sensors.lidar.rate_hz=5"]``.
        runs: number of Monte-Carlo runs instead of the scenario's.
        seed: seed of the noise instead of the scenario's.
        scenes: number of scenes, which replaces ``truth.seeds``.
        trackers: names of the trackers to keep; all unless given.

    Raises:
        InputError: there is no such scenario, or something in it is wrong; with file, line and key.
    """
    if not isinstance(scenario, Path | str | Mapping):
        raise InputError(f"{scenario!r} is no scenario; give a file, a name such as 'highway', a text or a mapping")
    if isinstance(trackers, Mapping):
        own = "a tracker of your own is a key of the scenario: load(..., {'trackers.mine': {'use': Mine}})"
        raise InputError(f"trackers takes the names of the trackers to keep; {own}")
    settings = set if isinstance(set, Mapping) else {}
    for key, value in settings.items():
        if isinstance(value, type) and key.startswith("trackers.") and key.count(".") == 1:
            raise InputError(
                f"write the class of a tracker under use: {{{key!r}: {{'use': {value.__name__}}}}}", key=key
            )
    overrides = [f"{key}={_yaml(value, key)}" for key, value in settings.items()] or listed(set)
    options = {"monte_carlo.runs": runs, "monte_carlo.seed": seed, "truth.seeds": scenes}
    overrides += [f"{key}={_yaml(value, key)}" for key, value in options.items() if value is not None]
    try:
        if isinstance(scenario, Mapping):
            loaded = scenario_of(_yaml(scenario), UNSAVED, overrides)
        elif isinstance(scenario, str) and "\n" in scenario:
            loaded = scenario_of(scenario, UNSAVED, overrides)
        else:
            loaded = load_scenario(scenario, overrides)
    except InputError as error:
        for key, value in settings.items():
            if isinstance(value, Mapping) and value and str(error.file).startswith(f"--set {key}="):
                example = {f"{key}.{name}": part for name, part in [*value.items()][:1]}
                hint = f"a mapping replaces all of {key}; to change one key of it write {example}"
                raise InputError(f"{error.message}; {hint}", key=error.key, file=error.file) from None
        raise
    return loaded if trackers is None else select_trackers(loaded, listed(trackers))


def load_several(
    scenarios: Iterable[Named],
    set: Mapping[str, Any] | Iterable[str] = (),
    *,
    runs: int | None = None,
    seed: int | None = None,
    scenes: int | None = None,
    trackers: Iterable[str] | None = None,
    worlds: Sequence[str] = (),
) -> tuple[list[Scenario], list[str]]:
    """Load each scenario in each of its worlds (kinds of drivers and sensors, such as typical).

    Returns:
        The scenarios, each in the named worlds or, without names, in its own; and warnings: a sentence on each of
        several scenarios that ``runs`` or ``scenes`` does not fit, and on each world that does not fit a scenario.
    """
    named, notes, loaded = [*scenarios], list[str](), list[Scenario]()
    for item in named:
        change = {option: n for option, n in (("runs", runs), ("scenes", scenes)) if n is not None}
        if len(named) > 1 and change:
            config = load(item, set).config
            fixed = {"runs": same_every_run(config), "scenes": "seeds" not in type(config.truth).model_fields}
            for option in [option for option in change if fixed[option]]:
                notes.append(f"{config.name} always has one {option[:-1]}: --{option} is ignored")
                del change[option]
        variants, world_notes = in_worlds(load(item, set, seed=seed, trackers=trackers, **change), worlds)
        loaded += variants
        notes += world_notes
    return loaded, notes


def worlds(scenario: Scenario | Named, names: Iterable[str] = ()) -> list[Scenario]:
    """Return a scenario in each of its worlds (kinds of drivers and sensors), for :func:`run`.

    Worlds that do not fit the scenario are left out.

    Args:
        scenario: a scenario, or an argument of :func:`load`.
        names: names of the worlds; unless given, the scenario's own list.

    Raises:
        InputError: something is wrong in the scenario, or there is no world with one of the names.
    """
    return in_worlds(loaded_scenario(scenario), listed(names))[0]


def loaded_scenario(scenario: Scenario | Named) -> Scenario:
    """Return a loaded scenario unchanged, and load any other."""
    return scenario if isinstance(scenario, Scenario) else load(scenario)


def listed(texts: Iterable[str]) -> list[str]:
    """Return texts as a list; a single text becomes a list of one text, not of its letters."""
    return [texts] if isinstance(texts, str) else [*texts]


def _yaml(value: Any, key: str | None = None) -> str:
    """Return a value as JSON, which as YAML keeps texts apart from numbers."""
    try:
        return json.dumps(value, default=_plain, indent=None if key else 2, allow_nan=False)
    except (TypeError, ValueError, AttributeError) as error:
        raise InputError(f"cannot be written as YAML: {error}", key=key) from None


def _plain(value: Any) -> Any:
    """Return a class as its ``module:name``, and a number or array of NumPy as plain numbers."""
    if isinstance(value, type | FunctionType):
        return reference_to(value)
    if not hasattr(value, "tolist"):
        name = type(value).__name__
        raise TypeError(f"an instance of {name}; give the class of a tracker, with its arguments under options")
    return value.tolist()


def truth(scenario: Scenario | Named) -> Truth:
    """Return the true motion of every target and of the observer; a simulated one is cached.

    Args:
        scenario: a scenario, or an argument of :func:`load`; the truth is of its first scene.

    Raises:
        InputError: something is wrong in the scenario, or a recording cannot be read.
    """
    from trackbench.scenario.truth import truth_of

    return truth_of(loaded_scenario(scenario)).truth


def sense(scenario: Scenario | Named, runs: range = range(1)) -> list[Scan]:
    """Return the scans of the runs ``runs``, sorted by time and equal to the last bit to those that trackers get.

    Args:
        scenario: a scenario, or an argument of :func:`load`; the scans are of its first scene.
        runs: numbers of the runs, from 0.

    Returns:
        Scans with ``measurement`` ``(m, objects, runs)`` and ``valid`` ``(objects, runs)``; objects are in the order of
        the truth's ``ids``. With hidden identities: ``(m, D)`` and ``(D,)``, of one run.

    Raises:
        InputError: something is wrong in the scenario, it has no such run, or identities are hidden in several runs.
    """
    # Imported here: loading a scenario does not need them.
    from trackbench.runner.work import work_of
    from trackbench.scenario.truth import truth_of
    from trackbench.sensing import scans
    from trackbench.sensing.detections import sense_hidden

    loaded = loaded_scenario(scenario)
    if not isinstance(runs, range) or not runs:
        raise InputError(f"{runs!r} is no range of runs; write range(3) for the first three", key="runs")
    total = loaded.config.monte_carlo.runs
    for run in runs:
        if run not in range(total):
            raise InputError(f"there is no run {run}; choose from 0 to {total - 1}", key="runs", file=loaded.path)
    hidden = loaded.config.sensing.identities == "hidden"
    if hidden and len(runs) != 1:
        message = "with hidden identities each run has its own number of detections; ask for one run at a time"
        raise InputError(message, key="runs", file=loaded.path)
    loaded_truth = truth_of(loaded)
    work = work_of(loaded, [loaded_truth])
    sensors = work.scenes[0].sensors
    if hidden:
        return [scan_of_run(scan, 0) for scan in sense_hidden(sensors, work.seed, work.scenario, runs).scans]
    sensed = scans.sense_known(sensors, work.seed, work.scenario, runs).scans
    shape = (len(loaded_truth.truth.ids), len(runs))
    return [
        scan._replace(measurement=scan.measurement.reshape(-1, *shape), valid=scan.valid.reshape(shape))
        for scan in sensed
    ]
