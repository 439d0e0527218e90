"""One or several scenarios, from what was loaded to results and their folders: what is behind a command and a call."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from pathlib import Path

from trackbench import results
from trackbench.api.plan import Listener, Plan, Prepared
from trackbench.base.errors import InputError
from trackbench.results import Result
from trackbench.scenario import Scenario
from trackbench.scenario.check import check_plugins
from trackbench.scenario.truth import PendingTruths


def prepare(scenarios: Sequence[Scenario], plan: Plan, executor: Executor, listener: Listener) -> list[Prepared]:
    """Check everything that could stop a run, and simulate the truth, before any tracker runs.

    Raises:
        InputError: something is wrong in a scenario or its plug-ins, or the results cannot be written.
    """
    if plan.out is not None:
        results.require_writable(plan.out)
    _require_distinct(scenarios)
    scenarios = [_checked(scenario, plan) for scenario in scenarios]
    if plan.out is not None:
        for scenario in scenarios:
            results.require_replaceable(plan.out / scenario.config.name)
    pending = [PendingTruths(scenario, executor) for scenario in scenarios]
    return [
        _prepared(scenario, truths, listener, _place(i, scenarios))
        for i, (scenario, truths) in enumerate(zip(scenarios, pending, strict=True), 1)
    ]


def run(prepared: Sequence[Prepared], plan: Plan, executor: Executor, listener: Listener) -> list[Result]:
    """The result of each scenario, saved where the plan says so; several are also compared there.

    Raises:
        TrackbenchError: the processes that do the work died, or a folder cannot be written.
    """
    # The runner and the reports take their time to import, which a mistake in a scenario need not wait for.
    from trackbench.api.batch import Batch, save_comparison

    batch = Batch(prepared, plan, executor, listener)
    found = batch.run()
    if plan.out is not None and _comparable(found):
        listener.compared(save_comparison(found, plan.out, batch.colours), plan.out / "comparison.md")
    return found


def _comparable(found: Sequence[Result]) -> bool:
    """Whether the same metric ranks the trackers of several results."""
    ranked = [item.summary.headline for item in found if item.summary.truth.known]
    return len(set(ranked)) < len(ranked)


def _checked(scenario: Scenario, plan: Plan) -> Scenario:
    if plan.precision is not None:
        from trackbench.runner.until import first_look

        if scenario.config.sensing.identities == "hidden":
            problem = "stops by the position RMSE of labelled objects; with hidden identities give --runs"
            raise InputError(problem, file=scenario.path, key="--runs-until")
        scenario = first_look(scenario, plan.precision[1])
        if len(scenario.config.truth.scenes()) > 1:
            problem = "more runs of the same scenes do not narrow an interval over scenes; take more scenes"
            raise InputError(problem, file=scenario.path, key="--runs-until")
        if len(scenario.config.trackers) < 2:
            problem = "needs two trackers, whose difference it is about"
            raise InputError(problem, file=scenario.path, key="--runs-until")
    check_plugins(scenario, plan.isolation)
    return scenario


def _prepared(scenario: Scenario, pending: PendingTruths, listener: Listener, place: str) -> Prepared:
    with listener.progress(f"{place}truth of {scenario.config.name}", "steps") as advance:
        truths = pending.collect(advance)
    for note in dict.fromkeys(note for truth in truths for note in truth.notes):
        listener.note(note)
    return Prepared(scenario, truths)


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
