"""Graphs as LLVM's intermediate language, with explicit vectors of members of a batch."""

from __future__ import annotations

import struct
from collections.abc import Iterable, Mapping, Sequence

from trackbench.engine.graph import ALL, COMPARISONS, GROUP, LOGICAL, MEMBER, Node, ordered
from trackbench.engine.layout import KernelLayout

#: Members of a batch in a vector: 8 doubles are one register of AVX-512; narrower machines take two or four for it.
WIDTH = 8
#: Size of what every object of Python begins with, bytes.
HEAD = object.__basicsize__
BINARY = {"add": "fadd", "sub": "fsub", "mul": "fmul", "div": "fdiv"}
#: Ordered comparisons, which a NaN fails; "ne" alone holds of a NaN.
COMPARED = {"lt": "olt", "le": "ole", "gt": "ogt", "ge": "oge", "eq": "oeq", "ne": "une"}
INTRINSICS = {"sqrt": "sqrt", "abs": "fabs", "ceil": "ceil", "floor": "floor", "rint": "rint", "copysign": "copysign"}
#: Bits of a double: the place of the exponent, and what is added to it.
FRACTION_BITS, BIAS = 52, 1023


def function(name: str, layout: KernelLayout, outputs: Sequence[Node], guard: Node) -> str:
    """The text of a function of the number of groups and of the members of each, and of the arrays of the inputs and of
    the outputs.

    The arrays are objects of NumPy, whose first field after the head of every object is the place of their data. Each
    has rows of all members, or of all groups. The outputs are numbers and masks; the first row of the masks says of
    each member whether the guard held. The function returns 1 if it held of all. A group has at least ``WIDTH``
    members: the last vector may overlap the one before, so that outputs must not lie where inputs are.
    """
    numbers: dict[int, str] = {}
    before, group = Text(1, "s", numbers, "1", "0"), Text(1, "g", numbers, "%groups", "%g")
    body = Text(WIDTH, "v", {}, "%members", "%i")
    texts = {ALL: before, GROUP: group, MEMBER: body}
    # What the guard alone needs of an output comes next to it, so that no register keeps it until the end.
    others = ordered([guard], [node.number for node in ordered(outputs)])
    checks = {item.number: node for node in others for item in node.arguments}
    steps = list(ordered([step for node in outputs for step in (node, checks.get(node.number, node))] + [guard]))
    names = [f"%a{place}" for place in range(len(layout.inputs) + 2)]
    places = [before.data_of(name) for name in names]
    bases = {item.name: place for item, place in zip(layout.inputs, places, strict=False)}
    into = places[-2:]
    before_members(texts, steps, (*outputs, guard), bases)
    waiting: dict[int, list[int]] = {}
    for place, node in enumerate(outputs):
        waiting.setdefault(node.number, []).append(place)
    for node in steps:
        if node.level == MEMBER:
            body.operation(node, bases)
        for place in waiting.get(node.number, ()):
            body.store(node, into[node.boolean], layout.rows[place])
    held = body.value(guard)
    body.store_mask(held, into[True], 0)
    lines = "\n".join
    ones = _constants("true", "i1", WIDTH)
    return f"""{lines(sorted(before.declared | group.declared | body.declared))}
define i64 @{name}(i64 %groups, i64 %size, {", ".join(f"ptr {item}" for item in names)}) {{
entry:
  %members = mul i64 %groups, %size
{lines(before.lines)}
  br label %group
group:
  %g = phi i64 [0, %entry], [%following, %grouped]
  %first = phi i64 [0, %entry], [%end, %grouped]
  %fine = phi <{WIDTH} x i1> [{ones}, %entry], [%still, %grouped]
  %end = add i64 %first, %size
  %last = sub i64 %end, {WIDTH}
{lines(group.lines)}
  br label %loop
loop:
  %i = phi i64 [%first, %group], [%next, %loop]
  %good = phi <{WIDTH} x i1> [%fine, %group], [%still, %loop]
{lines(body.lines)}
  %still = and <{WIDTH} x i1> %good, {held}
  %after = add i64 %i, {WIDTH}
  %over = icmp sgt i64 %after, %last
  %next = select i1 %over, i64 %last, i64 %after
  %more = icmp slt i64 %i, %last
  br i1 %more, label %loop, label %grouped
grouped:
  %following = add i64 %g, 1
  %others = icmp slt i64 %following, %groups
  br i1 %others, label %group, label %done
done:
  %bits = bitcast <{WIDTH} x i1> %still to i{WIDTH}
  %all = icmp eq i{WIDTH} %bits, -1
  %result = zext i1 %all to i64
  ret i64 %result
}}
"""


def before_members(
    texts: Mapping[int, Text], steps: Sequence[Node], outputs: Iterable[Node], bases: Mapping[str, str]
) -> None:
    """Write what is the same for members, and make vectors of what they or the outputs need of it."""
    for node in steps:
        if node.level != MEMBER and not node.constant:
            texts[node.level].operation(node, bases)
    needed = {item.number: item for node in steps if node.level == MEMBER for item in node.arguments}
    needed |= {node.number: node for node in outputs}
    for node in needed.values():
        if node.level != MEMBER and not node.constant:
            text = texts[node.level]
            text.lines += texts[MEMBER].spread(node, text.value(node))


class Text:
    """Instructions on numbers (width 1) or vectors, one for each node, whose names begin with ``prefix``.

    ``values``: by the number of a node, what stands for it. ``count``, ``at``: how long a row is, and where in it.
    """

    def __init__(self, width: int, prefix: str, values: dict[int, str], count: str, at: str) -> None:
        self.width = width
        self._count, self._at = count, at
        self.lines: list[str] = []
        self.declared: set[str] = set()
        self._values = values
        self._made = 0
        self._prefix = prefix

    def _type(self, kind: str) -> str:
        return kind if self.width == 1 else f"<{self.width} x {kind}>"

    def _new(self, instruction: str) -> str:
        self._made += 1
        name = f"%{self._prefix}{self._made}"
        self.lines.append(f"  {name} = {instruction}")
        return name

    def constant(self, value: object) -> str:
        """A constant of every member."""
        if isinstance(value, bool):
            return _constants("true" if value else "false", "i1", self.width)
        assert isinstance(value, float)
        return _constants(f"0x{struct.unpack('<Q', struct.pack('<d', value))[0]:016X}", "double", self.width)

    def value(self, node: Node) -> str:
        """What stands for a node."""
        return self.constant(node.value) if node.constant else self._values[node.number]

    def data_of(self, array: str) -> str:
        """Where the data of an array lies."""
        return self._new(f"load ptr, ptr {self._new(f'getelementptr i8, ptr {array}, i64 {HEAD}')}, align 8")

    def place(self, base: str, row: int, kind: str) -> str:
        """Where the number of a row is, or the vector."""
        offset = self._new(f"add i64 {self._new(f'mul i64 {self._count}, {row}')}, {self._at}")
        return self._new(f"getelementptr {kind}, ptr {base}, i64 {offset}")

    def spread(self, node: Node, number: str) -> list[str]:
        """Instructions that make a vector of a number computed before."""
        kind = "i1" if node.boolean else "double"
        vector, own = self._type(kind), self.lines
        self.lines = []
        single = self._new(f"insertelement {vector} poison, {kind} {number}, i32 0")
        self._values[node.number] = self._new(
            f"shufflevector {vector} {single}, {vector} poison, <{self.width} x i32> zeroinitializer"
        )
        made, self.lines = self.lines, own
        return made

    def store(self, node: Node, base: str, row: int) -> None:
        """Write a node to a row of the output."""
        if node.boolean:
            self.store_mask(self.value(node), base, row)
        else:
            where = self.place(base, row, "double")
            self.lines.append(f"  store {self._type('double')} {self.value(node)}, ptr {where}, align 8")

    def store_mask(self, value: str, base: str, row: int) -> None:
        """Write truth values as bytes."""
        where = self.place(base, row, "i8")
        wide = self._new(f"zext {self._type('i1')} {value} to {self._type('i8')}")
        self.lines.append(f"  store {self._type('i8')} {wide}, ptr {where}, align 1")

    def operation(self, node: Node, bases: Mapping[str, str]) -> None:
        """The instructions of a node; ``bases``: where the data of each input lie."""
        where = ""
        if isinstance(node.value, tuple):
            name, component = node.value
            where = self.place(bases[name], component, "i8" if node.boolean else "double")
        self._values[node.number] = self._instruction(node, where)

    def _instruction(self, node: Node, where: str) -> str:
        op, number, truth = node.op, self._type("double"), self._type("i1")
        values = [self.value(item) for item in node.arguments]
        if op == "input":
            if node.boolean:
                byte = self._type("i8")
                loaded = self._new(f"load {byte}, ptr {where}, align 1")
                return self._new(f"icmp ne {byte} {loaded}, {_constants('0', 'i8', self.width)}")
            return self._new(f"load {number}, ptr {where}, align 8")
        if op in BINARY:
            return self._new(f"{BINARY[op]} {number} {values[0]}, {values[1]}")
        if op == "neg":
            return self._new(f"fneg {number} {values[0]}")
        if op in COMPARISONS:
            return self._new(f"fcmp {COMPARED[op]} {number} {values[0]}, {values[1]}")
        if op == "not":
            return self._new(f"xor {truth} {values[0]}, {self.constant(True)}")
        if op in LOGICAL:
            return self._new(f"{op} {truth} {values[0]}, {values[1]}")
        if op == "where":
            kind = truth if node.boolean else number
            return self._new(f"select {truth} {values[0]}, {kind} {values[1]}, {kind} {values[2]}")
        if op in ("min", "max"):
            return self._extreme(op, node.arguments, values)
        if op in INTRINSICS:
            return self._call(INTRINSICS[op], values)
        return self._bits(op, values[0])

    def _extreme(self, op: str, arguments: Sequence[Node], values: Sequence[str]) -> str:
        """The smaller or larger of two, NaN where one is, as NumPy has it."""
        number, truth, less = self._type("double"), self._type("i1"), "lt" if op == "min" else "gt"
        if arguments[1].constant:
            first = self._new(f"fcmp u{less} {number} {values[0]}, {values[1]}")
        else:
            first = self._new(f"fcmp o{less} {number} {values[0]}, {values[1]}")
            if not arguments[0].constant:
                unknown = self._new(f"fcmp uno {number} {values[0]}, {values[0]}")
                first = self._new(f"or {truth} {first}, {unknown}")
        return self._new(f"select {truth} {first}, {number} {values[0]}, {number} {values[1]}")

    def _call(self, name: str, values: Sequence[str]) -> str:
        number = self._type("double")
        suffix = "f64" if self.width == 1 else f"v{self.width}f64"
        self.declared.add(f"declare {number} @llvm.{name}.{suffix}({', '.join([number] * len(values))})")
        return self._new(f"call {number} @llvm.{name}.{suffix}({', '.join(f'{number} {value}' for value in values)})")

    def _bits(self, op: str, value: str) -> str:
        """Operations on the bits of a number."""
        number, whole = self._type("double"), self._type("i64")

        def fixed(bits: int) -> str:
            return _constants(str(bits), "i64", self.width)

        if op == "power2":
            count = self._new(f"add {whole} {self._new(f'fptosi {number} {value} to {whole}')}, {fixed(BIAS)}")
            shifted = self._new(f"shl {whole} {count}, {fixed(FRACTION_BITS)}")
            return self._new(f"bitcast {whole} {shifted} to {number}")
        bits = self._new(f"bitcast {number} {value} to {whole}")
        if op == "negative":
            return self._new(f"icmp slt {whole} {bits}, {fixed(0)}")
        if op in ("bit0", "bit1"):
            bit = self._new(f"and {whole} {bits}, {fixed(1 if op == 'bit0' else 2)}")
            return self._new(f"icmp ne {whole} {bit}, {fixed(0)}")
        if op == "exponent":
            high = self._new(f"lshr {whole} {bits}, {fixed(FRACTION_BITS)}")
            low = self._new(f"and {whole} {high}, {fixed(2047)}")
            return self._new(f"sitofp {whole} {self._new(f'sub {whole} {low}, {fixed(BIAS)}')} to {number}")
        assert op == "fraction", op
        low = self._new(f"and {whole} {bits}, {fixed((1 << FRACTION_BITS) - 1)}")
        joined = self._new(f"or {whole} {low}, {fixed(BIAS << FRACTION_BITS)}")
        return self._new(f"bitcast {whole} {joined} to {number}")


def _constants(text: str, kind: str, width: int) -> str:
    return text if width == 1 else f"<{', '.join([f'{kind} {text}'] * width)}>"
