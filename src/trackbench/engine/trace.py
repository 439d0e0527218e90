"""Equations as a graph."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from trackbench.engine.arithmetic import lowered
from trackbench.engine.equations import Equations
from trackbench.engine.finite import conditions
from trackbench.engine.graph import Graph, Node, Untraceable, fused, ordered
from trackbench.engine.layout import Input, KernelLayout, Output
from trackbench.engine.nodes import Nodes, is_boolean
from trackbench.engine.symbols import Symbol, nodes_of_output
from trackbench.engine.user_equations import user_sources


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
    graph.batch_axes = axes if any(user_sources(equations.key)) else 0
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
    guard = graph.joined([*graph.guards, *conditions(graph, equations.counted, parts, dropped)])
    *outputs, guard = fused(graph, [*outputs, guard])
    used = {node.value[0] for node in ordered([*outputs, guard]) if isinstance(node.value, tuple)}
    others = {name: other for name, other in same.items() if name != other}
    layout = KernelLayout(tuple(item for item in inputs if item.name in used), tuple(own), others)
    return Trace(layout, outputs, guard)
