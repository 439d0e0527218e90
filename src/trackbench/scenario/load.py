"""Load a scenario: read, change and validate its file, and select trackers or worlds."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import yaml
from pydantic import ValidationError

from trackbench.base import files
from trackbench.base.config import KeyPath
from trackbench.base.config.messages import explain
from trackbench.base.errors import InputError, InputErrors, counted, nearest_choices
from trackbench.scenario.config import ScenarioConfig
from trackbench.scenario.overrides import apply_overrides, expand_sweeps, with_moved_paths
from trackbench.scenario.shipped import find_scenario
from trackbench.scenario.source import YamlDocument, parse_yaml
from trackbench.scenario.worlds import WORLDS, NoSuchWorldError, changes

#: Largest width of a line of a written scenario.
WIDTH = 120


@dataclass(frozen=True, repr=False)
class Scenario:
    """Validated scenario with the text and changes that it was made from."""

    config: ScenarioConfig
    path: Path
    text: str
    """Text of the file as written, before ``--set`` and the like."""
    overrides: tuple[str, ...]
    """Changes ``key.path=value`` that were applied to the file, by ``--set`` or an argument."""
    document: YamlDocument
    """Keys and values after all changes, each with its line in the file."""
    sweeps: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    """Names of the trackers into which a sweep was expanded, by name of the tracker that has the sweep."""
    selected: tuple[str, ...] = ()
    """Names of trackers that the user selected; empty if all trackers of the file are kept."""

    @property
    def places(self) -> dict[str, int]:
        """Index of each tracker among all trackers of the file, selected or not, by name."""
        return {name: place for place, name in enumerate(self.document.value["trackers"])}

    @property
    def folder(self) -> Path:
        """Folder in which relative paths start."""
        return self.path.resolve().parent

    def __repr__(self) -> str:
        runs = counted(self.config.monte_carlo.runs, "run")
        return f"<scenario {self.config.name}: {counted(len(self.config.trackers), 'tracker')}, {runs}>"

    def locate(self, error: InputError) -> InputError:
        """Return an error with the file and line of its key."""
        if isinstance(error, InputErrors):
            return InputErrors([self.locate(part) for part in error.errors])
        if error.file is not None:
            return error
        return error.located(**self.document.origin(_key_path(self.document, error.key))._asdict())


#: Largest number of errors that are shown for one file.
MOST_ERRORS = 50


def load_scenario(named: Path | str, overrides: Sequence[str] = ()) -> Scenario:
    """Read, override and validate a scenario file.

    Checks that need highway-env or the code of a tracker are made by :func:`check`, not here.

    Args:
        named: the YAML file, or the name of a scenario that comes with the package.
        overrides: ``key.path=value`` each; the value is read as YAML.

    Raises:
        InputError: the file cannot be read or is not YAML.
        InputErrors: everything that is wrong in the file, in the order of its lines.
    """
    path = find_scenario(named)
    return scenario_of(files.read_text(path, "; save the file as UTF-8"), path, overrides)


def scenario_of(text: str, path: Path, overrides: Sequence[str] = ()) -> Scenario:
    """Return the scenario in a YAML text, changed and validated like a file; errors name ``path``."""
    document, keys = parse_yaml(text, str(path)), ScenarioConfig.model_fields
    if not isinstance(document.value, dict):
        result = "is empty" if document.value is None else "is not a mapping of keys to values"
        required = ", ".join(name for name, field in keys.items() if field.is_required())
        message = f"the file {result}; a scenario has the keys {required}"
        raise InputError(message, file=path, line=document.origin(()).line)
    if not {*document.value} & {*keys}:
        # Messages must not show the content of a file of another kind.
        raise InputError(f"this is no scenario: it has none of the keys {', '.join(keys)}", file=path)
    document, sweeps = expand_sweeps(_in_world(apply_overrides(document, overrides)))
    try:
        config = ScenarioConfig.model_validate(document.value, context={"folder": path.resolve().parent})
    except ValidationError as invalid:
        problems = explain(invalid, {})
        raise _in_file_order(document, problems[:MOST_ERRORS], len(problems) - MOST_ERRORS) from None
    except RecursionError:
        raise InputError("nested too deeply", file=path) from None
    expected = [item for item in config.expect if item.holds_in(config.world)]
    config = config.model_copy(update={"expect": expected})
    return Scenario(config, path, text, tuple(overrides), document, sweeps)


def _in_world(document: YamlDocument) -> YamlDocument:
    """Change a document into the world (kind of drivers and sensors) that its key ``world`` names, if it names one."""
    world = document.value.get("world")
    if world not in WORLDS:
        return document
    try:
        return apply_overrides(document, changes(document.value, world))
    except InputError as error:
        raise error.located(**document.origin(_key_path(document, error.key))._asdict()) from None


def _in_file_order(document: YamlDocument, problems: Iterable[tuple[KeyPath, str]], more: int) -> InputError:
    unique = list({str(error): error for error in (document.error(*problem) for problem in problems)}.values())
    unique.sort(key=lambda error: (error.line is None, error.line or 0))
    if more > 0:
        unique.append(InputError(f"and {counted(more, 'more error')}", file=document.origin(()).file))
    return unique[0] if len(unique) == 1 else InputErrors(unique)


def _key_path(document: YamlDocument, key: str | None) -> KeyPath:
    """Return a dotted key as a path of keys and, in lists, integer indices; empty for None."""
    path: KeyPath = ()
    node = document.value
    for part in key.split(".") if key else ():
        is_index = isinstance(node, list) and part.isdecimal() and int(part) < len(node)
        step: str | int = int(part) if is_index else part
        path = (*path, step)
        node = node[step] if is_index else node.get(part) if isinstance(node, dict) else None
    return path


def select_trackers(loaded: Scenario, names: Sequence[str]) -> Scenario:
    """Return the scenario with only the named trackers, and the expectations on these trackers.

    Args:
        loaded: the scenario.
        names: names of trackers; the name of a sweep stands for all its points.

    Raises:
        InputError: the scenario has no tracker with one of the names.
    """
    config = loaded.config
    for name in names:
        if name not in config.trackers and name not in loaded.sweeps:
            problem = (
                f"no tracker {name!r} in this scenario; {nearest_choices(name, [*config.trackers, *loaded.sweeps])}"
            )
            raise InputError(problem, key="--trackers", file=loaded.path)
    selected = {point for name in names for point in loaded.sweeps.get(name, (name,))}
    trackers = {name: tracker for name, tracker in config.trackers.items() if name in selected}
    if not trackers:
        raise InputError("name at least one tracker", key="--trackers", file=loaded.path)
    expect = [item for item in config.expect if {item.tracker, item.better_than or item.tracker} <= set(trackers)]
    config = config.model_copy(update={"trackers": trackers, "expect": expect})
    return replace(loaded, config=config, selected=tuple(names))


def in_worlds(loaded: Scenario, worlds: Sequence[str] = ()) -> tuple[list[Scenario], list[str]]:
    """Return the scenario changed into each world (its drivers and sensors), and why a world does not fit it.

    Args:
        loaded: the scenario; it is returned unchanged if it is in a world already.
        worlds: names of the worlds; the scenario's own list if empty. Without either, it is returned unchanged.

    Raises:
        InputError: there is no world with one of the names.
    """
    for world in worlds:
        if world not in WORLDS:
            raise InputError(f"no world {world!r}; {nearest_choices(world, WORLDS)}", key="--worlds")
    current = loaded.config.world
    if worlds and current is not None:
        message = f"its key world already says {current}: remove that key, or leave --worlds out"
        raise loaded.locate(InputError(message, key="world"))
    names = [*worlds] or loaded.config.worlds
    if not names or current is not None:
        return [loaded], []
    scenarios: list[Scenario] = []
    notes = []
    for world in dict.fromkeys(names):
        try:
            scenario = scenario_of(loaded.text, loaded.path, [*loaded.overrides, f"world={world}"])
            scenarios.append(select_trackers(scenario, loaded.selected) if loaded.selected else scenario)
        except NoSuchWorldError as error:
            notes.append(f"{loaded.config.name} in the world {world}: {error.message}")
    return scenarios, notes


def own_modules(loaded: Scenario) -> list[Path]:
    """Return the Python files in a scenario's folder that the scenario names, as in ``use: my_tracker:Tracker``."""
    files = (loaded.folder / f"{name}.py" for name in _module_names(loaded) if name.isidentifier())
    return list(dict.fromkeys(file for file in files if file.is_file()))


def own_folder(loaded: Scenario) -> Path | None:
    """Return the scenario's folder if a module or package that the scenario names is in it, else None."""
    folder, tops = loaded.folder, {name.partition(".")[0] for name in _module_names(loaded)}
    has_modules = any((folder / f"{top}.py").is_file() or (folder / top / "__init__.py").is_file() for top in tops)
    return folder if has_modules else None


def _module_names(loaded: Scenario) -> Iterator[str]:
    """Return the possible module names in a scenario: in each text with a colon, the part before the colon."""
    return (text.partition(":")[0] for text in texts_of(loaded.document.value) if ":" in text)


def texts_of(node: Any) -> Iterator[str]:
    """Yield every text that is a value, not a key, in a tree of mappings and lists."""
    nodes = [node]
    while nodes:
        node = nodes.pop()
        if isinstance(node, dict | list):
            nodes += node.values() if isinstance(node, dict) else node
        elif isinstance(node, str):
            yield node


def written_with_changes(loaded: Scenario, folder: Path) -> str:
    """Return the YAML text of a scenario with its changes applied, for a file in ``folder``; comments are lost.

    Args:
        loaded: the scenario.
        folder: folder of the new file; the paths of a recorded truth are made relative to it.
    """
    value = apply_overrides(parse_yaml(loaded.text, "scenario"), loaded.overrides).value
    value["truth"] = with_moved_paths(value["truth"], loaded.folder, folder)
    return yaml.safe_dump(value, sort_keys=False, width=WIDTH, allow_unicode=True)
