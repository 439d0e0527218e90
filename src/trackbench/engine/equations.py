"""Equations that an engine computes, and what computed them."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Mapping
from typing import Any, Literal, NamedTuple, Protocol

from trackbench.base.types import Array

ComputedBy = Literal["numpy", "fused", "fused and numpy"]


class EngineUsed(NamedTuple):
    """What computed the steps of a built-in tracker."""

    engine: ComputedBy
    why_numpy: str = ""
    """Why the fused engine left some or all of them to NumPy; empty where it did not, or was not asked."""
    again: int = 0
    """How many members of batches NumPy computed again, of which the trace did not hold."""


def joined(parts: Iterable[EngineUsed]) -> EngineUsed | None:
    """What computed all parts together; None where there are none."""
    used = list(parts)
    if not used:
        return None
    engines = {part.engine for part in used}
    reasons = dict.fromkeys(part.why_numpy for part in used if part.why_numpy)
    engine = engines.pop() if len(engines) == 1 else "fused and numpy"
    return EngineUsed(engine, "; ".join(reasons), sum(part.again for part in used))


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
