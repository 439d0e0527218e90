"""Substitutes for NumPy functions on arrays of nodes, each with the graph as first argument."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np

from trackbench.engine.graph import Graph, Node
from trackbench.engine.nodes import (
    Nodes,
    cast,
    einsum,
    elementwise,
    folded,
    is_boolean,
    nodes_of,
    nodes_of_one_kind,
    power,
)

#: Result of a fold over no entries, by operation.
EMPTY = {"add": 0.0, "mul": 1.0, "and": True, "or": False, "max": None, "min": None}


def _fold(graph: Graph, values: Any, axis: Any = None, *, op: str) -> Nodes:
    nodes = nodes_of(graph, values)
    if axis is None and not all(node.uniform for node in nodes.flat):
        graph.refuse("one value of all axes, those of the batch among them; state the axis")
    nodes = cast(graph, nodes, False) if op in ("add", "mul") else nodes
    return folded(graph, op, nodes, _axes(nodes, axis), EMPTY[op])


def _hold(graph: Graph, values: Any, axis: Any = None, *, op: str) -> Any:
    """Trace ``np.all`` or ``np.any``: along axes as nodes of the graph; without axes as the bool of an ``if``.

    An ``if`` in the traced function is followed as if all entries were true, or none. A guard checks this at run time.
    An ``if`` on input masks alone has no guard: ``all`` counts as False and ``any`` as True, as in a mixed batch.
    """
    nodes = cast(graph, nodes_of(graph, values), True)
    result = folded(graph, op, nodes, _axes(nodes, axis), EMPTY[op])
    if axis is not None:
        return result
    node: Node = result.item()
    expected = op == "and"
    if node.constant:
        return bool(node.value)
    if depends_on_masks_alone(node):
        return not expected
    graph.guards.append(node if expected else graph.apply("not", node))
    return expected


def depends_on_masks_alone(node: Node) -> bool:
    return node.boolean and (all(map(depends_on_masks_alone, node.arguments)) if node.arguments else node.op == "input")


def _axes(nodes: Nodes, axis: Any) -> Sequence[int]:
    if axis is None:
        return range(nodes.ndim)
    return axis if isinstance(axis, tuple) else (axis,)


def _operation(op: str) -> Callable[..., Nodes]:
    return lambda graph, *values: elementwise(graph, op, *values)


def _matmul(graph: Graph, a: Any, b: Any) -> Nodes:
    a, b = nodes_of(graph, a), nodes_of(graph, b)
    if not (a.ndim and b.ndim):
        raise ValueError("numpy.matmul of a number")
    left, right = "...ij" if a.ndim > 1 else "j", "...jk" if b.ndim > 1 else "j"
    return einsum(graph, f"{left},{right}->...{'i' * (a.ndim > 1)}{'k' * (b.ndim > 1)}", a, b)


def _where(graph: Graph, condition: Any, *choices: Any) -> Nodes:
    if len(choices) != 2:
        graph.refuse("numpy.where of a condition alone")
    return elementwise(graph, "where", condition, *choices)


def _clip(graph: Graph, values: Any, low: Any, high: Any) -> Nodes:
    above = values if low is None else elementwise(graph, "max", values, low)
    return above if high is None else elementwise(graph, "min", above, high)


def _zeros_like(graph: Graph, like: Nodes, dtype: Any = None, shape: Any = None) -> Nodes:
    boolean = is_boolean(like) if dtype is None else np.dtype(dtype) == bool
    entries = cast(graph, nodes_of(graph, 0.0), boolean)
    return np.broadcast_to(entries, like.shape if shape is None else shape).copy()


def _moving(function: Callable[..., Any], as_nodes: Callable[[Graph, Any], Any] = nodes_of) -> Callable[..., Any]:
    """Return the substitute for a NumPy function that only moves or counts an array's entries."""
    return lambda graph, values, *places, **options: function(as_nodes(graph, values), *places, **options)


#: Operation on each entry, by NumPy function.
OPERATIONS = {
    np.add: "add",
    np.subtract: "sub",
    np.multiply: "mul",
    np.true_divide: "div",
    np.negative: "neg",
    np.absolute: "abs",
    np.sqrt: "sqrt",
    np.floor: "floor",
    np.ceil: "ceil",
    np.rint: "rint",
    np.maximum: "max",
    np.minimum: "min",
    np.sin: "sin",
    np.cos: "cos",
    np.arctan2: "arctan2",
    np.hypot: "hypot",
    np.exp: "exp",
    np.log: "log",
    np.less: "lt",
    np.less_equal: "le",
    np.greater: "gt",
    np.greater_equal: "ge",
    np.equal: "eq",
    np.not_equal: "ne",
    np.bitwise_and: "and",
    np.bitwise_or: "or",
    np.invert: "not",
}

FUNCTIONS: dict[Any, Callable[..., Any]] = {
    **{function: _operation(op) for function, op in OPERATIONS.items()},
    np.power: power,
    np.square: lambda graph, x: power(graph, x, 2),
    np.isfinite: lambda graph, x: elementwise(graph, "lt", elementwise(graph, "abs", x), np.inf),
    np.isnan: lambda graph, x: elementwise(graph, "ne", x, x),
    np.matmul: _matmul,
    np.einsum: einsum,
    np.where: _where,
    np.clip: _clip,
    np.concatenate: _moving(np.concatenate, nodes_of_one_kind),
    np.stack: _moving(np.stack, nodes_of_one_kind),
    np.broadcast_arrays: lambda graph, *values: np.broadcast_arrays(*(nodes_of(graph, value) for value in values)),
    np.broadcast_to: _moving(np.broadcast_to),
    np.swapaxes: _moving(np.swapaxes),
    np.reshape: _moving(np.reshape),
    np.copy: _moving(np.copy),
    np.zeros_like: _zeros_like,
    np.sum: partial(_fold, op="add"),
    np.prod: partial(_fold, op="mul"),
    np.max: partial(_fold, op="max"),
    np.min: partial(_fold, op="min"),
    np.all: partial(_hold, op="and"),
    np.any: partial(_hold, op="or"),
    np.ndim: _moving(np.ndim),
}
