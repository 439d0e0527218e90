"""What a class with ``predict`` and ``update`` takes, as far as its signatures tell."""

from __future__ import annotations

import inspect
from typing import Any, NamedTuple

from trackbench.errors import InputError
from trackbench.plugins.imports import attribute, classes, explained, searched

#: Names that a parameter for the time step, or for the noise covariance, goes by.
TIME_STEP = ("dt", "delta_t", "delta", "elapsed", "time_step", "step", "t")
NOISE = ("R", "r", "noise", "noise_covariance", "covariance", "cov")
#: Values of a constructor's arguments that the generated tracker needs: a state px, py, vx, vy, measured by position.
USUAL = {"dim_x": "4", "dim_z": "2", "n": "4", "m": "2"}


class Wrapped(NamedTuple):
    """How to call a class."""

    module: str
    name: str
    arguments: dict[str, str]
    """What its constructor needs, by name, as code; "None" where the author has to decide."""
    predict: str
    """The arguments of ``predict``, as code."""
    update: str
    """The arguments of ``update``, as code."""
    decisions: tuple[str, ...]
    """What the signatures leave open."""


def wrapped(reference: str) -> Wrapped:
    """Look a class up and at its methods, without calling any.

    Raises:
        InputError: it cannot be imported, or has no ``predict`` and ``update``.
    """
    if ":" not in reference:
        raise InputError(f'{reference!r} is no name in a module: write --around "module:Class"')
    with searched(None), explained(reference, None):
        found = attribute(reference, classes)
    methods = {name: getattr(found, name, None) for name in ("predict", "update")}
    missing = [name for name, method in methods.items() if not callable(method)]
    if not isinstance(found, type) or missing:
        lacking = f"it has no {' and no '.join(missing)}" if isinstance(found, type) else "it is not a class"
        raise InputError(f"{reference!r} cannot be wrapped: {lacking}")
    arguments = {name: USUAL.get(name, "None") for name in _required(found)}
    decisions = [f"what {name} is" for name, value in arguments.items() if value == "None"]
    predict = _call(methods["predict"], dict.fromkeys(TIME_STEP, "dt"), ["dt"], decisions)
    update = _call(methods["update"], dict.fromkeys(NOISE, "R"), ["z", "R"], decisions)
    module, _, name = reference.partition(":")
    return Wrapped(module, name, arguments, predict, update, tuple(decisions))


def _call(method: Any, known: dict[str, str], usual: list[str], decisions: list[str]) -> str:
    """The arguments of a call: those that are required, and optional ones of a known name."""
    given: list[str] = []
    for parameter in _parameters(method):
        required = parameter.default is parameter.empty
        value = known.get(parameter.name)
        if required and value is None:
            position = len(given)
            value = usual[position] if position < len(usual) else "None"
            if position > 0 or value == "None":
                decisions.append(f"whether {parameter.name} of {method.__name__} is {value}")
        if value is not None and (required or parameter.name in known):
            plain = required and parameter.kind is not parameter.KEYWORD_ONLY
            given.append(value if plain else f"{parameter.name}={value}")
    if "dt" in usual and not given:
        decisions.append("how predict() learns dt, which is not the same at every scan")
    return ", ".join(given)


def _required(found: type) -> list[str]:
    return [item.name for item in _parameters(found.__init__) if item.default is item.empty]  # type: ignore[misc]


def _parameters(method: Any) -> list[inspect.Parameter]:
    try:
        parameters = list(inspect.signature(method).parameters.values())[1:]
    except (TypeError, ValueError):
        return []
    return [item for item in parameters if item.kind not in (item.VAR_POSITIONAL, item.VAR_KEYWORD)]
