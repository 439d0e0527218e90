"""Arrays of nodes, and NumPy's operations on them.

All entries of an array are numbers, or all are truth values.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from trackbench.engine.graph import COMPARISONS, Graph, Node

#: An array of nodes.
Nodes = npt.NDArray[Any]
#: NumPy types that are computed as doubles, as NumPy does in operations with doubles.
NUMBERS = frozenset({np.dtype(float), np.dtype(np.int64)})
#: Logical operation on truth values in place of an operation on numbers; others are refused or change the type.
OF_TRUTH_VALUES = {"add": "or", "mul": "and", "max": "or", "min": "and"}
#: Largest power that is written out as products.
LARGEST_POWER = 16


def nodes_of(graph: Graph, value: Any) -> Nodes:
    """Return an array, a number or a list of these as nodes of the graph; nodes stay unchanged.

    Raises:
        Untraceable: an entry is no number, or has another precision.
    """
    if isinstance(value, np.ndarray) and value.dtype == object:
        return value
    if isinstance(value, list | tuple):
        return np.stack(nodes_of_one_kind(graph, value)) if value else np.empty(0, dtype=object)
    array = np.asarray(value)
    if array.dtype == bool:
        return _filled([graph.constant(bool(entry)) for entry in array.flat], array.shape)
    if array.dtype not in NUMBERS:
        graph.refuse(f"an array of {array.dtype}")
    return _filled([graph.constant(float(entry)) for entry in array.flat], array.shape)


def is_boolean(nodes: Nodes) -> bool:
    """Return whether the entries of an array of nodes are truth values."""
    return nodes.size > 0 and bool(nodes.flat[0].boolean)


def cast(graph: Graph, nodes: Nodes, boolean: bool) -> Nodes:
    """Convert the entries to truth values if ``boolean``, else to numbers."""
    if is_boolean(nodes) == boolean:
        return nodes
    zero = graph.constant(0.0)
    # As in NumPy, every number but zero is true.
    entries = [graph.apply("ne", entry, zero) if boolean else graph.as_number(entry) for entry in nodes.flat]
    return _filled(entries, nodes.shape)


def nodes_of_one_kind(graph: Graph, values: Sequence[Any]) -> list[Nodes]:
    """Return several arrays as nodes of one kind: truth values if all are truth values, else numbers."""
    arrays = [nodes_of(graph, value) for value in values]
    boolean = all(is_boolean(array) for array in arrays)
    return [cast(graph, array, boolean) for array in arrays]


def elementwise(graph: Graph, op: str, *values: Any) -> Nodes:
    """Apply an operation entry by entry, with NumPy's broadcasting.

    Raises:
        Untraceable: NumPy does something else with truth values or with numbers, or refuses them.
    """
    if op in ("and", "or", "not"):
        arrays = [nodes_of(graph, value) for value in values]
        if not all(is_boolean(array) for array in arrays if array.size):
            graph.refuse(f"a logical operation ({op}) on numbers")
    elif op == "where":
        arrays = [cast(graph, nodes_of(graph, values[0]), True), *nodes_of_one_kind(graph, values[1:])]
    else:
        arrays = nodes_of_one_kind(graph, values)
        if any(is_boolean(array) for array in arrays):
            if op in OF_TRUTH_VALUES:
                op = OF_TRUTH_VALUES[op]
            elif op in COMPARISONS:
                arrays = [cast(graph, array, False) for array in arrays]
            else:
                graph.refuse(f"arithmetic ({op}) with truth values alone")
    if len(arrays) == 1:
        return _filled([graph.apply(op, entry) for entry in arrays[0].flat], arrays[0].shape)
    broadcast = np.broadcast(*arrays)
    return _filled([graph.apply(op, *entries) for entries in broadcast], broadcast.shape)


def folded(graph: Graph, op: str, nodes: Nodes, axes: Sequence[int], empty: float | bool | None) -> Nodes:
    """Apply an operation along axes; ``empty`` is its result for an array without entries.

    Raises:
        ValueError: there are no entries, and ``empty`` is None.
    """
    for axis in sorted(np.lib.array_utils.normalize_axis_tuple(axes, nodes.ndim), reverse=True):
        parts = np.moveaxis(nodes, axis, 0)
        if len(parts) == 0 and empty is None:
            raise ValueError("nothing has no largest or smallest")
        nodes = parts[0, ...].copy() if len(parts) else nodes_of(graph, np.full(parts.shape[1:], empty))
        for i in range(1, len(parts)):
            nodes = elementwise(graph, op, nodes, parts[i, ...])
    return nodes


def einsum(graph: Graph, spec: str, *values: Any) -> Nodes:
    """Compute a sum of products by Einstein's notation ``spec``; an ellipsis stands for axes that broadcast."""
    if "->" not in spec:
        graph.refuse("numpy.einsum without ->")
    inputs, _, wanted = spec.replace(" ", "").partition("->")
    names = inputs.split(",")
    arrays = nodes_of_one_kind(graph, values)
    if any(is_boolean(array) for array in arrays):
        graph.refuse("numpy.einsum of truth values alone")
    spread = [_ellipsis_last(of, array) for of, array in zip(names, arrays, strict=True)]
    rest = np.broadcast_shapes(*(shape for _, shape in spread))
    letters = [of.replace("...", "") for of in names]
    flat = [_flat_rest(array, len(of), rest) for of, (array, _) in zip(letters, spread, strict=True)]
    parts = [
        _sum_of_products(graph, letters, wanted.replace("...", ""), [array[..., place] for array in flat])
        for place in range(flat[0].shape[-1])
    ]
    result = np.stack(parts, axis=-1).reshape(parts[0].shape + rest)
    return _ellipsis_back(wanted, result, len(rest))


def _ellipsis_last(names: str, array: Nodes) -> tuple[Nodes, tuple[int, ...]]:
    """Move the axes of the ellipsis to the end of an array; return also the lengths of these axes."""
    named = len(names.replace("...", ""))
    count = array.ndim - named
    if count < 0 or (count and "..." not in names):
        raise ValueError(f"numpy.einsum: {names} of an array of {array.ndim} axes")
    first = names.find("...") if count else named
    moved = np.moveaxis(array, range(first, first + count), range(named, array.ndim))
    return moved, moved.shape[named:]


def _flat_rest(array: Nodes, named: int, rest: tuple[int, ...]) -> Nodes:
    """Broadcast the axes after the first ``named`` ones to the shape ``rest``, and flatten them to one axis."""
    lengths, missing = array.shape[:named], len(rest) - (array.ndim - named)
    padded = array.reshape(lengths + (1,) * missing + array.shape[named:])
    return np.broadcast_to(padded, lengths + rest).reshape(*lengths, -1)


def _ellipsis_back(wanted: str, result: Nodes, count: int) -> Nodes:
    if "..." not in wanted and count:
        raise ValueError(f"numpy.einsum: nothing in {wanted} stands for the axes of an ellipsis")
    named, first = result.ndim - count, wanted.find("...") if count else 0
    return np.moveaxis(result, range(named, result.ndim), range(first, first + count))


def _sum_of_products(graph: Graph, letters: Sequence[str], wanted: str, arrays: Sequence[Nodes]) -> Nodes:
    sizes: dict[str, int] = {}
    for names, array in zip(letters, arrays, strict=True):
        sizes |= {name: max(size, sizes.get(name, 1)) for name, size in zip(names, array.shape, strict=True)}
    summed = [name for name in sizes if name not in wanted]
    shape = tuple(sizes[name] for name in wanted)
    places = [dict(zip(summed, place, strict=True)) for place in np.ndindex(*(sizes[name] for name in summed))]

    def entry(at: dict[str, int]) -> Node:
        total = graph.constant(0.0)
        for inner in places:
            at |= inner
            factors = [array[tuple([at[name] for name in names])] for names, array in zip(letters, arrays, strict=True)]
            term = factors[0]
            for factor in factors[1:]:
                term = graph.apply("mul", term, factor)
            total = graph.apply("add", total, term)
        return total

    return _filled([entry(dict(zip(wanted, place, strict=True))) for place in np.ndindex(shape)], shape)


def power(graph: Graph, base: Any, exponent: Any) -> Nodes:
    """Compute an integer power by products, and the power of a half by a square root."""
    if isinstance(exponent, np.ndarray) and exponent.dtype == object:
        graph.refuse("a power that is known only later")
    if np.ndim(exponent) or (exponent != 0.5 and exponent != int(exponent)):
        graph.refuse("a power that is no whole number, and no half")
    if exponent == 0.5:
        return elementwise(graph, "sqrt", base)
    if is_boolean(nodes_of(graph, base)):
        graph.refuse("a power of truth values")
    count = int(exponent)
    if abs(count) > LARGEST_POWER:
        graph.refuse(f"a power above {LARGEST_POWER}")
    if count < 0:
        return elementwise(graph, "div", 1.0, power(graph, base, -count))
    if count == 0:
        return nodes_of(graph, np.ones(nodes_of(graph, base).shape))
    if count == 1:
        return elementwise(graph, "mul", base, 1.0)
    half = power(graph, base, count // 2)
    square = elementwise(graph, "mul", half, half)
    return elementwise(graph, "mul", square, base) if count % 2 else square


def _filled(entries: Sequence[Node], shape: tuple[int, ...]) -> Nodes:
    return np.fromiter(entries, dtype=object, count=len(entries)).reshape(shape)
