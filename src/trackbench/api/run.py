"""Running scenarios."""

from __future__ import annotations

import os
from pathlib import Path
from typing import overload

from trackbench.api import session
from trackbench.api.plan import Counter, RunPlan
from trackbench.api.result import ReportableResult
from trackbench.api.scenario import Named, loaded_scenario
from trackbench.base.errors import InputError
from trackbench.base.execution import executor
from trackbench.base.subjects import offered
from trackbench.base.types import Progress, no_progress
from trackbench.driving.isolation import ISOLATED, Isolation
from trackbench.driving.processes import INSIDE
from trackbench.engine.choice import EngineName
from trackbench.scenario import Scenario

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
def run(
    scenario: Several,
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
) -> list[ReportableResult]: ...
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

    The result of an engine is the same wherever it is made, to the last bit, but for the times.

    Args:
        scenario: what :func:`load` gave or takes; or a list or tuple of these, which gives a list of results.
        workers: number of processes; as many as there are cores unless given, where the work takes long.
        cluster: a Dask cluster that is used instead: ``tcp://HOST:PORT``, or ``local:N`` for N workers on this machine.
        out: a folder in which each scenario gets one, as by ``trackbench run``: result, report, recording, tables.
            Several are also compared there. Nothing is written unless given.
        engine: what computes: ``numpy``; ``fused``, machine code made of the same functions, which takes
            ``trackbench[fast]``; or ``auto``, the fused one where it can be had and there is work enough for it.
        in_process: whether trackers of your own get no process of their own: for a debugger.
        tracker_timeout: longest time that one may take to answer a scan, s.
        tracker_memory: most memory that one may take, GB; a quarter of the machine's or container's unless given.
        progress: called with the number of runs done and of all of a scenario.
        files: ``recording=False`` leaves ``recording.rrd`` out of the folder, and so for each such file.

    Raises:
        InputError: something is wrong in a scenario, nothing can be written to ``out``, no cluster can be reached,
            or the engine cannot be had.
        TrackbenchError: the folder cannot be written, or workers died.
    """
    if INSIDE in os.environ:
        # A script that names a class of its own is imported by the tracker's process.
        problem = "a script that runs scenarios is imported as the module of a tracker; write the call under"
        raise InputError(f'{problem} if __name__ == "__main__":')
    artifacts = {Path(file).stem: file for file, _ in offered("artifacts")}
    for name in files:
        if name not in artifacts:
            raise TypeError(f"run() got an unexpected keyword argument {name!r}")
    left_out = frozenset(artifacts[name] for name, written in files.items() if not written)
    isolation = Isolation(in_process, tracker_timeout, tracker_memory)
    plan = RunPlan(None if out is None else Path(out), workers, cluster, left_out, isolation, engine)
    listener = Counter(progress, "runs")
    loaded = [loaded_scenario(item) for item in (scenario if isinstance(scenario, list | tuple) else [scenario])]
    with executor(workers, cluster) as chosen:
        prepared = session.prepare(loaded, plan, chosen, listener)
        finished = [ReportableResult.of(result) for result in session.run_prepared(prepared, plan, chosen, listener)]
    return finished if isinstance(scenario, list | tuple) else finished[0]
