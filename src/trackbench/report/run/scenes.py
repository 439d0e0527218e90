"""Single scenes of a run, and the moments of the recorded run in which each tracker was worst."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from trackbench.base.errors import counted
from trackbench.document import Block, Cell, Code, Column, Paragraph, Section, Table
from trackbench.metrics.moments import EstimateMoment, worst
from trackbench.metrics.recorded_run import recorded_run
from trackbench.report.numbers import NOT_AVAILABLE, decimals, fixed, joined, percent
from trackbench.report.run.tables import TRACKER
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
    yield _scene_table(result)


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


def _scene_table(result: Result) -> Table:
    names = [tracker.name for tracker in result.scored]
    contenders = [tracker.name for tracker in result.contenders]
    found = result.summary.truth.scenes
    places = decimals([value for scene in found for value in scene.error.values()], 3)
    first = (Column("scene", left=True), [Cell(scene.name) for scene in found])
    vehicles = (Column("vehicles"), [Cell(str(len(scene.objects))) for scene in found])
    columns = [
        (
            Column(f"{name}, m", f"{result.summary.headline_name} in this scene; bold is the smallest"),
            [_scene_cell(scene, name, places, name == _first(scene, contenders)) for scene in found],
        )
        for name in names
    ]
    return Table.of_columns("scenes", [first, vehicles, *columns])


def _scene_cell(scene: SceneSummary, name: str, places: int, best: bool) -> Cell:
    if name not in scene.error:
        return Cell(NOT_AVAILABLE, reason="no estimate in this scene")
    return Cell(fixed(scene.error[name], places), strong=best)


def worst_moments(result: Result) -> dict[str, EstimateMoment]:
    """By tracker, best first, the scored moment of its largest position error in the recorded run."""
    names = [tracker.name for tracker in result.scored]
    if not names:
        return {}
    recorded = recorded_run(result)
    found = {name: worst(recorded, [name], 1) for name in names if name in recorded.tracks}
    return {name: moments[0] for name, moments in found.items() if moments}


def moments_section(moments: Mapping[str, EstimateMoment], run: int, ringed: Sequence[str]) -> Iterator[Section]:
    """The worst moments, and the commands that show them in the recording.

    Args:
        moments: by tracker.
        run: number of the recorded run.
        ringed: the trackers whose moments the map rings.
    """
    if not moments:
        return
    text = (
        f"The largest position error of each tracker in run {run}, of those that count. In the folder of this run, "
        "trackbench inspect . --worst 3 lists more, and these commands open the recording at the rings of the map:"
    )
    shown = [name for name in ringed if name in moments]
    commands = "\n".join(f"trackbench view . --worst --tracker {name}" for name in shown)
    blocks: tuple[Block, ...] = (_moment_table(moments), Paragraph(text), Code(commands, "sh"))
    yield Section("Worst moments", blocks)


def say(moment: EstimateMoment) -> str:
    """Such as "3.18 m, v5 at 7.40 s"."""
    return f"{fixed(moment.position_error_m, 2)} m, {moment.object} at {fixed(moment.time_s, 2)} s"


def _moment_table(moments: Mapping[str, EstimateMoment]) -> Table:
    every = list(moments.values())
    numbers = {
        "position error, m": [moment.position_error_m for moment in every],
        "velocity error, m/s": [moment.velocity_error_mps for moment in every],
        "NEES, 4 expected": [moment.nees for moment in every],
    }
    columns = [
        (TRACKER, [Cell(name, tracker=name) for name in moments]),
        (Column("time, s"), [Cell(fixed(moment.time_s, 2)) for moment in every]),
        (Column("vehicle", left=True), [Cell(moment.object) for moment in every]),
        *((Column(heading), _number_cells(values)) for heading, values in numbers.items()),
    ]
    return Table.of_columns("worst-moments", columns)


def _number_cells(values: Sequence[float | None]) -> list[Cell]:
    places = decimals(values)
    return [
        Cell(NOT_AVAILABLE, reason="the tracker does not give what this needs") if value is None
        else Cell(fixed(value, places))
        for value in values
    ]  # fmt: skip
