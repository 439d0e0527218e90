"""The fused engine: equations as machine code, run over a whole batch."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Hashable, Iterator, Mapping, Sequence
from math import prod
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from trackbench.base.types import Array, Indices, Mask
from trackbench.base.user_code import place_of
from trackbench.engine import vector_code
from trackbench.engine.equations import Equations, Values, by_numpy
from trackbench.engine.graph import ALL, GROUP, MEMBER, Untraceable
from trackbench.engine.layout import Input, KernelLayout, packed, source_key, unpacked
from trackbench.engine.machine import FUNCTION, KernelCache, MachineCode, Processor
from trackbench.engine.trace import trace
from trackbench.engine.user_equations import has_user_equations

#: Shapes of inputs that are remembered.
PLANS = 4096
#: From how many members on a group is computed by itself: its last vector computes some members twice.
LEAST_GROUP = 8 * vector_code.WIDTH
#: How far machine code of a user's function may be from NumPy, as a share of the largest component: any rounding.
AGREEMENT = 1e-6
OTHER_NUMBERS = "its machine code gives other numbers than NumPy"


class Kernel(NamedTuple):
    """Equations for inputs of certain shapes."""

    layout: KernelLayout
    code: MachineCode
    parts: list[tuple[str, tuple[int, ...], slice, bool]]
    """Of each output its name and components, which rows it has, and whether they are masks."""
    rows: tuple[int, int]
    """How many rows there are of numbers and of masks."""


class CallPlan(NamedTuple):
    """What is to be done with inputs of certain shapes."""

    equations: Equations
    kernel: Kernel | None
    """None: NumPy computes."""
    made_for: Hashable
    batch: tuple[int, ...]
    members: int
    groups: int
    """In how many parts, one after the other, the kernel computes them."""
    inputs: list[tuple[str, Input, bool]]
    """Of each that the kernel reads; whether it is read as it is, if it lies in one piece."""


class Kernels:
    """Computes equations by machine code where they can be traced, and by NumPy where they cannot.

    A member for which the trace does not hold (a branch on data goes the other way, a value is not finite) is computed
    again by NumPy.
    """

    def __init__(self, processor: Processor | None = None, kept: KernelCache | None = None) -> None:
        self._processor = processor or Processor()
        self._kept = kept or KernelCache()
        self._found: dict[Hashable, Kernel | None] = {}
        self._plans: dict[Hashable, CallPlan] = {}
        self._unproven: set[Hashable] = set()
        """For what the kernels of a user's functions were made that have not been compared with NumPy."""
        self.untraced: dict[Hashable, tuple[str, str]] = {}
        """By the key of equations that NumPy computes, their name and why."""
        self.members_by_numpy = 0
        """How many members of batches were computed again."""
        self.seconds = 0.0
        """Spent on making kernels, or on loading them."""

    def __call__(self, equations: Equations, values: Values) -> dict[str, Array]:
        """What the equations give; see :class:`trackbench.engine.equations.Compute`."""
        plan = self._plan(equations, values)
        if plan.kernel is None or plan.members == 0:
            return by_numpy(equations, values)
        outputs, held = _run(plan, plan.kernel, values)
        # The set is empty nearly always, and what a kernel was made for takes its time to hash.
        unproven = self._unproven and plan.made_for in self._unproven
        if unproven and not self._proves(equations, plan, values, outputs, held):
            return by_numpy(equations, values)
        if held is not None:
            self._again(equations, plan, values, outputs, ~held)
        return outputs

    def why_numpy(self, equations: Equations, values: Values) -> str | None:
        """Why NumPy computes the equations of such values; None where a kernel does."""
        return self.untraced[equations.key][1] if self._plan(equations, values).kernel is None else None

    def code(self, text: str, arrays: int) -> MachineCode:
        """The machine code of LLVM's text, of a function of two numbers and of so many arrays."""
        return self._processor.function(self._code(text), arrays)

    def _plan(self, equations: Equations, values: Values) -> CallPlan:
        looks = []
        for name in equations.ranks:
            value = values[name]
            if isinstance(value, np.ndarray):
                looks.append((value.dtype, value.shape))
            else:
                kind = type(value)
                # NumPy would make an array of the number to say so.
                looks.append((kind, () if kind is float else np.shape(value)))
        key = equations.key or id(equations), equations.name, *looks
        return self._plans.get(key) or self._planned(key, equations, values)

    def _planned(self, key: Hashable, equations: Equations, values: Values) -> CallPlan:
        batch = batch_of(equations.ranks, values)
        inputs = tuple(_input(name, values[name], rank, batch) for name, rank in equations.ranks.items())
        made_for = equations.name, equations.key, inputs
        if made_for not in self._found:
            begin = time.perf_counter()
            self._found[made_for] = self._made(equations, inputs)
            self.seconds += time.perf_counter() - begin
            if self._found[made_for] is not None and has_user_equations(equations.key):
                self._unproven.add(made_for)
        kernel = self._found[made_for]
        ways = []
        for item in kernel.layout.inputs if kernel else ():
            value, kind = values[item.name], bool if item.boolean else float
            as_it_is = isinstance(value, np.ndarray) and value.dtype == kind and value.shape == item.full(batch)
            ways.append((item.name, item, bool(as_it_is)))
        if len(self._plans) >= PLANS:
            self._plans.clear()
        # The equations are kept, so that no others have their id.
        grouped = any(item.level == GROUP for _, item, _ in ways)
        groups = prod(batch[:-1]) if grouped else 1
        plan = self._plans[key] = CallPlan(equations, kernel, made_for, batch, prod(batch), groups, ways)
        return plan

    def _made(self, equations: Equations, inputs: Sequence[Input]) -> Kernel | None:
        own = source_key(equations, inputs)
        data = own and self._kept.find(self._key(own))
        kept = unpacked(data) if data else None
        if kept is None:
            try:
                kept = self._traced(equations, inputs, own)
            except Untraceable as reason:
                where = place_of(reason) or (reason.__cause__ and place_of(reason.__cause__))
                self.untraced[equations.key] = equations.name, f"{reason} ({where})" if where else str(reason)
                return None
        layout, code = kept
        parts, filled = [], [0, 1]
        for output in layout.outputs:
            first = filled[output.boolean]
            filled[output.boolean] += output.size
            parts.append((output.name, output.shape, slice(first, first + output.size), output.boolean))
        function = self._processor.function(code, len(layout.inputs) + 2)
        return Kernel(layout, function, parts, (filled[0], filled[1]))

    def _traced(self, equations: Equations, inputs: Sequence[Input], own: str | None) -> tuple[KernelLayout, bytes]:
        """The code of equations, kept by their source ``own``; without it by what the trace says.

        Raises:
            Untraceable: there is none; says why.
        """
        traced = trace(equations, inputs)
        text = vector_code.function(FUNCTION, traced.layout, traced.outputs, traced.guard)
        if not own:
            return traced.layout, self._code(text)
        code = self._processor.object_code(text)
        self._kept.put(self._key(own), packed(traced.layout, code))
        return traced.layout, code

    def _code(self, text: str) -> bytes:
        """The object file of a text, kept by it."""
        key = self._key(text)
        code = self._kept.find(key)
        if code is None:
            code = self._processor.object_code(text)
            self._kept.put(key, code)
        return code

    def _key(self, what: str) -> str:
        return hashlib.sha256(f"{self._processor.key}\n{what}".encode()).hexdigest()

    def _proves(
        self, equations: Equations, plan: CallPlan, values: Values, outputs: Mapping[str, Array], held: Mask | None
    ) -> bool:
        """Whether NumPy gives the same of the first and the last member, which makes sure that a user's function is one
        of each member by itself, and does not go by the type of what it is given."""
        good = np.arange(plan.members) if held is None else np.flatnonzero(held)
        if not len(good):
            return True
        self._unproven.discard(plan.made_for)
        places = good[[0, -1]] if plan.batch else good
        for name, expected in _by_numpy_alone(equations, plan, values, outputs, places):
            result = outputs[name].reshape(*expected.shape[:-1], plan.members)[..., places]
            scale = np.max(np.abs(expected), initial=0.0, where=np.isfinite(expected))
            if not np.allclose(result, expected, AGREEMENT, AGREEMENT * scale, equal_nan=True):
                self._found[plan.made_for] = None
                self.untraced[equations.key] = equations.name, OTHER_NUMBERS
                self._plans.clear()
                return False
        return True

    def _again(
        self, equations: Equations, plan: CallPlan, values: Values, outputs: dict[str, Array], which: Mask
    ) -> None:
        """Compute some members by NumPy."""
        places = np.flatnonzero(which)
        self.members_by_numpy += len(places)
        if plan.batch and len(places) == 1:
            # Of one member alone NumPy sums in another order, so that its bits would depend on the others.
            places = places.repeat(2)
        for name, value in _by_numpy_alone(equations, plan, values, outputs, places):
            components = value.shape[:-1]
            if name not in outputs:
                # Of the others there is nothing to be said.
                outputs[name] = np.zeros(components + plan.batch, dtype=value.dtype)
            outputs[name].reshape(*components, plan.members)[..., places] = value


def _by_numpy_alone(
    equations: Equations, plan: CallPlan, values: Values, outputs: Mapping[str, Array], places: Indices
) -> Iterator[tuple[str, Array]]:
    """What NumPy gives of some members: of each output its name, and ``(components..., places)``."""
    batch, count = plan.batch, len(places)
    chosen = {name: _members(values[name], rank, batch, places) for name, rank in equations.ranks.items()}
    for name, result in by_numpy(equations, chosen).items():
        if result is None:
            continue
        array = np.asarray(result)
        axes = (outputs[name].ndim if name in outputs else array.ndim) - len(batch)
        components, missing = array.shape[:axes], axes + len(batch) - array.ndim
        full = array.reshape(components + (1,) * missing + array.shape[axes:])
        full = np.broadcast_to(full, components + _one_axis(len(batch), count))
        yield name, full.reshape(*components, count)


def batch_of(ranks: Mapping[str, int], values: Values) -> tuple[int, ...]:
    """The batch axes of inputs together."""
    shapes = {np.shape(values[name])[rank:] for name, rank in ranks.items()}
    if len(shapes) == 1:
        return shapes.pop()
    shapes.discard(())
    return shapes.pop() if len(shapes) == 1 else np.broadcast_shapes(*shapes)


def _input(name: str, value: Any, rank: int, batch: tuple[int, ...]) -> Input:
    array = np.asarray(value, dtype=float if type(value) is int else None)
    axes = array.ndim - rank
    shared = axes > 0 and array.shape[-1] == 1 and batch[-1] >= LEAST_GROUP
    return Input(name, array.shape[:rank], axes, array.dtype.char, shared)


def _run(plan: CallPlan, kernel: Kernel, values: Values) -> tuple[dict[str, Array], Mask | None]:
    """The outputs, and of which members they are right; None: of all."""
    members, batch = plan.members, plan.batch
    padded = max(members, vector_code.WIDTH)
    arrays = []
    for name, item, as_it_is in plan.inputs:
        value = values[name]
        if not as_it_is or padded != members or not value.flags.c_contiguous:
            value = _rows(item, value, batch, padded)
        arrays.append(value)
    numbers, masks = np.empty((kernel.rows[0], padded)), np.empty((kernel.rows[1], padded), dtype=bool)
    fine = kernel.code.call(plan.groups, padded // plan.groups, *map(id, arrays), id(numbers), id(masks))
    if padded != members:
        numbers, masks = numbers[:, :members].copy(), masks[:, :members].copy()
    outputs: dict[str, Array] = {}
    for name, shape, rows, boolean in kernel.parts:
        outputs[name] = (masks if boolean else numbers)[rows].reshape(shape + batch)
    for name, other in kernel.layout.same.items():
        # Of members of which the trace is not right they may differ.
        outputs[name] = outputs[other] if fine else outputs[other].copy()
    return outputs, None if fine else masks[0].reshape(-1)


def _rows(item: Input, value: Any, batch: tuple[int, ...], padded: int) -> npt.NDArray[Any]:
    """An input as the kernel reads it: rows of components, each of all members or groups, one after the other."""
    kind = bool if item.boolean else float
    if item.level == ALL:
        return np.ascontiguousarray(value, dtype=kind)
    full = item.full(batch)
    array = value if value.shape == full else np.broadcast_to(value, full)
    array = np.ascontiguousarray(array, dtype=kind)
    members = prod(batch)
    if item.level == MEMBER and members < padded:
        whole = np.empty((array.size // members, padded), dtype=kind)
        whole[:, :members] = array.reshape(-1, members)
        whole[:, members:] = whole[:, members - 1 : members]
        return whole
    return array


def _members(value: Any, rank: int, batch: tuple[int, ...], places: Indices) -> Any:
    """Some members of an input, along one batch axis."""
    array = np.asarray(value)
    if array.ndim == rank:
        return value
    components = array.shape[:rank]
    chosen = np.broadcast_to(array, components + batch).reshape(*components, prod(batch))[..., places]
    return chosen.reshape(components + _one_axis(array.ndim - rank, len(places)))


def _one_axis(axes: int, count: int) -> tuple[int, ...]:
    """The lengths of batch axes of which the last has all members."""
    return (1,) * (axes - 1) + (count,) * (axes > 0)
