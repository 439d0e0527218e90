"""Functions by kernels and by NumPy, compared."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from trackbench.engine.equations import Equations, Values
from trackbench.engine.kernels import Kernels


def equations_of(function: Callable[[Values], Any], ranks: dict[str, int], **more: Any) -> Equations:
    """Equations of their own, whatever else has the same name."""
    return Equations(getattr(function, "__name__", "function"), function, ranks, key=object(), **more)


def compared(kernels: Kernels, equations: Equations, values: Values) -> int | str:
    """Make sure that a kernel gives what NumPy gives.

    Returns:
        How many members were computed by NumPy; or why all were.
    """
    before, given = kernels.members_by_numpy, {name: np.copy(value) for name, value in values.items()}
    with np.errstate(all="ignore"):
        expected = equations.function(values)
        found = kernels(equations, values)
    assert found.keys() == expected.keys()
    for name, wanted in expected.items():
        if wanted is None:
            assert found[name] is None
            continue
        np.testing.assert_allclose(found[name], np.asarray(wanted), rtol=1e-12, atol=1e-12, err_msg=name)
    for name, value in values.items():
        np.testing.assert_array_equal(value, given[name], err_msg=name)
    if equations.key in kernels.untraced:
        return kernels.untraced[equations.key][1]
    return kernels.members_by_numpy - before
