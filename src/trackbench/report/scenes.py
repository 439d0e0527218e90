"""Single scenes of a run, and what its intervals rest on."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from trackbench.base.errors import counted
from trackbench.document import Block, Cell, Column, Paragraph, Table
from trackbench.metrics.contrasts import FEW_DECIDE_UNTIL, turning_factor, undrawn_share
from trackbench.metrics.intervals import FEWEST_SCENES, TOO_FEW_SCENES, UNCALIBRATED
from trackbench.report.numbers import NOT_AVAILABLE, decimals, joined_names, rounded
from trackbench.report.verdicts import CERTAINTY
from trackbench.results import Result, by_value
from trackbench.results.scenario_summary import SceneSummary

ONE_RUN = "No intervals: a single run of one scene does not show what is chance"


def runs_in_words(result: Result) -> str:
    """ "100 runs", "10 scenes of 20 runs", or "10 stretches of one log"."""
    truth = result.summary.truth
    return parts_in_words(truth.scenes_in_words, result.summary.runs, len(truth.scenes))


def parts_in_words(scenes: str, runs: int, number: int) -> str:
    """Say what values are of, from the scenes in words, and how many runs and scenes there are."""
    if not scenes:
        return counted(runs, "run")
    return f"{scenes} of {counted(runs // number, 'run')}" if scenes.endswith("scenes") else scenes


def basis_of_intervals(result: Result) -> str:
    """What the intervals rest on, and so what they speak of."""
    noise = (result.summary.truth.model_extra or {}).get("recorded_noise", {})
    carried = "; those of errors include the recording's own noise" if any(noise.values()) else ""
    return _independent_parts(result) + carried


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
    """What stands in the place of intervals where there are too few scenes for one; empty where there are enough."""
    every = result.summary.truth.scenes
    if result.summary.identities == "hidden" and result.summary.runs == 1 and not every:
        return [ONE_RUN]
    if not 0 < len(every) < FEWEST_SCENES or len(result.tables.if_there("stretches")):
        return []
    places = decimals([value for scene in every for value in scene.error.values()], 3)
    kind = result.summary.truth.kind_of_scenes
    lines = [f"no ± with fewer than {FEWEST_SCENES} {kind}; {result.summary.headline_name} of each, m:"]
    for tracker in result.scored:
        lines.append(
            f"  {tracker.name}: {', '.join(rounded(scene.error.get(tracker.name), places) for scene in every)}"
        )
    return lines


def undrawn_scenes(number: int, few_decide: bool = False) -> list[str]:
    """Say how frequent a kind of scene of which none was drawn may be, and from which difference there an order turns.

    Empty where there are too few scenes for a verdict.

    Args:
        number: of scenes.
        few_decide: whether one scene of a hundred may decide between two trackers.
    """
    if number < FEWEST_SCENES:
        return []
    if few_decide and number < FEW_DECIDE_UNTIL:
        return [CERTAINTY["few decide"].format(until=FEW_DECIDE_UNTIL)]
    share, factor = f"{100 * undrawn_share(number):.2g} %", f"{turning_factor(number):.2g}"
    return [CERTAINTY["undrawn"].format(scenes=number, share=share, factor=factor)]


def without_interval(result: Result) -> str:
    """Say of which metrics no interval over runs holds, and why; empty where there are too few scenes for any."""
    paths: dict[str, dict[str, None]] = {}
    for tracker in result.scored:
        for path, metric in tracker.metrics.items():
            reason = metric.reason or ""
            if metric.value is not None and reason.startswith(UNCALIBRATED) and reason != TOO_FEW_SCENES:
                paths.setdefault(reason, {})[path] = None
    return "; ".join(f"{reason}: {joined_names([*own])}" for reason, own in paths.items())


def scenes(result: Result) -> Iterator[Block]:
    """Yield whether the best tracker leads in every scene, and the errors of the scenes in which it does not."""
    every = result.summary.truth.scenes
    if not every or not result.scored:
        return
    contenders = [tracker.name for tracker in result.contenders]
    turned = [scene for scene in every if _other_ahead(result, scene, contenders)]
    each = joined_names([f"{scene.name} ({_first(scene, contenders)})" for scene in turned])
    total, which = f"{len(every)} {result.summary.truth.kind_of_scenes}", f": {each}" if turned else ""
    yield Paragraph(CERTAINTY["ahead"].format(number=len(turned), total=total, best=contenders[0], which=which))
    if shown := every if len(every) <= FEWEST_SCENES else turned:
        yield _scene_table(result, shown, contenders)


def _first(scene: SceneSummary, names: Sequence[str]) -> str:
    """The best here of some trackers."""
    return next((name for name in by_value(scene.error) if name in names), "")


def _other_ahead(result: Result, scene: SceneSummary, names: Sequence[str]) -> bool:
    """Whether another tracker is better here than the one that is the best of all, by more than the margin."""
    best = names[0]
    if best not in scene.error:
        return any(name in scene.error for name in names)
    least = scene.error[_first(scene, names)]
    return scene.error[best] - least > result.summary.score.margin.at(least, "m")


def _scene_table(result: Result, every: Sequence[SceneSummary], contenders: Sequence[str]) -> Table:
    places = decimals([value for scene in every for value in scene.error.values()], 3)
    meaning = f"{result.summary.headline_name} in this scene; bold is the smallest"

    def cell(scene: SceneSummary, name: str) -> Cell:
        if name not in scene.error:
            return Cell(NOT_AVAILABLE, reason="no estimate in this scene")
        return Cell(rounded(scene.error[name], places), strong=name == _first(scene, contenders))

    columns = [
        (Column("scene", left=True), [Cell(scene.name) for scene in every]),
        (Column("vehicles"), [Cell(str(len(scene.objects))) for scene in every]),
        *(
            (Column(f"{tracker.name}, m", meaning), [cell(scene, tracker.name) for scene in every])
            for tracker in result.scored
        ),
    ]
    return Table.of_columns("scenes", columns)
