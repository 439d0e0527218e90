"""Random functions of arrays, to be traced and to be computed by NumPy."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from random import Random
from typing import Any, NamedTuple

import numpy as np

from trackbench.engine.equations import Equations, Values

#: A relative error of this size, about five units in the last place, is any machine's.
ROUNDING = 1e-15
#: The same of numbers with fewer digits.
SUBNORMAL = 5e-323
SPECIAL = [0.0, -0.0, 1.0, -1.0, 0.5, 2.0, np.inf, -np.inf, np.nan, 5e-324, 1e-300, 1e6, np.pi / 2]
#: Components of each input, and whether it is a mask; names that begin with u are the same for all members.
INPUTS: dict[str, tuple[tuple[int, ...], bool]] = {
    "a": ((), False),
    "v": ((3,), False),
    "w": ((2,), False),
    "m": ((3, 3), False),
    "n": ((2, 3), False),
    "valid": ((), True),
    "seen": ((3,), True),
    "u": ((), False),
    "uv": ((3,), False),
    "um": ((3, 3), False),
    "umask": ((), True),
}
BATCHES: list[tuple[int, ...]] = [(1,), (7,), (8,), (9,), (17,), (2, 5), (3, 1, 2)]


class Step(NamedTuple):
    """One value, of values before it."""

    function: Callable[..., Any]
    of: Sequence[int]
    error: str = "none"
    """What its rounding error is relative to: the value (``value``), or its terms' magnitudes (``terms``)."""


@dataclass
class Program:
    """A function that gives its values from ``first`` on."""

    axes: int
    """Number of batch axes."""
    steps: list[Step] = field(default_factory=list)
    first: int = 0

    def start(self, values: Values) -> list[Any]:
        """The inputs as values to go on with: those without batch axes get such of length one."""
        return [values[name][(..., *[None] * self.axes)] if name.startswith("u") else values[name] for name in INPUTS]

    def __call__(self, values: Values) -> Values:
        known = self.start(values)
        for step in self.steps:
            known.append(step.function(*(known[i] for i in step.of)))
        return {f"y{i}": known[i] for i in range(self.first, len(known))}

    def disturbed(self, values: Values, rng: np.random.Generator) -> Values:
        """The same with rounding errors, and with zeros of either sign."""
        known = self.start(values)
        for step in self.steps:
            given = [known[i] for i in step.of]
            said = np.asarray(step.function(*given))
            if said.dtype != bool:
                said = np.where(said == 0, rng.choice([-0.0, 0.0], said.shape), said)
                bound = {"none": 0.0, "value": np.abs(said)}.get(step.error)
                if bound is None:
                    bound = step.function(*(np.abs(item) for item in given))
                bound = np.where(np.isfinite(bound), bound, 0.0) * ROUNDING + (step.error != "none") * SUBNORMAL
                said = said + bound * rng.uniform(-1, 1, said.shape) * rng.integers(0, 2, said.shape)
            known.append(said)
        return {f"y{i}": known[i] for i in range(self.first, len(known))}

    def equations(self) -> Equations:
        """The program as equations."""
        return Equations("program", self, {name: len(shape) for name, (shape, _) in INPUTS.items()}, key=id(self))


def random_values(random: Random, batch: tuple[int, ...], *, special: float) -> dict[str, Any]:
    """Inputs, among them a share of special values."""
    rng = np.random.default_rng(random.randrange(2**32))
    values: dict[str, Any] = {}
    for name, (components, boolean) in INPUTS.items():
        shape = components if name.startswith("u") else components + batch
        if boolean:
            values[name] = rng.random(shape) < 0.6
            continue
        value = np.round(rng.normal(size=shape) * 10.0 ** rng.integers(-2, 3), random.choice([0, 1, 15]))
        values[name] = np.where(rng.random(shape) < special, rng.choice(SPECIAL, shape), value)
    return values


def random_program(random: Random, values: Values, batch: tuple[int, ...], length: int) -> Program:
    """A program that NumPy can run on these inputs."""
    program = Program(len(batch))
    known = program.start(values)
    while len(program.steps) < length:
        step = random.choice(KINDS)(Pool(random, known, len(batch)))
        if step is not None:
            # NumPy refuses some, such as a negative power of an integer, which a number of masks is.
            with np.errstate(all="ignore"), suppress(ValueError, TypeError, IndexError):
                known.append(step.function(*(known[i] for i in step.of)))
                program.steps.append(step)
    program.first = len(known) - max(1, length // 2)
    return program


@dataclass
class Pool:
    """Values to choose from."""

    random: Random
    known: list[Any]
    axes: int

    def components(self, i: int) -> tuple[int, ...]:
        shape: tuple[int, ...] = self.known[i].shape
        return shape[: len(shape) - self.axes]

    def pick(
        self, *, boolean: bool | None = False, rank: int | None = None, like: tuple[int, ...] | None = None
    ) -> int:
        """A value of a kind; -1: there is none."""
        fit = [
            i
            for i, value in enumerate(self.known)
            if (boolean is None or (value.dtype == bool) == boolean)
            and (rank is None or len(self.components(i)) == rank)
            and (like is None or self.components(i) == like)
        ]
        # What was made last is used more often.
        return self.random.choice(fit + fit[-4:]) if fit else -1

    def other(self, i: int, *, boolean: bool | None = False) -> int:
        """A value that broadcasts with another."""
        shape = self.random.choice([self.components(i), self.components(i), ()])
        return self.pick(boolean=boolean, like=shape)


UNARY: dict[Callable[..., Any], str] = {
    np.negative: "none",
    np.absolute: "none",
    np.ceil: "none",
    np.isnan: "none",
    np.isfinite: "none",
    np.zeros_like: "none",
    np.sin: "value",
    np.cos: "value",
    np.exp: "value",
    np.square: "value",
    (lambda x: np.sqrt(np.abs(x))): "value",
    (lambda x: np.log(np.abs(x))): "value",
    (lambda x: np.abs(x) ** 0.5): "value",
    (lambda x: x**3): "value",
    (lambda x: x**5.0): "value",
    (lambda x: x**-2): "value",
    (lambda x: x**0): "none",
    (lambda x: 2.0 * x - x): "none",
    (lambda x: 0.0 * x + 1.0): "none",
    (lambda x: x - x): "none",
    (lambda x: np.clip(x, -1.0, 2.5)): "none",
    (lambda x: x.copy()): "none",
    (lambda x: (x > 0) * x): "none",
}
BINARY: dict[Callable[..., Any], str] = {
    np.add: "none",
    np.subtract: "none",
    np.multiply: "none",
    np.divide: "none",
    np.maximum: "none",
    np.minimum: "none",
    np.less: "none",
    np.less_equal: "none",
    np.greater: "none",
    np.greater_equal: "none",
    np.equal: "none",
    np.not_equal: "none",
    np.arctan2: "value",
    np.hypot: "value",
}
OF_MASKS = [np.bitwise_and, np.bitwise_or, np.add, np.multiply, np.maximum, np.equal]


def unary(pool: Pool) -> Step | None:
    function, error = pool.random.choice(list(UNARY.items()))
    return Step(function, [pool.pick()], error)


def binary(pool: Pool) -> Step | None:
    function, error = pool.random.choice(list(BINARY.items()))
    i = pool.pick()
    j = pool.other(i, boolean=pool.random.choice([False, False, None]))
    of = [i, j] if pool.random.random() < 0.5 else [j, i]
    return Step(function, of, error) if j >= 0 else None


def masks(pool: Pool) -> Step | None:
    i = pool.pick(boolean=True)
    j = pool.other(i, boolean=True)
    if pool.random.random() < 0.2:
        return Step(np.invert, [i])
    return Step(pool.random.choice(OF_MASKS), [i, j]) if j >= 0 else None


def choice(pool: Pool) -> Step | None:
    i = pool.pick()
    mask, j = pool.other(i, boolean=True), pool.other(i, boolean=pool.random.choice([False, None]))
    return Step(np.where, [mask, i, j]) if mask >= 0 and j >= 0 else None


def branch(pool: Pool) -> Step | None:
    """A branch on data, both ways of which give the same where its condition holds."""
    i = pool.pick()
    mask, j = pool.other(i, boolean=True), pool.other(i)
    if mask < 0 or j < 0:
        return None

    def by_all(condition: Any, a: Any, b: Any) -> Any:
        return np.where(True, a, b) if np.all(condition) else np.where(condition, a, b)

    def by_any(condition: Any, a: Any, b: Any) -> Any:
        return np.where(condition, a, b) if condition.any() else np.where(False, a, b)

    return Step(pool.random.choice([by_all, by_any]), [mask, i, j])


def products(pool: Pool) -> Step | None:
    i = pool.pick(rank=pool.random.choice([1, 2]))
    mine = pool.components(i)
    # By the sum of products, the components of the other factor.
    specs: list[tuple[str, tuple[int, ...] | None]] = [("i...->...", None), ("i...,i...->...", mine)]
    specs += [("i...,j...->ij...", (2,)), ("i...,...->i...", ()), ("...,i...->i...", (*mine,))]
    if len(mine) == 2:
        specs = [("ij...->ji...", None), ("ij...->...", None), ("ij...,j...->i...", mine[1:])]
        specs += [("ik...,jk...->ij...", (size, mine[1])) for size in (2, 3)]
        specs += [("ij...,kj...,kl...->il...", (size, mine[1])) for size in (2, 3)]
        specs += [("ii...->i...", None)] * (mine[0] == mine[1])
    spec, wanted = pool.random.choice(specs)
    if wanted is None:
        return Step(lambda x: np.einsum(spec, x), [i], "terms")
    j = pool.pick(like=wanted)
    if j < 0 or (spec.startswith("...") and len(mine) != 1):
        return None
    if spec.count(",") == 2:
        return Step(lambda x, y: np.einsum(spec, x, y, y), [i, j], "terms")
    if spec.startswith("..."):
        return Step(lambda x, y: np.einsum(spec, x[0], y), [i, j], "terms")
    return Step(lambda x, y: np.einsum(spec, x, y), [i, j], "terms")


def folds(pool: Pool) -> Step | None:
    i = pool.pick(rank=pool.random.choice([1, 2]))
    name = pool.random.choice(["sum", "prod", "max", "min"])
    axes: list[Any] = [0] if len(pool.components(i)) == 1 else [0, 1]
    # The order of many factors decides what underflows on the way.
    axis = pool.random.choice(axes if name == "prod" else [*axes, tuple(axes)])
    if pool.random.random() < 0.5:
        return Step(lambda x: getattr(np, name)(x, axis=axis), [i], "terms" if name == "sum" else "value")
    return Step(lambda x: getattr(x, name)(axis=axis), [i], "terms" if name == "sum" else "value")


def folded_masks(pool: Pool) -> Step | None:
    i = pool.pick(boolean=True, rank=1)
    function = pool.random.choice([np.all, np.any, np.sum, np.max])
    return Step(lambda x: function(x, axis=0), [i]) if i >= 0 else None


def rearranged(pool: Pool) -> Step | None:
    i = pool.pick(rank=pool.random.choice([1, 2]), boolean=pool.random.choice([False, None]))
    size = pool.components(i)[0]
    k = pool.random.randrange(-size, size)
    ways: list[Callable[..., Any]] = [
        lambda x: x[k],
        lambda x: x[::-1],
        lambda x: x[1:],
        lambda x: x[[0, k]],
        lambda x: x[None][0, ...],
        lambda x: np.stack(list(x)),
        lambda x: np.concatenate([x[1:], x[:1]]),
        lambda x: np.broadcast_to(x[0], x.shape),
        lambda x: x.reshape(-1, *x.shape[1:]),
    ]
    if len(pool.components(i)) == 2:
        ways += [
            lambda x: np.swapaxes(x, 0, 1),
            lambda x: x[:, k % x.shape[1]],
            lambda x: x[np.ix_([0, 1], [k % x.shape[1], 0])],
            lambda x: x.reshape(x.shape[0] * x.shape[1], *x.shape[2:]),
        ]
    return Step(pool.random.choice(ways), [i])


def joined(pool: Pool) -> Step | None:
    i = pool.pick(rank=pool.random.choice([0, 1, 2]))
    shape = pool.components(i)
    j = pool.pick(boolean=pool.random.choice([False, None]), like=shape)
    if shape and pool.random.random() < 0.5:
        return Step(lambda x, y: np.concatenate(np.broadcast_arrays(x, y)), [i, j])
    axis = pool.random.randrange(len(shape) + 1)
    return Step(lambda x, y: np.stack(np.broadcast_arrays(x, y), axis=axis), [i, j])


def assigned(pool: Pool) -> Step | None:
    """A copy that is changed in place."""
    i = pool.pick(rank=pool.random.choice([1, 2]))
    row = pool.components(i)[1:]
    j = pool.pick(like=row, boolean=pool.random.choice([False, None]))
    if j < 0:
        return None
    size = pool.components(i)[0]
    k = pool.random.randrange(-size, size)
    way = pool.random.randrange(7)

    def change(x: Any, y: Any) -> Any:
        x = full(x, y)
        if way == 0:
            x[k] = y
        elif way == 1:
            x[k] += y
        elif way == 2:
            x[1:] *= y
        elif way == 3:
            x -= y
        elif way == 4:
            view = x[k]
            view /= 2.0
        elif way == 5:
            for part in x:
                part *= 3.0
        else:
            x[1:, ...] = y
        return x

    return Step(change, [i, j])


def full(x: Any, y: Any) -> Any:
    """A copy with all batch axes that another value has."""
    return np.broadcast_to(x, np.broadcast_shapes(x.shape, (x.shape[0], *y.shape))).copy()


KINDS = [
    unary,
    unary,
    unary,
    binary,
    binary,
    binary,
    masks,
    choice,
    choice,
    branch,
    products,
    products,
    folds,
    folded_masks,
    rearranged,
    joined,
    assigned,
]
