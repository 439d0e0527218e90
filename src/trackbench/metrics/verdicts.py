"""What intervals say of a tracker's covariance: over all estimates, under each condition, and together."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence

from trackbench.metrics.conditions import AGES
from trackbench.results import Breakdown, ConditionScores, ConditionVerdict, MetricValue

CONSISTENCY = ("consistent", "optimistic", "pessimistic", "undecided")
WHITENESS = ("white", "coloured", "undecided")

#: How far the mean of a NEES or NIS may be from its degrees of freedom without consequence, as a share of them. A
#: covariance that is 10 % too large or too small is one whose standard deviations are 5 % off.
TOLERANCE = 0.1
#: The same under one condition, below and above. A condition is chosen by what the truth did, which the error has to do
#: with: even of a sound filter, the mean NEES in a manoeuvre is up to 30 % above its degrees of freedom, and on
#: straights up to 15 % below, as the calibration measures.
BELOW, ABOVE = 0.25, 0.5
#: The parts of the NEES, which are judged too.
HALVES = ("position alone", "velocity alone")
#: A NEES or NIS is judged where this share of the estimates or innovations that there should be is given: the missing
#: ones may be the large ones. Without the worst 1 % a NEES of 4.00 becomes 3.88; without the worst 5 %, 3.59.
LEAST_COVERAGE = 0.99
#: A condition is judged where it has this share of the estimates, from so many runs or scenes.
SMALLEST_SHARE = 0.02
FEWEST_RUNS = 5
#: How far an autocorrelation may be from zero. Predicting each innovation from the one before then saves 0.05^2, a
#: quarter of a percent, of its variance.
WHITENESS_TOLERANCE = 0.05


def verdict(ci95: tuple[float, float] | None, dof: int) -> str:
    """What the interval of a mean NEES or NIS says of the covariance.

    ``consistent``: shown to be within ``TOLERANCE`` of ``dof``. ``optimistic``: shown to be above, errors are larger
    than stated. ``pessimistic``: the same below. ``undecided``: none of these is shown. With more runs an interval
    becomes shorter about the same mean, so that ``undecided`` may become any of the others, which stay. This is the
    logic of an equivalence test (Schuirmann 1987, "A comparison of the two one-sided tests procedure and the power
    approach").

    Args:
        ci95: None where nothing is known of it.
        dof: what the mean of a consistent tracker is.
    """
    return _consistency(ci95, dof * (1 - TOLERANCE), dof * (1 + TOLERANCE))


def condition_verdict(ci95: tuple[float, float] | None, dof: int) -> str:
    """The same of the mean under one condition, with ``BELOW`` and ``ABOVE``."""
    return _consistency(ci95, dof * (1 - BELOW), dof * (1 + ABOVE))


def whiteness_verdict(ci95: tuple[float, float] | None) -> str:
    """What the interval of an autocorrelation says: ``white``, ``coloured`` or ``undecided``, as in ``verdict``."""
    side = _side(ci95, -WHITENESS_TOLERANCE, WHITENESS_TOLERANCE)
    return "undecided" if side is None else "coloured" if side else "white"


def judged(breakdown: Breakdown) -> list[ConditionVerdict]:
    """The conditions with enough estimates: each manoeuvre, each range band and the first second; and the two halves of
    the NEES."""
    conditions = {**breakdown.manoeuvre, **breakdown.range, **breakdown.age}
    conditions.pop(AGES[1], None)
    return [*_judged(conditions.items(), breakdown.all.count), *_halves(breakdown.all)]


def together(mean: float, whole: str, conditions: Sequence[ConditionVerdict]) -> str:
    """The verdict on a covariance from that over all estimates and those under each condition.

    ``consistent``: so over all estimates and under each condition. ``optimistic`` and ``pessimistic``: off over all
    estimates or under some conditions, to that side alone. ``mixed``: off to both sides; or off under some condition
    and consistent over all estimates; or consistent under some condition, with a mean that differs from that over all
    estimates by more than is allowed for under a condition. The first second does not count for the last: it rests on
    the covariance that a track starts from, and may be right where the process noise is wrong everywhere; nor do
    position and velocity alone, which no fault need touch alike.

    Args:
        mean: over all estimates.
        whole: the verdict on it.
        conditions: those that are judged.
    """
    verdicts = {whole, *(condition.verdict for condition in conditions)}
    off = verdicts & {"optimistic", "pessimistic"}
    if not off:
        return "undecided" if "undecided" in verdicts else "consistent"
    apart = any(
        _side(condition.ci95, mean * (1 - BELOW), mean * (1 + ABOVE)) in (-1, 1)
        for condition in conditions
        if condition.verdict == "consistent" and condition.name not in (AGES[0], *HALVES)
    )
    return "mixed" if len(off) > 1 or whole == "consistent" or apart else off.pop()


def _halves(scores: ConditionScores) -> Iterator[ConditionVerdict]:
    """The NEES of the position and of the velocity by themselves: one too large may hide the other, too small."""
    for name, nees in zip(HALVES, (scores.nees_position, scores.nees_velocity), strict=True):
        if scores.runs >= FEWEST_RUNS and nees and nees.value is not None and nees.ci95 and nees.dof:
            complete = scores.given is None or scores.given >= LEAST_COVERAGE * scores.count
            word = condition_verdict(nees.ci95, nees.dof) if complete else "undecided"
            # Twice as much, to stand beside the others, of which 4 is right.
            low, high = nees.ci95
            yield ConditionVerdict(name=name, mean=2 * nees.value, ci95=(2 * low, 2 * high), verdict=word)


def _judged(conditions: Iterable[tuple[str, ConditionScores]], count: int) -> Iterator[ConditionVerdict]:
    for name, scores in conditions:
        nees = scores.nees
        if nees is None or nees.value is None or nees.dof is None or nees.ci95 is None:
            continue
        if scores.count >= SMALLEST_SHARE * count and scores.runs >= FEWEST_RUNS:
            complete = scores.given is None or scores.given >= LEAST_COVERAGE * scores.count
            word = condition_verdict(nees.ci95, nees.dof) if complete else "undecided"
            yield ConditionVerdict(name=name, mean=nees.value, ci95=nees.ci95, verdict=word)


def _consistency(ci95: tuple[float, float] | None, low: float, high: float) -> str:
    side = _side(ci95, low, high)
    return {None: "undecided", 0: "consistent", 1: "optimistic", -1: "pessimistic"}[side]


def _side(ci95: tuple[float, float] | None, low: float, high: float) -> int | None:
    """0 where an interval is between two limits, 1 and -1 where it is above and below both, else None."""
    if ci95 is None:
        return None
    if low <= ci95[0] and ci95[1] <= high:
        return 0
    return 1 if ci95[0] > high else -1 if ci95[1] < low else None


#: What a reader is told of a verdict on a covariance.
MEANING = {
    "consistent": "the errors are as large as its covariance states, under each condition",
    "optimistic": "the errors are larger than its covariance states",
    "pessimistic": "the errors are smaller than its covariance states",
    "mixed": "the errors are larger or smaller than its covariance states, depending on the condition",
    "undecided": "too few runs or scenes to say whether the errors are as large as its covariance states",
}


def conditions_off(nees: MetricValue, most: int = 4) -> str:
    """Where a mean is off, farthest first, and by how much: "turning 39.7, straight 2.9".

    Of a mixed one that is off nowhere, the conditions that are furthest apart.
    """
    off = [condition for condition in nees.conditions or () if condition.verdict in ("optimistic", "pessimistic")]
    dof = nees.dof or 1
    if nees.verdict == "mixed" and not off:
        means = sorted(nees.conditions or (), key=lambda condition: condition.mean)
        off = [means[0], means[-1]]
    off.sort(key=lambda condition: -abs(math.log(max(condition.mean, 1e-9) / dof)))
    named = [f"{condition.name} {mean_text(condition.mean)}" for condition in off[:most]]
    more = [f"{len(off) - most} more"] if len(off) > most else []
    return ", ".join(named + more)


def mean_text(mean: float) -> str:
    """ "4.2", "2e+05"."""
    return f"{mean:.1f}" if mean < 1000 else f"{mean:.0e}"
