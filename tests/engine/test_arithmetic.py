"""The transcendental functions that kernels compute, against correctly rounded values and NumPy's special cases."""

from collections.abc import Callable
from itertools import product
from typing import Any

import numpy as np
import pytest

from trackbench.engine.arithmetic import ERROR, LARGEST_ANGLE, LARGEST_SQUARE, SMALLEST_SQUARE, by_arithmetic
from trackbench.engine.equations import Equations, Values
from trackbench.engine.kernels import Kernels

FUNCTIONS: dict[str, Any] = {name: getattr(np, name) for name in ERROR}
#: The same in extended precision, of which a double is a rounding.
WIDE = np.finfo(np.longdouble).nmant > np.finfo(float).nmant
SMALLEST, TINY, LARGEST = 5e-324, np.finfo(float).tiny, np.finfo(float).max
SPECIAL = [0.0, SMALLEST, 3e-310, TINY, 1e-200, 1e-9, 0.5, 1.0, np.pi / 4, np.pi / 2, np.pi, 40.0, 1e9, 1e200, LARGEST]
EVERY_SIGN = np.array([sign * value for value in [*SPECIAL, np.inf, np.nan] for sign in (1.0, -1.0)])
ANGLES = ("sin", "cos")
#: How many examples of a kind are tried.
SIZE = 50_000


def computed(kernels: Kernels, name: str, *arguments: Any) -> np.ndarray:
    """A function of NumPy by a kernel, none of it by NumPy."""
    names = [f"x{i}" for i in range(len(arguments))]
    equations = Equations(
        name, lambda values: {"y": FUNCTIONS[name](*(values[x] for x in names))}, dict.fromkeys(names, 0), key=name
    )
    before = kernels.members_by_numpy
    found = kernels(equations, dict(zip(names, arguments, strict=True)))["y"]
    finite = np.isfinite(FUNCTIONS[name](*arguments))
    assert kernels.members_by_numpy - before <= np.sum(~finite)
    return found


def error(found: np.ndarray, function: Callable[..., Any], *arguments: Any) -> float:
    """The largest error in units in the last place of the correctly rounded value."""
    if not WIDE:
        pytest.skip("this machine has no numbers of extended precision")
    exact = function(*(np.asarray(item, dtype=np.longdouble) for item in arguments))
    return float(np.max(np.abs(found - exact) / np.spacing(np.abs(exact.astype(float)))))


def spread(rng: np.random.Generator, low: float, high: float, size: int) -> np.ndarray:
    """Numbers of both signs, evenly spread over orders of magnitude."""
    return rng.choice([-1.0, 1.0], size) * 10.0 ** rng.uniform(low, high, size)


def near(rng: np.random.Generator, size: int) -> np.ndarray:
    """Angles at and beside multiples of pi/2."""
    multiples = np.rint(spread(rng, 0, np.log10(LARGEST_ANGLE / 2), size)) * (np.pi / 2)
    return multiples + np.spacing(multiples) * rng.integers(-40, 40, size)


@pytest.mark.parametrize("name", ANGLES)
def test_angles(kernels: Kernels, name: str) -> None:
    rng = np.random.default_rng(1)
    x = np.concatenate(
        [
            rng.uniform(-4, 4, SIZE),
            spread(rng, -320, 0, SIZE),
            spread(rng, 0, np.log10(LARGEST_ANGLE), SIZE),
            near(rng, SIZE),
            np.arange(-SIZE, SIZE) * (np.pi / 4),
        ]
    )
    assert error(computed(kernels, name, x), FUNCTIONS[name], x) <= ERROR[name]


def test_directions(kernels: Kernels) -> None:
    rng = np.random.default_rng(2)
    for y, x in (
        rng.normal(size=(2, SIZE)),
        spread(rng, -2, 2, 2 * SIZE).reshape(2, SIZE),
        spread(rng, -100, 100, 2 * SIZE).reshape(2, SIZE),
        rng.integers(-9, 10, (2, SIZE)).astype(float),
    ):
        assert error(computed(kernels, "arctan2", y, x), np.arctan2, y, x) <= ERROR["arctan2"]


def test_exponentials_and_logarithms(kernels: Kernels) -> None:
    rng = np.random.default_rng(3)
    x = np.concatenate([rng.uniform(-1, 1, SIZE), rng.uniform(-708, 709, SIZE), spread(rng, -320, 0, SIZE)])
    assert error(computed(kernels, "exp", x), np.exp, x) <= ERROR["exp"]
    x = np.concatenate(
        [rng.uniform(0.5, 2, SIZE), np.abs(spread(rng, -320, 308, SIZE)), 1 + spread(rng, -16, -1, SIZE)]
    )
    assert error(computed(kernels, "log", x), np.log, x) <= ERROR["log"]


def test_lengths(kernels: Kernels) -> None:
    rng = np.random.default_rng(4)
    for x, y in (
        rng.normal(size=(2, SIZE)),
        spread(rng, -2, 2, 2 * SIZE).reshape(2, SIZE),
        spread(rng, -139, 149, 2 * SIZE).reshape(2, SIZE),
    ):
        assert error(computed(kernels, "hypot", x, y), np.hypot, x, y) <= ERROR["hypot"]


@pytest.mark.parametrize("size", [1e-320, 1e-160, 1e151, 1e307])
def test_lengths_whose_squares_are_lost_are_left_to_numpy(kernels: Kernels, size: float) -> None:
    x = size * np.arange(1.0, 5.0) / 4.0
    equations = Equations("length", lambda values: {"y": np.hypot(values["x"], values["x"])}, {"x": 0}, key="length")
    before = kernels.members_by_numpy
    np.testing.assert_array_equal(kernels(equations, {"x": x})["y"], np.hypot(x, x))
    assert kernels.members_by_numpy - before == len(x)


@pytest.mark.parametrize("name", ERROR)
def test_special_values_are_those_of_numpy(kernels: Kernels, name: str) -> None:
    arguments = [EVERY_SIGN]
    if name in ("arctan2", "hypot"):
        arguments = list(np.array(list(product(EVERY_SIGN, repeat=2))).T)
    elif name in ANGLES:
        arguments = [EVERY_SIGN[~(np.abs(EVERY_SIGN) > LARGEST_ANGLE)]]
    names = [f"x{i}" for i in range(len(arguments))]

    def finite(values: Values) -> Values:
        """What is not finite as masks, since NumPy would compute again the members with such an output."""
        y = FUNCTIONS[name](*(values[x] for x in names))
        infinite, finite = np.abs(y) == np.inf, np.where(np.isfinite(y), y, 1.0)
        return {"NaN": np.isnan(y), "infinite": infinite, "negative": y < 0, "y": finite}

    equations = Equations(name, finite, dict.fromkeys(names, 0), key=("special", name))
    values = dict(zip(names, arguments, strict=True))
    before = kernels.members_by_numpy
    with np.errstate(all="ignore"):
        expected, found = finite(values), kernels(equations, values)
    with np.errstate(all="ignore"):
        square = np.sum(np.square(arguments), axis=0)
    lost = {
        "arctan2": np.isinf(arguments).any(axis=0),
        "hypot": (square < SMALLEST_SQUARE) | (square > LARGEST_SQUARE) | np.isinf(arguments).any(axis=0),
    }
    assert kernels.members_by_numpy - before <= np.sum(lost.get(name, 0))
    for mask in ("NaN", "infinite", "negative"):
        np.testing.assert_array_equal(found[mask], expected[mask], err_msg=mask)
    np.testing.assert_allclose(found["y"], expected["y"], rtol=1e-15, atol=0)


def test_a_direction_has_the_sign_of_its_second_coordinate(kernels: Kernels) -> None:
    y, x = np.array(list(product([0.0, -0.0], [0.0, -0.0, 1.0, -1.0, 1e-310, -LARGEST]))).T
    found = computed(kernels, "arctan2", y, x)
    np.testing.assert_array_equal(found, np.arctan2(y, x))
    np.testing.assert_array_equal(np.signbit(found), np.signbit(y))


@pytest.mark.parametrize("name", ["sin", "cos"])
def test_beyond_the_largest_angle_numpy_computes(kernels: Kernels, name: str) -> None:
    x = np.array([1.0, np.nextafter(LARGEST_ANGLE, np.inf), 1e300, -1e22])
    equations = Equations(name, lambda values: {"y": FUNCTIONS[name](values["x"])}, {"x": 0}, key=("beyond", name))
    before = kernels.members_by_numpy
    found = kernels(equations, {"x": x})["y"]
    assert kernels.members_by_numpy - before == 3
    np.testing.assert_array_equal(found[1:], FUNCTIONS[name](x[1:]))


def test_numpy_evaluates_the_same_arithmetic() -> None:
    rng = np.random.default_rng(5)
    y, x = spread(rng, -5, 5, SIZE), spread(rng, -5, 5, SIZE)
    evaluated = np.asarray(np.arctan2(by_arithmetic(y), x))
    assert error(evaluated, np.arctan2, y, x) <= ERROR["arctan2"]
    assert np.asarray(np.arctan2(y, by_arithmetic(x))).tobytes() == evaluated.tobytes()
    y, x = np.array([*product(EVERY_SIGN, EVERY_SIGN)]).T
    special = np.asarray(np.arctan2(by_arithmetic(y), x))
    np.testing.assert_allclose(special, np.arctan2(y, x), rtol=1e-15, atol=0)
    np.testing.assert_array_equal(np.signbit(special[~np.isnan(special)]), np.signbit(y[~np.isnan(special)]))
