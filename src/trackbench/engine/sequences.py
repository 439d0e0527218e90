"""Sequences of kernel calls, made for one block of members after the other, so that data stay in the cache."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from trackbench.base.types import Array, Indices
from trackbench.engine.equations import Equations
from trackbench.engine.kernels import Kernel, Kernels
from trackbench.engine.layout import Input
from trackbench.engine.machine import MachineCode
from trackbench.engine.vector_code import HEAD, WIDTH

#: Number of members that go through all calls together: their data fit the second-level cache.
BLOCK = 256
Addresses = npt.NDArray[np.int64]


class ArrayPlace(NamedTuple):
    """Place in memory of an input or an output, at each call of a sequence."""

    address: Addresses
    """Address of the data at each call, ``(calls,)`` or ``(groups, calls)``."""
    stride: int
    """Distance in memory of consecutive components, as a count of numbers."""
    group: int = 0
    """Distance in memory of consecutive groups of members, in bytes."""
    form: Input = Input("", (), 1, "d")
    """Shape and type of the array as a kernel reads it; the name is empty."""


def place(array: npt.NDArray[Any], axes: int, steps: Indices) -> ArrayPlace:
    """Return the place in memory of an array at each call of a sequence.

    Args:
        array: array with ``axes`` component axes, then steps, then groups (or 1), then members (or 1). All members of a
            group share an array without a member axis; all members share one without both.
        axes: number of component axes, whose entries are equally far apart.
        steps: index ``(calls,)`` on the step axis at each call.
    """
    step, *groups = array.strides[axes:]
    stride = array.strides[axes - 1] if axes else 0
    address = array.ctypes.data + steps.astype(np.int64) * step
    group = groups[0] if groups and array.shape[axes + 1] > 1 else 0
    shared = len(groups) == 1 or array.shape[-1] == 1
    form = Input("", array.shape[:axes], min(len(groups), 1), array.dtype.char, bool(groups) and shared)
    return ArrayPlace(address, stride // array.itemsize, group, form)


def place_of_each(arrays: Sequence[npt.NDArray[Any]], axes: int, size: int) -> ArrayPlace:
    """Return the place in memory of like arrays, one per call: components, then members in groups of ``size``."""
    first = arrays[0]
    addresses = np.array([array.__array_interface__["data"][0] for array in arrays], dtype=np.int64)
    stride = first.strides[axes - 1] // first.itemsize if axes else 0
    return ArrayPlace(addresses, stride, size * first.itemsize, Input("", first.shape[:axes], 1, first.dtype.char))


class CallSequence:
    """Calls of kernels for groups of members, where all groups have the same calls.

    Args:
        kernels: kernels of this process.
        groups: number of groups.
        size: number of members of each group, at least ``WIDTH``.
        length: number of calls.
    """

    def __init__(self, kernels: Kernels, groups: int, size: int, length: int) -> None:
        self._kernels, self._groups, self._size, self._length = kernels, groups, size, length
        self._calls: list[tuple[Indices, int, list[ArrayPlace | None]]] = []
        self._rows = 1
        """Number of rows of scratch memory, to which kernels write the outputs that are not wanted."""

    def compute(
        self, equations: Equations, at: Indices, inputs: Mapping[str, ArrayPlace], outputs: Mapping[str, ArrayPlace]
    ) -> bool:
        """Add calls of the equations' kernel at the positions ``at`` of the sequence; return False without a kernel."""
        kernel = self._kernels.kernel(equations, [inputs[name].form._replace(name=name) for name in equations.ranks])
        if kernel is not None:
            self.call(kernel, at, inputs, outputs)
        return kernel is not None

    def call(
        self, kernel: Kernel, at: Indices, inputs: Mapping[str, ArrayPlace], outputs: Mapping[str, ArrayPlace]
    ) -> None:
        """Add calls of a kernel to the sequence.

        Args:
            kernel: kernel to call.
            at: ``(calls,)`` positions of the calls in the sequence.
            inputs: place in memory of each input of the kernel, by name.
            outputs: place in memory of each wanted output, by its name in the layout.
        """
        unwanted = (item.size for item in kernel.layout.outputs if item.name not in outputs)
        self._rows = max([self._rows, *unwanted])
        read = [inputs[item.name] for item in kernel.layout.inputs]
        written = [outputs.get(item.name) for item in kernel.layout.outputs]
        self._calls.append((at, kernel.code.part, [*read, *written, None]))

    def run(self) -> bool:
        """Make all calls; return whether the guards (run-time checks) held for all members. If not, discard outputs."""
        words = 1 + 2 * max(len(places) for _, _, places in self._calls)
        scratch = np.empty((self._rows, 1, 1, self._size))
        nowhere = place(scratch, 1, np.arange(1))
        table = np.zeros((self._groups, self._length, words), dtype=np.int64)
        groups = np.arange(self._groups)[:, None]
        for at, part, places in self._calls:
            table[:, at, 0] = part
            for number, item in enumerate(places):
                address, stride, group, _ = item or nowhere
                table[:, at, 1 + 2 * number] = address + groups * group
                table[:, at, 2 + 2 * number] = stride
        numbers = np.array([self._length, words, BLOCK], dtype=np.int64)
        return bool(_code(self._kernels).call(self._groups, self._size, id(table), id(numbers)))


@cache
def _code(kernels: Kernels) -> MachineCode:
    return kernels.code(TEXT, 2)


def total_of_vectors(sums: Array) -> Array:
    """Add up the last axis of ``sums`` ``(..., WIDTH)``, always in the same order; return ``(...)``."""
    total: Array = sums[..., 0].copy()
    for i in range(1, WIDTH):
        total += sums[..., i]
    return total


def _data(name: str, array: str) -> str:
    return f"""  %{name}.at = getelementptr i8, ptr %{array}, i64 {HEAD}
  %{name} = load ptr, ptr %{name}.at, align 8"""


def _number(name: str, place: int) -> str:
    return f"""  %{name}.at = getelementptr i64, ptr %numbers, i64 {place}
  %{name} = load i64, ptr %{name}.at, align 8"""


#: Text of the function that makes all calls. Arguments are the number of groups, the number of members of each, a table
#: with kernel and list of places of each call, and three numbers: calls, words of a call in the table, and members of a
#: block. The function returns 1 if the guards of all kernels held.
TEXT = f"""
define i64 @kernel(i64 %groups, i64 %size, ptr %a0, ptr %a1) {{
entry:
{_data("table", "a0")}
{_data("numbers", "a1")}
{_number("length", 0)}
{_number("words", 1)}
{_number("least", 2)}
  %all = mul i64 %length, %words
  br label %group
group:
  %g = phi i64 [0, %entry], [%next.group, %grouped]
  %skipped = mul i64 %g, %all
  %rows = getelementptr i64, ptr %table, i64 %skipped
  br label %block
block:
  %first = phi i64 [0, %group], [%end, %blocked]
  %wanted = add i64 %first, %least
  %rest = sub i64 %size, %wanted
  %short = icmp slt i64 %rest, {WIDTH}
  %end = select i1 %short, i64 %size, i64 %wanted
  br label %step
step:
  %s = phi i64 [0, %block], [%next.step, %held]
  %before = mul i64 %s, %words
  %row = getelementptr i64, ptr %rows, i64 %before
  %code = load ptr, ptr %row, align 8
  %list = getelementptr i64, ptr %row, i64 1
  %fine = call i64 %code(i64 %first, i64 %end, ptr %list)
  %holds = icmp ne i64 %fine, 0
  br i1 %holds, label %held, label %refused
held:
  %next.step = add i64 %s, 1
  %more.steps = icmp slt i64 %next.step, %length
  br i1 %more.steps, label %step, label %blocked
blocked:
  %more.blocks = icmp slt i64 %end, %size
  br i1 %more.blocks, label %block, label %grouped
grouped:
  %next.group = add i64 %g, 1
  %more.groups = icmp slt i64 %next.group, %groups
  br i1 %more.groups, label %group, label %done
refused:
  ret i64 0
done:
  ret i64 1
}}
"""
