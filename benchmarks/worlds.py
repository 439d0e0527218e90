"""Trackers tuned in each world, by one protocol, and scored in every world on other scenes: results/worlds/tuned.md.

Run as ``python -m benchmarks.worlds``. The scenario is the shipped ``highway``, the ranges are those of ``make tuned``.
"""

from __future__ import annotations

import copy
import json
from pathlib import Path
from typing import Any

import yaml
from benchmarks.tuned.protocol import SCENARIOS
from benchmarks.tuned.protocol import read as read_protocol
from benchmarks.tuned.scores import best_and_not_worse

import trackbench as tb
from trackbench.scenario.worlds import WORLDS

OUT = Path(__file__).parents[1] / "results" / "worlds"
TRACKERS = ("kf_cv", "ekf_cv", "ekf_ca", "ukf_ctrv", "imm_cv_ca", "imm_three")
#: Seeds from which scenes are drawn, and their numbers; every second car of I-80 is one to tune on.
TUNED_FROM, TUNED_SCENES, SCORED_FROM, SCORED_SCENES = 101, 12, 1, 20
RUNS, TUNED_RUNS, TRIALS = 10, 2, 48
METRICS = ("position_rmse", "velocity_rmse")

Scenario = dict[str, Any]
Errors = dict[str, dict[str, dict[str, float]]]
"""By tracker, world that it was tuned in, and metric."""
Best = dict[str, dict[str, Any]]
"""By metric, the tracker with the smallest error, and those that are not shown worse."""


def in_world(world: str, tuning: bool) -> Scenario:
    """The scenario in a world, with the scenes to tune on or those to score on."""
    written = yaml.safe_load((SCENARIOS / "highway.yaml").read_text(encoding="utf-8"))
    content: Scenario = copy.deepcopy(tb.load({**written, "expect": []}, {"world": world}).document.value)
    del content["world"]
    truth = content["truth"]
    if world == "recorded":
        truth["observer"] = {"vehicle": truth["observer"]["vehicle"][0 if tuning else 1 :: 2]}
    else:
        truth["seed"], truth["seeds"] = (TUNED_FROM, TUNED_SCENES) if tuning else (SCORED_FROM, SCORED_SCENES)
    return {**content, "trackers": {name: content["trackers"][name] for name in TRACKERS}}


def tuned(world: str) -> dict[str, dict[str, Any]]:
    """The values of each tracker."""
    protocol = read_protocol()
    scenario = in_world(world, tuning=True)
    values = {}
    for name in TRACKERS:
        study = tb.tune(
            scenario,
            [name],
            ranges=protocol.trackers[name]["ranges"],
            objective=protocol.objective,
            trials=TRIALS,
            **({} if world == "recorded" else {"train_scenes": TUNED_SCENES, "test_scenes": 1}),
            train_runs=TUNED_RUNS,
            test_runs=1,
        )
        values[name] = study.values[name]
        print(f"{world}, {name}: {values[name]}", flush=True)
    return values


def scored(world: str, values: dict[str, dict[str, dict[str, Any]]]) -> tuple[Errors, Best]:
    """By tracker and the world it was tuned in, its errors in this world; and by metric which of those tuned in it has
    the smallest error, with those that are not called worse."""
    scenario = in_world(world, tuning=False)
    plain, trackers = scenario["trackers"], {}
    for home, of in values.items():
        for name, own in of.items():
            changes = {f"trackers.{name}.{key}": value for key, value in own.items()}
            changed = tb.load({**scenario, "trackers": {name: plain[name]}}, changes)
            trackers[f"{name}-{home}"] = changed.document.value["trackers"][name]
    result = tb.run(tb.load({**scenario, "trackers": trackers}, runs=RUNS), recording=False)
    errors = {
        name: {home: {metric: getattr(result[f"{name}-{home}"], metric).value for metric in METRICS} for home in values}
        for name in TRACKERS
    }
    own = [f"{name}-{world}" for name in TRACKERS]
    return errors, {metric: best_and_not_worse(result, metric, own) for metric in METRICS}


def page(errors: dict[str, Errors], best: dict[str, Best]) -> str:
    """By metric a table: tracker and the world it was tuned in, against the world it is scored in."""
    text = INTRODUCTION
    for metric, unit in zip(METRICS, ("m", "m/s"), strict=True):
        text += f"## {metric.partition('_')[0].capitalize()} RMSE, {unit}\n\n"
        text += "| tracker | tuned in | " + " | ".join(errors) + " |\n| --- | --- |" + " --: |" * len(errors) + "\n"
        for name in TRACKERS:
            for home in errors:
                cells = []
                for world, of in errors.items():
                    own, value = of[name][world][metric], of[name][home][metric]
                    cells.append(
                        f"**{value:.3f}**" if home == world else f"{value:.3f} ({100 * (value / own - 1):+.0f} %)"
                    )
                text += f"| {name} | {home} | {' | '.join(cells)} |\n"
        smallest = [_with_not_worse(best[world][metric], f"-{world}") for world in errors]
        what = "smallest error, tuned in its world; in brackets those not shown worse"
        what = what if metric == METRICS[0] else "smallest error, tuned in its world, which is not tested"
        text += f"| {what} | | " + " | ".join(smallest) + " |\n\n"
    return text.rstrip() + "\n"


def _with_not_worse(best: dict[str, Any], ending: str) -> str:
    others = ", ".join(name.removesuffix(ending) for name in best["not worse"])
    return best["best"].removesuffix(ending) + (f" ({others})" if others else "")


INTRODUCTION = f"""\
# Tuned in one world, scored in another

Made by `make worlds`. Each tracker of the shipped `highway` is tuned in each [world](../../docs/worlds.md) for the
position error, by {TRIALS} trials on {TUNED_SCENES} scenes of {TUNED_RUNS} runs, and scored in every world on
{SCORED_SCENES} others of {RUNS} runs; in the recorded world on five cars of I-80 each. In bold: tuned where it is
scored; in brackets what tuning elsewhere costs, below zero where these scenes are kinder to other values.

"""


def main() -> None:
    values = {world: tuned(world) for world in WORLDS}
    found = {world: scored(world, values) for world in WORLDS}
    errors, best = ({world: of[place] for world, of in found.items()} for place in (0, 1))
    OUT.mkdir(parents=True, exist_ok=True)
    content = {"values": values, "errors": errors, "best": best}
    (OUT / "tuned.json").write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
    (OUT / "tuned.md").write_text(page(errors, best), encoding="utf-8")


if __name__ == "__main__":
    main()
