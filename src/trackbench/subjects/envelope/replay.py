"""A claim held against itself and against a tenth of its cells that are made again (``envelope --verify``)."""

from __future__ import annotations

import math
import secrets
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from trackbench.api.plan import Listener
from trackbench.base.errors import InputError, counted
from trackbench.base.execution import Executor, executor
from trackbench.driving.isolation import ISOLATED, Isolation
from trackbench.scenario import Scenario
from trackbench.scenario.load import scenario_of, select_trackers
from trackbench.scenario.shipped import find_scenario
from trackbench.subjects.envelope.absent import why_absent
from trackbench.subjects.envelope.api import EnvelopePlan, envelope_of, map_of
from trackbench.subjects.envelope.axes import Point, overrides, start_points
from trackbench.subjects.envelope.cells import joint_state
from trackbench.subjects.envelope.claim import (
    CLAIM,
    PARTS,
    CellValue,
    Claim,
    ClaimCell,
    ClaimedLimit,
    Envelope,
    State,
    TrackerState,
    hash_of,
    parts_of,
    place_of_cell,
    read_claim,
    read_envelope,
)
from trackbench.subjects.envelope.files import require_same
from trackbench.subjects.envelope.mapping import refined
from trackbench.subjects.envelope.task import EnvelopeTask

#: What follows from the scenario in the claim.
HEADER = ("scenario", "claim", "confidence", "spent", "extents", "seed", "envelope", "limits", "base")
#: Of the mean of the runs' values and the value itself, relative to the largest of them.
ROUNDING = 1e-9


class Discrepancy(NamedTuple):
    """Something that a claim should not state."""

    where: str
    """The cell and the tracker; "the claim" of what concerns all of it."""
    what: str

    def __str__(self) -> str:
        return f"{self.where}: {self.what}"


def contradictions(made: Envelope, expected: Claim, task: EnvelopeTask) -> Iterator[Discrepancy]:
    """What in a claim does not follow from the rest of it.

    Args:
        made: the claim and the values of its runs.
        expected: the claim on no cell that the scenario in it gives.
        task: of that scenario.
    """
    claim = made.claim
    for name in HEADER:
        if getattr(claim, name) != getattr(expected, name):
            yield Discrepancy("the claim", f"{name} is not that of the scenario in it")
    if len(made.parts) and hash_of(made.parts) != claim.parts_hash:
        yield Discrepancy("the claim", "the values of the runs have another hash")
    yield from _design(claim)
    for item in claim.absent:
        somewhere = tuple(item.at.get(axis.name, axis.values[0]) for axis in claim.axes)
        if task.absent_at(somewhere) != item:
            yield Discrepancy(item.shown(claim.axes), f"is said to be {item.text}, and there are cells")
    for number, cell in enumerate(claim.cells):
        where = place_of_cell(claim.axes, cell.at)
        if cell.changes != overrides(claim.axes, cell.at):
            yield Discrepancy(where, "its changes are not those of its values of the axes")
        for name, tracker in cell.trackers.items():
            for what in _of_tracker(claim, tracker, cell):
                yield Discrepancy(f"{where}, {name}", what)
        for place, limit in enumerate(claim.limits):
            for what in _of_value(made, number, place, cell.trackers[limit.tracker]):
                yield Discrepancy(f"{where}, {limit.tracker} {limit.metric}", what)


def _design(claim: Claim) -> Iterator[Discrepancy]:
    """The cells follow from the axes, and those near borders from the states of the others."""
    config, axes, cells, absent = claim.config, claim.axes, claim.by_point(), claim.absent
    if len(cells) < len(claim.cells):
        yield Discrepancy("the claim", "a cell stands there twice")
    seen: dict[Point, dict[str, State]] = {}
    points, added = start_points(axes, config, claim.base), False
    while points:
        for point in points:
            if why_absent(absent, axes, point):
                continue
            cell = cells.get(point)
            if cell is None:
                yield Discrepancy(place_of_cell(axes, point), "the map has to have this cell, and it is not there")
                return
            if cell.added != added:
                yield Discrepancy(place_of_cell(axes, point), "added is wrong")
            seen[point] = {name: tracker.state for name, tracker in cell.trackers.items()}
        further = refined(axes, seen, config.cells - len(seen), config.resolution, config.design)
        points, added = [point for point in further if not why_absent(absent, axes, point)], True
    for cell in claim.cells:
        if cell.at not in seen:
            yield Discrepancy(place_of_cell(axes, cell.at), "the map cannot have this cell")


def _of_tracker(claim: Claim, tracker: TrackerState, cell: ClaimCell) -> Iterator[str]:
    """Its state follows from those of its requirements, and its runs from the looks."""
    states = [value.state for value in tracker.values]
    expected = joint_state(states)
    if tracker.cause and tracker.state == "holds":
        yield f"holds, and yet {tracker.cause}"
    # What is missing may make it worse than its values are.
    elif tracker.state != expected and not (tracker.cause and joint_state([expected, tracker.state]) == tracker.state):
        yield f"is said to be {tracker.state}, and its values say {expected}"
    if tracker.cause and not tracker.looks:
        return
    if not 0 < tracker.looks <= len(claim.extents):
        yield f"{tracker.looks} looks, of {len(claim.extents)} that there are"
        return
    if (tracker.scenes, tracker.runs) != claim.extents[tracker.looks - 1]:
        yield f"{tracker.scenes} scenes of {tracker.runs} runs are not those of look {tracker.looks}"
    if tracker.state == "undecided" and tracker.looks < len(claim.extents):
        yield f"is undecided after look {tracker.looks}, and was not looked at again"
    if len(cell.measurements) < tracker.looks:
        yield f"{tracker.looks} looks, and measurements of {len(cell.measurements)}"


def _of_value(made: Envelope, number: int, place: int, tracker: TrackerState) -> Iterator[str]:
    """The state of a requirement follows from its bounds, and its value from the runs."""
    claim, limit = made.claim, made.claim.limits[place]
    own = claim.limits_of(limit.tracker)
    if len(tracker.values) != len(own):
        return
    value, parts = tracker.values[own.index(limit)], made.values(number, place)
    if value.state != (expected := state_of(value, limit)):
        yield f"is said to be {value.state}, and its bounds say {expected}"
    if value.value is None or not len(made.parts):
        return
    wanted = tracker.scenes if claim.claim == "traffic like these" else tracker.runs
    if len(parts) != wanted:
        yield f"there are the values of {len(parts)} runs, not of {wanted}"
    elif abs(float(np.mean(parts)) - value.value) > ROUNDING * float(np.abs(parts).max()):
        yield f"the value is {value.value:.10g}, and the mean of its runs {float(np.mean(parts)):.10g}"


def state_of(value: CellValue, limit: ClaimedLimit) -> State:
    """What the bounds of a value say of its limit."""
    under = value.high is not None and value.high < limit.limit
    over = value.low is not None and value.low > limit.limit
    if under or over:
        return "holds" if under == (limit.direction == "below") else "fails"
    return "undecided"


#: Share of the cells that are replayed.
SHARE = 0.1
WITHOUT_PARTS = f"there is no {PARTS} beside the claim: values were not held against those of their runs"
#: Values that differ by less, relative to the larger, are equal.
EQUAL = 1e-9


@dataclass(frozen=True)
class Verification:
    """What was found of a claim."""

    claim: Claim
    seed: int
    """Of the draw."""
    replayed: tuple[str, ...]
    """The cells that were made again."""
    discrepancies: tuple[Discrepancy, ...]
    notes: tuple[str, ...]
    """Versions that are others than those of the claim."""

    @property
    def passed(self) -> bool:
        """Whether nothing was found."""
        return not self.discrepancies

    @property
    def outcome(self) -> str:
        """In a sentence."""
        cells = f"{len(self.replayed)} of {counted(len(self.claim.cells), 'cell')} replayed (--seed {self.seed})"
        if self.passed:
            return f"{self.claim.scenario}: equal: the claim follows from itself, {cells}"
        return f"{self.claim.scenario}: not equal in {counted(len(self.discrepancies), 'place')}; {cells}"

    def json(self) -> dict[str, Any]:
        """As ``trackbench envelope --verify --json`` prints it."""
        return {
            "scenario": self.claim.scenario,
            "passed": self.passed,
            "seed": self.seed,
            "cells": len(self.claim.cells),
            "replayed": list(self.replayed),
            "discrepancies": [item._asdict() for item in self.discrepancies],
            "notes": list(self.notes),
        }


def verify(
    place: Path,
    *,
    seed: int | None = None,
    beside: Path | None = None,
    isolation: Isolation = ISOLATED,
    chosen: Executor | None = None,
    listener: Listener | None = None,
) -> Verification:
    """Check that a claim follows from itself, and replay a tenth of its cells from what it holds.

    Args:
        place: the folder of an envelope, or the claim in it.
        seed: of the draw; None: from the entropy of the operating system.
        beside: where the modules and logs are that the scenario names.
        isolation: how plug-ins are kept apart.
        chosen: where the runs are made.
        listener: is told of the work.

    Raises:
        InputError: there is no claim, it cannot be read, or a file that it names is another.
    """
    made = read_envelope(place, hashed=False) if _has_parts(place) else Envelope(read_claim(place), parts_of([]))
    claim = made.claim
    seed = secrets.randbits(32) if seed is None else seed
    loaded = _scenario(claim, place, beside)
    listener = listener or Listener()
    with executor() as own:
        plan = EnvelopePlan(isolation, "numpy" if claim.engine == "numpy" else "auto")
        again = map_of(loaded, plan, chosen or own, listener)
        expected = envelope_of(again, "").claim
        # Other axes or requirements have other cells.
        same = (claim.envelope, claim.limits) == (expected.envelope, expected.limits)
        numbers = drawn(len(claim.cells), seed) if same else []
        cells = [claim.cells[number] for number in numbers]
        with listener.progress(f"replay of {claim.scenario}", "cells") as advance:
            again.make_cells([cell.at for cell in cells], False, advance)
    replayed = envelope_of(again, "")
    problems = [*contradictions(made, expected, again.task)]
    for place_again, number in enumerate(numbers):
        problems += _differences(made, number, replayed, place_again)
    return Verification(
        claim,
        seed,
        tuple(place_of_cell(claim.axes, cell.at) for cell in cells),
        tuple(dict.fromkeys(problems)),
        (*_versions(claim, replayed.claim), *([] if len(made.parts) else [WITHOUT_PARTS])),
    )


def _has_parts(place: Path) -> bool:
    return ((place if place.is_dir() else place.parent) / PARTS).is_file()


def drawn(cells: int, seed: int) -> list[int]:
    """The numbers of the cells that are replayed: a tenth, at least one."""
    if not cells:
        return []
    return sorted(np.random.default_rng(seed).choice(cells, math.ceil(SHARE * cells), replace=False).tolist())


def _scenario(claim: Claim, place: Path, beside: Path | None) -> Scenario:
    """That of the claim, with the files beside it.

    Raises:
        InputError: it is none, or a file is missing or another.
    """
    file = place if place.is_file() else place / CLAIM
    named = Path(claim.file)
    try:
        path = find_scenario(claim.file) if beside is None else beside / named.name
    except InputError:
        path = file.parent / named.name
    try:
        loaded = scenario_of(claim.text, path, claim.overrides)
        names = {name for limit in claim.limits for name in (limit.tracker, limit.other) if name}
        loaded = select_trackers(loaded, [name for name in loaded.config.trackers if name in names])
    except InputError as error:
        raise InputError(f"the scenario in the claim is not valid: {error}", file=file) from None
    require_same(loaded, claim.files)
    return loaded


def _differences(made: Envelope, number: int, replayed: Envelope, again: int) -> Iterator[Discrepancy]:
    """Between a cell and what its replay gave, by their numbers in each."""
    claim, cell, other = made.claim, made.claim.cells[number], replayed.claim.cells[again]
    where = place_of_cell(claim.axes, cell.at)
    if cell.measurements != other.measurements:
        yield Discrepancy(where, "its measurements have another hash than those of the replay")
    for name, tracker in cell.trackers.items():
        for key in ("state", "cause", "scenes", "runs", "looks"):
            mine, its = getattr(tracker, key), getattr(other.trackers[name], key)
            if mine != its:
                yield Discrepancy(f"{where}, {name}", f"{key} is {mine!r}, and {its!r} of the replay")
        values = zip(claim.limits_of(name), tracker.values, other.trackers[name].values, strict=False)
        for limit, value, its_value in values:
            for what in _value_differences(value, its_value):
                yield Discrepancy(f"{where}, {name} {limit.metric}", what)
    for place, limit in enumerate(claim.limits if len(made.parts) else ()):
        runs, its_runs = made.values(number, place), replayed.values(again, place)
        scale = EQUAL * np.abs(its_runs).max(initial=0.0)
        if runs.shape != its_runs.shape or not np.allclose(runs, its_runs, rtol=EQUAL, atol=scale):
            what = "the values of its runs are not those of the replay"
            yield Discrepancy(f"{where}, {limit.tracker} {limit.metric}", what)


def _value_differences(value: CellValue, again: CellValue) -> Iterator[str]:
    """Between a value with its bounds and that of the replay."""
    if value.state != again.state:
        yield f"state is {value.state}, and {again.state} of the replay"
    numbers = [getattr(item, key) for item in (value, again) for key in ("value", "low", "high")]
    scale = max((abs(number) for number in numbers if number is not None), default=0.0)
    for key in ("value", "low", "high"):
        mine, its = getattr(value, key), getattr(again, key)
        if (mine is None) != (its is None):
            yield f"{key} is {mine}, and {its} of the replay"
        elif mine is not None and abs(mine - its) > EQUAL * scale:
            yield f"{key} is {mine:.10g}, and {its:.10g} of the replay: {abs(mine - its) / scale:.2g} of it apart"


def _versions(claim: Claim, here: Claim) -> Iterator[str]:
    for name, number in claim.versions.items():
        if here.versions.get(name) != number:
            yield f"made with {name} {number}, replayed with {here.versions.get(name, 'none')}"
    if here.engine not in ("", claim.engine):
        yield f"made by the engine {claim.engine}, replayed by {here.engine}"
