"""The files of a tuning, and its JSON values."""

from __future__ import annotations

import math
import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import Any
from urllib.parse import quote

from trackbench import results
from trackbench.base.errors import InputError
from trackbench.document.drawing import svg_file
from trackbench.document.html import to_html
from trackbench.document.markdown import to_markdown
from trackbench.metrics.intervals import Interval
from trackbench.scenario import Scenario
from trackbench.scenario.load import own_modules
from trackbench.scenario.shipped import shown_name
from trackbench.subjects.tuning.api import TunePlan
from trackbench.subjects.tuning.outcome import headline, remarks
from trackbench.subjects.tuning.report import tuning_document
from trackbench.subjects.tuning.response import NEGLIGIBLE, Response
from trackbench.subjects.tuning.trials import TuningTrial
from trackbench.subjects.tuning.tune import Tuning
from trackbench.subjects.tuning.write_back import written

SCHEMA_VERSION = 1


def to_json(found: Sequence[Tuning], command: str) -> dict[str, Any]:
    """All that was found of each tracker, and the command that repeats it."""
    return {
        "schema_version": SCHEMA_VERSION,
        "command": command,
        "objective": found[0].objective.name,
        "scenarios": [
            {
                "name": name,
                "train": {"scenes": found[0].train_scenes[number], "runs": found[0].train_runs[number]},
                "test": {"scenes": found[0].held_out.scenes[name], "runs": found[0].held_out.runs[name]},
                "held_out": found[0].apart[number] or None,
            }
            for number, name in enumerate(found[0].scenarios)
        ],
        "trackers": [_tracker(item) for item in found],
    }


def _tracker(item: Tuning) -> dict[str, Any]:
    return {
        "name": item.tracker,
        "verdict": headline(item)[0],
        "remarks": list(remarks(item)),
        "engine": item.engine,
        "ranges": [parameter.as_json() for parameter in item.parameters],
        "start": item.start,
        "tuned": dict(item.best.values),
        "at_edge": [parameter.key for parameter, _ in item.edges],
        "held_out": [
            {
                "scenario": one.scenario,
                "metric": one.measure,
                "unit": one.unit,
                "start": _interval(one.start),
                "tuned": _interval(one.tuned),
                "difference": {"value": one.difference.value, "ci95": _ends(one.difference.ci95)},
                "p_value": one.p_value,
                "verdict": one.verdict,
            }
            for one in item.held_out.comparisons
        ],
        "response": [_response(one) for one in item.responses],
        "front": [_trial(trial) for trial in item.front],
        "trials": [_trial(trial) for trial in item.trials],
    }


def _response(one: Response) -> dict[str, Any]:
    return {
        "option": one.parameter.key,
        "within_1_percent": list(one.within(NEGLIGIBLE)) if one.parameter.continuous else None,
        "optimum_ci95": list(one.optimum95) if one.parameter.continuous and one.told else None,
        "not_shown_worse": None if one.parameter.continuous else one.as_good,
        "points": [{"value": point.value, "rise": _number(point.rise), "reach95": point.reach} for point in one.points],
    }


def _trial(trial: TuningTrial) -> dict[str, Any]:
    return {
        "values": dict(trial.values),
        "losses": list(trial.losses),
        "failed": trial.failed or None,
        "measures": dict(trial.measures),
    }


def _interval(one: Interval) -> dict[str, Any]:
    return {"value": one.value, "ci95": _ends(one.ci95)}


def _ends(ends: tuple[float, float] | None) -> list[float] | None:
    return None if ends is None else list(ends)


def _number(value: float) -> float | None:
    return value if math.isfinite(value) else None


ENDING = ".yaml"


def default_out(scenarios: Sequence[Scenario]) -> Path:
    """A file for one scenario, a folder for several."""
    return Path("tuned.yaml" if len(scenarios) == 1 else "tuned")


def require_out(out: Path, scenarios: Sequence[Scenario]) -> None:
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
    for scenario, file in zip(scenarios, scenario_files(out, scenarios), strict=True):
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


def scenario_files(out: Path, scenarios: Sequence[Scenario]) -> list[Path]:
    """Where each scenario with the found values goes."""
    return [out] if len(scenarios) == 1 else [out / f"{item.config.name}{ENDING}" for item in scenarios]


def save_tuning(found: Sequence[Tuning], scenarios: Sequence[Scenario], out: Path, command: str) -> list[Path]:
    """Write all files, each whole or not at all; the scenarios come last. Figures of an earlier tuning go.

    Returns:
        Those that a reader opens, and the folder of the figures.

    Raises:
        OutputError: one cannot be written.
    """
    base = out.with_suffix("") if len(scenarios) == 1 else out / "tuning"
    document = tuning_document(found, command)
    figures = base.with_name(f"{base.name}_figures")
    content = {
        base.with_name(f"{base.name}.json"): results.to_json(to_json(found, command)).encode(),
        base.with_name(f"{base.name}.html"): to_html(document).encode(),
        base.with_name(f"{base.name}.md"): to_markdown(document, figures=quote(figures.name)).encode(),
    }
    drawn = {figures / f"{figure.name}.svg": svg_file(figure).encode() for figure in document.figures}
    values = {item.tracker: item.best.values for item in found}
    for scenario, file in zip(scenarios, scenario_files(out, scenarios), strict=True):
        # Trackers are looked for beside the scenario that names them.
        content |= {file.parent / module.name: module.read_bytes() for module in own_modules(scenario)}
        content[file] = written(scenario, values, file.parent).encode()
    for stale in {*figures.glob("*.svg")} - {*drawn}:
        stale.unlink()
    for file, each in {**drawn, **content}.items():
        results.write_bytes(file, each)
    return [*content, *([figures] if drawn else [])]


def command_of_tuning(scenarios: Sequence[Scenario], trackers: Sequence[str], plan: TunePlan, out: Path) -> str:
    """What repeats a tuning."""
    split = plan.split
    given = {
        "--objective": plan.objective.name,
        "--trials": plan.trials,
        "--train-scenes": split.train_scenes,
        "--test-scenes": split.test_scenes,
        "--train-runs": split.train_runs,
        "--test-runs": split.test_runs,
        "--train-seed": split.train_seed,
        "--test-seed": split.test_seed,
        "--seed": plan.seed or None,
        "--engine": None if plan.engine == "auto" else plan.engine,
        "--out": out,
    }
    options = [part for name, value in given.items() if value is not None for part in (name, str(value))]
    ranges = [part for text in plan.ranges for part in ("--range", text)]
    changes = [part for text in scenarios[0].overrides for part in ("--set", text)]
    named = [shown_name(item.path) for item in scenarios]
    return shlex.join(["trackbench", "tune", *named, "--trackers", ",".join(trackers), *ranges, *changes, *options])
