"""Claims of maps that were never run: the value of each cell is a function of its point."""

from collections.abc import Callable, Mapping, Sequence
from itertools import product
from typing import Any

import numpy as np

from trackbench.subjects.envelope.axes import MapAxis, Point, axes_of
from trackbench.subjects.envelope.claim import (
    CellValue,
    Claim,
    ClaimCell,
    ClaimedLimit,
    Envelope,
    TrackerState,
    parts_of,
)
from trackbench.subjects.envelope.config import EnvelopeConfig

#: The value of a tracker's requirement at a point, in shares of the axes; None: the tracker failed.
Value = Callable[..., float | None]


def claim_of(
    axes: Mapping[str, Mapping[str, Any]],
    values: Mapping[str, Value],
    *,
    limit: float = 1.0,
    reach: float = 0.05,
    base: Sequence[float | str | None] | None = None,
    more: Sequence[Sequence[float | str]] = (),
    **block: Any,
) -> Claim:
    """A claim.

    Args:
        axes: of the block.
        values: by tracker, a function of where the point lies on each axis, from 0 to 1.
        limit: below which the value has to be.
        reach: from each value to its bounds, a share of it.
        base: the scenario's own values; the middle of each axis unless given.
        more: further points near the border, in shares; choices as they are.
        block: other keys of the envelope.
    """
    config = EnvelopeConfig.model_validate({"axes": axes, "cells": 10_000, **block})
    ways = axes_of(config)
    points = [*product(*(axis.values for axis in ways))]
    added = [
        tuple(share if isinstance(share, str) else axis.at(share) for axis, share in zip(ways, row, strict=True))
        for row in more
    ]
    cells = [_cell(ways, point, values, limit, reach, point in added) for point in dict.fromkeys([*points, *added])]
    return Claim(
        scenario="made",
        file="made.yaml",
        text="",
        overrides=[],
        claim="these scenes",
        confidence=0.95,
        extents=[(1, 25), (1, 400)],
        seed=1,
        engine="numpy",
        versions={},
        command="trackbench envelope made.yaml",
        envelope=config.model_dump(mode="json", by_alias=True, exclude_unset=True),
        limits=[
            ClaimedLimit(tracker=name, metric="position_rmse", unit="m", direction="below", limit=limit)
            for name in values
        ],
        base=list(base) if base is not None else [axis.values[len(axis.values) // 2] for axis in ways],
        cells=cells,
    )


def envelope_of(claim: Claim, spread: float = 0.0, runs: int = 50) -> Envelope:
    """The claim with values of its runs, whose mean is that of the cell."""
    rows = []
    for number, cell in enumerate(claim.cells):
        for place, limit in enumerate(claim.limits):
            value = cell.trackers[limit.tracker].values[0].value
            if value is not None:
                noise = np.random.default_rng(place).standard_normal(runs)
                rows.append((number, place, value + spread * (noise - noise.mean())))
    return Envelope(claim, parts_of(rows))


def _cell(
    axes: Sequence[MapAxis], point: Point, values: Mapping[str, Value], limit: float, reach: float, added: bool
) -> ClaimCell:
    shares = [axis.share(value) for axis, value in zip(axes, point, strict=True)]
    trackers = {name: _tracker(function(*shares), limit, reach) for name, function in values.items()}
    return ClaimCell(point=list(point), changes=[], added=added, measurements=[], trackers=trackers)


def _tracker(value: float | None, limit: float, reach: float) -> TrackerState:
    if value is None:
        none = CellValue(state="undecided", value=None, low=None, high=None)
        return TrackerState(state="fails", cause="it raised", scenes=1, runs=25, looks=1, values=[none])
    low, high = value - reach * abs(value), value + reach * abs(value)
    state = "holds" if high < limit else "fails" if low > limit else "undecided"
    held = CellValue(state=state, value=value, low=low, high=high)
    return TrackerState(
        state=state, cause="", scenes=1, runs=400 if state == "undecided" else 25, looks=2, values=[held]
    )
