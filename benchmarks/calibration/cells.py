"""Cells of an envelope: how often any is decided wrongly, and how many are decided"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np
from scipy.special import ndtr, ndtri, stdtrit

from trackbench.base.types import Array
from trackbench.subjects.envelope.bounds import Sample, Side, mean_bound, positive_bound
from trackbench.subjects.envelope.cells import Spending

from .bounds import Draw, gamma, lognormal, sample_of
from .claim import STATED, Claim, power, rate

CELLS, REPEATS = 200, 200
FIRST = 25
#: A cell this far from the limit has to be decided.
FAR = 0.1
#: By the coefficient of variation of a run: its distribution, and the budget of a cell in runs.
NOISES = {"0.3": (lognormal(float(np.sqrt(np.log(1.09)))), 200), "1": (gamma(1.0), 1600)}

BoundOf = Callable[[Sample, float, Side], Array]


class States(NamedTuple):
    """Of ``(...)`` cells: 1 holds, -1 fails, 0 undecided; and the runs that it took."""

    state: Array
    runs: Array


def looks(budget: int) -> tuple[int, ...]:
    """Each the double of the one before."""
    return tuple(FIRST * 2**power for power in range(int(np.log2(budget / FIRST)) + 1))


def decided(
    values: Array,
    numbers: Sequence[int],
    levels: Sequence[float],
    bound_of: BoundOf = positive_bound,
    limit: float = 1.0,
) -> States:
    """Cells ``(..., runs)`` whose value has to be below the limit."""
    state, runs = np.zeros(values.shape[:-1], dtype=int), np.full(values.shape[:-1], numbers[-1])
    for number, level in zip(numbers, levels, strict=True):
        sample = sample_of(values[..., :number].reshape(-1, number))
        holds, fails = bound_of(sample, level, "upper") < limit, bound_of(sample, level, "lower") > limit
        holds, fails = holds.reshape(state.shape), fails.reshape(state.shape)
        new = (state == 0) & (holds | fails)
        state, runs = np.where(new, np.where(holds, 1, -1), state), np.where(new, number, runs)
    return States(state, runs)


def planted(random: np.random.Generator) -> Array:
    """``(CELLS,)`` true values over the limit: monotone along both axes of the map, with cells on both sides of it."""
    across, along = np.meshgrid(np.linspace(-1, 1, 20), np.linspace(-1, 1, 10))
    return np.exp(0.5 * across + 0.35 * along + 0.02 * random.normal()).ravel()


def levels_of(numbers: tuple[int, ...], cells: int = CELLS, error: float = 0.05) -> list[float]:
    """What each look may spend."""
    return [Spending(error, cells, numbers).at(look) for look in range(len(numbers))]


def claims() -> Iterator[Claim]:
    random = np.random.default_rng(1)
    yield from _border(random)
    for variation, (draw, budget) in NOISES.items():
        for runs in (budget // 2, budget):
            where = f"{CELLS} cells, coefficient of variation {variation}, at most {runs} runs a cell"
            yield from _planted(random, where, draw, looks(runs), 0.95 if runs == budget else 0.0)
        yield from _on_the_limit(random, f"{CELLS} cells, coefficient of variation {variation}", draw)
    yield from _ways_of_spending(random)


def _planted(
    random: np.random.Generator, where: str, draw: Draw, numbers: tuple[int, ...], least: float
) -> Iterator[Claim]:
    """A planted monotone requirement."""
    levels, shape = levels_of(numbers), (CELLS, numbers[-1])
    wrong, far, undecided, used, changed, worse = [], [], [], [], [], []
    for _ in range(REPEATS):
        truth = planted(random)
        noise = draw(random, shape)
        before = decided(truth[:, None] * noise, numbers, levels)
        again = decided(truth[:, None] * draw(random, shape), numbers, levels)
        after = decided(1.5 * truth[:, None] * noise, numbers, levels)
        wrong.append(bool(np.any(before.state == np.where(truth < 1.0, -1, 1))))
        far.append(float(np.mean(before.state[abs(truth - 1.0) >= FAR] != 0)))
        undecided.append(float(np.mean(before.state == 0)))
        used.append(float(before.runs.mean()))
        changed.append(bool(np.any((before.state == 1) & (again.state == -1))))
        worse.append(bool(np.any((before.state == 1) & (after.state == -1))))
    yield rate(f"{where}: any decided wrongly", wrong, 0.0, 0.05)
    yield power(f"{where}: those 10 % or more from the limit decided", far, least)
    yield power(f"{where}: all undecided", undecided)
    yield Claim(f"{where}: mean runs", f"{np.mean(used):.0f}", STATED, True)
    yield rate(f"{where}: any goes from holds to fails with other seeds", changed, 0.0, 0.05)
    yield power(
        f"{where}: any goes from holds to fails of a tracker whose value is 1.5 times as large, with the same seeds",
        worse,
    )


def _on_the_limit(random: np.random.Generator, where: str, draw: Draw) -> Iterator[Claim]:
    """The worst case: all cells have the value of the limit."""
    numbers = looks(400)
    maps = [decided(draw(random, (CELLS, numbers[-1])), numbers, levels_of(numbers)).state for _ in range(5 * REPEATS)]
    for word, state in (("holds", 1), ("fails", -1)):
        yield rate(f"{where}, all on the limit: any {word}", [bool((own == state).any()) for own in maps], 0.0, 0.05)


def _border(random: np.random.Generator, trials: int = 20_000) -> Iterator[Claim]:
    """A cell whose true value is the limit, normal runs."""
    numbers = looks(400)
    values = random.normal(size=(trials, numbers[-1]))

    def student(sample: Sample, level: float, side: Side) -> Array:
        reach = stdtrit(sample.number - 1, 1 - level) * sample.error
        return np.asarray(sample.mean + (reach if side == "upper" else -reach))

    def share(what: str, levels: Sequence[float], bound_of: BoundOf) -> Claim:
        return rate(
            f"cell on the limit, 5 looks: {what}", decided(values, numbers, levels, bound_of, 0.0).state != 0, 0.0, 0.05
        )

    plain, spent = [0.025] * len(numbers), levels_of(numbers, 1, 0.025)
    yield share("decided by plain 95 % intervals", plain, student)._replace(wanted=STATED, holds=True)
    yield share("decided by Student's intervals with 5 % spent over the looks", spent, student)
    yield share("decided by the bounds with 5 % spent over the looks", spent, mean_bound)


def _ways_of_spending(random: np.random.Generator, trials: int = 2000) -> Iterator[Claim]:
    """Which share of cells 10 % from the limit is decided, and after how many runs."""
    draw, _ = NOISES["0.3"]
    error, numbers = 0.05 / CELLS, looks(200)
    times = np.array(numbers) / numbers[-1]
    reach = -ndtri(1 - error / 2) / np.sqrt(times)
    ways = {
        "in proportion to the runs": levels_of(numbers),
        "alike over the looks": np.full(len(numbers), error / len(numbers)),
        "as O'Brien and Fleming (1979)": np.maximum(np.diff(2 * ndtr(reach), prepend=0.0), 1e-15),
    }
    noise = draw(random, (trials, numbers[-1]))
    for name, levels in ways.items():
        for value in (0.9, 1.1, 0.5):
            states = decided(value * noise, numbers, [*levels])
            measured = f"{100 * np.mean(states.state != 0):.0f} %, {states.runs.mean():.0f}"
            what = f"error spent {name}, 25 to 200 runs, value {value:g} of the limit: decided, mean runs"
            yield Claim(what, measured, STATED, True)
