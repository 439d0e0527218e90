"""The fused engine: equations compiled to machine code and run over a whole batch."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable, Hashable, Sequence
from functools import cached_property
from math import prod
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from trackbench.base.types import Array, Indices, Mask
from trackbench.base.user_code import place_of
from trackbench.engine import vector_code
from trackbench.engine.equations import Equations, Values, batch_of, by_numpy, by_numpy_alone
from trackbench.engine.graph import ALL, GROUP, MEMBER, Untraceable
from trackbench.engine.layout import Input, KernelLayout, source_key
from trackbench.engine.machine import FUNCTION, KernelCache, MachineCode, Processor
from trackbench.engine.trace import trace
from trackbench.engine.user_types import agree, says_pure

#: Largest number of plans in memory.
PLANS = 4096
#: Least number of members of a group that is computed by itself; its last vector computes some members twice.
LEAST_GROUP = 8 * vector_code.WIDTH


class Kernel(NamedTuple):
    """Machine code of equations for inputs with certain numbers of components and batch axes."""

    layout: KernelLayout
    code: MachineCode
    parts: list[tuple[str, tuple[int, ...], slice, bool]]
    """Name, component shape, rows in the result, and whether it is a mask, for each output."""
    rows: tuple[int, int]
    """Number of rows of numbers, and number of rows of masks, over all outputs."""


class CallPlan(NamedTuple):
    """How to call equations whose inputs have certain shapes and types: a kernel, or NumPy."""

    equations: Equations
    kernel: Kernel | None
    """Kernel of the equations; None if NumPy computes them."""
    grouped: bool
    """Whether each group of members is computed in a call of its own."""
    inputs: Sequence[tuple[str, Input, type, bool, bool]]
    """For each input that the kernel reads: its name, layout and type, whether a contiguous array needs no copy, and
    whether all members share it."""


class Kernels:
    """Engine that computes equations by machine code where they can be traced, and by NumPy elsewhere.

    NumPy recomputes a member for which the trace does not hold: a branch on data goes the other way, or a value is not
    finite. A kernel of a user's model is compared with NumPy while ``compares`` is set.
    """

    def __init__(self, processor: Processor | None = None, cache: KernelCache | None = None) -> None:
        self._stated_processor = processor
        self._cache = cache or KernelCache()
        self._kernels: dict[tuple[Any, ...], Kernel | None] = {}
        self._plans: dict[Hashable, CallPlan] = {}
        self.compares = True
        """Whether kernels of users' models are compared with NumPy, as is done in the first block of a run."""
        self.differing: set[Hashable] = set()
        """Keys of the equations whose kernels gave values other than NumPy's."""
        self.untraced: dict[Hashable, tuple[str, str]] = {}
        """Name of the equations that NumPy computes, and the reason, by their key."""
        self.members_by_numpy = 0
        """Number of members that NumPy recomputed, in all batches."""
        self.seconds = 0.0
        """Time spent on making or loading kernels, s."""

    def __call__(self, equations: Equations, values: Values) -> dict[str, Array]:
        """Compute the outputs of equations, each ``(components..., batch...)``, by name."""
        plan, batch = self.plan(equations, values)
        if plan.kernel is None or 0 in batch:
            return by_numpy(equations, values)
        outputs, held = _run(plan, plan.kernel, values, batch)
        if held is not None:
            self._compute_by_numpy(np.flatnonzero(~held), equations, batch, values, outputs)
        if equations.user_types and self.compares:
            expected = by_numpy(equations, values)
            if not agree(outputs, expected):
                self._leave_to_numpy(equations)
                return expected
        return outputs

    @cached_property
    def _processor(self) -> Processor:
        return self._stated_processor or Processor()

    def code(self, text: str, arrays: int) -> MachineCode:
        """Return the machine code of an LLVM text, whose function takes two numbers and ``arrays`` arrays."""
        code = self._load_or_make(text, lambda: self._processor.object_code(text))
        return self._processor.function(code, arrays)

    def plan(self, equations: Equations, values: Values) -> tuple[CallPlan, tuple[int, ...]]:
        """Return the plan for inputs of these shapes, with any number of members, and the batch axes' lengths."""
        signature: list[Any] = []
        batch: tuple[int, ...] = ()
        is_regular = True
        for name, rank in equations.ranks.items():
            value = values[name]
            if not isinstance(value, np.ndarray):
                kind = type(value)
                # numpy.shape would first make an array of the number.
                signature.append((kind, () if kind is float else np.shape(value)))
                is_regular &= len(signature[-1][1]) == rank
                continue
            shape = value.shape
            axes = shape[rank:]
            batch = batch or axes
            if axes and axes == batch:
                signature.append((value.dtype, shape[:rank], True))
            else:
                signature.append((value.dtype, shape))
                is_regular &= not axes
        key = equations.key or id(equations), equations.name, len(batch) if is_regular else batch, *signature
        if not is_regular:
            batch = batch_of(equations.ranks, values)
        return self._plans.get(key) or self._make_plan(key, equations, values, batch), batch

    def _make_plan(self, key: Hashable, equations: Equations, values: Values, batch: tuple[int, ...]) -> CallPlan:
        inputs = [_input(name, values[name], rank, batch) for name, rank in equations.ranks.items()]
        kernel = self.kernel(equations, inputs)
        reads = []
        for item in kernel.layout.inputs if kernel else ():
            value, kind = values[item.name], bool if item.boolean else float
            needs_no_copy = isinstance(value, np.ndarray) and value.dtype == kind and value.shape == item.full(batch)
            reads.append((item.name, item, kind, bool(needs_no_copy), item.level == ALL))
        if len(self._plans) >= PLANS:
            self._plans.clear()
        # The plan holds the equations, so that no others get their id.
        grouped = any(item.level == GROUP for _, item, *_ in reads)
        plan = self._plans[key] = CallPlan(equations, kernel, grouped, reads)
        return plan

    def kernel(self, equations: Equations, inputs: Sequence[Input]) -> Kernel | None:
        """Return the machine code of equations for inputs of these shapes and types; None if NumPy computes them."""
        made_for = equations.name, equations.key, tuple(inputs)
        if made_for not in self._kernels:
            begin = time.perf_counter()
            self._kernels[made_for] = self._make_kernel(equations, inputs)
            self.seconds += time.perf_counter() - begin
        return self._kernels[made_for]

    def _make_kernel(self, equations: Equations, inputs: Sequence[Input]) -> Kernel | None:
        reason = _why_not_traced(equations, equations.key in self.differing)
        if reason is not None:
            self.untraced[equations.key] = equations.name, reason
            return None
        try:
            layout, code = self._load_or_make(
                source_key(equations, inputs), lambda: self._layout_and_code(equations, inputs)
            )
        except Untraceable as refusal:
            where = place_of(refusal)
            self.untraced[equations.key] = equations.name, f"{refusal} ({where})" if where else str(refusal)
            return None
        parts = [
            (output.name, output.shape, slice(first, first + output.size), output.boolean)
            for output, first in zip(layout.outputs, layout.first_rows, strict=True)
        ]
        function = self._processor.function(code, len(layout.inputs) + 2)
        numbers = sum(output.size for output in layout.outputs if not output.boolean)
        masks = 1 + sum(output.size for output in layout.outputs if output.boolean)
        return Kernel(layout, function, parts, (numbers, masks))

    def _layout_and_code(self, equations: Equations, inputs: Sequence[Input]) -> tuple[KernelLayout, bytes]:
        traced = trace(equations, inputs)
        text = vector_code.kernel_text(FUNCTION, traced.layout, traced.outputs, traced.guard)
        return traced.layout, self._processor.object_code(text)

    def _load_or_make(self, source: str | None, make: Callable[[], Any]) -> Any:
        """Load the value of a source from the cache, else make and store it; if ``source`` is None, only make it."""
        if source is None:
            return make()
        key = hashlib.sha256(f"{self._processor.key}\n{source}".encode()).hexdigest()
        value = self._cache.find(key)
        if value is None:
            value = make()
            self._cache.put(key, value)
        return value

    def _compute_by_numpy(
        self, places: Indices, equations: Equations, batch: tuple[int, ...], values: Values, outputs: dict[str, Array]
    ) -> None:
        self.members_by_numpy += len(places)
        for name, value in by_numpy_alone(equations, batch, values, outputs, places).items():
            components = value.shape[:-1]
            if name not in outputs:
                # The values of other members mean nothing.
                outputs[name] = np.zeros(components + batch, dtype=value.dtype)
            outputs[name].reshape(*components, prod(batch))[..., places] = value

    def _leave_to_numpy(self, equations: Equations) -> None:
        self.differing.add(equations.key)
        self.untraced[equations.key] = equations.name, _difference(equations)
        self._kernels = {key: None if key[1] == equations.key else kernel for key, kernel in self._kernels.items()}
        self._plans.clear()


def _why_not_traced(equations: Equations, differs: bool) -> str | None:
    """Return why the users' classes in the equations are not allowed to be compiled; None if they are."""
    without_pure = [kind.__name__ for kind in equations.user_types if not says_pure(kind)]
    if without_pure:
        return f"{' and '.join(without_pure)} {'does' if len(without_pure) == 1 else 'do'} not say pure = True"
    return _difference(equations) if differs else None


def _difference(equations: Equations) -> str:
    names = " and ".join(kind.__name__ for kind in equations.user_types)
    return f"{names} says pure = True, but machine code and NumPy give different numbers"


def _input(name: str, value: Any, rank: int, batch: tuple[int, ...]) -> Input:
    array = np.asarray(value, dtype=float if type(value) is int else None)
    axes = array.ndim - rank
    shared = axes > 0 and array.shape[-1] == 1 and batch[-1] >= LEAST_GROUP
    return Input(name, array.shape[:rank], axes, array.dtype.char, shared)


def _run(
    plan: CallPlan, kernel: Kernel, values: Values, batch: tuple[int, ...]
) -> tuple[dict[str, Array], Mask | None]:
    """Call a kernel; return its outputs by name, and a mask of the members for which they are right (None: all)."""
    members = prod(batch)
    padded, groups = max(members, vector_code.WIDTH), prod(batch[:-1]) if plan.grouped else 1
    arrays = []
    for name, item, kind, needs_no_copy, is_shared in plan.inputs:
        value = values[name]
        if is_shared:
            value = np.ascontiguousarray(value, dtype=kind)
        elif not needs_no_copy or padded != members or not value.flags.c_contiguous:
            value = _rows(item, value, batch, padded)
        arrays.append(value)
    numbers, masks = np.empty((kernel.rows[0], padded)), np.empty((kernel.rows[1], padded), dtype=bool)
    fine = kernel.code.call(groups, padded // groups, *map(id, arrays), id(numbers), id(masks))
    if padded != members:
        numbers, masks = numbers[:, :members].copy(), masks[:, :members].copy()
    outputs: dict[str, Array] = {}
    for name, shape, rows, boolean in kernel.parts:
        outputs[name] = (masks if boolean else numbers)[rows].reshape(shape + batch)
    for name, other in kernel.layout.same.items():
        # NumPy may give them different values where the guard fails.
        outputs[name] = outputs[other] if fine else outputs[other].copy()
    return outputs, None if fine else masks[0].reshape(-1)


def _rows(item: Input, value: Any, batch: tuple[int, ...], padded: int) -> npt.NDArray[Any]:
    """Return an input as a kernel reads it: contiguous rows of components, padded by repeating the last member."""
    kind, full = bool if item.boolean else float, item.full(batch)
    array = value if value.shape == full else np.broadcast_to(value, full)
    array = np.ascontiguousarray(array, dtype=kind)
    members = prod(batch)
    if item.level == MEMBER and members < padded:
        whole = np.empty((array.size // members, padded), dtype=kind)
        whole[:, :members] = array.reshape(-1, members)
        whole[:, members:] = whole[:, members - 1 : members]
        return whole
    return array
