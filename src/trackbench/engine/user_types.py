"""Motion models and sensors from outside trackbench, and the comparison of their kernels with NumPy."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from trackbench.base.types import Array
from trackbench.models.motion import MotionModel

#: Largest difference between a kernel and NumPy, relative to the largest number of the same component.
AGREEMENT = 1e-9
#: Difference allowed in addition, relative to the largest number of all components.
ROUNDING = 1e-14


def is_user_type(kind: type) -> bool:
    """Return whether a class is defined outside trackbench."""
    return not kind.__module__.startswith("trackbench.")


def says_pure(kind: type) -> bool:
    """Return whether a class declares ``pure = True`` itself, not by one of its base classes."""
    return bool(vars(kind).get("pure", False))


def user_types(motions: Iterable[MotionModel]) -> tuple[type, ...]:
    """Return the classes from outside trackbench among motion models and the motion models that these contain."""
    kinds: dict[type, None] = {}
    for motion in motions:
        kinds |= dict.fromkeys([type(motion)] if is_user_type(type(motion)) else [])
        kinds |= dict.fromkeys(user_types(part for part in vars(motion).values() if isinstance(part, MotionModel)))
    return tuple(kinds)


def agree(outputs: Mapping[str, Array], expected: Mapping[str, Array]) -> bool:
    """Return whether the outputs of a kernel equal NumPy's to rounding.

    Args:
        outputs: outputs of the kernel.
        expected: outputs of NumPy for the same inputs.
    """
    pairs = {
        name: (np.asarray(outputs[name], dtype=float), np.asarray(value, dtype=float))
        for name, value in expected.items()
        if value is not None
    }
    return all(_close(*pair) for pair in pairs.values())


def _close(result: Array, expected: Array) -> bool:
    size = np.where(np.isfinite(expected), np.abs(expected), 0.0)
    # A component that is zero for all members may contain rounding of the largest component.
    allowed = AGREEMENT * np.max(size, axis=-1, keepdims=True, initial=0.0) + ROUNDING * np.max(size, initial=0.0)
    return bool(np.isclose(result, expected, 0.0, allowed, equal_nan=True).all())
