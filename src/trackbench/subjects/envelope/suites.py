"""The cheapest sensors with which a tracker meets its requirement: by what the values of the axes cost."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import product
from math import prod
from typing import NamedTuple

from trackbench.subjects.envelope.absent import why_absent
from trackbench.subjects.envelope.axes import MapAxis, Value
from trackbench.subjects.envelope.claim import Claim, ClaimCell

#: Of all trackers together.
EVERY = ""


class SensorSuite(NamedTuple):
    """Values of the axes that have a cost, and the cells that have them."""

    values: tuple[Value, ...]
    """In the order of the priced axes."""
    cost: float
    cells: tuple[ClaimCell, ...]
    absent: tuple[str, ...] = ()
    """Why there is no cell at further values of the other axes, one for each."""

    def state(self, trackers: Sequence[str]) -> str:
        """``holds`` where every cell does, ``fails`` where one does, else ``undecided``; for all of some trackers."""
        states = {cell.trackers[name].state for cell in self.cells for name in trackers}
        return "fails" if "fails" in states else "undecided" if "undecided" in states else "holds"

    def shown(self, axes: Sequence[MapAxis]) -> str:
        """As it is read, such as "azimuth 0.5 deg, rate 20 Hz"."""
        return ", ".join(f"{axis.name} {axis.shown(value)}" for axis, value in zip(axes, self.values, strict=True))


class CheapestSuite(NamedTuple):
    """The suites of least cost inside the envelope of a tracker, or of all."""

    tracker: str
    """Empty of all trackers together."""
    suites: tuple[SensorSuite, ...]
    """Those of the least cost, which may be several; none where no suite is shown to hold."""
    cheaper: SensorSuite | None
    """The dearest of the suites that cost less, none of which is shown to hold."""
    cheaper_state: str
    undecided: int
    """Of all suites those that neither hold nor fail."""


def priced_axes(claim: Claim) -> list[MapAxis]:
    """The axes with a cost."""
    return [axis for axis in claim.axes if axis.config.cost]


def cheapest_suites(claim: Claim) -> list[CheapestSuite]:
    """Of each tracker, and of several together, the cheapest suite that holds whatever the other axes are.

    Of a grid those suites count that were tried at all levels of the other axes, or at as many points.
    """
    if not priced_axes(claim):
        return []
    groups = {tracker: [tracker] for tracker in claim.trackers}
    if len(groups) > 1:
        groups[EVERY] = claim.trackers
    suites = _suites(claim)
    return [_cheapest(name, suites, trackers) for name, trackers in groups.items()]


def suite_sentences(claim: Claim) -> Iterator[str]:
    """What is said of each cheapest suite."""
    axes = priced_axes(claim)
    for cheapest in cheapest_suites(claim):
        who = cheapest.tracker or "all trackers"
        if not cheapest.suites:
            shown = f"no suite is shown to hold, {cheapest.undecided} undecided" if cheapest.undecided else ""
            yield f"{who}: {shown or 'holds with no suite, at any cost'}"
            continue
        first, *tied = cheapest.suites
        cells = "in its cell" if len(first.cells) == 1 else f"in all its {len(first.cells)} cells"
        cells += "".join(f", {first.absent.count(why)} {why}" for why in dict.fromkeys(first.absent))
        text = f"{who}: the cheapest suite costs {first.cost:g}, {first.shown(axes)}: holds {cells}"
        text += "".join(f"; as cheap: {suite.shown(axes)}" for suite in tied)
        if cheapest.cheaper is None:
            yield f"{text}; none costs less"
        else:
            cheaper = cheapest.cheaper
            yield f"{text}; the next cheaper one, {cheaper.shown(axes)} for {cheaper.cost:g}: {cheapest.cheaper_state}"


def _suites(claim: Claim) -> list[SensorSuite]:
    """By cost."""
    axes = claim.axes
    priced = [number for number, axis in enumerate(axes) if axis.config.cost]
    cells: dict[tuple[Value, ...], list[ClaimCell]] = {}
    for cell in claim.cells:
        cells.setdefault(tuple(cell.at[number] for number in priced), []).append(cell)
    is_grid = claim.config.design == "grid"
    least = prod(len(axis.values) for axis in axes if not axis.config.cost) if is_grid else 1
    absent = {values: tuple(_absent(claim, priced, values)) if is_grid else () for values in cells}
    suites = [
        SensorSuite(
            values,
            sum(axes[number].cost(value) for number, value in zip(priced, values, strict=True)),
            tuple(own),
            absent[values],
        )
        for values, own in cells.items()
        if len(own) + len(absent[values]) >= least
    ]
    return sorted(suites, key=lambda suite: suite.cost)


def _absent(claim: Claim, priced: Sequence[int], values: Sequence[Value]) -> Iterator[str]:
    """Why there is no cell with some values of the priced axes, at each level of the others without one."""
    own = dict(zip(priced, values, strict=True))
    for point in product(*([own[i]] if i in own else axis.values for i, axis in enumerate(claim.axes))):
        if why := why_absent(claim.absent, claim.axes, point):
            yield why


def _cheapest(name: str, suites: Sequence[SensorSuite], trackers: Sequence[str]) -> CheapestSuite:
    states: Mapping[tuple[Value, ...], str] = {suite.values: suite.state(trackers) for suite in suites}
    holding = [suite for suite in suites if states[suite.values] == "holds"]
    least = holding[0].cost if holding else float("-inf")
    cheaper = [suite for suite in suites if suite.cost < least]
    return CheapestSuite(
        name,
        tuple(suite for suite in holding if suite.cost == least),
        cheaper[-1] if cheaper else None,
        states[cheaper[-1].values] if cheaper else "",
        [*states.values()].count("undecided"),
    )
