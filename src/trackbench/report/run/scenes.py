"""What several scenes say that one cannot: how much hangs on the scene, and where the order turns."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from trackbench.base.errors import counted
from trackbench.document import Block, Cell, Column, Paragraph, Table
from trackbench.report.numbers import NOT_AVAILABLE, decimals, fixed, joined, percent
from trackbench.results import Result
from trackbench.results.scenario_summary import SceneSummary


def runs_in_words(result: Result) -> str:
    """ "100 runs", or "10 scenes of 20 runs"."""
    summary = result.summary
    scenes = len(summary.truth.scenes)
    if not scenes:
        return counted(summary.runs, "run")
    return f"{scenes} scenes of {counted(summary.runs // scenes, 'run')}"


def basis_of_intervals(result: Result) -> str:
    """What the intervals rest on, and so what they speak of."""
    summary = result.summary
    if summary.truth.scenes:
        return f"over {len(summary.truth.scenes)} scenes"
    if summary.runs == 1:
        return "over stretches of the time of one run"
    if (summary.truth.model_extra or {}).get("random"):
        return "over runs, each with a motion of its own"
    return "over runs of one scene: of the sensors' noise, not of other traffic"


def scenes(result: Result) -> Iterator[Block]:
    """The errors scene by scene, with those in which the order is another one."""
    found = result.summary.truth.scenes
    if not found or not result.scored:
        return
    yield Paragraph(_variance(result))
    yield Paragraph(_turned(result))
    yield _table(result)


def _variance(result: Result) -> str:
    shares = [(tracker.name, tracker.scene_share) for tracker in result.scored]
    known = [f"{name} {percent(share)}" for name, share in shares if share is not None]
    if not known:
        return "With one run in each scene, what the scene does to the error cannot be told from what the noise does."
    return (
        f"How much of the variance of one run's squared {result.summary.headline_name} is between scenes, and not "
        f"noise within one: {joined(known)}. The intervals of this page take the scenes for what is independent."
    )


def _turned(result: Result) -> str:
    names = [tracker.name for tracker in result.contenders]
    best = names[0]
    turned = [scene for scene in result.summary.truth.scenes if _ahead(result, scene, names)]
    total = len(result.summary.truth.scenes)
    if not turned:
        return f"No tracker is ahead of {best} by more than the margin in any of the {total} scenes."
    each = [f"{scene.name} ({_first(scene, names)})" for scene in turned]
    where = f"In {len(turned)} of {total} scenes another tracker is ahead of {best} by more than the margin"
    return f"{where}: {joined(each)}."


def _first(scene: SceneSummary, names: Sequence[str]) -> str:
    """The best here of some trackers."""
    return next((name for name in scene.order if name in names), "")


def _ahead(result: Result, scene: SceneSummary, names: Sequence[str]) -> bool:
    """Whether another tracker is better here than the one that is the best of all, by more than the margin."""
    best = names[0]
    if best not in scene.error:
        return any(name in scene.error for name in names)
    least = scene.error[_first(scene, names)]
    return scene.error[best] - least > result.summary.score.margin.at(least, "m")


def _table(result: Result) -> Table:
    names = [tracker.name for tracker in result.scored]
    contenders = [tracker.name for tracker in result.contenders]
    found = result.summary.truth.scenes
    places = decimals([value for scene in found for value in scene.error.values()], 3)
    first = (Column("scene", left=True), [Cell(scene.name) for scene in found])
    vehicles = (Column("vehicles"), [Cell(str(len(scene.objects))) for scene in found])
    columns = [
        (
            Column(f"{name}, m", f"{result.summary.headline_name} in this scene; bold is the smallest"),
            [_cell(scene, name, places, name == _first(scene, contenders)) for scene in found],
        )
        for name in names
    ]
    return Table.of_columns("scenes", [first, vehicles, *columns])


def _cell(scene: SceneSummary, name: str, places: int, best: bool) -> Cell:
    if name not in scene.error:
        return Cell(NOT_AVAILABLE, reason="no estimate in this scene")
    return Cell(fixed(scene.error[name], places), strong=best)
