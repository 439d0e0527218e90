"""What intervals say of a tracker's covariance: over all estimates, under each condition, and together."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence

from scipy.special import chdtrc

from trackbench.metrics.conditions import AGES
from trackbench.metrics.consistency import BEYOND, DIRECTIONS, beyond_path, beyond_points
from trackbench.results import ConditionScores, ConditionVerdict, MetricValue, PartVerdict

CONSISTENCY = ("consistent", "optimistic", "pessimistic", "undecided")
#: Of a NEES, which is judged by its tails and under each condition too.
TRUST = (*CONSISTENCY, "mixed", "heavy-tailed")
WHITENESS = ("white", "coloured", "undecided")

#: How far the mean of a NEES or NIS may be from its degrees of freedom without consequence, as a share of them. A
#: covariance that is 10 % too large or too small is one whose standard deviations are 5 % off.
TOLERANCE = 0.1
#: Probability at which few runs or scenes call a consistent tracker wrong, on each side.
DOUBT = 0.001
#: How far above it may be for the share beyond the farthest point that is judged: where ten are expected beyond it, a
#: matched filter is shown to be within this in 97 % of all cases or more, and within ``TOLERANCE`` in 33 to 79 %.
FAR_TOLERANCE = 0.2
#: The same under one condition, below and above. A condition is chosen by what the truth did, which the error has to do
#: with: even of a sound filter, the mean NEES in a manoeuvre is up to 30 % above its degrees of freedom, and on
#: straights up to 15 % below, as the calibration measures.
BELOW, ABOVE = 0.25, 0.5
#: The parts of the NEES, which are judged too.
HALVES = ("position alone", "velocity alone")
#: Name of the part of the NEES beyond a point of chi-square.
_PART = "beyond the {} point"
#: The point of chi-square beyond which a share can be too small as well.
NEAR = "95 %"
#: A NEES or NIS is judged where this share of the estimates or innovations that there should be is given: the missing
#: ones may be the large ones. Without the worst 1 % a NEES of 4.00 becomes 3.88; without the worst 5 %, 3.59.
LEAST_COVERAGE = 0.99
#: A condition is judged where it has this share of the estimates, from so many runs or scenes.
SMALLEST_SHARE = 0.02
FEWEST_RUNS = 5
#: How far an autocorrelation may be from zero. Predicting each innovation from the one before then saves 0.05^2, a
#: quarter of a percent, of its variance.
WHITENESS_TOLERANCE = 0.05


def mean_verdict(ci95: tuple[float, float] | None, dof: int) -> str:
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


def doubtless_verdict(mean: float, parts: float, dof: int) -> str:
    """Return ``optimistic`` or ``pessimistic`` where a mean over few parts leaves no doubt, else ``undecided``.

    However much the errors within a part are correlated, the mean NEES of a consistent filter there varies no more than
    a single chi-square variable. So the sum is held against chi-square with ``dof`` degrees of freedom for each part.

    Args:
        mean: of a NEES or NIS.
        parts: effective number of independent runs or scenes.
        dof: what the mean of a consistent tracker is.
    """
    total, freedom = mean * parts, dof * parts
    if chdtrc(freedom, total / (1 + TOLERANCE)) < DOUBT:
        return "optimistic"
    return "pessimistic" if 1 - chdtrc(freedom, total / (1 - TOLERANCE)) < DOUBT else "undecided"


def condition_verdict(ci95: tuple[float, float] | None, dof: int) -> str:
    """The same of the mean under one condition, with ``BELOW`` and ``ABOVE``."""
    return _consistency(ci95, dof * (1 - BELOW), dof * (1 + ABOVE))


def tail_limits(point: str, under_condition: bool = False, factor: float = 1.0) -> tuple[float, float]:
    """Between which the share of the NEES beyond a point of chi-square may be: where it is if the covariance is right
    but for a factor that is tolerated. Beyond the 99 % and 99.9 % points too few change nothing.

    Args:
        point: of ``BEYOND``.
        under_condition: with ``BELOW`` and ``ABOVE``.
        factor: by which the covariance is known to be too small.
    """
    place = dict(zip(BEYOND, beyond_points(4), strict=True))[point] / factor
    below, above = (BELOW, ABOVE) if under_condition else (TOLERANCE, TOLERANCE if point == NEAR else FAR_TOLERANCE)
    low = chdtrc(4, place / (1 - below)) if point == NEAR else 0.0
    return low, chdtrc(4, place / (1 + above))


def tail_verdict(ci95: tuple[float, float], point: str, under_condition: bool = False) -> str:
    """What the interval of the share of the NEES beyond a point says of the covariance: ``heavy-tailed`` and
    ``pessimistic`` where it is shown to be above and below :func:`tail_limits`; else as in ``mean_verdict``."""
    word = _consistency(ci95, *tail_limits(point, under_condition))
    return "heavy-tailed" if word == "optimistic" else word


def whiteness_verdict(ci95: tuple[float, float] | None) -> str:
    """What the interval of an autocorrelation says: ``white``, ``coloured`` or ``undecided``; as ``mean_verdict``."""
    side = _side(ci95, -WHITENESS_TOLERANCE, WHITENESS_TOLERANCE)
    return "undecided" if side is None else "coloured" if side else "white"


def judged_parts(scores: ConditionScores, under_condition: bool = False) -> list[PartVerdict]:
    """The share of the NEES beyond the 95 % point and beyond the farthest point of which the share is stated, and the
    NEES along and across the motion. None where the first is not stated: there are too few estimates. An estimate that
    is missing may be within a point or beyond it, and the interval of the share holds both.

    Args:
        scores: under one condition, or of all estimates.
        under_condition: whether they are those of one.
    """
    complete, parts = _is_complete(scores), []
    beyond = {point: scores.metrics[path] for point in BEYOND if (path := beyond_path(point)) in scores.metrics}
    share_given = scores.given / scores.count if scores.count else 1.0
    for point, share in beyond.items():
        if point in (NEAR, [*beyond][-1]) and share.value is not None and share.ci95 is not None:
            ci95 = (share_given * share.ci95[0], share_given * share.ci95[1] + 1 - share_given)
            word = tail_verdict(ci95, point, under_condition) if complete else "undecided"
            name, expected = _PART.format(point), BEYOND[point]
            parts.append(PartVerdict(name=name, value=share.value, expected=expected, ci95=ci95, verdict=word))
    for name, field in DIRECTIONS.items():
        nees = scores.metrics.get(field)
        # What the truth did under a condition is what the velocity of a sound filter lags behind.
        if parts and not (under_condition and "velocity" in name) and nees and nees.value is not None and nees.ci95:
            word = condition_verdict(nees.ci95, 1) if complete else "undecided"
            parts.append(PartVerdict(name=name, value=nees.value, expected=1.0, ci95=nees.ci95, verdict=word))
    return parts


def condition_verdicts(conditions: Mapping[str, ConditionScores]) -> list[ConditionVerdict]:
    """Return the verdicts under the conditions with enough estimates: each manoeuvre, each range band and the first
    second; and on the two halves of the NEES."""
    judged = _judged(_conditions_by_name(conditions).items(), conditions[""].count)
    return [*judged, *_halves(conditions[""])]


def _conditions_by_name(conditions: Mapping[str, ConditionScores]) -> dict[str, ConditionScores]:
    """Return the conditions that may be judged: each manoeuvre, each range band and the first second."""
    named = [(*name.partition(": ")[::2], scores) for name, scores in conditions.items()]
    return {name: scores for group, name, scores in named if group not in ("", "jump") and name != AGES[1]}


def overall_verdict(
    mean: float, whole: str, conditions: Sequence[ConditionVerdict], parts: Sequence[PartVerdict] = ()
) -> str:
    """The verdict on a covariance from that over all estimates and those under each condition.

    ``consistent``: so over all estimates and under each condition. ``optimistic`` and ``pessimistic``: off over all
    estimates or under some conditions, to that side alone. ``mixed``: off to both sides; or off under some condition
    and consistent over all estimates; or consistent under some condition, with a mean that differs from that over all
    estimates by more than is allowed for under a condition. The first second does not count for the last: it rests on
    the covariance that a track starts from, and may be right where the process noise is wrong everywhere; nor do
    position and velocity alone, which no fault need touch alike. ``heavy-tailed``: none of these, and too many of the
    NEES are far out, over all estimates or under some condition. What is undecided of the tails and directions under a
    condition, which take more estimates than its mean, counts neither for nor against.

    Args:
        mean: over all estimates.
        whole: the verdict on it.
        conditions: those that are judged.
        parts: those over all estimates.
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
    word: str, mean: float, conditions: Sequence[ConditionVerdict], parts: Sequence[PartVerdict]
) -> str | None:
    """``heavy-tailed`` where a verdict by means, which comes first, hides that large errors are too frequent.

    They are where the share beyond a point, over all estimates or under a condition, is above what the mean there
    explains: that of a covariance which is too small by the factor of the mean, and of none that is too large.

    Args:
        word: the verdict.
        mean: over all estimates.
        conditions: those that are judged.
        parts: those over all estimates.
    """
    if word not in ("optimistic", "pessimistic", "mixed"):
        return None
    groups = [(mean, parts, False), *((item.mean, item.parts, True) for item in conditions)]
    heavy = any(
        part.ci95[0] > tail_limits(point, under_condition, max(own / 4, 1.0))[1]
        for own, items, under_condition in groups
        for part in items
        for point in BEYOND
        if part.name == _PART.format(point) and part.verdict == "heavy-tailed"
    )
    return "heavy-tailed" if heavy else None


def _halves(scores: ConditionScores) -> Iterator[ConditionVerdict]:
    """The NEES of the position and of the velocity by themselves: one too large may hide the other, too small."""
    for name, nees in zip(HALVES, map(scores.metrics.get, ("nees_position", "nees_velocity")), strict=True):
        if scores.runs >= FEWEST_RUNS and nees and nees.value is not None and nees.ci95 and nees.dof:
            word = condition_verdict(nees.ci95, nees.dof) if _is_complete(scores) else "undecided"
            # Twice as much, to stand beside the others, of which 4 is right.
            low, high = nees.ci95
            yield ConditionVerdict(name=name, mean=2 * nees.value, ci95=(2 * low, 2 * high), verdict=word)


def _judged(conditions: Iterable[tuple[str, ConditionScores]], count: int) -> Iterator[ConditionVerdict]:
    for name, scores in conditions:
        nees = scores.metrics.get("nees")
        if nees is None or nees.value is None or nees.dof is None or nees.ci95 is None:
            continue
        if scores.count >= SMALLEST_SHARE * count and scores.runs >= FEWEST_RUNS:
            word = condition_verdict(nees.ci95, nees.dof) if _is_complete(scores) else "undecided"
            parts = tuple(judged_parts(scores, under_condition=True))
            yield ConditionVerdict(name=name, mean=nees.value, ci95=nees.ci95, verdict=word, parts=parts)


def _is_complete(scores: ConditionScores) -> bool:
    return scores.given >= LEAST_COVERAGE * scores.count


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
    "consistent": f"the errors are as large as its covariance states, within the tolerance of {100 * TOLERANCE:g} % of "
    f"the mean NEES ({100 * BELOW:g} % below to {100 * ABOVE:g} % above under a condition), and in the tails",
    "optimistic": "the errors are larger than its covariance states",
    "pessimistic": "the errors are smaller than its covariance states",
    "mixed": "the errors are larger or smaller than its covariance states, depending on the condition",
    "heavy-tailed": "large errors are more frequent than its covariance states; the mean NEES does not show it",
    "undecided": "too few runs or scenes to say whether the errors are as large as its covariance states",
}


#: What is added where large errors are too frequent as well.
_MORE_LARGE = "; large errors are more frequent than its mean NEES explains"


def meaning(nees: MetricValue, conditions: Mapping[str, ConditionScores]) -> str:
    """The same, with where alone it holds if the mean is undecided. Of an undecided one with the share of the estimates
    that are given, where more runs would not tell for those that are missing."""
    word = nees.verdict or "undecided"
    if word == "undecided" and conditions:
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
    return MEANING[word] + where + (_MORE_LARGE if nees.also else "")


def only_where(nees: MetricValue, most: int = 2) -> str:
    """Where a covariance is off of which the mean NEES is undecided: "braking, velocity alone"; else empty."""
    word = nees.verdict
    if word not in ("optimistic", "pessimistic") or nees.ci95 is None or mean_verdict(nees.ci95, nees.dof or 4) == word:
        return ""
    conditions = nees.conditions or ()
    names = [condition.name for condition in conditions if condition.verdict == word]
    names += [part.name for part in nees.parts or () if part.verdict == word]
    names += [f"{item.name} {part.name}" for item in conditions for part in item.parts if part.verdict == word]
    return _first(names, most)


def what_is_off(nees: MetricValue, most: int = 4, word: str | None = None) -> str:
    """What is off, farthest first, and by how much: "turning 39.7, straight 2.9".

    The conditions under which the mean is; of a mixed one, where there are none, those that are furthest apart; and of
    a heavy-tailed one, or where no mean is off, "15 % beyond the 95 % point (5 % expected)".

    Args:
        nees: with its verdict.
        most: how many to name.
        word: of the verdict, of which to say it; the main one unless given.
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
    """ "15 % beyond the 95 % point (5 % expected)", "1.9 along the motion (1 expected)"."""
    if part.name in DIRECTIONS:
        return f"{mean_text(part.value)} {part.name} (1 expected)"
    return f"{100 * part.value:.2g} % {part.name} ({100 * part.expected:g} % expected)"


def _first(texts: Sequence[str], most: int) -> str:
    more = [f"{len(texts) - most} more"] if len(texts) > most else []
    return ", ".join([*texts[:most], *more])


def mean_text(mean: float) -> str:
    """ "4.2", "0.05", "2e+05"."""
    return f"{mean:.1g}" if mean < 0.095 else f"{mean:.1f}" if mean < 1000 else f"{mean:.0e}"
