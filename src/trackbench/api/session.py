"""One or several scenarios, from what was loaded to results and their folders: what is behind a command and a call."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from trackbench import results
from trackbench.api.plan import Listener, Prepared, RunPlan, command_of
from trackbench.api.provenance import provenance_of
from trackbench.base.errors import InputError
from trackbench.base.execution import Executor
from trackbench.base.subjects import offered, resolve
from trackbench.base.types import Progress
from trackbench.results import Result
from trackbench.scenario import Scenario
from trackbench.scenario.check import check_plugins
from trackbench.scenario.truth import PendingTruths

if TYPE_CHECKING:
    from trackbench.runner.run import PendingRun


def prepare(scenarios: Sequence[Scenario], plan: RunPlan, executor: Executor, listener: Listener) -> list[Prepared]:
    """Check everything that could stop a run, and simulate the truth, before any tracker runs.

    Raises:
        InputError: something is wrong in a scenario or its plug-ins, or the results cannot be written.
    """
    if plan.out is not None:
        results.require_writable(plan.out)
    _require_distinct(scenarios)
    scenarios = [_checked(scenario, plan, listener) for scenario in scenarios]
    if plan.out is not None:
        for scenario in scenarios:
            results.require_replaceable(plan.out / scenario.config.full_name)
    pending = [PendingTruths(scenario, executor) for scenario in scenarios]
    return [
        _prepared(scenario, truths, listener, _place(i, scenarios))
        for i, (scenario, truths) in enumerate(zip(scenarios, pending, strict=True), 1)
    ]


def run_prepared(prepared: Sequence[Prepared], plan: RunPlan, executor: Executor, listener: Listener) -> list[Result]:
    """The result of each scenario, saved where the plan says so; several are also compared there.

    Raises:
        TrackbenchError: the processes that do the work died, or a folder cannot be written.
    """
    batch = _Batch(prepared, plan, executor, listener)
    finished = batch.run()
    ranked = [result.summary.headline for result in finished if result.summary.truth.known]
    # Comparable are results whose trackers the same metric ranks.
    if plan.out is not None and len(set(ranked)) < len(ranked):
        from trackbench.compare import compare_results, results_in
        from trackbench.report.comparison.document import batch_files

        comparison = compare_results([results_in(plan.out, finished)])
        for file, content in batch_files(comparison, plan.out):
            results.write_bytes(file, content)
        listener.compared(comparison, plan.out / "comparison.md")
    return finished


def _checked(scenario: Scenario, plan: RunPlan, listener: Listener) -> Scenario:
    if plan.precision is not None:
        from trackbench.runner.run import first_look

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
    for note in check_plugins(scenario, plan.isolation):
        listener.note(note)
    return scenario


def _prepared(scenario: Scenario, pending: PendingTruths, listener: Listener, place: str) -> Prepared:
    with listener.progress(f"{place}truth of {scenario.config.full_name}", "steps") as advance:
        truths = pending.collect(advance)
    for note in dict.fromkeys(note for truth in truths for note in truth.notes):
        listener.note(note)
    return Prepared(scenario, truths, provenance_of(scenario))


def _place(number: int, of: Sequence[object]) -> str:
    return f"{number} of {len(of)}: " if len(of) > 1 else ""


def _require_distinct(scenarios: Sequence[Scenario]) -> None:
    """Two scenarios of one name would overwrite each other."""
    by_name: dict[str, Path] = {}
    for scenario in scenarios:
        name = scenario.config.full_name
        if name in by_name:
            problem = f"{by_name[name]} has the same name {name!r}; give each scenario its own"
            raise InputError(problem, file=scenario.path, key="name")
        by_name[name] = scenario.path


_Writer = Callable[[Path], None]


def pages(result: Result) -> dict[str, str]:
    """The report of a run, by the name of the file."""
    from trackbench.document.html import to_html
    from trackbench.document.markdown import to_markdown
    from trackbench.report.result import result_document

    document = result_document(result)
    return {"report.html": to_html(document), "report.md": to_markdown(document)}


def _save(
    result: Result,
    folder: Path,
    pages: Mapping[str, str],
    progress: Progress,
    left_out: Collection[str],
) -> Result:
    """Write the folder of a run with everything that is in it.

    Args:
        result: of the run.
        folder: its name; an earlier result under it is replaced.
        pages: the report, by the name of the file.
        progress: called with the number of files written and of all.
        left_out: the files of subjects that are not written.

    Returns:
        The result, which names the files.

    Raises:
        TrackbenchError: the folder cannot be written; nothing is left under its name.
    """
    result, artifacts = with_artifacts(result, pages, left_out)
    result.save(folder, _counted(artifacts, progress))
    return result


def with_artifacts(
    result: Result, pages: Mapping[str, str], left_out: Collection[str] = ()
) -> tuple[Result, dict[str, Callable[[Path], None]]]:
    """The result, which names all files of its folder, and what writes those beside its numbers.

    Args:
        result: of the run.
        pages: the report, by the name of the file.
        left_out: the files of subjects that are not written.
    """
    artifacts: dict[str, _Writer] = {name: partial(results.write_file, text) for name, text in pages.items()}
    for file, offer in offered("artifacts"):
        if file not in left_out:
            artifacts[file] = partial(resolve(offer.target), result)
    files = (*artifacts, *(f"{table}.parquet" for table in result.tables))
    return result.updated(
        artifacts={"markdown" if file == "report.md" else Path(file).stem: file for file in files}
    ), artifacts


def _counted(artifacts: Mapping[str, _Writer], progress: Progress) -> dict[str, _Writer]:
    """The same writers, each of which says which of them it is."""

    def write(number: int, writer: _Writer, path: Path) -> None:
        progress(number, len(artifacts))
        writer(path)

    return {name: partial(write, number, writer) for number, (name, writer) in enumerate(artifacts.items())}


#: On a cluster, whatever its size: of so many scenarios the runs are asked for beside the one that is waited for.
AHEAD = 32


class _Computed(NamedTuple):
    """A result, and the pages of its folder, which are being made."""

    place: str
    result: Result
    pages: Iterator[dict[str, str]] | None


class _Batch:
    """The runs of several scenarios.

    Args:
        prepared: the scenarios.
        plan: how they are run.
        executor: what does the work.
        listener: is told of it.
    """

    def __init__(self, prepared: Sequence[Prepared], plan: RunPlan, executor: Executor, listener: Listener) -> None:
        self._prepared, self._plan, self._executor, self._listener = prepared, plan, executor, listener
        self._alone = len(prepared) == 1
        # With more at once in one process nothing would be done earlier, and a viewer shows one run at a time.
        one_by_one = (plan.workers == 1 and plan.cluster is None) or listener.observes
        cores = os.cpu_count() or 1
        self._ahead = 0 if one_by_one else AHEAD if plan.cluster is not None else plan.workers or cores

    def run(self) -> list[Result]:
        """The results in the scenarios' order, each saved where the plan says so."""
        finished: list[Result] = []
        begun: deque[PendingRun | None] = deque()
        unsaved: deque[_Computed] = deque()
        for number, item in enumerate(self._prepared):
            last = number + self._ahead + 1
            begun.extend(self._begun(later) for later in self._prepared[number + len(begun) : last])
            unsaved.append(self._computed(_place(number + 1, self._prepared), item, begun.popleft()))
            while len(unsaved) > self._ahead:
                finished.append(self._ended(unsaved.popleft()))
        return [*finished, *map(self._ended, unsaved)]

    def _begun(self, item: Prepared) -> PendingRun | None:
        """Its runs; None where their number is not known yet."""
        if self._plan.precision is not None:
            return None
        # The runner takes its time to import, which a mistake in a scenario need not wait for.
        from trackbench.runner.run import PendingRun

        return PendingRun(
            item.scenario,
            item.truths,
            self._executor,
            isolation=self._plan.isolation,
            engine=self._plan.engine,
            observed=self._listener.observes,
            alone=self._alone,
        )

    def _computed(self, place: str, item: Prepared, pending: PendingRun | None) -> _Computed:
        scenario, observe = item.scenario, self._listener.begin(item)
        with self._listener.progress(f"{place}{scenario.config.full_name}", "runs") as advance:
            if pending is not None:
                result = pending.collect(command_of(scenario, self._plan.engine), advance, observe)
            else:
                from trackbench.runner.run import run_until

                assert self._plan.precision is not None
                result = run_until(
                    scenario,
                    item.truths,
                    *self._plan.precision,
                    executor=self._executor,
                    isolation=self._plan.isolation,
                    engine=self._plan.engine,
                    command=partial(command_of, engine=self._plan.engine),
                    progress=advance,
                    on_recorded_run=observe,
                )
            result = result.updated(provenance=item.provenance)
            advance(result.summary.runs, result.summary.runs)
        if self._plan.out is None:
            return _Computed(place, result, None)
        executor = Executor() if self._alone else self._executor
        return _Computed(place, result, executor.map(pages, [(result,)]))

    def _ended(self, computed: _Computed) -> Result:
        place, result, made = computed
        folder = None
        if self._plan.out is not None and made is not None:
            name = result.summary.scenario.name
            folder = self._plan.out / name
            with self._listener.progress(f"{place}writing {name}", "files") as advance:
                result = _save(result, folder, next(made), advance, self._plan.left_out)
        self._listener.end(result, folder)
        return result
