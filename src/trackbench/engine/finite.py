"""Under which conditions a graph is right that leaves out products with zero: what it left out is finite."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from trackbench.engine.graph import Graph, Node, ordered

#: Operations that are not finite where an argument is not; of a quotient that holds of the first one.
CARRYING = frozenset({"add", "sub", "mul", "neg", "abs", "sqrt", "floor", "ceil", "rint", "copysign", "div"})


def conditions(
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
        symbol = graph.given(mask)
        result = result if symbol is None else graph.apply("or", result, graph.apply("not", symbol))
    return result


def _carried(nodes: Iterable[Node]) -> set[int]:
    """What some of these nodes would show if it was not finite."""
    waiting, found = list(nodes), set[int]()
    while waiting:
        node = waiting.pop()
        if node.number not in found:
            found.add(node.number)
            if node.op in CARRYING:
                waiting += node.arguments[: 1 if node.op in ("div", "copysign") else None]
    return found


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
