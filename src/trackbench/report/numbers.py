"""How numbers are written: as many decimals as a column needs, and the same for the whole column."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

from trackbench.results.metric_value import MetricValue

NOT_AVAILABLE = "n/a"
#: By how much the longer half of an interval may be longer than the other and be written as ±.
UNSYMMETRIC = 0.25
#: What is beside a value in a table.
REACH = f"half of its 95 % interval, or with its ends where one half is more than {100 * UNSYMMETRIC:g} % longer"


def decimals(values: Iterable[float | None], significant: int = 3) -> int:
    """Decimals that show the smallest value of a column to so many significant digits (0 to 4)."""
    sizes = [abs(value) for value in values if value is not None and value != 0]
    if not sizes:
        return significant - 1
    return min(4, max(0, significant - 1 - math.floor(math.log10(min(sizes)))))


def half_width(bounds: Sequence[float] | None) -> float | None:
    """Half of an interval, or None where there is none."""
    return (bounds[1] - bounds[0]) / 2 if bounds else None


def meaningful(value: float | None, bounds: Sequence[float] | None) -> int:
    """Decimals of a value that half of its interval leaves a meaning; three digits where it has no width."""
    half = half_width(bounds)
    return decimals([half], 1) if half else decimals([value])


def rounded(value: float | None, places: int) -> str:
    """``value`` with so many decimals, with a true minus sign; "n/a" for None."""
    if value is None:
        return NOT_AVAILABLE
    text = f"{value:.{places}f}"
    return text.replace("-", "\N{MINUS SIGN}") if float(text) != 0 else text.lstrip("-")


def short(value: float | None, places: int) -> str:
    """As :func:`rounded`, but "6.4e+06" from 10,000 on."""
    return (
        rounded(value, places) if value is None or abs(value) < 1e4 else f"{value:.1e}".replace("-", "\N{MINUS SIGN}")
    )


def interval_text(bounds: Sequence[float] | None, places: int) -> str:
    """ "0.41 to 0.43", or nothing where there is no interval."""
    return f"{short(bounds[0], places)} to {short(bounds[1], places)}" if bounds else ""


def reach_text(value: float | None, bounds: Sequence[float] | None, places: int) -> str:
    """ "±0.006", or "0.10 to 0.13" where one half of the interval is longer than the other by more than
    ``UNSYMMETRIC``; nothing where there is no interval."""
    if value is None or not bounds:
        return ""
    halves = value - bounds[0], bounds[1] - value
    if max(halves) > (1.0 + UNSYMMETRIC) * min(halves):
        return interval_text(bounds, places)
    return f"±{short(half_width(bounds), places)}"


def intervals_in_short(metrics: Sequence[MetricValue], places: int, scale: float = 1.0) -> list[str]:
    """Half of each interval, or its ends: to the first digit of the longest of their shorter halves, or of the end."""
    scaled = [
        (None if m.value is None else scale * m.value, m.ci95 and (scale * m.ci95[0], scale * m.ci95[1]))
        for m in metrics
    ]
    shorter = [min(value - ends[0], ends[1] - value) for value, ends in scaled if value is not None and ends]
    least = decimals([max(shorter, default=None)], 1)
    written = []
    for value, ends in scaled:
        half = reach_text(value, ends, places)
        if ends and half[:1] not in ("±", ""):
            half = reach_text(value, ends, min(places, max(least, decimals([ends[0]], 1)))).replace(" to ", "-")
        written.append(half)
    return written


def signed(value: float, places: int) -> str:
    """With a plus sign where it is positive."""
    return ("+" if value > 0 else "") + rounded(value, places)


def percent(share: float | None, places: int = 0) -> str:
    """A share as "95 %"."""
    return NOT_AVAILABLE if share is None else f"{rounded(100 * share, places)}\N{NO-BREAK SPACE}%"


def percent_number(share: float | None, places: int = 0) -> str:
    """The same without its sign, under a heading that has it."""
    return percent(share, places).removesuffix("\N{NO-BREAK SPACE}%")


def joined_names(names: Sequence[str]) -> str:
    """ "a", "a and b", "a, b and c"."""
    return " and ".join([", ".join(names[:-1]), names[-1]]) if len(names) > 1 else "".join(names)


def margin_words(margins: Iterable[float]) -> str:
    """ "5 mm", or "5 to 12 mm" of differences with several: the margins that held, in m."""
    ends = [float(f"{1000 * margin:.2g}") for margin in margins]
    return f"{' to '.join(dict.fromkeys(f'{end:g}' for end in (min(ends), max(ends))))} mm"
