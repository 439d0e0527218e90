"""What an engine computes: a function of components, for every member of a batch."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping
from typing import Any, NamedTuple, Protocol

from trackbench.base.types import Array

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
