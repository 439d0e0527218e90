"""An envelope: what is behind ``trackbench envelope``, and the call from a program."""

from __future__ import annotations

import hashlib
import json
import shlex
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from trackbench.api.plan import Counter, Listener
from trackbench.api.provenance import hashes_of
from trackbench.api.result import Report
from trackbench.api.scenario import Named, loaded_scenario
from trackbench.base.execution import Executor, executor
from trackbench.base.types import Progress, no_progress
from trackbench.driving.isolation import ISOLATED, Isolation
from trackbench.engine.choice import EngineName, require_engine
from trackbench.runner.assemble import versions
from trackbench.scenario import Scenario
from trackbench.scenario.check import check_plugins
from trackbench.scenario.shipped import shown_name
from trackbench.subjects.envelope.axes import overrides
from trackbench.subjects.envelope.cells import CellDecision, Store
from trackbench.subjects.envelope.claim import (
    CellValue,
    Claim,
    ClaimCell,
    Envelope,
    TrackerState,
    parts_of,
)
from trackbench.subjects.envelope.counter import CounterMaker
from trackbench.subjects.envelope.mapping import EnvelopeMap, TrackerCell
from trackbench.subjects.envelope.margins import AxisMargin, margins
from trackbench.subjects.envelope.task import EnvelopeTask, task_of


@dataclass(frozen=True)
class EnvelopePlan:
    """How a map is made."""

    isolation: Isolation = ISOLATED
    engine: EngineName = "auto"
    store: Path | None = None
    """A folder that keeps the runs until the map is written."""
    counter_examples: int | None = None
    """Most of a tracker; None: twice the number of axes."""

    def __post_init__(self) -> None:
        require_engine(self.engine)


def make_envelope(loaded: Scenario, plan: EnvelopePlan, executor: Executor, listener: Listener) -> Envelope:
    """Make the map that a scenario asks for.

    Raises:
        InputError: something is wrong in the scenario, or a cell of the map is none.
        TrackbenchError: the processes that do the work died.
    """
    task = task_of(loaded)
    for note in check_plugins(task.loaded, plan.isolation):
        listener.note(note)
    made = EnvelopeMap(task, executor, plan.isolation, plan.engine, Store(plan.store, map_signature(task, plan)))
    with listener.progress(f"envelope of {loaded.config.name}", "cells") as advance:
        made.make(advance)
    mapped = envelope_of(made, command_of_envelope(loaded, plan))
    maker = CounterMaker(made, mapped.claim)
    examples = maker.make(plan.counter_examples, listener)
    claim = mapped.claim.model_copy(update={"counter_examples": examples})
    return replace(mapped, claim=claim, shown=maker.shown)


def envelope_of(made: EnvelopeMap, command: str) -> Envelope:
    """What is claimed of a map that was made."""
    task, rows = made.task, []
    cells = [*made.cells.values()]
    for number, cell in enumerate(cells):
        for place, item in enumerate(task.requirements):
            own = task.of(item.tracker)
            judged = cell.trackers[item.tracker].judged
            decision = judged[own.index(item)] if judged else None
            if decision is not None:
                rows.append((number, place, decision.interval.value + decision.interval.influence))
    parts = parts_of(rows)
    config = task.loaded.config
    claim = Claim(
        scenario=config.name,
        file=shown_name(task.loaded.path),
        text=task.loaded.text,
        overrides=list(task.loaded.overrides),
        claim=task.config.claim,
        confidence=task.config.confidence,
        extents=[tuple(extent) for extent in task.extents],
        seed=config.monte_carlo.seed,
        engine=made.engine,
        versions=versions(),
        command=command,
        envelope=task.config.model_dump(mode="json", by_alias=True, exclude_unset=True),
        limits=list(task.requirements),
        base=task.base,
        places={name: task.loaded.places[name] for name in task.trackers},
        cells=[
            ClaimCell(
                point=list(cell.point),
                changes=overrides(task.axes, cell.point),
                added=cell.added,
                measurements=[each.hex()[:16] for each in cell.measurements],
                trackers={name: _tracker(tracker) for name, tracker in cell.trackers.items()},
            )
            for cell in cells
        ],
        absent=made.absent,
    )
    return Envelope(claim, parts)


def _tracker(tracker: TrackerCell) -> TrackerState:
    return TrackerState(
        state=tracker.state,
        cause=tracker.cause,
        failed=tracker.failed,
        scenes=tracker.extent.scenes,
        runs=tracker.extent.runs,
        looks=tracker.looks,
        values=[_value(item) for item in tracker.judged],
        coverage=tracker.coverage and _value(tracker.coverage),
    )


def _value(item: CellDecision | None) -> CellValue:
    if item is None:
        return CellValue(state="undecided", value=None, low=None, high=None)
    return CellValue(state=item.state, value=item.interval.value, low=item.low, high=item.high)


def map_signature(task: EnvelopeTask, plan: EnvelopePlan) -> str:
    """What determines the runs of a map."""
    loaded = task.loaded
    settings = [loaded.text, loaded.overrides, [*loaded.config.trackers], hashes_of(loaded), plan.engine, versions()]
    return hashlib.sha256(json.dumps(settings).encode()).hexdigest()


def command_of_envelope(loaded: Scenario, plan: EnvelopePlan) -> str:
    """The command that repeats a map."""
    parts = ["trackbench", "envelope", shown_name(loaded.path)]
    for override in loaded.overrides:
        parts += ["--set", override]
    if plan.engine != "auto":
        parts += ["--engine", plan.engine]
    return shlex.join(parts)


def envelope(
    scenario: Scenario | Named,
    *,
    workers: int | None = 1,
    engine: EngineName = "auto",
    counter_examples: int | None = None,
    progress: Progress = no_progress,
) -> FinishedEnvelope:
    """Map where trackers meet what the scenario expects of them.

    Args:
        scenario: what :func:`load` gave or takes, with an ``envelope:`` block.
        workers: number of processes; None: one for each core where it pays. The claim is the same.
        engine: ``auto``, ``numpy`` or ``fused``.
        counter_examples: most of a tracker; twice the number of axes unless given.
        progress: called with the number of cells that are decided and of those that there are.

    Raises:
        InputError: something is wrong in the scenario.
        TrackbenchError: the processes that do the work died.
    """
    loaded = loaded_scenario(scenario)
    with executor(workers) as chosen:
        plan = EnvelopePlan(engine=engine, counter_examples=counter_examples)
        return FinishedEnvelope(make_envelope(loaded, plan, chosen, Counter(progress, "cells")))


class FinishedEnvelope:
    """A map that was made. A notebook shows it as a page, ``print`` as text."""

    def __init__(self, made: Envelope) -> None:
        self.envelope = made

    @property
    def claim(self) -> Claim:
        """Its cells, and what repeats them."""
        return self.envelope.claim

    @property
    def margins(self) -> list[AxisMargin]:
        """Of each tracker and axis, where the requirement stops to hold along the line through the scenario."""
        return [margin for tracker in self.claim.trackers for margin in margins(self.claim, tracker)]

    def json(self) -> dict[str, Any]:
        """The claim, as ``trackbench envelope --json`` prints it."""
        values: dict[str, Any] = self.claim.model_dump(mode="json")
        return values

    def report(self) -> Report:
        """The page, as ``trackbench envelope`` writes it."""
        from trackbench.subjects.envelope.report import envelope_document

        return Report(envelope_document(self.envelope))

    def save(self, out: Path | str, recording: bool = True) -> Path:
        """Write the folder of the envelope; returns its place.

        Args:
            out: in which it is made.
            recording: whether each counter-example has one.

        Raises:
            TrackbenchError: it cannot be written.
        """
        from trackbench.subjects.envelope.files import save_envelope

        return save_envelope(self.envelope, Path(out), recording)

    def __repr__(self) -> str:
        claim = self.claim
        return f"<envelope of {claim.scenario}: {len(claim.cells)} cells, {len(claim.axes)} axes>"

    def __str__(self) -> str:
        return str(self.report())

    def _repr_html_(self) -> str:
        return self.report()._repr_html_()
