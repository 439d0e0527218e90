"""The Python call ``trackbench.envelope``, and the steps that it shares with the command ``trackbench envelope``."""

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
from trackbench.sensing.scans import fingerprint_of
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
    """Settings of how a map is computed (isolation, engine, storage), which do not change the measurements."""

    isolation: Isolation = ISOLATED
    engine: EngineName = "auto"
    store: Path | None = None
    """Folder that stores finished runs, so that an interrupted map can go on; None stores nothing."""
    counter_examples: int | None = None
    """Largest number of counter-examples (nearest failing cells) of a tracker; None for twice the number of axes."""

    def __post_init__(self) -> None:
        require_engine(self.engine)


def make_envelope(loaded: Scenario, plan: EnvelopePlan, executor: Executor, listener: Listener) -> Envelope:
    """Compute the map of a scenario's ``envelope:`` block, and its counter-examples: the nearest failing cells.

    Raises:
        InputError: the scenario is invalid, as it is written or at a cell of the map.
        TrackbenchError: the processes that do the work died.
    """
    task = task_of(loaded)
    check_plugins(task.loaded, plan.isolation)
    store = Store(plan.store, map_signature(task, plan))
    envelope_map = EnvelopeMap(task, executor, plan.isolation, plan.engine, store)
    with listener.progress(f"envelope of {loaded.config.name}", "cells") as advance:
        envelope_map.make(advance)
    mapped = envelope_of(envelope_map, command_of_envelope(loaded, plan))
    maker = CounterMaker(envelope_map, mapped.claim)
    examples = maker.make(plan.counter_examples, listener)
    claim = mapped.claim.model_copy(update={"counter_examples": examples})
    return replace(mapped, claim=claim, shown=maker.shown)


def envelope_of(envelope_map: EnvelopeMap, command: str) -> Envelope:
    """Return the claim of a finished map (its cells and their states), with each run's or scene's contribution."""
    task, rows = envelope_map.task, []
    cells = [*envelope_map.cells.values()]
    for number, cell in enumerate(cells):
        for limit_number, item in enumerate(task.requirements):
            tracker_requirements = task.requirements_on(item.tracker)
            decisions = cell.trackers[item.tracker].decisions
            decision = decisions[tracker_requirements.index(item)] if decisions else None
            if decision is not None:
                rows.append((number, limit_number, decision.interval.value + decision.interval.influence))
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
        engine=envelope_map.engine,
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
                measurements=[fingerprint_of(digest) for digest in cell.measurements],
                trackers={name: _tracker(tracker) for name, tracker in cell.trackers.items()},
            )
            for cell in cells
        ],
        absent=envelope_map.absent,
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
        values=[_value(item) for item in tracker.decisions],
        coverage=tracker.coverage and _value(tracker.coverage),
    )


def _value(item: CellDecision | None) -> CellValue:
    if item is None:
        return CellValue(state="undecided", value=None, low=None, high=None)
    return CellValue(state=item.state, value=item.interval.value, low=item.low, high=item.high)


def map_signature(task: EnvelopeTask, plan: EnvelopePlan) -> str:
    """Return a hash of all that determines the runs of a map; the names of the files of stored runs contain it."""
    loaded = task.loaded
    settings = [loaded.text, loaded.overrides, [*loaded.config.trackers], hashes_of(loaded), plan.engine, versions()]
    return hashlib.sha256(json.dumps(settings).encode()).hexdigest()


def command_of_envelope(loaded: Scenario, plan: EnvelopePlan) -> str:
    """Return the shell command that repeats a map."""
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
        scenario: a scenario with an ``envelope:`` block, loaded or by its path or name.
        workers: number of processes; None: one for each core where it pays. The claim is the same.
        engine: ``auto``, ``numpy`` or ``fused``.
        counter_examples: largest number of counter-examples of a tracker; None for twice the number of axes.
        progress: called with the number of decided cells and the number of all cells.

    Raises:
        InputError: the scenario is invalid.
        TrackbenchError: the processes that do the work died.
    """
    loaded = loaded_scenario(scenario)
    with executor(workers) as chosen:
        plan = EnvelopePlan(engine=engine, counter_examples=counter_examples)
        return FinishedEnvelope(make_envelope(loaded, plan, chosen, Counter(progress, "cells")))


class FinishedEnvelope:
    """Finished map. A notebook shows it as a page, ``print`` as text."""

    def __init__(self, envelope: Envelope) -> None:
        self.envelope = envelope

    @property
    def claim(self) -> Claim:
        """Cells of the map with their states (holds, fails or undecided), and the settings that repeat them."""
        return self.envelope.claim

    @property
    def margins(self) -> list[AxisMargin]:
        """Axis values at which a tracker's requirements cease to hold, on lines of cells near the scenario."""
        return [margin for tracker in self.claim.trackers for margin in margins(self.claim, tracker)]

    def json(self) -> dict[str, Any]:
        """Return the claim as a dictionary, with the keys of ``trackbench envelope --json``."""
        values: dict[str, Any] = self.claim.model_dump(mode="json")
        return values

    def report(self) -> Report:
        """Return the page that ``trackbench envelope`` writes."""
        from trackbench.subjects.envelope.report import envelope_document

        return Report(envelope_document(self.envelope))

    def save(self, out: Path | str, recording: bool = True) -> Path:
        """Write the folder of the envelope (claim, values of runs, pages, counter-examples); return its path.

        Args:
            out: folder in which the envelope's folder is made.
            recording: whether to write a recording of each counter-example.

        Raises:
            TrackbenchError: the folder cannot be written.
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
