"""Single scenes of a run, and what its intervals rest on."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from trackbench.base.errors import counted
from trackbench.document import Block, Cell, Column, Paragraph, Table
from trackbench.metrics.contrasts import FEW_DECIDE_UNTIL, turning_factor, undrawn_share
from trackbench.metrics.intervals import FEWEST_SCENES, TOO_FEW_SCENES, UNCALIBRATED
from trackbench.report.numbers import NOT_AVAILABLE, decimals, joined_names, percent, rounded
from trackbench.results import Result
from trackbench.results.scenario_summary import SceneSummary

ONE_RUN = "No intervals: one run of one scene does not say what is chance"


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
    carried = ", with the recording's own noise in those of errors" if any(noise.values()) else ""
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
        return "over runs, each with a motion of its own"
    return "over runs of one scene: of the sensors' noise, not of other traffic"


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
        return [
            "Vehicles hide others, and one scene of a hundred in which one is lost may decide: with fewer than "
            f"{FEW_DECIDE_UNTIL} scenes an error is shown to be larger only where it is more than 1.5 times the other; "
            "intervals leave such a scene out"
        ]
    share, factor = f"{100 * undrawn_share(number):.2g} %", f"{turning_factor(number):.2g}"
    return [
        f"{number} scenes may leave out a kind of scene that makes up {share} of all: an order would turn if two "
        f"trackers differed there by {factor} times as much as in these scenes, in the other direction"
    ]


def without_interval(result: Result) -> list[str]:
    """Of which metrics no interval over runs holds, and why: "no interval holds with fewer than 50 runs: tgospa"; none
    where there are too few scenes for any."""
    paths: dict[str, dict[str, None]] = {}
    for tracker in result.scored:
        for path, metric in tracker.metrics.items():
            if metric.value is not None and (metric.reason or "").startswith(UNCALIBRATED):
                paths.setdefault(metric.reason or "", {})[path] = None
    paths.pop(TOO_FEW_SCENES, None)
    return [f"{reason}: {joined_names([*own])}" for reason, own in paths.items()]


def scenes(result: Result) -> Iterator[Block]:
    """The errors scene by scene, with those in which the order is another one."""
    summary = result.summary
    if not summary.truth.scenes or not result.scored:
        return
    shares = [f"{t.name} {percent(t.scene_share)}" for t in result.scored if t.scene_share is not None]
    variance = (
        f"How much of the variance of one run's squared {summary.headline_name} is between scenes, and not "
        f"noise within one: {joined_names(shares)}. The intervals of this page take the scenes for what is independent."
    )
    untold = "With one run in each scene, what the scene does to the error cannot be told from what the noise does."
    yield Paragraph(variance if shares else untold)
    contenders = [tracker.name for tracker in result.contenders]
    turned = [scene for scene in summary.truth.scenes if _other_ahead(result, scene, contenders)]
    total, best = f"{len(summary.truth.scenes)} {summary.truth.kind_of_scenes}", contenders[0]
    if turned:
        each = [f"{scene.name} ({_first(scene, contenders)})" for scene in turned]
        where = f"In {len(turned)} of {total} another tracker is ahead of {best} by more than the margin"
        yield Paragraph(f"{where}: {joined_names(each)}.")
    else:
        yield Paragraph(f"No tracker is ahead of {best} by more than the margin in any of the {total}.")
    yield _scene_table(result, contenders)


def _first(scene: SceneSummary, names: Sequence[str]) -> str:
    """The best here of some trackers."""
    return next((name for name in scene.order if name in names), "")


def _other_ahead(result: Result, scene: SceneSummary, names: Sequence[str]) -> bool:
    """Whether another tracker is better here than the one that is the best of all, by more than the margin."""
    best = names[0]
    if best not in scene.error:
        return any(name in scene.error for name in names)
    least = scene.error[_first(scene, names)]
    return scene.error[best] - least > result.summary.score.margin.at(least, "m")


def _scene_table(result: Result, contenders: Sequence[str]) -> Table:
    every = result.summary.truth.scenes
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
