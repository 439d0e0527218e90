"""Errors in each scene of a run, and the independent runs or scenes from which its intervals are computed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from trackbench.base.errors import counted
from trackbench.document import Block, Cell, Column, Paragraph, Table
from trackbench.metrics.contrasts import FEW_DECIDE_UNTIL, turning_factor, undrawn_share
from trackbench.metrics.intervals import FEWEST_SCENES
from trackbench.report.numbers import NOT_AVAILABLE, decimals, joined_names, rounded
from trackbench.report.verdicts import CERTAINTY
from trackbench.results import Result, by_value
from trackbench.results.scenario_summary import SceneSummary

ONE_RUN = "No intervals: a single run of one scene does not show what is chance"


def runs_in_words(result: Result) -> str:
    """Return the extent of a run in words: "100 runs", "10 scenes of 20 runs" or "10 stretches of one log"."""
    truth = result.summary.truth
    return parts_in_words(truth.scenes_in_words, result.summary.runs, len(truth.scenes))


def parts_in_words(scenes: str, runs: int, number: int) -> str:
    """Return runs and scenes in words, such as "10 scenes of 20 runs".

    Args:
        scenes: scenes in words, such as "10 scenes"; empty for a single scene.
        runs: number of runs in all scenes.
        number: number of scenes.
    """
    if not scenes:
        return counted(runs, "run")
    return f"{scenes} of {counted(runs // number, 'run')}" if scenes.endswith("scenes") else scenes


def basis_of_intervals(result: Result) -> str:
    """Return text on the independent runs, scenes or stretches that intervals rest on, such as "over 10 scenes"."""
    noise = (result.summary.truth.model_extra or {}).get("recorded_noise", {})
    recorded = ", with the recording's own noise in those of errors" if any(noise.values()) else ""
    return _independent_parts(result) + recorded


def _independent_parts(result: Result) -> str:
    summary = result.summary
    if summary.truth.scenes and len(result.tables.if_there("stretches")):
        return f"over stretches of the time of {len(summary.truth.scenes)} logs"
    if summary.truth.log_stretches:
        return f"over {runs_in_words(result)}, through which trackers go once"
    if summary.truth.scenes:
        return f"over {summary.truth.scenes_in_words}"
    if summary.runs == 1:
        return "over stretches of the time of one run"
    if (summary.truth.model_extra or {}).get("random"):
        return "over runs with different motion"
    return "over runs of one scene: for other sensor noise, not for other traffic"


def values_of_few_scenes(result: Result) -> list[str]:
    """Return each tracker's errors by scene, a line each, if scenes are too few for intervals; else an empty list."""
    scenes = result.summary.truth.scenes
    if result.summary.identities == "hidden" and result.summary.runs == 1 and not scenes:
        return [ONE_RUN]
    if not 0 < len(scenes) < FEWEST_SCENES or len(result.tables.if_there("stretches")):
        return []
    places = decimals([value for scene in scenes for value in scene.error.values()], 3)
    kind = result.summary.truth.kind_of_scenes
    lines = [f"no ± with fewer than {FEWEST_SCENES} {kind}; {result.summary.headline_name} of each, m:"]
    for tracker in result.scored:
        errors = ", ".join(rounded(scene.error.get(tracker.name), places) for scene in scenes)
        lines.append(f"  {tracker.name}: {errors}")
    return lines


def undrawn_scenes(number: int, few_decide: bool = False) -> list[str]:
    """Return a sentence on scenes of a kind not sampled: how frequent they can be, and if they can reverse a verdict.

    The list is empty if the scenes are too few for a verdict.

    Args:
        number: number of scenes.
        few_decide: whether one scene of a hundred can decide which of two trackers is better.
    """
    if number < FEWEST_SCENES:
        return []
    if few_decide and number < FEW_DECIDE_UNTIL:
        return [CERTAINTY["few decide"].format(until=FEW_DECIDE_UNTIL)]
    share, factor = f"{100 * undrawn_share(number):.2g} %", f"{turning_factor(number):.2g}"
    return [CERTAINTY["undrawn"].format(scenes=number, share=share, factor=factor)]


def scene_blocks(result: Result) -> Iterator[Block]:
    """Yield in how many scenes the overall best does not lead, and errors in these, or in all if scenes are few."""
    scenes = result.summary.truth.scenes
    if not scenes or not result.scored:
        return
    contenders = [tracker.name for tracker in result.contenders]
    reversed_scenes = [scene for scene in scenes if _another_leads(result, scene, contenders)]
    named = joined_names([f"{scene.name} ({_best_in_scene(scene, contenders)})" for scene in reversed_scenes])
    number, total = len(reversed_scenes), f"{len(scenes)} {result.summary.truth.kind_of_scenes}"
    which = f": {named}" if reversed_scenes else ""
    yield Paragraph(CERTAINTY["ahead"].format(number=number, total=total, best=contenders[0], which=which))
    if shown := scenes if len(scenes) <= FEWEST_SCENES else reversed_scenes:
        yield _scene_table(result, shown, contenders)


def _best_in_scene(scene: SceneSummary, names: Sequence[str]) -> str:
    return next((name for name in by_value(scene.error) if name in names), "")


def _another_leads(result: Result, scene: SceneSummary, names: Sequence[str]) -> bool:
    """Return whether in a scene some tracker beats the overall best, ``names[0]``, by more than the margin."""
    best = names[0]
    if best not in scene.error:
        return any(name in scene.error for name in names)
    least = scene.error[_best_in_scene(scene, names)]
    return scene.error[best] - least > result.summary.score.margin.at(least, "m")


def _scene_table(result: Result, scenes: Sequence[SceneSummary], contenders: Sequence[str]) -> Table:
    places = decimals([value for scene in scenes for value in scene.error.values()], 3)
    meaning = f"{result.summary.headline_name} in this scene; bold is the smallest"

    def cell(scene: SceneSummary, name: str) -> Cell:
        if name not in scene.error:
            return Cell(NOT_AVAILABLE, reason="no estimate in this scene")
        return Cell(rounded(scene.error[name], places), strong=name == _best_in_scene(scene, contenders))

    columns = [
        (Column("scene", left=True), [Cell(scene.name) for scene in scenes]),
        (Column("vehicles"), [Cell(str(len(scene.objects))) for scene in scenes]),
        *(
            (Column(f"{tracker.name}, m", meaning), [cell(scene, tracker.name) for scene in scenes])
            for tracker in result.scored
        ),
    ]
    return Table.of_columns("scenes", columns)
