"""Transcendental functions by arithmetic alone, so that every machine computes the same bits.

The engine compiles them; NumPy evaluates the same operations where scans are made.

Coefficients: W. J. Cody and W. Waite (1980), "Software Manual for the Elementary Functions", in the form of FreeBSD's
msun. ``ERROR`` holds the largest errors that the tests find.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from trackbench.base.types import Array
from trackbench.engine.graph import Graph, Node, ordered

#: Largest errors against correctly rounded values, in units in the last place.
ERROR = {"sin": 2.5, "cos": 2.5, "arctan2": 2.5, "exp": 1.0, "log": 1.0, "hypot": 1.5}
#: Addend that rounds a number below 2^51 to a whole number in the last bits.
WHOLE = 1.5 * 2.0**52
#: Largest angle, rad, for which the multiple of pi/2 in parts is exact.
LARGEST_ANGLE = 2.0**20
#: Range in which a sum of two squares keeps all its digits.
SMALLEST_SQUARE, LARGEST_SQUARE = 1e-280, 1e300
#: pi/2 in three parts of 33 bits, and the remainder. Source: FreeBSD msun, e_rem_pio2.c.
QUARTER_TURN = (
    1.57079632673412561417e00,
    6.07710050630396597660e-11,
    2.02226624871116645580e-21,
    8.47842766036889956997e-32,
)
#: Coefficients of the arc tangent, the highest power first: those of even index, then those of odd index.
ATAN = (
    (
        1.62858201153657823623e-02,
        4.97687799461593236017e-02,
        6.66107313738753120669e-02,
        9.09088713343650656196e-02,
        1.42857142725034663711e-01,
        3.33333333333329318027e-01,
    ),
    (
        -3.65315727442169155270e-02,
        -5.83357013379057348645e-02,
        -7.69187620504482999495e-02,
        -1.11111104054623557880e-01,
        -1.99999999998764832476e-01,
    ),
)
#: Angles whose tangents are 1/2 and 1, each a double and its remainder.
ATAN_HALF = (4.63647609000806093515e-01, 2.26987774529616870924e-17)
ATAN_ONE = (7.85398163397448278999e-01, 3.06161699786838301793e-17)
SIN = (
    1.58969099521155010221e-10,
    -2.50507602534068634195e-08,
    2.75573137070700676789e-06,
    -1.98412698298579493134e-04,
    8.33333333332248946124e-03,
    -1.66666666666666324348e-01,
)
COS = (
    -1.13596475577881948265e-11,
    2.08757232129817482790e-09,
    -2.75573143513906633035e-07,
    2.48015872894767294178e-05,
    -1.38888888888741095749e-03,
    4.16666666666666019037e-02,
)
EXP = (
    4.13813679705723846039e-08,
    -1.65339022054652515390e-06,
    6.61375632143793436117e-05,
    -2.77777777770155933842e-03,
    1.66666666666666019037e-01,
)
LOG = (
    1.479819860511658591e-01,
    1.531383769920937332e-01,
    1.818357216161805012e-01,
    2.222219843214978396e-01,
    2.857142874366239149e-01,
    3.999999999940941908e-01,
    6.666666666666735130e-01,
)
LN2_HIGH, LN2_LOW = 6.93147180369123816490e-01, 1.90821492927058770002e-10


def _operator(op: str) -> Callable[[Any, Term | float], Term]:
    return lambda self, other: _apply(self.graph, op, self, other)


@dataclass(frozen=True)
class Term:
    """Node of an expression graph, with Python's operators, so that equations read as formulas."""

    graph: Graph
    node: Node

    __add__, __sub__, __mul__, __truediv__ = map(_operator, ("add", "sub", "mul", "div"))
    __gt__, __lt__ = map(_operator, ("gt", "lt"))

    def __rsub__(self, other: float) -> Term:
        return _apply(self.graph, "sub", other, self)

    def __rtruediv__(self, other: float) -> Term:
        return _apply(self.graph, "div", other, self)


def _apply(graph: Graph, op: str, *values: Term | float) -> Term:
    nodes = [value.node if isinstance(value, Term) else graph.constant(value) for value in values]
    return Term(graph, graph.apply(op, *nodes))


def _where(condition: Term, yes: Term | float, no: Term | float) -> Term:
    return _apply(condition.graph, "where", condition, yes, no)


def polynomial(x: Any, coefficients: Sequence[float]) -> Any:
    """Evaluate a polynomial of a term or an array; the coefficient of the highest power comes first."""
    result = x * coefficients[0] + coefficients[1] if coefficients[0] != 1.0 else x + coefficients[1]
    for coefficient in coefficients[2:]:
        result = result * x + coefficient
    return result


def _leave_to_numpy(condition: Term) -> None:
    """Add a guard (run-time check) that ``condition`` is False; NumPy computes the members for which it is True."""
    condition.graph.guards.append(_apply(condition.graph, "not", condition).node)


def _quarter_turns(x: Term) -> tuple[Term, Term]:
    """Return an angle's number of quarter turns plus ``WHOLE``, and the remaining angle, from -pi/4 to pi/4."""
    graph = x.graph
    _leave_to_numpy(_apply(graph, "abs", x) > LARGEST_ANGLE)
    whole = x * 0.6366197723675814 + WHOLE
    turns, rest = whole - WHOLE, x
    for part in QUARTER_TURN:
        rest = rest - turns * part
    return whole, rest


def _circular(x: Term, shift: float) -> Term:
    whole, rest = _quarter_turns(x)
    whole, square = whole + shift, rest * rest
    cosine = 1.0 - (square * 0.5 - square * square * polynomial(square, COS))
    sine = rest + rest * square * polynomial(square, SIN)
    value = _where(_apply(x.graph, "bit0", whole), cosine, sine)
    # Two quarter turns change the sign.
    return _where(_apply(x.graph, "bit1", whole), _apply(x.graph, "neg", value), value)


def sin(x: Term) -> Term:
    """Return the sine of an angle in rad."""
    return _circular(x, 0.0)


def cos(x: Term) -> Term:
    """Return the cosine of an angle in rad."""
    return _circular(x, 1.0)


def arctan2(y: Term, x: Term) -> Term:
    """Return the angle of the point (x, y), from -pi to pi."""
    graph = y.graph
    width, height = _apply(graph, "abs", x), _apply(graph, "abs", y)
    small, large = _apply(graph, "min", width, height), _apply(graph, "max", width, height)
    _leave_to_numpy(_apply(graph, "eq", large, float("inf")))
    large = _where(_apply(graph, "eq", large, 0.0), 1.0, large)
    # Tangent of the angle, or of its excess over the angle whose tangent is 1/2 or 1.
    over_half, over_one = small > large * 0.4375, small > large * 0.6875
    above = _where(over_one, small - large, _where(over_half, small * 2.0 - large, small))
    below = _where(over_one, small + large, _where(over_half, large * 2.0 + small, large))
    near, rest = (_where(over_one, ATAN_ONE[i], _where(over_half, ATAN_HALF[i], 0.0)) for i in (0, 1))
    ratio = above / below
    square = ratio * ratio
    even, odd = (polynomial(square * square, coefficients) for coefficients in ATAN)
    angle = near - ((ratio * (square * (even + square * odd)) - rest) - ratio)
    angle = _where(height > width, 1.5707963267948966 - (angle - 6.123233995736766e-17), angle)
    angle = _where(_apply(graph, "negative", x), 3.141592653589793 - (angle - 1.2246467991473532e-16), angle)
    return _apply(graph, "copysign", angle, y)


def exp(x: Term) -> Term:
    graph = x.graph
    bounded = _apply(graph, "max", _apply(graph, "min", x, 710.0), -746.0)
    power = _apply(graph, "rint", bounded * 1.4426950408889634)
    # NaN has no whole power.
    power = _where(_apply(graph, "eq", power, power), power, 0.0)
    high, low = bounded - power * LN2_HIGH, power * LN2_LOW
    rest = high - low
    square = rest * rest
    change: Term = rest - square * polynomial(square, EXP)
    near = 1.0 - ((low - rest * change / (2.0 - change)) - high)
    # Two factors, since a single power of two may overflow or underflow.
    first = _apply(graph, "floor", power * 0.5)
    return near * _apply(graph, "power2", first) * _apply(graph, "power2", power - first)


def log(x: Term) -> Term:
    """Return the natural logarithm; NaN for a negative number, -inf for zero."""
    graph = x.graph
    tiny = x < 2.2250738585072014e-308
    scaled = _where(tiny, x * 2.0**54, x)
    exponent, fraction = _apply(graph, "exponent", scaled), _apply(graph, "fraction", scaled)
    upper = fraction > 1.4142135623730951
    fraction = _where(upper, fraction * 0.5, fraction)
    exponent = exponent + _where(upper, 1.0, 0.0) - _where(tiny, 54.0, 0.0)
    near = fraction - 1.0
    share = near / (near + 2.0)
    square = share * share
    series = square * polynomial(square, LOG)
    half = near * near * 0.5
    result = exponent * LN2_HIGH - ((half - (share * (half + series) + exponent * LN2_LOW)) - near)
    result = _where(x < float("inf"), result, x)
    result = _where(x > 0.0, result, _where(_apply(graph, "eq", x, 0.0), float("-inf"), float("nan")))
    return _where(_apply(graph, "ne", x, x), x, result)


def hypot(x: Term, y: Term) -> Term:
    """Return the length of the vector (x, y)."""
    graph = x.graph
    square = x * x + y * y
    # Smaller and larger squares lose bits.
    both_zero = _apply(graph, "and", *(_apply(graph, "eq", side, 0.0) for side in (x, y)))
    lost = _apply(graph, "and", square < SMALLEST_SQUARE, _apply(graph, "not", both_zero))
    # A vector with an infinite component has infinite length, even where the other component is NaN.
    infinite = [_apply(graph, "eq", _apply(graph, "abs", side), float("inf")) for side in (x, y)]
    for condition in (lost, square > LARGEST_SQUARE, *infinite):
        _leave_to_numpy(condition)
    return _apply(graph, "sqrt", square)


FUNCTIONS: dict[str, Callable[..., Term]] = {
    "sin": sin,
    "cos": cos,
    "arctan2": arctan2,
    "exp": exp,
    "log": log,
    "hypot": hypot,
}


def lowered(graph: Graph, roots: Sequence[Node]) -> list[Node]:
    """Replace transcendental functions in ``roots`` and in the graph's guards (run-time checks) by arithmetic.

    Further guards can be added to the graph.
    """
    lowered_nodes: dict[int, Node] = {}
    guards, graph.guards = graph.guards, []
    for node in ordered([*roots, *guards]):
        arguments = tuple([lowered_nodes[argument.number] for argument in node.arguments])
        if node.op in FUNCTIONS:
            lowered_nodes[node.number] = FUNCTIONS[node.op](*(Term(graph, argument) for argument in arguments)).node
        else:
            lowered_nodes[node.number] = node if arguments == node.arguments else graph.apply(node.op, *arguments)
    graph.guards = list(dict.fromkeys([*(lowered_nodes[guard.number] for guard in guards), *graph.guards]))
    return [lowered_nodes[root.number] for root in roots]


#: NumPy function for each operation of ``arctan2``.
OPERATIONS: dict[str, Callable[..., Any]] = {
    "add": np.add,
    "sub": np.subtract,
    "mul": np.multiply,
    "div": np.divide,
    "abs": np.abs,
    "min": np.minimum,
    "max": np.maximum,
    "gt": np.greater,
    "eq": np.equal,
    "not": np.logical_not,
    "where": np.where,
    "negative": np.signbit,
    "copysign": np.copysign,
}


class Immediate:
    """Stand-in for a graph whose operations are computed at once, on arrays."""

    def __init__(self) -> None:
        self.guards: list[Any] = []

    def constant(self, value: float) -> float:
        return value

    def apply(self, op: str, *values: Any) -> Any:
        return OPERATIONS[op](*values)


class ByArithmetic(np.ndarray[Any, np.dtype[np.float64]]):
    """Array whose ``numpy.arctan2`` is computed by arithmetic, as NumPy's bits differ between processors."""

    def __array_ufunc__(self, ufunc: np.ufunc, method: Any, *inputs: Any, **options: Any) -> Any:
        if "out" in options:
            options["out"] = tuple(map(_plain, options["out"]))
        if "where" in options:
            options["where"] = _plain(options["where"])
        inputs = tuple(map(_plain, inputs))
        if ufunc is np.arctan2 and method == "__call__" and not options:
            result = _angles(*np.broadcast_arrays(*inputs))
        else:
            result = getattr(ufunc, method)(*inputs, **options)
        return by_arithmetic(result) if isinstance(result, np.ndarray) else result


def _angles(y: Array, x: Array) -> Array:
    """Compute the angles of the points (x, y) in arrays of one shape, with the same bits as :func:`arctan2`.

    A ratio of at most 7/16 needs neither a reduction of the angle nor a guard, so the polynomial alone is computed.
    """
    height = np.abs(y)
    with np.errstate(all="ignore"):
        ratio = height / x
        square = ratio * ratio
        even, odd = (polynomial(square * square, coefficients) for coefficients in ATAN)
        result: Array = np.copysign(ratio - ratio * (square * (even + square * odd)), y)
    is_general = ~((height <= x * 0.4375) & (x > 0.0) & (x < np.inf))
    if is_general.any():
        graph: Any = Immediate()
        y, x = y[is_general], x[is_general]
        with np.errstate(all="ignore"):
            angle: Any = arctan2(*(Term(graph, value) for value in (y, x))).node  # type: ignore[arg-type]
        result[is_general] = np.where(np.logical_and.reduce(graph.guards), angle, np.arctan2(y, x))
    return result


def _plain(value: Any) -> Any:
    return np.asarray(value) if isinstance(value, ByArithmetic) else value


def by_arithmetic(values: npt.ArrayLike) -> Array:
    """Return numbers as an array whose ``numpy.arctan2`` gives the same bits on every processor."""
    return np.asarray(values).view(ByArithmetic)
