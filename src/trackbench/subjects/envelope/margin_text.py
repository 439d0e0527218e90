"""Margins as they are read."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import groupby

from trackbench.report.numbers import joined
from trackbench.subjects.envelope.axes import MapAxis
from trackbench.subjects.envelope.claim import ClaimedLimit
from trackbench.subjects.envelope.margins import AxisMargin, Crossing

#: A band is written as ± where its halves differ by no more than this share of it.
SYMMETRIC = 0.2


def margin_sentence(margin: AxisMargin, limits: Sequence[ClaimedLimit]) -> str:
    """Such as "ekf_cv holds position_rmse below 0.5 m up to 2.1 ± 0.1 deg of azimuth, at range 0.3 m"."""
    required = " and ".join(limit.text.removeprefix(f"{margin.tracker} ") for limit in limits)
    parts = [f"{margin.tracker} holds {required} {holding(margin)} of {margin.axis.name}", undecided(margin)]
    parts += [f"at {along(margin)}"] if margin.at else []
    parts += [] if margin.through_base else ["the cells nearest to the scenario's own values"]
    return ", ".join(part for part in parts if part)


def holding(margin: AxisMargin) -> str:
    """For which values of the axis the requirement is met, with the band of each border."""
    axis = margin.axis
    if not margin.decided:
        return "at no value surely"
    if not axis.continuous:
        met = [_number(value) for value, state in margin.states.items() if state == "holds"]
        return f"at {joined(met)} {axis.unit}".strip() if met else "at none of its values"
    spans = [*_spans(margin)]
    if spans:
        return " and ".join(spans)
    states = margin.states
    held, total = [*states.values()].count("holds"), len(states)
    share = f"all {total}" if held == total else f"{held or 'none'} of its {total}"
    return f"in {share} cells from {_number(min(states))} to {axis.shown(max(states))}"


def _spans(margin: AxisMargin) -> Iterator[str]:
    """In which it is met, between the borders on both sides of each."""
    axis, crossings = margin.axis, margin.crossings
    for start, stop in zip([None, *crossings], [*crossings, None], strict=True):
        if start is None and stop is not None and stop.holds_below:
            yield f"up to {border(axis, stop)}"
        elif start is not None and not start.holds_below:
            yield f"from {border(axis, start)}" + (" on" if stop is None else f" to {border(axis, stop)}")


def border(axis: MapAxis, crossing: Crossing) -> str:
    """Such as "2.1 ± 0.1 deg", or "2.1 deg (2.0 to 2.4)" where the border is not half way between the cells."""
    low, high, point = crossing.low, crossing.high, crossing.point
    # One digit of the band, two where the first would be a 1.
    step = 10.0 ** math.floor(math.log10((high - low) / 2) - 0.3)
    if abs((high - point) - (point - low)) <= SYMMETRIC * (high - low):
        centre = _rounded(point, step)
        half = step * math.ceil(max(high - float(centre), float(centre) - low) / step - 1e-6)
        return f"{centre} ± {_rounded(half, step)} {axis.unit}".strip()
    return f"{_rounded(point, step)} {axis.unit}".strip() + f" ({_number(low)} to {_number(high)})"


def undecided(margin: AxisMargin) -> str:
    """Where no cell outside the bands is decided; empty where there is none."""
    spans = []
    outside = {
        value: state == "undecided" and not any(item.low < value < item.high for item in margin.crossings)
        for value, state in margin.states.items()
    }
    for is_open, group in groupby(outside, key=lambda value: outside[value]):
        values = list(group)
        if is_open:
            start = f"{_number(values[0])} to " if len(values) > 1 else ""
            spans.append(f"{start}{margin.axis.shown(values[-1])}")
    return f"undecided at {', '.join(spans)}" if spans else ""


def along(margin: AxisMargin) -> str:
    """The values of the other axes; empty where there is none."""
    return ", ".join(f"{axis.name} {axis.shown(value)}" for axis, value in margin.at)


def _number(value: float) -> str:
    return f"{value:.4g}"


def _rounded(value: float, step: float) -> str:
    return f"{value:.{max(0, -math.floor(math.log10(step) + 1e-9))}f}"
