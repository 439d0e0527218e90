"""The files of a tuning: its numbers as JSON, its report, and the scenario with the tuned values."""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

from trackbench import results
from trackbench.base.errors import InputError
from trackbench.document.html import to_html
from trackbench.scenario import Scenario
from trackbench.scenario.load import WIDTH, own_modules
from trackbench.scenario.overrides import with_moved_paths
from trackbench.subjects.tuning.entry import Values, plain
from trackbench.subjects.tuning.report import remarks, tuning_document, tuning_headline
from trackbench.subjects.tuning.tune import Tuning

SCHEMA_VERSION = 1


def tuning_content(tunings: Sequence[Tuning], command: str) -> dict[str, Any]:
    """Return the values and comparisons of each tracker, and the command that repeats them, for JSON."""
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
        "trials": [
            {"values": dict(trial.values), "loss": None if trial.failed else trial.loss, "failed": trial.failed or None}
            for trial in item.trials
        ],
    }


ENDING = ".yaml"


def default_out(scenarios: Sequence[Scenario]) -> Path:
    """Return the default path of the tuned scenarios: a file for one scenario, a folder for several."""
    return Path("tuned.yaml" if len(scenarios) == 1 else "tuned")


def require_tuning_files(out: Path, scenarios: Sequence[Scenario]) -> None:
    """Refuse, before any work, files that cannot be written.

    Raises:
        InputError: the path does not fit the number of scenarios, or a file would be overwritten.
    """
    single = len(scenarios) == 1
    if single != (out.suffix == ENDING):
        advice = (
            "give a file whose name ends in .yaml" if single else "several scenarios go into a folder: give its name"
        )
        raise InputError(advice, key="--out", file=out)
    for scenario, file in zip(scenarios, tuned_scenario_files(out, scenarios), strict=True):
        if file.resolve() == scenario.path.resolve():
            raise InputError("is the scenario that is tuned, which is not overwritten; give another name", key="--out")
        results.require_file(file, "--out")
        for module in own_modules(scenario):
            existing = file.parent / module.name
            if existing.is_file() and existing.read_bytes() != module.read_bytes():
                raise InputError(
                    f"another {module.name} than that beside {scenario.path} is there; give another folder",
                    key="--out",
                    file=out,
                )


def tuned_scenario_files(out: Path, scenarios: Sequence[Scenario]) -> list[Path]:
    """Return the path of each tuned scenario: ``out`` itself for one scenario, else a file in the folder ``out``."""
    return [out] if len(scenarios) == 1 else [out / f"{item.config.name}{ENDING}" for item in scenarios]


def save_tuning(tunings: Sequence[Tuning], scenarios: Sequence[Scenario], out: Path, command: str) -> list[Path]:
    """Write all files, each whole or not at all; return their paths, with the scenarios last.

    Raises:
        OutputError: a file cannot be written.
    """
    base = out.with_suffix("") if len(scenarios) == 1 else out / "tuning"
    content = {
        base.with_name(f"{base.name}.json"): results.json_text(tuning_content(tunings, command)).encode(),
        base.with_name(f"{base.name}.html"): to_html(tuning_document(tunings, command)).encode(),
    }
    values = {item.tracker: item.best.values for item in tunings}
    for scenario, file in zip(scenarios, tuned_scenario_files(out, scenarios), strict=True):
        folder = file.parent.resolve()
        # A scenario's plug-in modules must lie beside it.
        modules = [module for module in own_modules(scenario) if module.parent != folder]
        content |= {file.parent / module.name: module.read_bytes() for module in modules}
        content[file] = tuned_scenario_text(scenario, values, file.parent).encode()
    for file, data in content.items():
        results.write_bytes(file, data)
    return list(content)


def tuned_scenario_text(loaded: Scenario, tuned: Mapping[str, Values], folder: Path) -> str:
    """Return the text of the scenario with the tuned trackers under their names, and the start under NAME_start.

    Args:
        loaded: the scenario.
        tuned: values of the options, by tracker.
        folder: folder of the new file; relative paths of recordings are changed to start there.
    """
    trackers: dict[str, Any] = {}
    for name, entry in loaded.document.value["trackers"].items():
        if name in tuned:
            trackers |= {name: plain(loaded, name, tuned[name]), f"{name}_start": copy.deepcopy(entry)}
        else:
            # An earlier search's NAME_start is replaced.
            trackers.setdefault(name, entry)
    truth = loaded.document.value["truth"]
    if truth.get("source") == "recording":
        truth = with_moved_paths(truth, loaded.folder, folder)
    content = {**loaded.document.value, "truth": truth, "trackers": trackers}
    return yaml.safe_dump(content, sort_keys=False, default_flow_style=None, width=WIDTH, allow_unicode=True)
