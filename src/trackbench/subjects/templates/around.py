"""What a class with ``predict`` and ``update`` takes, as far as its signatures tell."""

from __future__ import annotations

import inspect
from typing import Any, NamedTuple

from trackbench.base.errors import InputError
from trackbench.base.plugins.imports import attribute, classes, explained, searched

#: Names that a parameter for the time step, or for the noise covariance, goes by.
TIME_STEP = ("dt", "delta_t", "delta", "elapsed", "time_step", "step", "t")
NOISE = ("R", "r", "noise", "noise_covariance", "covariance", "cov")
#: What a filter has to be told, as a decision says it.
LEARNT = {
    "dt": "dt, which is not the same at every scan",
    "R": "R, the covariance of z, which is not the same for every sensor",
}
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
    decisions: dict[str, list[str]]
    """What the signatures leave open at each call: ``start``, ``predict``, ``update``."""


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
    start = [f"what {name} is" for name, value in arguments.items() if value == "None"]
    predict, for_predict = _call(methods["predict"], dict.fromkeys(TIME_STEP, "dt"), ["dt"])
    update, for_update = _call(methods["update"], dict.fromkeys(NOISE, "R"), ["z", "R"])
    module, _, name = reference.partition(":")
    decisions = {"start": start, "predict": for_predict, "update": for_update}
    return Wrapped(module, name, arguments, predict, update, decisions)


def _call(method: Any, known: dict[str, str], usual: list[str]) -> tuple[str, list[str]]:
    """The arguments of a call, those that are required and optional ones of a known name; what they leave open."""
    given: list[str] = []
    decisions: list[str] = []
    for parameter in _parameters(method):
        required = parameter.default is parameter.empty
        value = known.get(parameter.name)
        if required and value is None:
            position = len(given)
            value = usual[position] if position < len(usual) else "None"
            if value != "z":
                decisions.append(f"whether {parameter.name} of {method.__name__} is {value}")
        if value is not None and (required or parameter.name in known):
            plain = required and parameter.kind is not parameter.KEYWORD_ONLY
            given.append(value if plain else f"{parameter.name}={value}")
    learnt = usual[-1]
    if not any(argument.rpartition("=")[2] == learnt for argument in given):
        decisions.append(f"how {method.__name__}() learns {LEARNT[learnt]}")
    return ", ".join(given), decisions


def _required(found: type) -> list[str]:
    return [item.name for item in _parameters(found.__init__) if item.default is item.empty]  # type: ignore[misc]


def _parameters(method: Any) -> list[inspect.Parameter]:
    try:
        parameters = list(inspect.signature(method).parameters.values())[1:]
    except (TypeError, ValueError):
        return []
    return [item for item in parameters if item.kind not in (item.VAR_POSITIONAL, item.VAR_KEYWORD)]
