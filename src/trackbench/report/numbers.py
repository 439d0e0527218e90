"""Values as text, with equally many decimals in a whole column."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

from trackbench.results.metric_value import MetricValue

NOT_AVAILABLE = "n/a"
#: An interval is written as ± if its longer half exceeds the shorter by at most this share.
UNSYMMETRIC = 0.25


def decimals(values: Iterable[float | None], significant: int = 3) -> int:
    """Return how many decimals, 0 to 4, show a column's smallest value to ``significant`` digits."""
    sizes = [abs(value) for value in values if value is not None and value != 0]
    if not sizes:
        return significant - 1
    return min(4, max(0, significant - 1 - math.floor(math.log10(min(sizes)))))


def half_width(bounds: Sequence[float] | None) -> float | None:
    """Return half the width of an interval; None if there is no interval."""
    return (bounds[1] - bounds[0]) / 2 if bounds else None


def meaningful_decimals(value: float | None, bounds: Sequence[float] | None) -> int:
    """Return how many decimals show a value to the first digit of its uncertainty, or to three digits without one."""
    half = half_width(bounds)
    return decimals([half], 1) if half else decimals([value])


def rounded(value: float | None, places: int) -> str:
    """Return a value with ``places`` decimals and a true minus sign; "n/a" for None."""
    if value is None:
        return NOT_AVAILABLE
    text = f"{value:.{places}f}"
    return text.replace("-", "\N{MINUS SIGN}") if float(text) != 0 else text.lstrip("-")


def short(value: float | None, places: int) -> str:
    """Return a value with ``places`` decimals, or as "6.4e+06" from 10,000 on."""
    return (
        rounded(value, places) if value is None or abs(value) < 1e4 else f"{value:.1e}".replace("-", "\N{MINUS SIGN}")
    )


def interval_text(bounds: Sequence[float] | None, places: int) -> str:
    """Return an interval as "0.41 to 0.43"; empty for None."""
    return f"{short(bounds[0], places)} to {short(bounds[1], places)}" if bounds else ""


def reach_text(value: float | None, bounds: Sequence[float] | None, places: int) -> str:
    """Return an interval as "±0.006", or as "0.10 to 0.13" where it is not symmetric; empty for None."""
    if value is None or not bounds:
        return ""
    halves = value - bounds[0], bounds[1] - value
    if max(halves) > (1.0 + UNSYMMETRIC) * min(halves):
        return interval_text(bounds, places)
    return f"±{short(half_width(bounds), places)}"


def intervals_in_short(metrics: Sequence[MetricValue], places: int, scale: float = 1.0) -> list[str]:
    """Return the interval of each metric as "±0.006" or, if not symmetric, as "0.1-0.4" with few decimals."""
    scaled = [
        (None if m.value is None else scale * m.value, m.ci95 and (scale * m.ci95[0], scale * m.ci95[1]))
        for m in metrics
    ]
    shorter = [min(value - ends[0], ends[1] - value) for value, ends in scaled if value is not None and ends]
    fewest = decimals([max(shorter, default=None)], 1)
    texts = []
    for value, ends in scaled:
        text = reach_text(value, ends, places)
        if ends and text[:1] not in ("±", ""):
            text = reach_text(value, ends, min(places, max(fewest, decimals([ends[0]], 1)))).replace(" to ", "-")
        texts.append(text)
    return texts


def signed(value: float, places: int) -> str:
    """Return a value with ``places`` decimals and a sign, "+" or a true minus."""
    return ("+" if value > 0 else "") + rounded(value, places)


def percent(share: float | None, places: int = 0) -> str:
    """Return a share, 0 to 1, as "95 %"; "n/a" for None."""
    return NOT_AVAILABLE if share is None else f"{rounded(100 * share, places)}\N{NO-BREAK SPACE}%"


def percent_number(share: float | None, places: int = 0) -> str:
    """Return a share, 0 to 1, as "95", for a column whose heading has the per cent sign."""
    return percent(share, places).removesuffix("\N{NO-BREAK SPACE}%")


def joined_names(names: Sequence[str]) -> str:
    """Return names as "a", "a and b" or "a, b and c"."""
    return " and ".join([", ".join(names[:-1]), names[-1]]) if len(names) > 1 else "".join(names)


def margin_words(margins: Iterable[float]) -> str:
    """Return margins, m, as "5 mm" or, where they differ, "5 to 12 mm"."""
    ends = [float(f"{1000 * margin:.2g}") for margin in margins]
    return f"{' to '.join(dict.fromkeys(f'{end:g}' for end in (min(ends), max(ends))))} mm"
