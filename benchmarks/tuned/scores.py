"""The tuned trackers on the scenes that they are scored on."""

from __future__ import annotations

import json
from concurrent.futures import Executor
from pathlib import Path
from typing import Any

import trackbench as tb

from .page import page
from .protocol import Protocol

#: Which values a tracker has: those of the scenario itself, of its family, and of all scenarios.
SETS = ("own", "family", "all")
#: The tracker whose smoother stands beside, as what was to be had offline.
SMOOTHED = "imm_cv_ca"


def scored(protocol: Protocol, values: dict[str, dict[str, dict[str, Any]]], pool: Executor, out: Path) -> None:
    """Score all trackers with all values, and write the page and its numbers."""
    pending = {name: pool.submit(_of_scenario, protocol, values, name) for name in protocol.scenarios}
    found = {}
    for name, future in pending.items():
        found[name] = future.result()
        print(f"scored: {name}", flush=True)
    (out / "tuned.json").write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    (out / "tuned.md").write_text(page(protocol, values, found), encoding="utf-8")


def _of_scenario(
    protocol: Protocol, values: dict[str, dict[str, dict[str, Any]]], scenario: str
) -> dict[str, dict[str, Any]]:
    """By tracker and values (``ekf_cv.family``), its scores."""
    of_set = {"own": scenario, "family": protocol.family_of(scenario), "all": "all"}
    trackers, changes = {}, {}
    for tracker, stated in protocol.trackers.items():
        for which in SETS:
            name = f"{tracker}_{which}"
            trackers[name] = stated["entry"]
            changes |= {f"trackers.{name}.{key}": value for key, value in values[tracker][of_set[which]].items()}
    smoothed = {"smoothed": {**trackers[f"{SMOOTHED}_family"], "smoother": "rts"}}
    changes |= {f"trackers.smoothed.{key}": value for key, value in values[SMOOTHED][of_set["family"]].items()}
    budget = protocol.scored_on
    loaded = protocol.loaded(scenario, trackers | smoothed, set=changes, scenes=budget.scenes, runs=budget.runs)
    result = tb.run(loaded)
    return {name: _scores(result[name]) for name in (*trackers, *smoothed)}


def _scores(found: Any) -> dict[str, Any]:
    nees = found.nees
    return {
        "position_rmse": found.position_rmse.value,
        "ci95": found.position_rmse.ci95,
        "velocity_rmse": found.velocity_rmse.value,
        "diverged": found.health.diverged_runs if hasattr(found.health, "diverged_runs") else None,
        "nees": nees.value,
        "nees_ci95": nees.ci95,
        "verdict": nees.verdict,
        "off": {
            item.name: item.mean for item in nees.conditions or () if item.verdict not in ("consistent", "undecided")
        },
        "undecided": {item.name: item.mean for item in nees.conditions or () if item.verdict == "undecided"},
    }
