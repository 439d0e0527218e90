"""A tuning as JSON."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from trackbench.metrics.intervals import Interval
from trackbench.subjects.tuning.outcome import headline, remarks
from trackbench.subjects.tuning.response import NEGLIGIBLE, Response
from trackbench.subjects.tuning.trials import TuningTrial
from trackbench.subjects.tuning.tune import Tuning

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
