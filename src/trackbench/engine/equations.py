"""Equations that an engine computes, and what computed them."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Mapping
from math import prod
from typing import Any, Literal, NamedTuple, Protocol

import numpy as np

from trackbench.base.types import Array, Indices

ComputedBy = Literal["numpy", "fused", "fused and numpy"]


class EngineUsed(NamedTuple):
    """What computed the steps of a built-in tracker."""

    engine: ComputedBy
    why_numpy: str = ""
    """Why the fused engine left some or all of them to NumPy; else empty."""
    again: int = 0
    """Number of members of batches that NumPy computed again because their guard did not hold."""
    of_pure: bool = False
    """Whether ``why_numpy`` concerns a user's class that says ``pure = True``."""
    differs: bool = False
    """Whether a kernel of a user's class gave other numbers than NumPy, so that NumPy computes all runs again."""


def joined_engines(parts: Iterable[EngineUsed]) -> EngineUsed | None:
    """What computed all parts together; None where there are none."""
    used = list(parts)
    if not used:
        return None
    engines = {part.engine for part in used}
    reasons = dict.fromkeys(part.why_numpy for part in used if part.why_numpy)
    engine = engines.pop() if len(engines) == 1 else "fused and numpy"
    of_pure, differs = (any(getattr(part, name) for part in used) for name in ("of_pure", "differs"))
    return EngineUsed(engine, "; ".join(reasons), sum(part.again for part in used), of_pure, differs)


#: Arrays by name; inside a function each is ``(components..., batch...)``, or without batch axes the same for all.
Values = Mapping[str, Any]


class Equations(NamedTuple):
    """A function of components, written with NumPy, that gives the same for a member whatever else is in the batch."""

    name: str
    """What it computes, as a user is told."""
    function: Callable[[Values], Values]
    ranks: Mapping[str, int]
    """Number of component axes of each input; what follows them are batch axes."""
    symmetric: frozenset[str] = frozenset()
    """Inputs that are symmetric matrices."""
    counted: Mapping[str, str] = {}
    """Inputs and outputs that mean nothing, and need not be finite, where a mask among the inputs does not hold."""
    key: Hashable = None
    """Where ``function`` was made for something: for what, so that others of the same name are told apart."""
    modes: Mapping[str, str] = {}
    """Outputs that a sequence of calls does not write but adds up: how, as ``trackbench.engine.layout`` has it."""
    user_types: tuple[type, ...] = ()
    """Classes of motion models and sensors that the function calls and that are not the package's own."""


class Compute(Protocol):
    """How equations are computed."""

    def __call__(self, equations: Equations, values: Values) -> dict[str, Array]:
        """What the equations give, each ``(components..., batch...)`` with all batch axes.

        Args:
            equations: what to compute.
            values: the inputs, with the batch axes of ``equations.ranks`` or none; a mask is an array of bool.
        """
        ...


def by_numpy(equations: Equations, values: Values) -> dict[str, Array]:
    """The reference: NumPy computes the function as it stands."""
    return dict(equations.function(values))


def by_numpy_alone(
    equations: Equations, batch: tuple[int, ...], values: Values, outputs: Mapping[str, Array], places: Indices
) -> dict[str, Array]:
    """What NumPy gives of some members of a batch: of each output ``(components..., places)``.

    Args:
        equations: what to compute.
        batch: the lengths of the batch axes.
        values: the inputs of all members.
        outputs: of all members, as far as there are any.
        places: numbers of the members that are asked for, all at once.
    """
    wanted = len(places)
    if batch and wanted == 1:
        # Of one member alone NumPy sums in another order, so that its bits would depend on the others.
        places = places.repeat(2)
    count, outcome = len(places), {}
    chosen = {name: _members(values[name], rank, batch, places) for name, rank in equations.ranks.items()}
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
    """The batch axes of inputs together."""
    shapes = {np.shape(values[name])[rank:] for name, rank in ranks.items()}
    if len(shapes) == 1:
        return shapes.pop()
    shapes.discard(())
    return shapes.pop() if len(shapes) == 1 else np.broadcast_shapes(*shapes)


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
