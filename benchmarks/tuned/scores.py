"""The tuned trackers on the scenes that they are scored on."""

from __future__ import annotations

import json
from collections.abc import Mapping
from concurrent.futures import Executor
from pathlib import Path
from typing import Any

import trackbench as tb

from .page import page
from .protocol import Budget, Protocol
from .trust import believable, by_distance

#: So many of the nearest are scored with their own values too, where none is believable with those of the family.
NEAREST = 2
#: The tracker whose smoother stands beside, as what was to be had offline.
SMOOTHED = "imm_cv_ca"

Values = Mapping[str, Mapping[str, Mapping[str, Any]]]
"""By tracker and set of scenarios."""


def scored(protocol: Protocol, values: Values, pool: Executor, out: Path) -> None:
    """Score all trackers with all values, and write the page and its numbers."""
    pending = {name: pool.submit(_of_scenario, protocol, values, name) for name in protocol.scenarios}
    found = {}
    for name, future in pending.items():
        found[name] = future.result()
        print(f"scored: {name}", flush=True)
    (out / "tuned.json").write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    (out / "tuned.md").write_text(page(protocol, values, found), encoding="utf-8")


def _of_scenario(protocol: Protocol, values: Values, scenario: str) -> dict[str, Any]:
    """The trackers with the values of the family, held against each other; and with each set of values, on the same
    measurements."""
    sets = {"own": scenario, "family": protocol.family_of(scenario), "all": "all"}
    entries = protocol.entries
    of_family = {tracker: values[tracker][sets["family"]] for tracker in entries}
    smoothed = {**entries[SMOOTHED], "smoother": "rts"}
    result = _run(
        protocol,
        scenario,
        protocol.scored_on,
        {**entries, "smoothed": smoothed},
        {**of_family, "smoothed": of_family[SMOOTHED]},
    )
    best = result.contenders[0].name
    shown_worse = [pair.a if pair.better == pair.b else pair.b for pair in _pairs(result) if pair.better == best]
    each = {f"{tracker}_{which}": (tracker, name) for tracker in entries for which, name in sets.items()}
    compared = _run(
        protocol,
        scenario,
        protocol.compared_on,
        {name: entries[tracker] for name, (tracker, _) in each.items()},
        {name: values[tracker][of] for name, (tracker, of) in each.items()},
    )
    scores = {name: _scores(result[name]) for name in result}
    return {
        "best": best,
        "not shown to be worse": [name for name in entries if name != best and name not in shown_worse],
        "scores": scores,
        "own": _with_own_values(protocol, values, scenario, scores),
        "position_rmse": {
            which: {tracker: compared[f"{tracker}_{which}"].position_rmse.value for tracker in entries}
            for which in sets
        },
    }


def _with_own_values(protocol: Protocol, values: Values, scenario: str, scores: Mapping[str, Any]) -> dict[str, Any]:
    """Scores of the nearest with the values of the very scenario, where none is believable with those of the family."""
    trackers = list(protocol.trackers)
    if believable(trackers, scores):
        return {}
    near = by_distance(trackers, scores)[:NEAREST]
    entries = {tracker: protocol.entries[tracker] for tracker in near}
    own = {tracker: values[tracker][scenario] for tracker in near}
    result = _run(protocol, scenario, protocol.scored_on, entries, own)
    return {name: _scores(result[name]) for name in result}


def _run(
    protocol: Protocol, scenario: str, budget: Budget, entries: Mapping[str, Any], values: Mapping[str, Any]
) -> Any:
    """The scenario with these trackers, whose options have these values."""
    changes = {f"trackers.{name}.{key}": value for name, of in values.items() for key, value in of.items()}
    return tb.run(protocol.loaded(scenario, dict(entries), set=changes, scenes=budget.scenes, runs=budget.runs))


def _pairs(result: Any) -> list[Any]:
    """The differences of position RMSE."""
    return [pair for pair in result.differences if pair.metric == "position_rmse"]


def _scores(found: Any) -> dict[str, Any]:
    nees, breakdown = found.nees, found.breakdown
    counts = {
        name: of.count for part in (breakdown.manoeuvre, breakdown.range, breakdown.age) for name, of in part.items()
    }
    return {
        "position_rmse": found.position_rmse.value,
        "ci95": found.position_rmse.ci95,
        "velocity_rmse": found.velocity_rmse.value,
        "diverged": found.health.diverged_runs,
        "nees": nees.value,
        "nees_ci95": nees.ci95,
        "verdict": nees.verdict,
        "conditions": {
            item.name: {
                "mean": item.mean,
                "verdict": item.verdict,
                "share": counts.get(item.name, breakdown.all.count) / breakdown.all.count,
            }
            for item in nees.conditions or ()
        },
    }
