"""Traces of equations as graphs; products with zero are left out, on condition that the other factor is finite."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from trackbench.engine.arithmetic import lowered
from trackbench.engine.equations import Equations
from trackbench.engine.graph import Graph, Node, Untraceable, ordered, with_fused_sums
from trackbench.engine.layout import Input, KernelLayout, Output
from trackbench.engine.nodes import Nodes, is_boolean
from trackbench.engine.symbols import Symbol, nodes_of_output

#: Operations that are not finite where an argument is not (div and copysign: the first argument).
CARRYING = frozenset({"add", "sub", "mul", "neg", "abs", "sqrt", "floor", "ceil", "rint", "copysign", "div"})


def _finite_conditions(
    graph: Graph, counted: Mapping[str, str], outputs: Mapping[str, Sequence[Node]], dropped: Iterable[Node]
) -> list[Node]:
    """Return the conditions that all outputs and all dropped nodes are finite.

    A sum is finite only if all of its terms are, so one comparison is enough; where a sum overflows, NumPy recomputes
    the member needlessly.

    Args:
        graph: graph that gets the conditions.
        counted: name of the mask outside which an input or output means nothing, by the name of that input or output.
        outputs: components of each output by name.
        dropped: nodes that were left out of products with zero.
    """
    sums: dict[frozenset[str], dict[int, Node]] = {}
    for name, nodes in outputs.items():
        masks = frozenset({counted[name]} if name in counted else ())
        sums.setdefault(masks, {}).update((node.number, node) for node in nodes if not node.boolean)
    carried = _nodes_carried_by(sums.get(frozenset(), {}).values())
    left = [node for node in dropped if node.number not in carried]
    depends = _masks_needed_by(counted, outputs, left)
    for node in left:
        sums.setdefault(depends[node.number], {})[node.number] = node
    return [_finite(graph, masks, nodes.values()) for masks, nodes in sums.items()]


def _finite(graph: Graph, masks: Iterable[str], nodes: Iterable[Node]) -> Node:
    total = graph.constant(0.0)
    for node in nodes:
        total = graph.apply("add", total, node)
    result = graph.apply("lt", graph.apply("abs", total), graph.constant(float("inf")))
    for mask in sorted(masks):
        symbol = graph.first_component(mask)
        result = result if symbol is None else graph.apply("or", result, graph.apply("not", symbol))
    return result


def _nodes_carried_by(nodes: Iterable[Node]) -> set[int]:
    """Return the numbers of all nodes in whose place an infinity or NaN would show in one of ``nodes``."""
    waiting, carried = list(nodes), set[int]()
    while waiting:
        node = waiting.pop()
        if node.number not in carried:
            carried.add(node.number)
            if node.op in CARRYING:
                waiting += node.arguments[: 1 if node.op in ("div", "copysign") else None]
    return carried


def _masks_needed_by(
    counted: Mapping[str, str], outputs: Mapping[str, Sequence[Node]], nodes: Sequence[Node]
) -> dict[int, frozenset[str]]:
    """Return by node number the names of the masks outside which a node, or a value in it, means nothing."""
    of_outputs = {
        node.number: counted[name] for name, of in outputs.items() if name in counted for node in of if node.arguments
    }
    result: dict[int, frozenset[str]] = {}
    for node in ordered(nodes):
        masks = {mask for argument in node.arguments for mask in result[argument.number]}
        if node.number in of_outputs:
            masks.add(of_outputs[node.number])
        if isinstance(node.value, tuple) and node.value[0] in counted:
            masks.add(counted[node.value[0]])
        result[node.number] = frozenset(masks)
    return result


class Trace(NamedTuple):
    """Outputs of traced equations for one member of a batch as nodes of a graph, with a guard (run-time check)."""

    layout: KernelLayout
    outputs: list[Node]
    """Nodes of the outputs' components, in the order of the layout."""
    guard: Node
    """Condition on a member of the batch under which the outputs are right for it."""


def trace(equations: Equations, inputs: Sequence[Input]) -> Trace:
    """Trace equations: call their function once with symbols, as for a batch of one member.

    Raises:
        Untraceable: the function does something that cannot be traced.
    """
    graph = Graph()
    for item in inputs:
        if item.kind not in ("d", "?"):
            graph.refuse(f"{item.name}, which is not given as doubles")
    symbols = {item.name: _symbol(graph, equations, item) for item in inputs}
    axes = max((item.batch_axes for item in inputs), default=0)
    try:
        outputs: Any = equations.function(symbols)
        result = {
            name: _without_batch_axes(graph, name, nodes_of_output(graph, value), axes)
            for name, value in outputs.items()
            if value is not None
        }
    except Untraceable:
        raise
    # Whatever a user's function raises on symbols, it cannot be traced.
    except Exception as error:
        raise Untraceable(graph.refused or f"{type(error).__name__}: {error}") from error
    if graph.refused is not None:
        raise Untraceable(graph.refused)
    return _finish(graph, equations, inputs, result)


def _symbol(graph: Graph, equations: Equations, item: Input) -> Symbol:
    nodes = np.empty(item.shape, dtype=object)
    for number, place in enumerate(np.ndindex(item.shape)):
        nodes[place] = graph.input(item.name, number, level=item.level, boolean=item.boolean)
    if item.name in equations.symmetric:
        for i, j in np.ndindex(item.shape):
            nodes[i, j] = nodes[max(i, j), min(i, j)]
    nodes = nodes.reshape(item.shape + (1,) * item.batch_axes)
    # Equations must not write into their inputs.
    nodes.flags.writeable = False
    return Symbol(graph, nodes)


def _without_batch_axes(graph: Graph, name: str, nodes: Nodes, axes: int) -> Nodes:
    first = nodes.ndim - axes
    if nodes.ndim and (first < 0 or nodes.shape[first:] != (1,) * axes):
        graph.refuse(f"{name} of shape {nodes.shape}, which does not end with the batch axes")
    return nodes.reshape(nodes.shape[: max(0, first)])


def _finish(graph: Graph, equations: Equations, inputs: Sequence[Input], result: dict[str, Nodes]) -> Trace:
    nodes: list[Node] = [node for array in result.values() for node in array.flat]
    dropped = list(graph.dropped.values())
    graph.dropped = {}
    every = iter(lowered(graph, [*nodes, *dropped]))
    parts = {name: [next(every) for _ in range(array.size)] for name, array in result.items()}
    dropped = [*every, *graph.dropped.values()]
    # Equal outputs are written once.
    first: dict[tuple[object, ...], str] = {}
    modes = {name: equations.modes.get(name, "") for name in result}
    same = {name: first.setdefault((modes[name], result[name].shape, *parts[name]), name) for name in result}
    written = [
        Output(name, array.shape, is_boolean(array), modes[name])
        for name, array in result.items()
        if same[name] == name
    ]
    outputs = [node for output in written for node in parts[output.name]]
    guard = graph.all_of([*graph.guards, *_finite_conditions(graph, equations.counted, parts, dropped)])
    *outputs, guard = with_fused_sums(graph, [*outputs, guard])
    used = {node.value[0] for node in ordered([*outputs, guard]) if isinstance(node.value, tuple)}
    copies = {name: original for name, original in same.items() if name != original}
    layout = KernelLayout(tuple(item for item in inputs if item.name in used), tuple(written), copies)
    return Trace(layout, outputs, guard)
