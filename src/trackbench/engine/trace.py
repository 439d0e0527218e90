"""Equations as a graph; products with zero are left out of it on the condition that the other factor is finite."""

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

#: Operations that are not finite where an argument is not; of a quotient that holds of the first one.
CARRYING = frozenset({"add", "sub", "mul", "neg", "abs", "sqrt", "floor", "ceil", "rint", "copysign", "div"})


def _finite_conditions(
    graph: Graph, counted: Mapping[str, str], outputs: Mapping[str, Sequence[Node]], dropped: Iterable[Node]
) -> list[Node]:
    """Conditions that all outputs, and what was left out, are finite.

    A sum is finite only if all of its terms are, so that one comparison is enough; where a sum overflows, NumPy
    computes the member for nothing.

    Args:
        graph: where to make them.
        counted: by the name of an input or output the mask without which it means nothing.
        outputs: by name, their components.
        dropped: what was left out.
    """
    sums: dict[frozenset[str], dict[int, Node]] = {}
    for name, nodes in outputs.items():
        masks = frozenset({counted[name]} if name in counted else ())
        sums.setdefault(masks, {}).update((node.number, node) for node in nodes if not node.boolean)
    carried = _carried(sums.get(frozenset(), {}).values())
    left = [node for node in dropped if node.number not in carried]
    depends = _depends(counted, outputs, left)
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


def _carried(nodes: Iterable[Node]) -> set[int]:
    """What some of these nodes would show if it was not finite."""
    waiting, carried = list(nodes), set[int]()
    while waiting:
        node = waiting.pop()
        if node.number not in carried:
            carried.add(node.number)
            if node.op in CARRYING:
                waiting += node.arguments[: 1 if node.op in ("div", "copysign") else None]
    return carried


def _depends(
    counted: Mapping[str, str], outputs: Mapping[str, Sequence[Node]], nodes: Sequence[Node]
) -> dict[int, frozenset[str]]:
    """By the number of a node the masks without which something that it is made of means nothing."""
    own = {
        node.number: counted[name] for name, of in outputs.items() if name in counted for node in of if node.arguments
    }
    result: dict[int, frozenset[str]] = {}
    for node in ordered(nodes):
        masks = {mask for argument in node.arguments for mask in result[argument.number]}
        if node.number in own:
            masks.add(own[node.number])
        if isinstance(node.value, tuple) and node.value[0] in counted:
            masks.add(counted[node.value[0]])
        result[node.number] = frozenset(masks)
    return result


class Trace(NamedTuple):
    """What equations compute of one member."""

    layout: KernelLayout
    outputs: list[Node]
    """Of each component, in the order of the layout."""
    guard: Node
    """Whether all of it is right for a member."""


def trace(equations: Equations, inputs: Sequence[Input]) -> Trace:
    """Call the function with symbols, as if with a batch of one member.

    Raises:
        Untraceable: it cannot be done; says why.
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
            name: _components(graph, name, nodes_of_output(graph, value), axes)
            for name, value in outputs.items()
            if value is not None
        }
    except Untraceable:
        raise
    # What a function of someone else raises when it is given symbols, whatever it is, means the same.
    except Exception as error:
        raise Untraceable(graph.refused or f"{type(error).__name__}: {error}") from error
    if graph.refused is not None:
        raise Untraceable(graph.refused)
    return _lowered(graph, equations, inputs, result)


def _symbol(graph: Graph, equations: Equations, item: Input) -> Symbol:
    nodes = np.empty(item.shape, dtype=object)
    for number, place in enumerate(np.ndindex(item.shape)):
        nodes[place] = graph.input(item.name, number, level=item.level, boolean=item.boolean)
    if item.name in equations.symmetric:
        for i, j in np.ndindex(item.shape):
            nodes[i, j] = nodes[max(i, j), min(i, j)]
    nodes = nodes.reshape(item.shape + (1,) * item.batch_axes)
    # A function that writes into its inputs is no function of them.
    nodes.flags.writeable = False
    return Symbol(graph, nodes)


def _components(graph: Graph, name: str, nodes: Nodes, axes: int) -> Nodes:
    """An output without its batch axes."""
    first = nodes.ndim - axes
    if nodes.ndim and (first < 0 or nodes.shape[first:] != (1,) * axes):
        graph.refuse(f"{name} of shape {nodes.shape}, which does not end with the batch axes")
    return nodes.reshape(nodes.shape[: max(0, first)])


def _lowered(graph: Graph, equations: Equations, inputs: Sequence[Input], result: dict[str, Nodes]) -> Trace:
    """The graph without transcendental functions, and with the conditions under which it is right."""
    nodes: list[Node] = [node for array in result.values() for node in array.flat]
    dropped = list(graph.dropped.values())
    graph.dropped = {}
    every = iter(lowered(graph, [*nodes, *dropped]))
    parts = {name: [next(every) for _ in range(array.size)] for name, array in result.items()}
    dropped = [*every, *graph.dropped.values()]
    # What is the same as another output is written once.
    first: dict[tuple[object, ...], str] = {}
    modes = {name: equations.modes.get(name, "") for name in result}
    same = {name: first.setdefault((modes[name], result[name].shape, *parts[name]), name) for name in result}
    own = [
        Output(name, array.shape, is_boolean(array), modes[name])
        for name, array in result.items()
        if same[name] == name
    ]
    outputs = [node for output in own for node in parts[output.name]]
    guard = graph.joined([*graph.guards, *_finite_conditions(graph, equations.counted, parts, dropped)])
    *outputs, guard = with_fused_sums(graph, [*outputs, guard])
    used = {node.value[0] for node in ordered([*outputs, guard]) if isinstance(node.value, tuple)}
    others = {name: other for name, other in same.items() if name != other}
    layout = KernelLayout(tuple(item for item in inputs if item.name in used), tuple(own), others)
    return Trace(layout, outputs, guard)
