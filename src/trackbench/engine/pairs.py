"""Pairs of members of two batches of which a condition holds, found by machine code.

Each of the first batch belongs to a group, and meets those of the second batch that belong to it too. Of each pair the
numbers are at hand where they are compared: no array has one for every pair.
"""

from __future__ import annotations

import threading
from collections.abc import Collection, Mapping
from typing import Any

import numpy as np

from trackbench.base.types import Array, Indices
from trackbench.engine.equations import Equations, Values
from trackbench.engine.graph import ALL, GROUP, MEMBER, Node, ordered
from trackbench.engine.kernels import Kernels
from trackbench.engine.layout import Input, KernelLayout
from trackbench.engine.machine import FUNCTION
from trackbench.engine.trace import trace
from trackbench.engine.vector_code import WIDTH, Text, before_members


class _Memory(threading.local):
    """Where a thread's pairs are put; it is kept, since to be given so much again takes longer than to search."""

    pairs = np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)


class PairSearch:
    """Finds the pairs of which a condition holds.

    Args:
        kernels: of this process.
        equations: their only output says whether it holds; of a pair of which they are not finite it does not.
        shapes: of the components of each input.
        first, second: inputs of which each member of the first, or of the second batch has its own.
    """

    def __init__(
        self,
        kernels: Kernels,
        equations: Equations,
        shapes: Mapping[str, tuple[int, ...]],
        first: Collection[str],
        second: Collection[str],
    ) -> None:
        own = {*first, *second}
        inputs = [Input(name, shape, int(name in own), "d", name in first) for name, shape in shapes.items()]
        result = trace(equations, inputs)
        text = _search_text(FUNCTION, result.layout, result.outputs[0])
        self._inputs = [(item.name, item.name in second) for item in result.layout.inputs]
        self._code = kernels.code(text, len(self._inputs) + 4)
        self._memory = _Memory()

    def __call__(self, values: Values, group: Indices, bounds: Indices) -> tuple[Indices, Indices]:
        """The pairs, sorted by their number in the first batch, then by that in the second.

        Args:
            values: the inputs; members of a batch along the last axis.
            group: ``(L,)`` of each of the first batch.
            bounds: ``(groups + 1,)`` where each group of the second batch begins, and where the last ends.
        """
        firsts, seconds = len(group), int(bounds[-1])
        if not firsts or not seconds:
            return np.zeros(0, dtype=np.intp), np.zeros(0, dtype=np.intp)
        inputs = [_as_read(values[name], second and seconds < WIDTH) for name, second in self._inputs]
        left, right = self._memory.pairs
        if len(left) < firsts * seconds:
            most = firsts * int((bounds[1:] - bounds[:-1]).max())
            if len(left) < most:
                left, right = self._memory.pairs = np.empty(most, dtype=np.int64), np.empty(most, dtype=np.int64)
        arrays = [*inputs, np.ascontiguousarray(group, dtype=np.int64), np.ascontiguousarray(bounds, dtype=np.int64)]
        count = self._code.call(firsts, max(seconds, WIDTH), *map(id, arrays), id(left), id(right))
        return left[:count].copy(), right[:count].copy()


def _as_read(value: Any, padded: bool) -> Array:
    """An input as the code reads it, if need be with so many members that they fill a vector."""
    result = np.ascontiguousarray(value, dtype=float)
    return np.pad(result, [(0, 0)] * (result.ndim - 1) + [(0, WIDTH - result.shape[-1])]) if padded else result


def _search_text(name: str, layout: KernelLayout, condition: Node) -> str:
    """The text of a function of the sizes of both batches, of the inputs, and of the arrays that name the pairs.

    Behind the inputs come the group of each of the first batch, the bounds of the groups in the second, and where the
    numbers of the pairs are put. The function returns how many there are. The second batch has at least ``WIDTH``
    members, so that a vector of them that would end behind the last begins earlier.
    """
    numbers: dict[int, str] = {}
    before, one, body = Text(1, "s", numbers, "0"), Text(1, "g", numbers, "%i"), Text(WIDTH, "v", {}, "%at")
    names = [f"%a{place}" for place in range(len(layout.inputs) + 4)]
    places = [before.data_of(item) for item in names]
    strides = {ALL: "1", GROUP: "%firsts", MEMBER: "%seconds"}
    bases = {item.name: (place, strides[item.level]) for item, place in zip(layout.inputs, places, strict=False)}
    group, bounds, to_first, to_second = places[-4:]
    steps = list(ordered([condition]))
    before_members({ALL: before, GROUP: one, MEMBER: body}, steps, [condition], bases)
    for node in steps:
        if node.level == MEMBER:
            body.operation(node, bases)
    lines = "\n".join
    return f"""{lines(sorted(before.declared | one.declared | body.declared))}
declare i64 @llvm.smin.i64(i64, i64)
declare i64 @llvm.cttz.i64(i64, i1)
define i64 @{name}(i64 %firsts, i64 %seconds, {", ".join(f"ptr {item}" for item in names)}) {{
entry:
{lines(before.lines)}
  %furthest = sub i64 %seconds, {WIDTH}
  br label %one
one:
  %i = phi i64 [0, %entry], [%next, %past]
  %count = phi i64 [0, %entry], [%counted, %past]
  %of = getelementptr i64, ptr {group}, i64 %i
  %own = load i64, ptr %of, align 8
  %from = getelementptr i64, ptr {bounds}, i64 %own
  %to = getelementptr i64, ptr %from, i64 1
  %begin = load i64, ptr %from, align 8
  %end = load i64, ptr %to, align 8
{lines(one.lines)}
  %none = icmp sge i64 %begin, %end
  br i1 %none, label %past, label %part
part:
  %first = phi i64 [%begin, %one], [%after, %through]
  %so_far = phi i64 [%count, %one], [%now, %through]
  %after = add i64 %first, 64
  %stop = call i64 @llvm.smin.i64(i64 %after, i64 %end)
  br label %some
some:
  %j = phi i64 [%first, %part], [%j_next, %some]
  %word = phi i64 [0, %part], [%joined, %some]
  %at = call i64 @llvm.smin.i64(i64 %j, i64 %furthest)
{lines(body.lines)}
  %bits = bitcast <{WIDTH} x i1> {body.value(condition)} to i{WIDTH}
  %wide = zext i{WIDTH} %bits to i64
  %early = sub i64 %j, %at
  %own_bits = lshr i64 %wide, %early
  %before = sub i64 %j, %first
  %shifted = shl i64 %own_bits, %before
  %joined = or i64 %word, %shifted
  %j_next = add i64 %j, {WIDTH}
  %further = icmp slt i64 %j_next, %stop
  br i1 %further, label %some, label %whole
whole:
  %length = sub i64 %stop, %first
  %behind = sub i64 64, %length
  %inside = lshr i64 -1, %behind
  %pairs = and i64 %joined, %inside
  %any = icmp ne i64 %pairs, 0
  br i1 %any, label %found, label %through
found:
  %left = phi i64 [%pairs, %whole], [%others, %found]
  %place = phi i64 [%so_far, %whole], [%more, %found]
  %bit = call i64 @llvm.cttz.i64(i64 %left, i1 true)
  %second = add i64 %first, %bit
  %into_first = getelementptr i64, ptr {to_first}, i64 %place
  %into_second = getelementptr i64, ptr {to_second}, i64 %place
  store i64 %i, ptr %into_first, align 8
  store i64 %second, ptr %into_second, align 8
  %more = add i64 %place, 1
  %lower = sub i64 %left, 1
  %others = and i64 %left, %lower
  %again = icmp ne i64 %others, 0
  br i1 %again, label %found, label %through
through:
  %now = phi i64 [%so_far, %whole], [%more, %found]
  %remaining = icmp slt i64 %after, %end
  br i1 %remaining, label %part, label %past
past:
  %counted = phi i64 [%count, %one], [%now, %through]
  %next = add i64 %i, 1
  %remain = icmp slt i64 %next, %firsts
  br i1 %remain, label %one, label %done
done:
  ret i64 %counted
}}
"""
