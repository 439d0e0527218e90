"""Run of scenarios: prepare, run, save and compare them."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, overload

from trackbench import results
from trackbench.api.plan import Counter, Listener, Prepared, RunPlan, command_of, place_prefix
from trackbench.api.prepare import prepare
from trackbench.api.result import ReportableResult
from trackbench.api.save import with_artifacts
from trackbench.api.scenario import Named, loaded_scenario
from trackbench.base.errors import InputError
from trackbench.base.execution import Executor
from trackbench.base.execution import executor as executor_of
from trackbench.base.subjects import offered
from trackbench.base.types import Progress, no_progress
from trackbench.driving.isolation import ISOLATED, Isolation
from trackbench.driving.process import INSIDE
from trackbench.engine.choice import EngineName
from trackbench.results import Result
from trackbench.scenario import Scenario

#: Number of scenarios whose runs a cluster is given ahead of the scenario that is waited for.
AHEAD = 32
Several = list[Scenario | Named] | tuple[Scenario | Named, ...]


@overload
def run(
    scenario: Scenario | Named,
    *,
    workers: int | None = None,
    cluster: str | None = None,
    out: Path | str | None = None,
    engine: EngineName = "auto",
    in_process: bool = False,
    tracker_timeout: float = ISOLATED.timeout,
    tracker_memory: float | None = None,
    progress: Progress = no_progress,
    **files: bool,
) -> ReportableResult: ...
@overload
def run(scenario: Several, **options: Any) -> list[ReportableResult]: ...
def run(
    scenario: Scenario | Named | Several,
    *,
    workers: int | None = None,
    cluster: str | None = None,
    out: Path | str | None = None,
    engine: EngineName = "auto",
    in_process: bool = False,
    tracker_timeout: float = ISOLATED.timeout,
    tracker_memory: float | None = None,
    progress: Progress = no_progress,
    **files: bool,
) -> ReportableResult | list[ReportableResult]:
    """Score every tracker of a scenario over its Monte-Carlo runs.

    For a given engine, the result is the same to the last bit on any number of workers; only measured times differ.

    Args:
        scenario: a scenario or anything that :func:`load` takes; a list or tuple of these gives a list of results.
        workers: number of processes; None for one per core if the work takes long, else one.
        cluster: Dask cluster instead of processes: ``tcp://HOST:PORT``, or ``local:N`` for N workers on this machine.
        out: folder in which each scenario gets a folder as by ``trackbench run``: result, report, recording, tables.
            Several scenarios are also compared there. Nothing is written unless given.
        engine: ``numpy``; ``fused``, machine code made of the same functions, which needs ``trackbench[fast]``; or
            ``auto``, the fused engine where it is available and the work is large enough.
        in_process: whether your own trackers run in this process, without limits, for a debugger.
        tracker_timeout: longest time that your own tracker may take to answer a scan, s.
        tracker_memory: largest memory of your own tracker, GB; a quarter of the machine's or container's unless given.
        progress: called with the number of runs done and of all runs of a scenario.
        files: ``NAME=False`` leaves a file out of the folder, such as ``recording=False`` for ``recording.rrd``.

    Raises:
        InputError: something is wrong in a scenario, nothing can be written to ``out``, no cluster can be reached,
            or the engine is not available.
        TrackbenchError: the folder cannot be written, or workers died.
    """
    if INSIDE in os.environ:
        # A script that names a class of its own is imported by the tracker's process.
        problem = "this script is imported again to start its tracker; put the call of run() under"
        raise InputError(f'{problem} if __name__ == "__main__":')
    artifacts = {Path(file).stem: file for file, _ in offered("artifacts")}
    for name in files:
        if name in ("runs", "seed", "scenes", "trackers", "set"):
            raise TypeError(f"{name} belongs to the scenario: run(load(..., {name}={files[name]!r}))")
        if name not in artifacts:
            raise TypeError(f"run() got an unexpected keyword argument {name!r}")
    left_out = frozenset(artifacts[name] for name, written in files.items() if not written)
    isolation = Isolation(in_process, tracker_timeout, tracker_memory)
    plan = RunPlan(None if out is None else Path(out), workers, cluster, left_out, isolation, engine)
    listener = Counter(progress, "runs")
    loaded = [loaded_scenario(item) for item in (scenario if isinstance(scenario, list | tuple) else [scenario])]
    with executor_of(workers, cluster) as chosen:
        finished = [ReportableResult.of(result) for result in run_scenarios(loaded, plan, chosen, listener)]
    return finished if isinstance(scenario, list | tuple) else finished[0]


def run_scenarios(scenarios: Sequence[Scenario], plan: RunPlan, executor: Executor, listener: Listener) -> list[Result]:
    """Prepare and run scenarios, and return their results; save them in the plan's folder, and compare several.

    Raises:
        InputError: something is wrong in a scenario or its plug-ins, or the results cannot be written.
        TrackbenchError: the processes that do the work died, or a folder cannot be written.
    """
    prepared = prepare(scenarios, plan, executor, listener)
    # Imported here: slow to import, and a mistake in a scenario is reported before it.
    from trackbench.runner.run import PendingRun

    # One process gains nothing from several scenarios at once, and a viewer shows one run at a time.
    one_by_one = (plan.workers == 1 and plan.cluster is None) or listener.observes
    ahead = 0 if one_by_one else AHEAD if plan.cluster is not None else plan.workers or os.cpu_count() or 1

    def start(item: Prepared) -> Callable[..., Result]:
        options: Any = {"observed": listener.observes, "alone": len(prepared) == 1}
        return PendingRun(item.scenario, item.truths, executor, plan.isolation, plan.engine, **options).collect

    waiting, begun = deque(prepared), deque[Callable[..., Result]]()
    finished: list[Result] = []
    for number, item in enumerate(prepared, 1):
        while waiting and len(begun) <= ahead:
            begun.append(start(waiting.popleft()))
        place, observe = place_prefix(number, prepared), listener.begin(item)
        with listener.progress(f"{place}{item.scenario.config.full_name}", "runs") as advance:
            command = partial(command_of, engine=plan.engine)
            result = begun.popleft()(command=command, progress=advance, on_recorded_run=observe)
            result = result.updated(provenance=item.provenance)
            advance(result.summary.runs, result.summary.runs)
        folder = None
        if plan.out is not None:
            folder = plan.out / result.summary.scenario.name
            with listener.progress(f"{place}writing {folder.name}", "files"):
                result, artifacts = with_artifacts(result, plan.left_out)
                result.save(folder, artifacts)
        finished.append(result)
        listener.end(result, folder)
    if plan.out is not None:
        _compare(finished, plan.out, listener)
    return finished


def _compare(finished: Sequence[Result], out: Path, listener: Listener) -> None:
    ranked = [result.summary.headline for result in finished if result.summary.truth.known]
    # Results can be compared if the same metric ranks their trackers.
    if len(set(ranked)) == len(ranked):
        return
    from trackbench.compare import compare_results, results_in
    from trackbench.report.comparison.document import batch_files

    comparison = compare_results([results_in(out, finished)])
    for file, content in batch_files(comparison, out):
        results.write_bytes(file, content)
    listener.compared(comparison, out / "comparison.md")
