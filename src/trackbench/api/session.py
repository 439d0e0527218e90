"""One or several scenarios, from what was loaded to results and their folders: what is behind a command and a call."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from trackbench import results
from trackbench.api.files import save, save_comparison
from trackbench.api.listener import Listener, Prepared
from trackbench.errors import InputError
from trackbench.palette import tracker_colours
from trackbench.results import Result
from trackbench.scenario import Scenario
from trackbench.scenario.check import check_plugins, notes
from trackbench.scenario.shipped import shown_name
from trackbench.scenario.truth import truths_of

#: Where a run that goes on until its precision is reached stops even so.
MAX_RUNS = 10_000


@dataclass(frozen=True)
class Plan:
    """How every scenario is run."""

    out: Path | None = None
    """Each scenario gets a folder in it; nothing is written unless given."""
    workers: int = 1
    """Number of processes."""
    recording: bool = True
    """Whether the Rerun recording is written."""
    precision: tuple[float, int] | None = None
    """The share and the largest number of runs, where the precision decides on their number."""

    def __post_init__(self) -> None:
        if not isinstance(self.workers, int) or self.workers < 1:
            raise InputError(f"{self.workers!r} is no number of processes; give a whole one from 1", key="workers")


def prepare(scenarios: Sequence[Scenario], plan: Plan, listener: Listener) -> list[Prepared]:
    """Check everything that could stop a run, and simulate the truth, before any tracker runs.

    Raises:
        InputError: something is wrong in a scenario or its plug-ins, or the results cannot be written.
    """
    if plan.out is not None:
        results.require_writable(plan.out)
    _require_distinct(scenarios)
    prepared = [_prepare(scenario, plan, listener, _place(i, scenarios)) for i, scenario in enumerate(scenarios, 1)]
    if plan.out is not None:
        for scenario in scenarios:
            results.require_replaceable(plan.out / scenario.config.name)
    return prepared


def run(prepared: Sequence[Prepared], plan: Plan, listener: Listener) -> list[Result]:
    """The result of each scenario, saved where the plan says so; several are also compared there.

    Raises:
        TrackbenchError: a worker died, or a folder cannot be written.
    """
    colours = tracker_colours(name for item in prepared for name in item.scenario.config.trackers)
    found = [_run(item, plan, listener, colours, _place(i, prepared)) for i, item in enumerate(prepared, 1)]
    if plan.out is not None and len(found) > 1:
        save_comparison(found, plan.out, colours)
    return found


def command_of(scenario: Scenario) -> str:
    """What reproduces the result of a scenario."""
    settings = (x for item in scenario.overrides for x in ("--set", item))
    only = ["--trackers", ",".join(scenario.selected)] if scenario.selected else []
    return shlex.join(["trackbench", "run", shown_name(scenario.path), *settings, *only])


def _prepare(scenario: Scenario, plan: Plan, listener: Listener, place: str) -> Prepared:
    if plan.precision is not None:
        from trackbench.runner.until import first_look

        scenario = first_look(scenario, plan.precision[1])
        if len(scenario.config.truth.scenes()) > 1:
            problem = "more runs of the same scenes do not narrow an interval over scenes; take more scenes"
            raise InputError(problem, file=scenario.path, key="--runs-until")
        if len(scenario.config.trackers) < 2:
            problem = "needs two trackers, whose difference it is about"
            raise InputError(problem, file=scenario.path, key="--runs-until")
    check_plugins(scenario)
    with listener.progress(f"{place}truth of {scenario.config.name}", "steps") as advance:
        truths = truths_of(scenario, advance, plan.workers)
    for note in (*notes(scenario), *dict.fromkeys(note for truth in truths for note in truth.notes)):
        listener.note(note)
    return Prepared(scenario, truths)


def _run(item: Prepared, plan: Plan, listener: Listener, colours: Mapping[str, str], place: str) -> Result:
    from trackbench.runner.run import run as run_scenario
    from trackbench.runner.until import run_until

    scenario, truths, name = item.scenario, item.truths, item.scenario.config.name
    observe = listener.begin(item)
    with listener.progress(f"{place}{name}", "runs") as advance:
        if plan.precision is None:
            result = run_scenario(
                scenario,
                truths,
                workers=plan.workers,
                command=command_of(scenario),
                progress=advance,
                on_recorded_run=observe,
            )
        else:
            result = run_until(
                scenario,
                truths,
                *plan.precision,
                workers=plan.workers,
                command=command_of,
                progress=advance,
                on_recorded_run=observe,
            )
        advance(result.summary.runs, result.summary.runs)
    folder = None
    if plan.out is not None:
        folder = plan.out / name
        with listener.progress(f"{place}writing {name}", "files") as advance:
            result = save(result, folder, advance, colours, recording=plan.recording)
    listener.end(result, folder)
    return result


def _place(number: int, of: Sequence[object]) -> str:
    return f"{number} of {len(of)}: " if len(of) > 1 else ""


def _require_distinct(scenarios: Sequence[Scenario]) -> None:
    """Two scenarios of one name would overwrite each other."""
    by_name: dict[str, Path] = {}
    for scenario in scenarios:
        name = scenario.config.name
        if name in by_name:
            problem = f"{by_name[name]} has the same name {name!r}; give each scenario its own"
            raise InputError(problem, file=scenario.path, key="name")
        by_name[name] = scenario.path
