"""Motion models and sensors that are not the package's own, and whether a kernel of theirs agrees with NumPy."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from trackbench.base.types import Array
from trackbench.engine.equations import Equations, Values, by_numpy
from trackbench.models.motion import MotionModel

#: How far numbers of a kernel may be from NumPy's, as a share of the largest number of the same component.
AGREEMENT = 1e-9
#: A difference is rounding if inputs changed by the share ``ROUNDING`` change NumPy's numbers as much, or by more than
#: its part in ``AMPLIFIED``.
ROUNDING, AMPLIFIED = 1e-14, 100.0


def is_user_type(kind: type) -> bool:
    """Return whether a class is not one of the package's own."""
    return not kind.__module__.startswith("trackbench.")


def says_pure(kind: type) -> bool:
    """Return whether a class itself, and not one that it inherits from, says ``pure = True``."""
    return bool(vars(kind).get("pure", False))


def user_types(motions: Iterable[MotionModel]) -> tuple[type, ...]:
    """Return the users' classes of motion models, and of motion models within them."""
    kinds: dict[type, None] = {}
    for motion in motions:
        kinds |= dict.fromkeys([type(motion)] if is_user_type(type(motion)) else [])
        kinds |= dict.fromkeys(user_types(part for part in vars(motion).values() if isinstance(part, MotionModel)))
    return tuple(kinds)


def agree(equations: Equations, values: Values, outputs: Mapping[str, Array], expected: Mapping[str, Array]) -> bool:
    """Return whether the outputs of a kernel are those of NumPy, to rounding.

    Args:
        equations: what was computed.
        values: the inputs.
        outputs: of the kernel.
        expected: what NumPy gives of the same inputs.
    """
    pairs = {
        name: (np.asarray(outputs[name], dtype=float), np.asarray(value, dtype=float))
        for name, value in expected.items()
        if value is not None
    }
    if all(_close(*pair) for pair in pairs.values()):
        return True
    repeated = by_numpy(equations, values)
    if not all(np.array_equal(repeated[name], pair[1], equal_nan=True) for name, pair in pairs.items()):
        return False
    # An ill-conditioned step amplifies rounding: then NumPy's numbers change too.
    random, spread = np.random.default_rng(0), dict.fromkeys(pairs, np.zeros(()))
    for _ in range(3):
        disturbed = by_numpy(equations, {name: _disturbed(value, random) for name, value in values.items()})
        spread = {name: np.fmax(spread[name], np.abs(disturbed[name] - pairs[name][1])) for name in pairs}
    return all(_close(*pair, AMPLIFIED * spread[name]) for name, pair in pairs.items())


def _disturbed(value: Array | float, random: np.random.Generator) -> Array | float:
    if np.asarray(value).dtype != float:
        return value
    return value * (1.0 + ROUNDING * random.standard_normal(np.shape(value)))


def _close(result: Array, expected: Array, rounding: Array | float = 0.0) -> bool:
    size = np.where(np.isfinite(expected), np.abs(expected), 0.0)
    # A covariance that is zero for all members is only rounding beside the largest variance.
    allowed = AGREEMENT * np.max(size, axis=-1, keepdims=True, initial=0.0) + ROUNDING * np.max(size, initial=0.0)
    near = np.isclose(result, expected, 0.0, allowed, equal_nan=True)
    return bool(np.all(near | (np.abs(result - expected) <= rounding)))
