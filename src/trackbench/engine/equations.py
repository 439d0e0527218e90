"""Equations that an engine computes, and the record of the engines that computed them."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Mapping
from math import prod
from typing import Any, Literal, NamedTuple, Protocol

import numpy as np

from trackbench.base.types import Array, Indices

ComputedBy = Literal["numpy", "fused", "fused and numpy"]


class EngineUsed(NamedTuple):
    """Engine that computed the steps of a built-in tracker, and why not the fused one."""

    engine: ComputedBy
    why_numpy: str = ""
    """Reasons why the fused engine left steps to NumPy; empty if NumPy was not needed."""
    again: int = 0
    """Number of members of all batches that NumPy recomputed, because a condition of the compiled code did not hold."""
    of_pure: bool = False
    """Whether a class in ``why_numpy`` is a user's that declares ``pure = True``, and yet was left to NumPy."""
    differs: bool = False
    """Whether a kernel of a user's class gave values other than NumPy's, so that NumPy recomputes all runs."""


def joined_engines(parts: Iterable[EngineUsed]) -> EngineUsed | None:
    """Merge the engine records of all blocks of a run into one; return None if there are none."""
    used = list(parts)
    if not used:
        return None
    engines = {part.engine for part in used}
    reasons = dict.fromkeys(part.why_numpy for part in used if part.why_numpy)
    engine = engines.pop() if len(engines) == 1 else "fused and numpy"
    of_pure, differs = (any(getattr(part, name) for part in used) for name in ("of_pure", "differs"))
    return EngineUsed(engine, "; ".join(reasons), sum(part.again for part in used), of_pure, differs)


#: Arrays by name, in equations ``(components..., batch...)``; all members share an array without batch axes.
Values = Mapping[str, Any]


class Equations(NamedTuple):
    """Function on arrays, written with NumPy, whose result for a member of a batch depends on no other member."""

    name: str
    """Name of the result, such as "update", for messages."""
    function: Callable[[Values], Values]
    ranks: Mapping[str, int]
    """Number of component axes of each input, by the input's name; batch axes follow the component axes."""
    symmetric: frozenset[str] = frozenset()
    """Names of the inputs that are symmetric matrices."""
    counted: Mapping[str, str] = {}
    """Name of a mask among the inputs, by the name of an input or output that means nothing, and need not be finite,
    where that mask is False."""
    key: Hashable = None
    """Key that distinguishes equations with the same name; None if the name is unique."""
    modes: Mapping[str, str] = {}
    """Rule, by output name, for repeated calls: ``added`` adds each member's numbers to those of earlier calls, and
    ``summed`` also sums over members. An output without a rule is overwritten."""
    user_types: tuple[type, ...] = ()
    """Motion models and sensors, defined outside trackbench, that ``function`` calls."""


class Compute(Protocol):
    """Function with which an engine computes equations."""

    def __call__(self, equations: Equations, values: Values) -> dict[str, Array]:
        """Return the outputs of equations by name, each ``(components..., batch...)`` with all batch axes.

        Args:
            equations: function to evaluate, with the form of its inputs.
            values: the inputs, with the batch axes of ``equations.ranks`` or none; a mask is an array of bool.
        """
        ...


def by_numpy(equations: Equations, values: Values) -> dict[str, Array]:
    """Compute equations by NumPy, the reference for the fused engine."""
    return dict(equations.function(values))


def by_numpy_alone(
    equations: Equations, batch: tuple[int, ...], values: Values, outputs: Mapping[str, Array], places: Indices
) -> dict[str, Array]:
    """Compute some members of a batch by NumPy; return outputs ``(components..., members)`` by name.

    Args:
        equations: equations to compute.
        batch: lengths of the batch axes.
        values: inputs of all members.
        outputs: outputs of all members, from an earlier computation; may be empty.
        places: indices ``(members,)`` in the flattened batch of the members to compute.
    """
    wanted = len(places)
    if batch and wanted == 1:
        # For a single member NumPy sums in another order, so that its bits would depend on the other members.
        places = places.repeat(2)
    count, outcome = len(places), {}
    chosen = {name: _select_members(values[name], rank, batch, places) for name, rank in equations.ranks.items()}
    for name, result in by_numpy(equations, chosen).items():
        if result is None:
            continue
        array = np.asarray(result)
        axes = (outputs[name].ndim if name in outputs else array.ndim) - len(batch)
        components, missing = array.shape[:axes], axes + len(batch) - array.ndim
        full = array.reshape(components + (1,) * missing + array.shape[axes:])
        full = np.broadcast_to(full, components + _one_axis(len(batch), count))
        outcome[name] = full.reshape(*components, count)[..., :wanted]
    return outcome


def batch_of(ranks: Mapping[str, int], values: Values) -> tuple[int, ...]:
    """Return the lengths of the batch axes to which the inputs broadcast."""
    shapes = {np.shape(values[name])[rank:] for name, rank in ranks.items()}
    if len(shapes) == 1:
        return shapes.pop()
    shapes.discard(())
    return shapes.pop() if len(shapes) == 1 else np.broadcast_shapes(*shapes)


def _select_members(value: Any, rank: int, batch: tuple[int, ...], places: Indices) -> Any:
    array = np.asarray(value)
    if array.ndim == rank:
        return value
    components = array.shape[:rank]
    chosen = np.broadcast_to(array, components + batch).reshape(*components, prod(batch))[..., places]
    return chosen.reshape(components + _one_axis(array.ndim - rank, len(places)))


def _one_axis(axes: int, count: int) -> tuple[int, ...]:
    return (1,) * (axes - 1) + (count,) * (axes > 0)
