"""Graphs as LLVM's intermediate language, with explicit vectors over members of a batch."""

from __future__ import annotations

import struct
from collections.abc import Iterable, Mapping, Sequence

from trackbench.engine.graph import ALL, COMPARISONS, GROUP, LOGICAL, MEMBER, Node, ordered
from trackbench.engine.layout import SUMMED, KernelLayout

#: Number of members in a vector: 8 doubles fill one AVX-512 register, or two or four narrower ones.
WIDTH = 8
#: Size of the header of every Python object, bytes.
HEAD = object.__basicsize__
BINARY = {"add": "fadd", "sub": "fsub", "mul": "fmul", "div": "fdiv"}
#: LLVM comparisons: false for NaN, but "ne" is true for NaN.
COMPARED = {"lt": "olt", "le": "ole", "gt": "ogt", "ge": "oge", "eq": "oeq", "ne": "une"}
INTRINSICS = {
    "sqrt": "sqrt",
    "abs": "fabs",
    "ceil": "ceil",
    "floor": "floor",
    "rint": "rint",
    "copysign": "copysign",
    "fma": "fma",
}
#: Format of a double: number of bits of the fraction, and bias of the exponent.
FRACTION_BITS, BIAS = 52, 1023
#: Registers with the address of an array's data, and with the distance of its rows.
Place = tuple[str, str]


def kernel_text(name: str, layout: KernelLayout, outputs: Sequence[Node], guard: Node) -> str:
    """Return LLVM's text of a kernel's two functions, ``name`` and ``name.part``.

    ``name.part`` computes the members from a first index up to an end, at least ``WIDTH`` of them. The last vector may
    overlap the vector before it, so outputs must not share memory with inputs. Arguments are these two indices, and a
    list with address and row distance of each input, of each output and of the guard's mask. It returns 1 if the guard
    held for all members. An output in mode ``added`` is added to the numbers in place, an output in mode ``summed`` to
    a vector of sums.

    ``name`` computes groups of consecutive members. Arguments are the number of groups, the number of members of each,
    and the arrays of the inputs, of the outputs' numbers and of their masks. These are NumPy objects, whose data
    address is the first field after the object's header.
    """
    numbers: dict[int, str] = {}
    before, body = Text(1, "s", numbers, "0"), Text(WIDTH, "v", {}, "%i")
    texts = {ALL: before, GROUP: before, MEMBER: body}
    # A check of an output by the guard alone follows at once, so that no register holds the output until the end.
    guard_steps = ordered([guard], [node.number for node in ordered(outputs)])
    checks = {item.number: node for node in guard_steps for item in node.arguments}
    steps = list(ordered([step for node in outputs for step in (node, checks.get(node.number, node))] + [guard]))
    places = [before.listed(number) for number in range(len(layout.inputs) + len(layout.outputs) + 1)]
    bases = {item.name: place for item, place in zip(layout.inputs, places, strict=False)}
    into = places[len(layout.inputs) :]
    before_members(texts, steps, (*outputs, guard), bases)
    waiting: dict[int, list[tuple[str, Place, int]]] = {}
    rows = [
        (item.mode, place, row) for item, place in zip(layout.outputs, into, strict=False) for row in range(item.size)
    ]
    for node, row in zip(outputs, rows, strict=True):
        waiting.setdefault(node.number, []).append(row)
    for node in steps:
        if node.level == MEMBER:
            body.operation(node, bases)
        for row in waiting.get(node.number, ()):
            body.put(node, *row)
    held = body.value(guard)
    body.store_mask(held, into[-1], 0)
    lines = "\n".join
    ones, numbered = _constants("true", "i1", WIDTH), ", ".join(f"i64 {number}" for number in range(WIDTH))
    return f"""{lines(sorted(before.declared | body.declared))}
define i64 @{name}.part(i64 %first, i64 %end, ptr %list) {{
entry:
  %last = sub i64 %end, {WIDTH}
{lines(before.lines)}
  br label %loop
loop:
  %i = phi i64 [%first, %entry], [%next, %loop]
  %from = phi i64 [%first, %entry], [%after, %loop]
  %good = phi <{WIDTH} x i1> [{ones}, %entry], [%still, %loop]
  %early = sub i64 %from, %i
  %single = insertelement <{WIDTH} x i64> poison, i64 %early, i32 0
  %every = shufflevector <{WIDTH} x i64> %single, <{WIDTH} x i64> poison, <{WIDTH} x i32> zeroinitializer
  %fresh = icmp sge <{WIDTH} x i64> <{numbered}>, %every
{lines(body.lines)}
  %still = and <{WIDTH} x i1> %good, {held}
  %after = add i64 %i, {WIDTH}
  %over = icmp sgt i64 %after, %last
  %next = select i1 %over, i64 %last, i64 %after
  %more = icmp slt i64 %i, %last
  br i1 %more, label %loop, label %done
done:
  %bits = bitcast <{WIDTH} x i1> %still to i{WIDTH}
  %all = icmp eq i{WIDTH} %bits, -1
  %result = zext i1 %all to i64
  ret i64 %result
}}
{_group_text(name, layout)}"""


def _group_text(name: str, layout: KernelLayout) -> str:
    """Return LLVM's text of the function ``name``, which calls ``name.part`` for each group of members."""
    text = Text(1, "t", {}, "0")
    sizes = {ALL: ("1", "0"), GROUP: ("%groups", "%g"), MEMBER: ("%members", "%begin")}
    arrays = [f"%a{number}" for number in range(len(layout.inputs) + 2)]
    data = [text.data_of(item) for item in arrays]
    opening, text.lines = text.lines, []
    parts = [(base, item.boolean, 0, *sizes[item.level]) for base, item in zip(data, layout.inputs, strict=False)]
    for output, first in zip(layout.outputs, layout.first_rows, strict=True):
        parts.append((data[output.boolean - 2], output.boolean, first, *sizes[MEMBER]))
    parts.append((data[-1], True, 0, *sizes[MEMBER]))
    for number, (base, boolean, row, stride, at) in enumerate(parts):
        text.lines.append(
            f"  store ptr {text.place((base, stride), row, 'i8' if boolean else 'double', at)}, "
            f"ptr {text.entry('%list', 2 * number)}, align 8"
        )
        text.lines.append(f"  store i64 {stride}, ptr {text.entry('%list', 2 * number + 1)}, align 8")
    lines = "\n".join
    return f"""define i64 @{name}(i64 %groups, i64 %size, {", ".join(f"ptr {item}" for item in arrays)}) {{
entry:
  %list = alloca [{2 * len(parts)} x i64], align 8
  %members = mul i64 %groups, %size
{lines(opening)}
  br label %group
group:
  %g = phi i64 [0, %entry], [%following, %group]
  %fine = phi i64 [1, %entry], [%still, %group]
  %begin = mul i64 %g, %size
{lines(text.lines)}
  %held = call i64 @{name}.part(i64 0, i64 %size, ptr %list)
  %still = and i64 %fine, %held
  %following = add i64 %g, 1
  %others = icmp slt i64 %following, %groups
  br i1 %others, label %group, label %done
done:
  ret i64 %still
}}
"""


def before_members(
    texts: Mapping[int, Text], steps: Sequence[Node], outputs: Iterable[Node], bases: Mapping[str, Place]
) -> None:
    """Write the operations that members share, and copy those results that are needed per member into vectors."""
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

    ``values`` are the registers of nodes by number; ``at`` is the register with the index of the member.
    """

    def __init__(self, width: int, prefix: str, values: dict[int, str], at: str) -> None:
        self.width = width
        self._at = at
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
        """Return LLVM's text of a constant, repeated for every member of a vector."""
        if isinstance(value, bool):
            return _constants("true" if value else "false", "i1", self.width)
        assert isinstance(value, float)
        return _constants(f"0x{struct.unpack('<Q', struct.pack('<d', value))[0]:016X}", "double", self.width)

    def value(self, node: Node) -> str:
        """Return the register or the constant that holds a node's value."""
        return self.constant(node.value) if node.constant else self._values[node.number]

    def data_of(self, array: str) -> str:
        """Write the load of the address of an array's data; return its register."""
        return self._new(f"load ptr, ptr {self._new(f'getelementptr i8, ptr {array}, i64 {HEAD}')}, align 8")

    def listed(self, number: int) -> Place:
        """Write the load of an array's address and row distance from the list of arrays; return the two registers."""
        base, stride = self.entry("%list", 2 * number), self.entry("%list", 2 * number + 1)
        return self._new(f"load ptr, ptr {base}, align 8"), self._new(f"load i64, ptr {stride}, align 8")

    def entry(self, array: str, number: int) -> str:
        """Write the address of one entry of an array of 64-bit integers; return its register."""
        return self._new(f"getelementptr i64, ptr {array}, i64 {number}")

    def place(self, where: Place, row: int, kind: str, at: str | None = None) -> str:
        """Write the address of a number or vector in a row of an array; return its register."""
        base, stride = where
        offset = self._new(f"add i64 {self._new(f'mul i64 {stride}, {row}')}, {at or self._at}")
        return self._new(f"getelementptr {kind}, ptr {base}, i64 {offset}")

    def spread(self, node: Node, number: str) -> list[str]:
        """Return the instructions that copy a number into all entries of a vector."""
        kind = "i1" if node.boolean else "double"
        vector, lines = self._type(kind), self.lines
        self.lines = []
        single = self._new(f"insertelement {vector} poison, {kind} {number}, i32 0")
        self._values[node.number] = self._new(
            f"shufflevector {vector} {single}, {vector} poison, <{self.width} x i32> zeroinitializer"
        )
        made, self.lines = self.lines, lines
        return made

    def put(self, node: Node, mode: str, where: Place, row: int) -> None:
        """Write a node's value to a row of an output, or add it as ``mode`` says; no member is added twice."""
        value, number = self.value(node), self._type("double")
        if node.boolean:
            self.store_mask(value, where, row)
            return
        place = self.place(where, row, "double", "0" if mode == SUMMED else None)
        if mode:
            addend = self._new(f"select {self._type('i1')} %fresh, {number} {value}, {number} {self.constant(0.0)}")
            before = self._new(f"load {number}, ptr {place}, align 8")
            value = self._new(f"fadd {number} {before}, {addend}")
        self.lines.append(f"  store {number} {value}, ptr {place}, align 8")

    def store_mask(self, value: str, where: Place, row: int) -> None:
        """Write the instructions that store truth values as bytes in a row of an array."""
        place = self.place(where, row, "i8")
        wide = self._new(f"zext {self._type('i1')} {value} to {self._type('i8')}")
        self.lines.append(f"  store {self._type('i8')} {wide}, ptr {place}, align 1")

    def operation(self, node: Node, bases: Mapping[str, Place]) -> None:
        """Write the instructions of a node; ``bases`` are the places of the inputs in memory, by name."""
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
        return self._bit_operation(op, values[0])

    def _extreme(self, op: str, arguments: Sequence[Node], values: Sequence[str]) -> str:
        """Return the register of the smaller or larger of two numbers; NaN if one of them is NaN, as in NumPy."""
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

    def _bit_operation(self, op: str, value: str) -> str:
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
