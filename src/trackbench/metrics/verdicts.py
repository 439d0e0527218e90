"""Verdicts on a tracker's covariance from intervals: over all estimates, under each condition, and combined."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence

from scipy.special import chdtrc

from trackbench.metrics.conditions import AGES
from trackbench.metrics.consistency import BEYOND, DIRECTIONS, beyond_path, beyond_points
from trackbench.results import ConditionScores, ConditionVerdict, MetricValue, PartVerdict

CONSISTENCY = ("consistent", "optimistic", "pessimistic", "undecided")
#: Verdicts on a NEES, which is also judged by its tails and under each condition.
TRUST = (*CONSISTENCY, "mixed", "heavy-tailed")
WHITENESS = ("white", "coloured", "undecided")

#: Tolerated deviation of the mean of a NEES or NIS from its degrees of freedom, as a share of them. A covariance that
#: is 10 % too large or too small has standard deviations that are 5 % off.
TOLERANCE = 0.1
#: Probability, on each side, that few runs or scenes call a consistent tracker wrong.
DOUBT = 0.001
#: Tolerated excess of the mean NEES for the share beyond the farthest point that is judged: where ten are expected
#: beyond it, a matched filter is shown to be within this in 97 % of all cases, and within ``TOLERANCE`` in 33 to 79 %.
FAR_TOLERANCE = 0.2
#: Tolerated deviation of the mean under one condition, below and above. A condition is chosen by the motion, which the
#: error depends on: even a sound filter has a mean NEES up to 30 % above its degrees of freedom in a manoeuvre, and up
#: to 15 % below on straights, as the calibration measures.
BELOW, ABOVE = 0.25, 0.5
#: Names of the two halves of the NEES, which are judged too.
HALVES = ("position alone", "velocity alone")
#: Name of the verdict's part on the share of the NEES beyond a point of chi-square.
_PART = "beyond the {} point"
#: Point of chi-square beyond which a share can also be too small.
NEAR = "95 %"
#: Share of the due estimates or innovations that must be given for a verdict on the NEES or NIS: the missing ones may
#: be the large ones. Without the worst 1 % a NEES of 4.00 becomes 3.88; without the worst 5 %, 3.59.
LEAST_COVERAGE = 0.99
#: Least share of the estimates, and least number of runs or scenes, for a verdict under a condition.
SMALLEST_SHARE = 0.02
FEWEST_RUNS = 5
#: Tolerated deviation of an autocorrelation from zero. Predicting each innovation from the previous one then saves
#: 0.05^2, a quarter of a percent, of its variance.
WHITENESS_TOLERANCE = 0.05


def mean_verdict(ci95: tuple[float, float] | None, dof: int) -> str:
    """Return the verdict on a covariance from the 95 % interval of a mean NEES or NIS.

    ``consistent``: the whole interval is within ``TOLERANCE`` of ``dof``. ``optimistic``: the whole interval is above,
    since errors are larger than stated. ``pessimistic``: the whole interval is below. ``undecided``: the interval shows
    none of these. More runs shorten the interval about the same mean, so ``undecided`` can become any other verdict,
    and the other verdicts stay. This is the logic of an equivalence test (Schuirmann 1987, "A comparison of the two
    one-sided tests procedure and the power approach").

    Args:
        ci95: 95 % interval of the mean; None where it is unknown, which gives ``undecided``.
        dof: degrees of freedom, the mean of a consistent tracker.
    """
    return _consistency(ci95, dof * (1 - TOLERANCE), dof * (1 + TOLERANCE))


def doubtless_verdict(mean: float, parts: float, dof: int) -> str:
    """Return ``optimistic`` or ``pessimistic`` where a mean over few parts leaves no doubt, else ``undecided``.

    However correlated the errors within a part are, its mean NEES varies no more than a single chi-square variable if
    the filter is consistent. So the sum is compared with chi-square with ``dof`` degrees of freedom for each part.

    Args:
        mean: mean NEES or NIS.
        parts: effective number of independent runs or scenes.
        dof: degrees of freedom, the mean of a consistent tracker.
    """
    total, freedom = mean * parts, dof * parts
    if chdtrc(freedom, total / (1 + TOLERANCE)) < DOUBT:
        return "optimistic"
    return "pessimistic" if 1 - chdtrc(freedom, total / (1 - TOLERANCE)) < DOUBT else "undecided"


def condition_verdict(ci95: tuple[float, float] | None, dof: int) -> str:
    """Return the verdict from a mean NEES under one condition; 25 % below ``dof`` and 50 % above are tolerated."""
    return _consistency(ci95, dof * (1 - BELOW), dof * (1 + ABOVE))


def tail_limits(point: str, under_condition: bool = False, factor: float = 1.0) -> tuple[float, float]:
    """Return the least and largest share of NEES beyond a point, for a covariance that is right within the tolerances.

    The lower limit is 0 beyond the 99 % and 99.9 % points.

    Args:
        point: point of chi-square: ``95 %``, ``99 %`` or ``99.9 %``.
        under_condition: whether the share is of the estimates under one condition; the tolerances are then wider.
        factor: factor by which the covariance is known to be too small.
    """
    place = dict(zip(BEYOND, beyond_points(4), strict=True))[point] / factor
    below, above = (BELOW, ABOVE) if under_condition else (TOLERANCE, TOLERANCE if point == NEAR else FAR_TOLERANCE)
    low = chdtrc(4, place / (1 - below)) if point == NEAR else 0.0
    return low, chdtrc(4, place / (1 + above))


def tail_verdict(ci95: tuple[float, float], point: str, under_condition: bool = False) -> str:
    """Return the verdict on the share of NEES beyond a point: ``heavy-tailed`` if above the tolerated share."""
    verdict = _consistency(ci95, *tail_limits(point, under_condition))
    return "heavy-tailed" if verdict == "optimistic" else verdict


def whiteness_verdict(ci95: tuple[float, float] | None) -> str:
    """Return ``white``, ``coloured`` or ``undecided`` from the interval of an autocorrelation."""
    side = _side(ci95, -WHITENESS_TOLERANCE, WHITENESS_TOLERANCE)
    return "undecided" if side is None else "coloured" if side else "white"


def judged_parts(scores: ConditionScores, under_condition: bool = False) -> list[PartVerdict]:
    """Return the verdicts on the tails of the NEES, and on the NEES along and across the motion.

    The tails are the shares beyond the 95 % point and beyond the farthest point with a stated share. The list is empty
    where estimates are too few to state the share beyond the 95 % point. A missing estimate could lie within a point or
    beyond; the interval covers both cases.

    Args:
        scores: scores under one condition, or of all estimates.
        under_condition: whether the scores are under one condition.
    """
    complete, parts = _is_complete(scores), []
    beyond = {point: scores.metrics[path] for point in BEYOND if (path := beyond_path(point)) in scores.metrics}
    share_given = scores.given / scores.count if scores.count else 1.0
    for point, share in beyond.items():
        if point in (NEAR, [*beyond][-1]) and share.value is not None and share.ci95 is not None:
            ci95 = (share_given * share.ci95[0], share_given * share.ci95[1] + 1 - share_given)
            verdict = tail_verdict(ci95, point, under_condition) if complete else "undecided"
            name, expected = _PART.format(point), BEYOND[point]
            parts.append(PartVerdict(name=name, value=share.value, expected=expected, ci95=ci95, verdict=verdict))
    for name, field in DIRECTIONS.items():
        nees = scores.metrics.get(field)
        # A condition is a kind of motion, which the velocity of even a sound filter lags behind.
        if parts and not (under_condition and "velocity" in name) and nees and nees.value is not None and nees.ci95:
            verdict = condition_verdict(nees.ci95, 1) if complete else "undecided"
            parts.append(PartVerdict(name=name, value=nees.value, expected=1.0, ci95=nees.ci95, verdict=verdict))
    return parts


def condition_verdicts(conditions: Mapping[str, ConditionScores]) -> list[ConditionVerdict]:
    """Return the verdicts under each condition with enough estimates, and on position and velocity alone."""
    judged = _judged(_conditions_by_name(conditions).items(), conditions[""].count)
    return [*judged, *_halves(conditions[""])]


def _conditions_by_name(conditions: Mapping[str, ConditionScores]) -> dict[str, ConditionScores]:
    """Return the conditions that can get a verdict, by short name: each manoeuvre, range band and the first second."""
    named = [(*name.partition(": ")[::2], scores) for name, scores in conditions.items()]
    return {name: scores for group, name, scores in named if group not in ("", "jump") and name != AGES[1]}


def overall_verdict(
    mean: float, whole: str, conditions: Sequence[ConditionVerdict], parts: Sequence[PartVerdict] = ()
) -> str:
    """Combine the verdicts over all estimates and under each condition to the verdict on a covariance.

    ``consistent``: over all estimates and under each condition. ``optimistic`` and ``pessimistic``: the covariance is
    off over all estimates or under some conditions, to that side alone. ``mixed``: off to both sides; or off under some
    condition and consistent over all estimates; or consistent under some condition, with a mean that differs from the
    mean over all estimates by more than a condition tolerates. The first second is excepted: its covariance is the
    initial one, which can be right where the process noise is wrong everywhere. The NEES of position alone and of
    velocity alone are excepted as well, since a fault need not touch both. ``heavy-tailed``: none of these, and too
    many NEES are far out, over all estimates or under some condition. Undecided tails and directions under a condition,
    which take more estimates than the mean NEES, do not count.

    Args:
        mean: mean NEES over all estimates.
        whole: verdict on this mean.
        conditions: verdicts under each condition.
        parts: verdicts on the tails and directions over all estimates.
    """
    under = {part.verdict for condition in conditions for part in condition.parts} - {"undecided"}
    # A mean that is off is said first, whichever way its directions are: along a straight line all may lag.
    of_mean = {whole} if whole in ("optimistic", "pessimistic") else {whole, *(part.verdict for part in parts)}
    verdicts = {*of_mean, *(condition.verdict for condition in conditions), *under}
    off = verdicts & {"optimistic", "pessimistic"}
    if not off and "heavy-tailed" in verdicts:
        return "heavy-tailed"
    if not off:
        return "undecided" if "undecided" in verdicts else "consistent"
    apart = any(
        _side(condition.ci95, mean * (1 - BELOW), mean * (1 + ABOVE)) in (-1, 1)
        for condition in conditions
        if condition.verdict == "consistent" and condition.name not in (AGES[0], *HALVES)
    )
    return "mixed" if len(off) > 1 or whole == "consistent" or apart else off.pop()


def heavy_beside(
    verdict: str, mean: float, conditions: Sequence[ConditionVerdict], parts: Sequence[PartVerdict]
) -> str | None:
    """Return ``heavy-tailed`` where large errors are too frequent but the verdict by means says otherwise; else None.

    Large errors are too frequent where the share beyond a point, over all estimates or under a condition, exceeds the
    share for a covariance that is too small by the factor that the mean NEES of the same estimates shows.

    Args:
        verdict: overall verdict.
        mean: mean NEES over all estimates.
        conditions: verdicts under each condition.
        parts: verdicts on the tails and directions over all estimates.
    """
    if verdict not in ("optimistic", "pessimistic", "mixed"):
        return None
    groups = [(mean, parts, False), *((item.mean, item.parts, True) for item in conditions)]
    heavy = any(
        part.ci95[0] > tail_limits(point, under_condition, max(mean_nees / 4, 1.0))[1]
        for mean_nees, items, under_condition in groups
        for part in items
        for point in BEYOND
        if part.name == _PART.format(point) and part.verdict == "heavy-tailed"
    )
    return "heavy-tailed" if heavy else None


def _halves(scores: ConditionScores) -> Iterator[ConditionVerdict]:
    """Yield the verdicts on the NEES of position alone and of velocity alone, whose faults can cancel in the sum."""
    for name, nees in zip(HALVES, map(scores.metrics.get, ("nees_position", "nees_velocity")), strict=True):
        if scores.runs >= FEWEST_RUNS and nees and nees.value is not None and nees.ci95 and nees.dof:
            verdict = condition_verdict(nees.ci95, nees.dof) if _is_complete(scores) else "undecided"
            # Doubled, so that 4 is right as for the whole NEES.
            low, high = nees.ci95
            yield ConditionVerdict(name=name, mean=2 * nees.value, ci95=(2 * low, 2 * high), verdict=verdict)


def _judged(conditions: Iterable[tuple[str, ConditionScores]], count: int) -> Iterator[ConditionVerdict]:
    for name, scores in conditions:
        nees = scores.metrics.get("nees")
        if nees is None or nees.value is None or nees.dof is None or nees.ci95 is None:
            continue
        if scores.count >= SMALLEST_SHARE * count and scores.runs >= FEWEST_RUNS:
            verdict = condition_verdict(nees.ci95, nees.dof) if _is_complete(scores) else "undecided"
            parts = tuple(judged_parts(scores, under_condition=True))
            yield ConditionVerdict(name=name, mean=nees.value, ci95=nees.ci95, verdict=verdict, parts=parts)


def _is_complete(scores: ConditionScores) -> bool:
    return scores.given >= LEAST_COVERAGE * scores.count


def _consistency(ci95: tuple[float, float] | None, low: float, high: float) -> str:
    side = _side(ci95, low, high)
    return {None: "undecided", 0: "consistent", 1: "optimistic", -1: "pessimistic"}[side]


def _side(ci95: tuple[float, float] | None, low: float, high: float) -> int | None:
    """Return 0 for an interval between two limits, 1 for an interval above both, -1 for below both, else None."""
    if ci95 is None:
        return None
    if low <= ci95[0] and ci95[1] <= high:
        return 0
    return 1 if ci95[0] > high else -1 if ci95[1] < low else None


#: Explanation of each verdict on a covariance.
MEANING = {
    "consistent": f"the errors are as large as its covariance states, within the tolerance of {100 * TOLERANCE:g} % of "
    f"the mean NEES ({100 * BELOW:g} % below to {100 * ABOVE:g} % above under a condition), and in the tails",
    "optimistic": "the errors are larger than its covariance states",
    "pessimistic": "the errors are smaller than its covariance states",
    "mixed": "the errors are larger or smaller than its covariance states, depending on the condition",
    "heavy-tailed": "large errors are more frequent than its covariance states; the mean NEES does not show it",
    "undecided": "too few runs or scenes to say whether the errors are as large as its covariance states",
}
#: Text added where large errors are too frequent as well.
_MORE_LARGE = "; large errors are more frequent than its mean NEES explains"


def meaning(nees: MetricValue, conditions: Mapping[str, ConditionScores]) -> str:
    """Explain the verdict on a NEES, with the conditions that alone show a fault, or the share of given estimates."""
    verdict = nees.verdict or "undecided"
    if verdict == "undecided" and conditions:
        by_name, every = _conditions_by_name(conditions), conditions[""]
        verdicts = condition_verdicts(conditions)
        rows = [("", every)]
        rows += [(f"{item.name} ", by_name[item.name]) for item in verdicts if item.name in by_name]
        for name, scores in rows:
            if not _is_complete(scores):
                share = f"{name}{100 * scores.given / scores.count:.3g} % given, {100 * LEAST_COVERAGE:g} % needed"
                return f"too many estimates are missing to say whether the errors are as large as stated: {share}"
        tails, without_missing = (
            {part.verdict for part in judged_parts(scores) if part.name not in DIRECTIONS}
            for scores in (every, every.model_copy(update={"count": every.given}))
        )
        if "undecided" in tails - without_missing:
            share = f"{100 * every.given / every.count:.3g} % given"
            return f"too many estimates are missing to say whether large errors are as frequent as stated: {share}"
    where = f", as shown for {places}; the mean NEES is undecided" if (places := only_where(nees)) else ""
    return MEANING[verdict] + where + (_MORE_LARGE if nees.also else "")


def only_where(nees: MetricValue, most: int = 2) -> str:
    """Return where a covariance is off, such as "braking", if its mean NEES is undecided; else an empty text."""
    word = nees.verdict
    if word not in ("optimistic", "pessimistic") or nees.ci95 is None or mean_verdict(nees.ci95, nees.dof or 4) == word:
        return ""
    conditions = nees.conditions or ()
    names = [condition.name for condition in conditions if condition.verdict == word]
    names += [part.name for part in nees.parts or () if part.verdict == word]
    names += [f"{item.name} {part.name}" for item in conditions for part in item.parts if part.verdict == word]
    return _first(names, most)


def what_is_off(nees: MetricValue, most: int = 4, word: str | None = None) -> str:
    """Return under which conditions a covariance is off, farthest first, with mean NEES: "turning 39.7, straight 2.9".

    The text names the conditions with a mean that is off. A heavy-tailed verdict, or a verdict without such conditions,
    gives shares: "15 % beyond the 95 % point (5 % expected)". A mixed verdict with neither conditions nor shares names
    the two conditions that are furthest apart.

    Args: nees: NEES with its verdict. most: largest number of names. word: verdict to explain, such as
    ``heavy-tailed``; by default the overall verdict.
    """
    word = word or nees.verdict
    off = [condition for condition in nees.conditions or () if condition.verdict in ("optimistic", "pessimistic")]
    if word == "heavy-tailed" or not off:
        texts = _parts_off(nees, word)
        if texts:
            return _first(texts, most)
    dof = nees.dof or 1
    if word == "mixed" and not off:
        means = sorted(nees.conditions or (), key=lambda condition: condition.mean)
        off = [means[0], means[-1]]
    off.sort(key=lambda condition: -abs(math.log(max(condition.mean, 1e-9) / dof)))
    return _first([f"{condition.name} {mean_text(condition.mean)}" for condition in off], most)


def _parts_off(nees: MetricValue, word: str | None) -> list[str]:
    every = [("", nees.parts or ()), *((f"{item.name} ", item.parts) for item in nees.conditions or ())]
    words = {"heavy-tailed"} if word == "heavy-tailed" else {"optimistic", "pessimistic"}
    off = [(condition, part) for condition, parts in every for part in parts if part.verdict in words]
    off.sort(key=lambda item: (item[0] != "", -abs(math.log(max(item[1].value, 1e-9) / item[1].expected))))
    return [f"{condition}{part_text(part)}" for condition, part in off]


def part_text(part: PartVerdict) -> str:
    """Return a verdict on a tail or direction in words, such as "15 % beyond the 95 % point (5 % expected)"."""
    if part.name in DIRECTIONS:
        return f"{mean_text(part.value)} {part.name} (1 expected)"
    return f"{100 * part.value:.2g} % {part.name} ({100 * part.expected:g} % expected)"


def _first(texts: Sequence[str], most: int) -> str:
    more = [f"{len(texts) - most} more"] if len(texts) > most else []
    return ", ".join([*texts[:most], *more])


def mean_text(mean: float) -> str:
    """Return a mean NEES in few digits: "4.2", "0.05", "2e+05"."""
    return f"{mean:.1g}" if mean < 0.095 else f"{mean:.1f}" if mean < 1000 else f"{mean:.0e}"
