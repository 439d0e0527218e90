"""Expressions as graphs of operations on numbers, in which nothing is computed twice."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import NoReturn

#: Operations whose arguments may be exchanged.
COMMUTATIVE = frozenset({"add", "mul", "and", "or", "eq", "ne"})
COMPARISONS = frozenset({"lt", "le", "gt", "ge", "eq", "ne"})
LOGICAL = frozenset({"and", "or", "not"})
#: Truth values from the bits of a number; "negative" is the sign bit.
OF_BITS = frozenset({"negative", "bit0", "bit1"})
TRUTH_VALUES = COMPARISONS | LOGICAL | OF_BITS
#: Levels of sharing: a number belongs to all members of a batch; to a group of members, which differ along the last
#: batch axis alone; or to one member.
ALL, GROUP, MEMBER = range(3)
#: Largest number of operations of a function; more would take seconds to compile.
LARGEST = 50_000
#: Operations that are computed at once where all arguments are constants.
KNOWN: dict[str, Callable[..., float | bool]] = {
    "add": lambda a, b: a + b,
    "sub": lambda a, b: a - b,
    "mul": lambda a, b: a * b,
    "div": lambda a, b: a / b,
    "neg": lambda a: -a,
    "abs": abs,
    "sqrt": math.sqrt,
    "floor": lambda a: float(math.floor(a)),
    "ceil": lambda a: float(math.ceil(a)),
    "rint": lambda a: float(round(a)),
    "min": lambda a, b: a if a < b or a != a else b,
    "max": lambda a, b: a if a > b or a != a else b,
    "lt": lambda a, b: a < b,
    "le": lambda a, b: a <= b,
    "gt": lambda a, b: a > b,
    "ge": lambda a, b: a >= b,
    "eq": lambda a, b: a == b,
    "ne": lambda a, b: a != b,
    "and": lambda a, b: a and b,
    "or": lambda a, b: a or b,
    "not": lambda a: not a,
}


class Untraceable(TypeError):
    """Error for a function that cannot be traced; the message says why."""


@dataclass(eq=False, slots=True)
class Node:
    """Node of a graph: an operation, an input's component or a constant."""

    number: int
    op: str
    arguments: tuple[Node, ...] = ()
    value: float | bool | tuple[str, int] | None = None
    """Number or truth value of a constant; name and component index of an input; None for an operation."""
    level: int = ALL
    """Members that share the value: ``ALL`` of the batch, a ``GROUP`` of them, or one ``MEMBER`` alone."""
    boolean: bool = False

    @property
    def constant(self) -> bool:
        return self.op == "constant"

    @property
    def uniform(self) -> bool:
        """Whether all members of a batch share the value of the node."""
        return self.level == ALL


class Graph:
    """Operations of one function as nodes, none of them twice.

    Zeros are left out of sums and products. This loses the sign of a zero, and hides a factor that is not finite.
    """

    def __init__(self) -> None:
        self.guards: list[Node] = []
        """Conditions on a member of the batch under which the graph gives the right outputs for it."""
        self.dropped: dict[int, Node] = {}
        """Nodes left out, such as a factor times zero, by node number; outputs are right only if these are finite."""
        self.refused: str | None = None
        """Reason why the function cannot be traced, kept even if the function catches the error; None if it can be."""
        self._applied: dict[tuple[object, ...], Node] = {}
        self._leaves: dict[object, Node] = {}
        self._count = 0

    def refuse(self, reason: str) -> NoReturn:
        """Record the reason why a function cannot be traced, and raise an error with it.

        Raises:
            Untraceable: always.
        """
        self.refused = self.refused or reason
        raise Untraceable(reason)

    def input(self, name: str, component: int, *, level: int, boolean: bool = False) -> Node:
        """Return the node of a component, by its index, of the input with a name."""
        at = name, component
        if at not in self._leaves:
            self._leaves[at] = self._node("input", (), at, level, boolean)
        return self._leaves[at]

    def first_component(self, name: str) -> Node | None:
        """Return the node of the first component of the input with a name; None if there is no such input."""
        return self._leaves.get((name, 0))

    def constant(self, value: float | bool) -> Node:
        """Return the node of a number or a truth value."""
        boolean = isinstance(value, bool)
        value = value if boolean else float(value)
        # As a key, text tells 0.0 from -0.0 and from False, and NaN equals itself.
        text = repr(value)
        if text not in self._leaves:
            self._leaves[text] = self._node("constant", (), value, ALL, boolean)
        return self._leaves[text]

    def apply(self, op: str, *arguments: Node) -> Node:
        """Return the node of an operation, in its simplest form."""
        key = (op, *[argument.number for argument in arguments])
        result = self._applied.get(key)
        if result is None:
            result = self._applied[key] = self._make(op, arguments)
        return result

    def all_of(self, conditions: Iterable[Node]) -> Node:
        """Return a node that is True where all ``conditions`` are."""
        result = self.constant(True)
        for condition in conditions:
            result = self.apply("and", result, condition)
        return result

    def as_number(self, node: Node) -> Node:
        """Return a number unchanged, and a truth value as 1.0 or 0.0."""
        return self.apply("where", node, self.constant(1.0), self.constant(0.0)) if node.boolean else node

    def raw(self, op: str, *arguments: Node, boolean: bool = False) -> Node:
        """Return a new node of an operation, without simplification."""
        return self._node(op, arguments, None, max(argument.level for argument in arguments), boolean)

    def negative(self, node: Node) -> Node:
        """Return the node of a number with the opposite sign."""
        return self.constant(-node.value) if isinstance(node.value, float) and node.constant else self.raw("neg", node)

    def _make(self, op: str, arguments: tuple[Node, ...]) -> Node:
        if op in COMMUTATIVE and arguments[0].number > arguments[1].number:
            return self.apply(op, arguments[1], arguments[0])
        result = self._simplify(op, arguments)
        if result is not None:
            return result
        level = max(argument.level for argument in arguments)
        boolean = op in TRUTH_VALUES or (op == "where" and arguments[1].boolean)
        return self._node(op, arguments, None, level, boolean)

    def _node(
        self,
        op: str,
        arguments: tuple[Node, ...],
        value: float | bool | tuple[str, int] | None,
        level: int,
        boolean: bool,
    ) -> Node:
        if self._count >= LARGEST:
            self.refuse(f"more than {LARGEST} operations")
        self._count += 1
        return Node(self._count, op, arguments, value, level, boolean)

    def _simplify(self, op: str, arguments: tuple[Node, ...]) -> Node | None:
        """Return an equal node that costs less than the operation; None if there is none."""
        if arguments[0].constant and op in KNOWN and all(argument.constant for argument in arguments):
            try:
                return self.constant(KNOWN[op](*(argument.value for argument in arguments)))
            except (ArithmeticError, ValueError):
                return None
        match op:
            case "add":
                return self._sum(*arguments)
            case "sub":
                return self._difference(*arguments)
            case "mul":
                return self._product(*arguments)
            case "div":
                return self._quotient(*arguments)
            case "where":
                condition, yes, no = arguments
                if condition.constant:
                    return yes if condition.value else no
                return yes if yes is no else None
            case "and" | "or":
                return self._logical(op, *arguments)
            case "neg" | "not" if arguments[0].op == op:
                return arguments[0].arguments[0]
        return None

    def _drop(self, node: Node) -> None:
        self.dropped[node.number] = node

    def _sum(self, a: Node, b: Node) -> Node | None:
        if _number(a) == 0.0:
            return b
        if _number(b) == 0.0:
            return a
        if b.op == "neg":
            return self.apply("sub", a, b.arguments[0])
        if a.op == "neg":
            return self.apply("sub", b, a.arguments[0])
        return self.apply("mul", self.constant(2.0), a) if a is b else None

    def _difference(self, a: Node, b: Node) -> Node | None:
        if _number(b) == 0.0:
            return a
        if _number(a) == 0.0:
            return self.apply("neg", b)
        if a is b:
            self._drop(a)
            return self.constant(0.0)
        return self.apply("add", a, b.arguments[0]) if b.op == "neg" else None

    def _product(self, a: Node, b: Node) -> Node | None:
        x = _number(a)
        if x is None:
            x, a, b = _number(b), b, a
        if x == 0.0:
            self._drop(b)
            return self.constant(0.0)
        if x == 1.0:
            return b
        if x == -1.0:
            return self.apply("neg", b)
        if x == 0.5 and b.op == "mul" and 2.0 in map(_number, b.arguments):
            return b.arguments[1 if _number(b.arguments[0]) == 2.0 else 0]
        if a.op == "neg" and b.op == "neg":
            return self.apply("mul", a.arguments[0], b.arguments[0])
        if a.op == "neg":
            return self.apply("neg", self.apply("mul", a.arguments[0], b))
        if b.op == "neg":
            return self.apply("neg", self.apply("mul", a, b.arguments[0]))
        return None

    def _quotient(self, a: Node, b: Node) -> Node | None:
        y = _number(b)
        if y == 1.0:
            return a
        if _number(a) == 0.0:
            self._drop(b)
            self.guards.append(self.apply("ne", b, self.constant(0.0)))
            return self.constant(0.0)
        # The reciprocal of a power of two is exact.
        if y is not None and abs(math.frexp(y)[0]) == 0.5 and math.isfinite(1.0 / y):
            return self.apply("mul", a, self.constant(1.0 / y))
        return None

    def _logical(self, op: str, a: Node, b: Node) -> Node | None:
        for side, other in ((a, b), (b, a)):
            if side.constant:
                return other if side.value == (op == "and") else side
        return a if a is b else None


def _number(node: Node) -> float | None:
    return node.value if node.constant and isinstance(node.value, float) else None


def with_fused_sums(graph: Graph, roots: Sequence[Node]) -> list[Node]:
    """Replace ``a b + c`` by the fused operation ``fma(a, b, c)`` where the product has no other use.

    Which sums are replaced does not depend on whether members of the batch share a number.
    """
    steps = list(ordered(roots))
    needed = Counter(item.number for node in steps for item in node.arguments)
    needed.update(root.number for root in roots)
    made: dict[int, Node] = {}
    for node in steps:
        arguments = tuple([made[argument.number] for argument in node.arguments])
        products = [place for place, item in enumerate(node.arguments) if item.op == "mul" and needed[item.number] == 1]
        if node.op in ("add", "sub") and products:
            second = products[-1]
            (a, b), other = arguments[second].arguments, arguments[not second]
            if node.op == "sub":
                a, other = (graph.negative(a), other) if second else (a, graph.negative(other))
            made[node.number] = graph.raw("fma", a, b, other)
        elif arguments != node.arguments:
            made[node.number] = graph.raw(node.op, *arguments, boolean=node.boolean)
        else:
            made[node.number] = node
    return [made[root.number] for root in roots]


def ordered(roots: Sequence[Node], made: Iterable[int] = ()) -> Iterator[Node]:
    """Yield each node that the roots need, after its arguments, and near the nodes that use it.

    ``made``: numbers of nodes to leave out.
    """
    seen = set(made)
    for root in roots:
        waiting = [(root, iter(root.arguments))] if root.number not in seen else []
        seen.add(root.number)
        while waiting:
            node, arguments = waiting[-1]
            for item in arguments:
                if item.number not in seen:
                    seen.add(item.number)
                    waiting.append((item, iter(item.arguments)))
                    break
            else:
                waiting.pop()
                yield node
