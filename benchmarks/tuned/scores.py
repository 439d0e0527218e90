"""The tuned trackers on the scenes that they are scored on."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from pathlib import Path
from typing import Any

import trackbench as tb

from .page import METRICS, page
from .protocol import Protocol

#: The tracker whose smoother stands beside, as what is to be had offline.
SMOOTHED = "imm_cv_ca"

Values = Mapping[str, Mapping[str, Mapping[str, Any]]]
"""By tracker and set of scenarios."""


def scored(protocol: Protocol, values: Values, pool: Executor, out: Path) -> None:
    """Score all trackers with the values of their family and of the scenario, and write the page and its numbers."""
    pending = {name: pool.submit(_of_scenario, protocol, values, name) for name in protocol.scenarios}
    scores = {}
    for name, future in pending.items():
        scores[name] = future.result()
        print(f"scored: {name}", flush=True)
    (out / "tuned.json").write_text(json.dumps(scores, indent=1) + "\n", encoding="utf-8")
    (out / "tuned.md").write_text(page(protocol, values, scores), encoding="utf-8")


def _of_scenario(protocol: Protocol, values: Values, scenario: str) -> dict[str, Any]:
    """The trackers with the values of the family, and with the scenario's own, on the same measurements."""
    entries = protocol.entries
    family = {tracker: values[tracker][protocol.family_of(scenario)] for tracker in entries}
    own = {tracker: values[tracker][scenario] for tracker in entries}
    smoothed = {**entries, "smoothed": {**entries[SMOOTHED], "smoother": "rts"}}
    return {
        "family": _scores(_run(protocol, scenario, smoothed, {**family, "smoothed": family[SMOOTHED]}), list(entries)),
        "own": _scores(_run(protocol, scenario, entries, own), list(entries)),
    }


def _run(protocol: Protocol, scenario: str, entries: Mapping[str, Any], values: Mapping[str, Any]) -> Any:
    """The scenario with these trackers, whose options have these values."""
    changes = {f"trackers.{name}.{key}": value for name, of in values.items() for key, value in of.items()}
    budget = protocol.scored_on
    return tb.run(protocol.loaded(scenario, dict(entries), set=changes, scenes=budget.scenes, runs=budget.runs))


def _scores(result: Any, trackers: list[str]) -> dict[str, Any]:
    """Of each tracker; and by metric the best of ``trackers``, and those that are not shown to be worse."""
    scores: dict[str, Any] = {"trackers": {}}
    for name in result:
        errors = {metric: getattr(result[name], metric) for metric in METRICS}
        scores["trackers"][name] = {
            **{metric: {"value": error.value, "ci95": error.ci95} for metric, error in errors.items()},
            "diverged": result[name].health.diverged_runs,
            "nees": {"value": result[name].nees.value, "verdict": result[name].nees.verdict},
        }
    return scores | {metric: best_and_not_worse(result, metric, trackers) for metric in METRICS}


def best_and_not_worse(result: Any, metric: str, trackers: Sequence[str]) -> dict[str, Any]:
    """Return the tracker with the smallest error as ``best``, and those that the product does not call worse.

    A metric whose differences are in no family has no verdict; nothing is said of the others.
    """
    best = min(trackers, key=lambda name: getattr(result[name], metric).value)
    worse = {
        pair.b if pair.a == best else pair.a
        for pair in result.differences
        if pair.metric == metric and best in (pair.a, pair.b) and (pair.verdict is None or pair.better == best)
    }
    return {"best": best, "not worse": [name for name in trackers if name not in {best, *worse}]}
