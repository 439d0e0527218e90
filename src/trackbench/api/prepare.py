"""Check scenarios and simulate their truths, before any tracker runs."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from trackbench import results
from trackbench.api.plan import Listener, Prepared, RunPlan, place_prefix
from trackbench.api.provenance import provenance_of
from trackbench.base.errors import InputError
from trackbench.base.execution import Executor
from trackbench.scenario import Scenario
from trackbench.scenario.check import check_plugins
from trackbench.scenario.truth import PendingTruths


def prepare(scenarios: Sequence[Scenario], plan: RunPlan, executor: Executor, listener: Listener) -> list[Prepared]:
    """Check everything that could stop a run, and simulate the truths, before any tracker runs.

    Raises:
        InputError: something is wrong in a scenario or its plug-ins, or the results cannot be written.
    """
    if plan.out is not None:
        results.require_writable(plan.out)
    _require_distinct_names(scenarios)
    for scenario in scenarios:
        check_plugins(scenario, plan.isolation)
    if plan.out is not None:
        for scenario in scenarios:
            results.require_replaceable(plan.out / scenario.config.full_name)
    pending = [PendingTruths(scenario, executor) for scenario in scenarios]
    return [
        _prepared(scenario, truths, listener, place_prefix(i, scenarios))
        for i, (scenario, truths) in enumerate(zip(scenarios, pending, strict=True), 1)
    ]


def _prepared(scenario: Scenario, pending: PendingTruths, listener: Listener, place: str) -> Prepared:
    with listener.progress(f"{place}truth of {scenario.config.full_name}", "steps") as advance:
        truths = pending.collect(advance)
    for note in dict.fromkeys(note for truth in truths for note in truth.notes):
        listener.note(note)
    return Prepared(scenario, truths, provenance_of(scenario))


def _require_distinct_names(scenarios: Sequence[Scenario]) -> None:
    by_name: dict[str, Path] = {}
    for scenario in scenarios:
        name = scenario.config.full_name
        if name in by_name:
            problem = f"{name!r} is also the name of {by_name[name]}; give each scenario its own name"
            raise InputError(problem, file=scenario.path, key="name")
        by_name[name] = scenario.path
