"""One-sided bounds at the small levels of a map of many cells"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
from scipy.special import stdtrit

import trackbench as tb
from trackbench.base.types import Array
from trackbench.subjects.envelope.bounds import Sample, Side, mean_bound, positive_bound, rate_bound, share_bound

from .claim import STATED, Claim
from .scenes import HELD_BACK, METRICS, SCENES, pool

LEVELS = (0.05, 0.01, 0.001, 0.00025, 0.0001)
TRIALS = 50_000
#: Values that are drawn at once.
CHUNK = 4_000_000
#: Runs of each shipped scenario that stand for all runs.
POPULATION = 2000
TRACKERS = ("ekf_cv", "imm_three")

Random = np.random.Generator
Size = tuple[int, int]
Draw = Callable[[Random, Size], Array]
BoundOf = Callable[[Sample, float, Side], Array]


class Family(NamedTuple):
    """What runs or scenes are drawn from."""

    draw: Draw
    truth: float
    calibrated: bool = True
    """Whether the bounds are meant to hold; else what they miss is stated."""


def hard(share: float, sigma: float) -> Draw:
    """Lognormal, of which a share is ten times as large; mean one."""

    def draw(random: Random, size: Size) -> Array:
        factor = np.where(random.random(size) < share, 10.0, 1.0) / (1 + 9 * share)
        return np.asarray(random.lognormal(-(sigma**2) / 2, sigma, size) * factor)

    return draw


def lognormal(sigma: float) -> Draw:
    return lambda random, size: random.lognormal(-(sigma**2) / 2, sigma, size)


def gamma(shape: float) -> Draw:
    return lambda random, size: random.gamma(shape, 1 / shape, size)


def student_squares(random: Random, size: Size) -> Array:
    """Mean squares of twelve errors each, of Student's t with 5 degrees of freedom."""
    return np.asarray((random.standard_t(5, (*size, 12)) ** 2).mean(axis=-1) * 0.6)


def negative_binomial(mean: float, shape: float) -> Draw:
    return lambda random, size: random.negative_binomial(shape, shape / (shape + mean), size).astype(float)


POSITIVE = {
    "gamma, shape 0.5": Family(gamma(0.5), 1.0),
    "gamma, shape 1": Family(gamma(1.0), 1.0),
    "gamma, shape 5": Family(gamma(5.0), 1.0),
    "chi-square, 200 degrees of freedom": Family(gamma(100.0), 1.0),
    "lognormal, sigma 0.5": Family(lognormal(0.5), 1.0),
    "twelve squared errors of Student's t with 5 degrees of freedom": Family(student_squares, 1.0),
}
SIGNED = {
    "normal": Family(lambda random, size: random.normal(size=size), 0.0),
    "Student's t with 5 degrees of freedom": Family(lambda random, size: random.standard_t(5, size), 0.0),
    "exponential": Family(gamma(1.0), 1.0),
    "lognormal, sigma 0.5": Family(lognormal(0.5), 1.0),
}
SHARES = {
    **{
        f"single trials, {share:g}": Family(lambda random, size, p=share: (random.random(size) < p) * 1.0, share)
        for share in (0.001, 0.01, 0.1, 0.5)
    },
    "beta, mean 0.02, of 3": Family(lambda random, size: random.beta(0.06, 2.94, size), 0.02),
    "beta, mean 0.3, of 30": Family(lambda random, size: random.beta(9.0, 21.0, size), 0.3),
    "one run in 50 with a share up to 0.5": Family(
        lambda random, size: (random.random(size) < 0.02) * random.random(size) * 0.5, 0.005
    ),
}
RATES = {
    **{
        f"Poisson, {mean:g} a scene": Family(lambda random, size, m=mean: random.poisson(m, size) * 1.0, mean)
        for mean in (0.01, 0.1, 1.0)
    },
    "negative binomial, 1 a scene, variance 2": Family(negative_binomial(1.0, 1.0), 1.0),
    "negative binomial, 5 a scene, variance 30": Family(negative_binomial(5.0, 1.0), 5.0),
    "where it stops: negative binomial, 0.1 a scene, variance 0.13": Family(negative_binomial(0.1, 0.3), 0.1, False),
}
HARD_SCENES = {
    "lognormal, sigma 1": Family(lognormal(1.0), 1.0),
    "one in 20 ten times as hard, lognormal, sigma 0.5": Family(hard(0.05, 0.5), 1.0),
    "one in 20 ten times as hard, lognormal, sigma 0.2": Family(hard(0.05, 0.2), 1.0),
    "where it stops: one in 100 ten times as hard, lognormal, sigma 0.3": Family(hard(0.01, 0.3), 1.0, False),
}


def sample_of(values: Array, count: Array | None = None, scenes: bool = False) -> Sample:
    """``(trials,)`` of ``(trials, number)`` values or, with counts, of ratios of the sums of both."""
    number = values.shape[1]
    count = np.ones((1, 1)) if count is None else count
    mean = values.mean(axis=1) / count.mean(axis=1)
    offset = (values - mean[:, None] * count) / count.mean(axis=1)[:, None]
    square = offset * offset
    variance = square.mean(axis=1)
    third = (square * offset).mean(axis=1) / np.where(variance > 0, variance, 1.0) ** 1.5
    return Sample(mean, np.sqrt(variance / (number - 1)), third, number, scenes)


def drawn(family: Family, random: Random, number: int, scenes: bool = False, trials: int = TRIALS) -> Sample:
    """``(trials,)`` so many runs or scenes each."""
    each = max(1, CHUNK // (number * (12 if family.draw is student_squares else 1)))
    sizes = [min(each, trials - start) for start in range(0, trials, each)]
    return joined([sample_of(family.draw(random, (size, number)), scenes=scenes) for size in sizes])


def joined(samples: list[Sample]) -> Sample:
    """The trials of all."""
    means, errors, thirds = (np.concatenate(arrays) for arrays in zip(*(item[:3] for item in samples), strict=True))
    return Sample(means, errors, thirds, *samples[0][3:])


def missed(what: str, sample: Sample, truth: float, bound_of: BoundOf, calibrated: bool = True) -> Claim:
    """How often each bound misses, at each level; it holds where none misses more often, but for the error of so many
    trials (three standard errors)."""
    trials, texts, holds, excess = len(sample.mean), [], True, -1.0
    for side, sign in (("lower", 1), ("upper", -1)):
        shares = []
        for level in LEVELS:
            share = float((sign * (bound_of(sample, level, side) - truth) > 0).mean())  # type: ignore[arg-type]
            allowed = level + 3 * (level / trials) ** 0.5
            holds &= share <= allowed
            excess = max(excess, share / allowed - 1)
            shares.append(f"{100 * share:.3g}")
        texts.append(f"{side} {', '.join(shares)}")
    wanted = f"at most {', '.join(f'{100 * level:g}' for level in LEVELS)} %, but for the error of {trials:,} trials"
    wanted = wanted if calibrated else STATED
    return Claim(what, f"{'; '.join(texts)} %", wanted, holds or not calibrated, excess=excess)


def width(what: str, sample: Sample, bound_of: BoundOf, level: float = 1e-4) -> Claim:
    """How far the bounds reach, over Student's; the median."""
    reach = stdtrit(sample.number - 1, 1 - level) * sample.error
    low, high = (np.median(abs(bound_of(sample, level, side) - sample.mean) / reach) for side in ("lower", "upper"))
    return Claim(
        f"{what}: reach at {100 * level:g} % over Student's", f"lower {low:.2f}, upper {high:.2f}", STATED, True
    )


def claims() -> Iterator[Claim]:
    random = np.random.default_rng(1)
    for number in (25, 100, 400):
        for name, family in POSITIVE.items():
            what, sample = f"mean of {number} runs, {name}", drawn(family, random, number)
            yield missed(what, sample, family.truth, positive_bound, family.calibrated)
            yield width(what, sample, positive_bound)
        for name, family in SIGNED.items():
            what, sample = f"signed mean of {number} runs, {name}", drawn(family, random, number)
            yield missed(what, sample, family.truth, mean_bound, family.calibrated)
            yield width(what, sample, mean_bound)
        for name, family in SHARES.items():
            sample = drawn(family, random, number)
            yield missed(f"share, {number} runs, {name}", sample, family.truth, share_bound, family.calibrated)
    for number in (60, 400):
        for name, family in RATES.items():
            sample = drawn(family, random, number, scenes=True)
            bound_of = lambda sample, level, side, own=number: rate_bound(sample, own, level, side)  # noqa: E731
            yield missed(f"rate, {number} scenes, {name}", sample, family.truth, bound_of, family.calibrated)
    for number in (30, 100, 400):
        for name, family in HARD_SCENES.items():
            what, sample = f"mean of {number} scenes, {name}", drawn(family, random, number, scenes=True)
            yield missed(what, sample, family.truth, positive_bound, family.calibrated)
            yield width(what, sample, positive_bound)
    yield from _real_scenes(random)
    yield from _real_runs(random)
    yield _student(random)


def _student(random: Random) -> Claim:
    """What it would be instead."""
    sample = drawn(POSITIVE["gamma, shape 1"], random, 25)
    shares = [(sample.mean + stdtrit(24, 1 - level) * sample.error < 1).mean() for level in LEVELS]
    measured = f"upper {', '.join(f'{100 * share:.3g}' for share in shares)} %"
    return Claim("mean of 25 runs, gamma, shape 1: Student's t instead misses", measured, STATED, True)


def _real_scenes(random: Random) -> Iterator[Claim]:
    """The scenes to which no constant of an interval was fitted."""
    for environment in SCENES:
        table = pool(environment)
        for number in (30, 120):
            for tracker in TRACKERS:
                for metric in METRICS:
                    squares, count = table[f"{tracker} {metric}"], table["count"]
                    held_back = ", no scene of which was fitted to" if environment == HELD_BACK else ""
                    what = f"scenes of {environment}{held_back}, {number}, {tracker}, mean squared {metric} error"
                    yield _resampled(what, random, squares, count, number, scenes=True)


def _real_runs(random: Random) -> Iterator[Claim]:
    for scenario, name in {"highway": "ekf_cv", "fusion": "ekf_cv", "scripted/own_model": "ekf"}.items():
        result = tb.run(tb.load(scenario, runs=POPULATION, trackers=[name]))
        table = result.to_pandas("runs").set_index("tracker").loc[name]
        count = table["count"].to_numpy()
        for metric, column in METRICS.items():
            squares = table[column].to_numpy() ** 2 * count
            for number in (25, 100):
                what = f"runs of {scenario}, {number}, {name}, mean squared {metric} error"
                yield _resampled(what, random, squares, count, number)


def _resampled(what: str, random: Random, total: Array, count: Array, number: int, scenes: bool = False) -> Claim:
    """Drawn with replacement."""
    each = CHUNK // number
    sizes = [min(each, TRIALS - start) for start in range(0, TRIALS, each)]
    places = [random.integers(0, len(total), (size, number)) for size in sizes]
    sample = joined([sample_of(total[place], count[place], scenes) for place in places])
    return missed(what, sample, float(total.sum() / count.sum()), positive_bound)
