"""Quantiles and probabilities of Student's t, chi-square, beta and the normal distribution.

From ``scipy.special``, whose functions ``scipy.stats`` wraps.
"""

from __future__ import annotations

import math
from functools import lru_cache, partial

import numpy as np

from trackbench.base.scipy_functions import scipy_function
from trackbench.base.types import Array

_special = partial(scipy_function, "scipy.special", "_ufuncs")


def normal_quantile(probability: float) -> float:
    """Of the standard normal distribution."""
    return float(_special("ndtri")(probability))


def normal_below(x: Array) -> Array:
    """``(...)`` probabilities that a standard normal variable is at most ``x``."""
    return np.asarray(_special("ndtr")(x))


def normal_density(x: float) -> float:
    """Of the standard normal distribution."""
    return math.exp(-0.5 * x * x) / math.sqrt(2 * math.pi)


def normal_within(x: float) -> float:
    """The probability that a standard normal variable is between ``-x`` and ``x``."""
    return math.erf(x / math.sqrt(2))


@lru_cache(maxsize=1024)
def t_quantile(probability: float, freedom: float) -> float:
    """Of Student's t; ``freedom`` may be infinite."""
    return float(_special("stdtrit")(freedom, probability))


def t_probability(x: Array, freedom: float) -> Array:
    """``(...)`` probabilities that a variable with Student's t distribution is at most ``x``."""
    return np.asarray(_special("stdtr")(freedom, x))


def chi_square_quantile(probability: float, freedom: Array | float) -> Array:
    """``(...)`` of chi-square, for degrees of freedom ``(...)``, which need not be whole."""
    return np.asarray(2 * _special("gammaincinv")(np.asarray(freedom) / 2, probability))


def chi_square_beyond(x: float, freedom: float) -> float:
    """The probability that a chi-square variable is above ``x``."""
    return float(_special("gammaincc")(freedom / 2, x / 2))


def beta_quantile(probability: float, a: Array | float, b: Array | float) -> Array:
    """``(...)`` of the beta distribution."""
    return np.asarray(_special("betaincinv")(a, b, probability))
