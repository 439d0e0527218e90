"""The files of a tuning: its JSON values, and the scenario with the values that were found."""

from __future__ import annotations

import copy
import itertools
import json
import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any
from urllib.parse import quote

import yaml

from trackbench import results
from trackbench.base.errors import InputError
from trackbench.base.files import path_from
from trackbench.document.drawing import svg_file
from trackbench.document.html import to_html
from trackbench.document.markdown import to_markdown
from trackbench.scenario import Scenario
from trackbench.scenario.load import WIDTH, own_modules
from trackbench.scenario.overrides import expand_sweeps, with_moved_paths
from trackbench.scenario.source import parse_yaml
from trackbench.subjects.tuning.entry import Values, plain
from trackbench.subjects.tuning.report import remarks, tuning_document, tuning_headline
from trackbench.subjects.tuning.search import NEGLIGIBLE
from trackbench.subjects.tuning.study import TuningTrial
from trackbench.subjects.tuning.tune import Tuning

SCHEMA_VERSION = 1


def tuning_content(tunings: Sequence[Tuning], command: str) -> dict[str, Any]:
    """All that was found of each tracker, and the command that repeats it."""
    return {
        "schema_version": SCHEMA_VERSION,
        "command": command,
        "objective": tunings[0].objective.name,
        "scenarios": [
            {
                "name": name,
                "train": {"scenes": tunings[0].train_scenes[number], "runs": tunings[0].train_runs[number]},
                "test": {"scenes": tunings[0].held_out.scenes[name], "runs": tunings[0].held_out.runs[name]},
                "held_out": tunings[0].apart[number] or None,
            }
            for number, name in enumerate(tunings[0].scenarios)
        ],
        "trackers": [_tracker(item) for item in tunings],
    }


def _tracker(item: Tuning) -> dict[str, Any]:
    return {
        "name": item.tracker,
        "verdict": tuning_headline(item)[0],
        "remarks": list(remarks(item)),
        "engine": item.engine,
        "ranges": [parameter.as_json() for parameter in item.parameters],
        "start": item.start,
        "tuned": dict(item.best.values),
        "at_edge": [parameter.key for parameter, _ in item.edges],
        "held_out": [
            {
                "scenario": comparison.scenario,
                "metric": comparison.measure,
                "unit": comparison.unit,
                **{
                    name: {"value": value.value, "ci95": None if value.ci95 is None else list(value.ci95)}
                    for name in ("start", "tuned", "difference")
                    for value in [getattr(comparison, name)]
                },
                "p_value": comparison.p_value,
                "verdict": comparison.verdict,
            }
            for comparison in item.held_out.comparisons
        ],
        "response": [
            {
                "option": response.parameter.key,
                "within_1_percent": list(response.within(NEGLIGIBLE)) if response.parameter.continuous else None,
                "optimum_ci95": list(response.optimum95)
                if response.parameter.continuous and response.has_reach
                else None,
                "not_shown_worse": None if response.parameter.continuous else response.as_good,
                "points": [
                    {
                        "value": point.value,
                        "rise": point.rise if math.isfinite(point.rise) else None,
                        "reach95": point.reach,
                    }
                    for point in response.points
                ],
            }
            for response in item.responses
        ],
        "front": [_trial(trial) for trial in item.front],
        "trials": [_trial(trial) for trial in item.trials],
    }


def _trial(trial: TuningTrial) -> dict[str, Any]:
    return {
        "values": dict(trial.values),
        "losses": list(trial.losses),
        "failed": trial.failed or None,
        "measures": dict(trial.measures),
    }


ENDING = ".yaml"


def default_out(scenarios: Sequence[Scenario]) -> Path:
    """A file for one scenario, a folder for several."""
    return Path("tuned.yaml" if len(scenarios) == 1 else "tuned")


def require_tuning_files(out: Path, scenarios: Sequence[Scenario]) -> None:
    """Make sure that the files can be written, before the work begins.

    Raises:
        InputError: the name is none for them, or a scenario would be overwritten.
    """
    single = len(scenarios) == 1
    if single != (out.suffix == ENDING):
        wanted = (
            "give a file whose name ends in .yaml" if single else "several scenarios go into a folder: give its name"
        )
        raise InputError(wanted, key="--out", file=out)
    for scenario, file in zip(scenarios, tuned_scenario_files(out, scenarios), strict=True):
        if file.resolve() == scenario.path.resolve():
            raise InputError("is the scenario that is tuned, which is not overwritten; give another name", key="--out")
        results.require_file(file, "--out")
        for module in own_modules(scenario):
            there = file.parent / module.name
            if there.is_file() and there.read_bytes() != module.read_bytes():
                raise InputError(
                    f"another {module.name} than that beside {scenario.path} is there; give another folder",
                    key="--out",
                    file=out,
                )


def tuned_scenario_files(out: Path, scenarios: Sequence[Scenario]) -> list[Path]:
    """Where each scenario with the found values goes."""
    return [out] if len(scenarios) == 1 else [out / f"{item.config.name}{ENDING}" for item in scenarios]


def save_tuning(tunings: Sequence[Tuning], scenarios: Sequence[Scenario], out: Path, command: str) -> list[Path]:
    """Write all files, each whole or not at all; the scenarios come last. Figures of an earlier tuning go.

    Returns:
        Those that a reader opens, and the folder of the figures.

    Raises:
        OutputError: one cannot be written.
    """
    base = out.with_suffix("") if len(scenarios) == 1 else out / "tuning"
    document = tuning_document(tunings, command)
    figures = base.with_name(f"{base.name}_figures")
    content = {
        base.with_name(f"{base.name}.json"): results.json_text(tuning_content(tunings, command)).encode(),
        base.with_name(f"{base.name}.html"): to_html(document).encode(),
        base.with_name(f"{base.name}.md"): to_markdown(document, figures=quote(figures.name)).encode(),
    }
    drawn = {figures / f"{figure.name}.svg": svg_file(figure).encode() for figure in document.figures}
    values = {item.tracker: item.best.values for item in tunings}
    for scenario, file in zip(scenarios, tuned_scenario_files(out, scenarios), strict=True):
        folder = file.parent.resolve()
        # Trackers are looked for beside the scenario that names them.
        content |= {file.parent / own.name: own.read_bytes() for own in own_modules(scenario) if own.parent != folder}
        content[file] = tuned_scenario_text(scenario, values, file.parent).encode()
    for stale in {*figures.glob("*.svg")} - {*drawn}:
        stale.unlink()
    for file, each in {**drawn, **content}.items():
        results.write_bytes(file, each)
    return [*content, *([figures] if drawn else [])]


START, TUNED = "_start", "_tuned"


def tuned_scenario_text(loaded: Scenario, tuned: Mapping[str, Values], folder: Path) -> str:
    """The text of the scenario, each tuned tracker with its new values under its name, and as it was under NAME_start.

    Comments, anchors and the other trackers stay as they are. A scenario that the command line changed is written anew,
    and so is one whose text cannot be changed in place. A point of a sweep gets an entry of its own, NAME_tuned.

    Args:
        loaded: the scenario.
        tuned: by tracker the values of its options.
        folder: where it is written; a relative path of a recording is as seen from there.
    """
    names = _second_names(loaded, tuned)
    entries = {name: plain(loaded, name, values) for name, values in tuned.items()}

    def seen(path: str) -> str:
        return path_from(path, loaded.folder, folder)

    truth = loaded.document.value["truth"]
    wanted = {
        **loaded.document.value,
        "truth": with_moved_paths(truth, seen) if truth.get("source") == "recording" else truth,
        "trackers": _with_entries(loaded, entries, names),
    }
    if not loaded.overrides:
        try:
            text = _changed(loaded, entries, names, seen)
            if expand_sweeps(parse_yaml(text, str(loaded.path)))[0].value == wanted:
                return text
        except (InputError, KeyError):
            # Such as an entry that a merge key brings in, or a key after a question mark.
            pass
    return yaml.safe_dump(wanted, sort_keys=False, width=WIDTH, allow_unicode=True)


def _second_names(loaded: Scenario, tuned: Mapping[str, Values]) -> dict[str, str]:
    """By tuned tracker the name of its second entry: as it was; of a point of a sweep, as it is tuned."""
    taken = {*loaded.document.value["trackers"]}
    names = {}
    for tracker in tuned:
        plain_name = tracker + (TUNED if _sweep(loaded, tracker) else START)
        numbered = (f"{plain_name}_{number}" for number in itertools.count(2))
        names[tracker] = next(name for name in itertools.chain([plain_name], numbered) if name not in taken)
        taken.add(names[tracker])
    return names


def _sweep(loaded: Scenario, tracker: str) -> str | None:
    """The name of the sweep that a tracker is a point of."""
    return next((name for name, points in loaded.sweeps.items() if tracker in points), None)


def _with_entries(loaded: Scenario, entries: Mapping[str, Any], names: Mapping[str, str]) -> dict[str, Any]:
    """All trackers, the tuned ones twice."""
    trackers = {}
    for name, entry in loaded.document.value["trackers"].items():
        if name not in entries:
            trackers[name] = entry
        elif _sweep(loaded, name):
            trackers |= {name: entry, names[name]: entries[name]}
        else:
            trackers |= {name: entries[name], names[name]: copy.deepcopy(entry)}
    return trackers


def _changed(
    loaded: Scenario, entries: Mapping[str, dict[str, Any]], names: Mapping[str, str], seen: Callable[[str], str]
) -> str:
    """The text of the file, changed in place.

    Raises:
        KeyError: something does not stand where it does in most scenarios.
    """
    text = loaded.text
    if loaded.document.value["truth"].get("source") == "recording":
        nodes = {node.start_mark.index: node for node in _path_nodes(_entry(_composed(text), "truth")[1])}
        for start, node in sorted(nodes.items(), reverse=True):
            text = f"{text[:start]}{json.dumps(seen(node.value))}{text[node.end_mark.index :]}"
    for tracker, entry in entries.items():
        trackers = _entry(_composed(text), "trackers")[1]
        sweep = _sweep(loaded, tracker)
        key = _entry(trackers, sweep or tracker)[0]
        if sweep:
            text = _inserted(text, key.start_mark, names[tracker], entry, trackers.flow_style)
        else:
            text = text[: key.start_mark.index] + names[tracker] + text[key.end_mark.index :]
            text = _inserted(text, key.start_mark, tracker, entry, trackers.flow_style)
    return text


def _composed(text: str) -> Any:
    return yaml.compose(text, Loader=yaml.SafeLoader)


def _entry(node: Any, name: str) -> tuple[Any, Any]:
    """The nodes of a key and of its value."""
    return {key.value: (key, value) for key, value in node.value}[name]


def _path_nodes(node: Any) -> Iterator[Any]:
    """The nodes of all paths of a recording."""
    if isinstance(node, yaml.MappingNode):
        for key, value in node.value:
            if key.value == "path":
                yield from value.value if isinstance(value, yaml.SequenceNode) else [value]
            else:
                yield from _path_nodes(value)


def _inserted(text: str, mark: yaml.Mark, name: str, entry: dict[str, Any], in_braces: bool) -> str:
    """The text with an entry of a mapping before the one that begins at the mark."""
    before, after = text[: mark.index], text[mark.index :]
    line, margin = f"{name}: {_shown(entry)}", " " * mark.column
    if in_braces:
        between = " " if before.rpartition("\n")[2].strip() else f"\n{margin}"
        return f"{before}{line},{between}{after}"
    if mark.column + len(line) > WIDTH:
        rows = [f"{key}: {_shown(value)}" for key, value in entry.items()]
        line = f"\n{margin}  ".join([f"{name}:", *rows])
    return f"{before}{line}\n{margin}{after}"


def _shown(value: Any) -> str:
    if isinstance(value, dict):
        return "{" + ", ".join(f"{_shown(key)}: {_shown(item)}" for key, item in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(_shown, value)) + "]"
    if isinstance(value, str) and re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", value) and value.lower() not in _WORDS:
        return value
    if isinstance(value, float) and float(f"{value:.10g}") == value:
        return f"{value:.10g}"
    return json.dumps(value)


_WORDS = ("true", "false", "null", "yes", "no", "on", "off", "y", "n")
